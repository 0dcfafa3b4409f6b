#pragma once

#include <cmath>
#include <numbers>
#include <string>

#include "interflect/output/tone.h"
#include "output/rooms.h"

namespace interflect::test {

/// A floor, a wall with a lamp in it, and a round barrel: sharp edges, smooth ones and three groups.
inline Scene sample_scene(const std::string& lamp_name = "lamp") {
  SceneBuilder s;
  const auto wall = s.material({0.5, 0.5, 0.5}), lamp = s.material({0.5, 0.5, 0.5}, {40, 30, 20});
  s.quad("walls", wall, {0, 0, 0}, {0, 0, 2}, {2, 0, 2}, {2, 0, 0});
  s.quad("walls", wall, {0, 0, 0}, {1, 0, 0}, {1, 2, 0}, {0, 2, 0});
  s.quad(lamp_name, lamp, {1, 0, 0}, {2, 0, 0}, {2, 2, 0}, {1, 2, 0});
  const auto at = [&](int k, double y) {
    const double angle = 2 * std::numbers::pi * k / 16;
    return Vec3{1 + 0.3 * std::cos(angle), y, 1 - 0.3 * std::sin(angle)};
  };
  for (int k = 0; k < 16; ++k) s.quad("barrel", wall, at(k, 0.1), at(k + 1, 0.1), at(k + 1, 1), at(k, 1));
  return s.scene();
}

struct Sample : Lit {
  explicit Sample(double brightness = 1, const std::string& lamp_name = "lamp") : Lit(sample_scene(lamp_name), 0.05) {
    for (std::size_t i = 0; i < mesh.size(); ++i) {
      const Vec3 p = mesh.centroid[i];
      const double b = emits(mesh.emittance[i]) ? 20 * brightness : brightness * (1 + p.x + p.y);
      solution.radiosity[i] = {b, b / 2, b / 4};
    }
  }
};

}  // namespace interflect::test
