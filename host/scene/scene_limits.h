#pragma once

#include <cstddef>
#include <cstdint>

namespace interflect {

/// What a reader accepts at most, so that a small hostile file cannot ask for all memory or never end. Far above what a
/// radiosity solution can use.
constexpr std::uint64_t max_scene_triangles = std::uint64_t{1} << 22;
constexpr int max_scene_depth = 100;            ///< elements, nodes or references inside each other
constexpr double max_scene_coordinate = 1e15;   ///< areas and volumes stay finite in single precision
constexpr std::size_t max_scene_warnings = 50;  ///< further ones are counted, not kept

constexpr std::size_t max_scene_surfaces = std::size_t{1} << 18;
constexpr std::size_t max_scene_name = 255;  ///< bytes of a name or a path of names; longer ones are cut

}  // namespace interflect
