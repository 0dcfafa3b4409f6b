#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "interflect/scene/affine.h"
#include "interflect/scene/primitives.h"
#include "interflect/scene/scene.h"

namespace interflect::rrv {

/// A triangleset, cuboid, barrel, globe or teapot in its own coordinates.
struct Part {
  struct Face {
    std::array<std::uint32_t, 3> corner{};
    std::uint32_t material = 0;
    std::uint32_t line = 0;
  };
  std::string name;
  std::vector<Vec3> positions;
  std::vector<Face> faces;
};

/// What stands inside an objectdef, a transformation or the body.
struct Item {
  enum class Kind { part, reference, transform };
  Kind kind = Kind::transform;
  std::uint32_t line = 0;
  std::size_t index = 0;       ///< of the part or the definition
  Affine map;                  ///< of a transform
  std::vector<Item> children;  ///< of a transform
};

struct Definition {
  std::string name;
  std::uint32_t line = 0;
  std::vector<Item> items;
};

/// The file as read, before anything is instanced.
struct Document {
  std::vector<Part> parts;
  std::vector<Definition> definitions;
  std::vector<Item> body;
  std::vector<Material> materials;
  std::optional<Camera> camera;
  std::vector<std::string> warnings;
};

/// Reads the text; see read_rrv_xml() for what it understands. Throws an input Error with file and line.
[[nodiscard]] Document parse(const std::string& text, const std::string& file);

}  // namespace interflect::rrv
