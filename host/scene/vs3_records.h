#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "interflect/base/vec3.h"

namespace interflect::vs3 {

/// A surface record of a View3D file. Numbers of surfaces start at 1 and are those of the file.
struct Surface {
  enum class Kind {
    radiating,    ///< S
    mask,         ///< M: lies on its base, face to face with it
    null,         ///< N: takes its base away where it lies
    obstruction,  ///< O: in the way, but without view factors of its own
  };
  Kind kind = Kind::radiating;
  std::uint32_t line = 0;
  std::vector<Vec3> outline;  ///< 3 or 4 corners, counter-clockwise from the front
  Vec3 middle{}, normal{};    ///< unit length, or 0 for an outline without an area
  double radius = 0;          ///< largest distance of a corner from the middle
  std::uint32_t base = 0;     ///< the surface in whose plane and within which this one lies, or 0
  std::uint32_t combine = 0;  ///< the surface with which this one is reported as one, or 0
  double emittance = 0;       ///< 0 to 1
  std::string name;           ///< may be empty
};

struct File {
  std::vector<Surface> surfaces;
  std::vector<std::string> warnings;
};

/// Reads the records of a View3D text: title, control, geometry format 3 or 3a, vertices, surfaces. See read_vs3() for
/// what is accepted. Bases and combinations exist and are of the right kind and order; what of the geometry depends on
/// two surfaces is not checked. Throws an input Error naming file and line.
[[nodiscard]] File read_records(std::string_view text, const std::string& file);

}  // namespace interflect::vs3
