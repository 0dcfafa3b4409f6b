#include "interflect/formfactor/patch_table.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace interflect {

namespace {

// Two patches whose planes differ by less than this share of their sizes (and of the scene) are coplanar.
constexpr double of_patch = 1e-6, of_scene = 1e-9;

double longest_edge(const std::array<Vec3, 3>& t) {
  return std::max({length(t[1] - t[0]), length(t[2] - t[1]), length(t[0] - t[2])});
}

}  // namespace

PatchTable::PatchTable(const PatchMesh& mesh) : size(mesh.size()) {
  const std::size_t padded = blocks() * block;
  Vec3 low{}, high{};
  for (std::size_t i = 0; i < size; ++i) {
    for (const Vec3 p : mesh.triangle(i)) {
      low = i == 0 ? p : min(low, p);
      high = i == 0 ? p : max(high, p);
    }
  }
  centre = 0.5 * (low + high);
  extent = std::max({high.x - centre.x, high.y - centre.y, high.z - centre.z, std::numeric_limits<double>::min()});

  for (auto& a : corner) a.assign(padded, 0);
  for (auto& a : node) a.assign(padded, 0);
  for (auto& a : normal) a.assign(padded, 0);
  for (auto& a : centroid) a.assign(padded, 0);
  offset.assign(padded, 0);
  radius.assign(padded, 0);
  tolerance.assign(padded, std::numeric_limits<double>::infinity());
  area.assign(padded, 0);
  for (std::size_t i = 0; i < size; ++i) {
    auto t = mesh.triangle(i);
    for (Vec3& p : t) p = p - centre;
    const Vec3 middle = (t[0] + t[1] + t[2]) / 3;
    const Vec3 twice = cross(t[1] - t[0], t[2] - t[0]);
    const Vec3 n = normalized(twice);
    for (std::size_t k = 0; k < 3; ++k) {
      const Vec3 q = 0.5 * (middle + t[k]);
      for (int axis = 0; axis < 3; ++axis) {
        const auto at = static_cast<std::size_t>(axis);
        corner[3 * k + at][i] = t[k][axis];
        node[3 * k + at][i] = q[axis];
        normal[at][i] = n[axis];
        centroid[at][i] = middle[axis];
      }
      radius[i] = std::max(radius[i], length(t[k] - middle));
    }
    offset[i] = dot(n, middle);
    tolerance[i] = of_patch * longest_edge(t) + of_scene * extent;
    area[i] = 0.5 * length(twice);
  }
}

std::array<Vec3, 3> PatchTable::triangle(std::size_t i) const {
  return {Vec3{corner[0][i], corner[1][i], corner[2][i]}, Vec3{corner[3][i], corner[4][i], corner[5][i]},
          Vec3{corner[6][i], corner[7][i], corner[8][i]}};
}

kernel::Plane PatchTable::plane(std::size_t i) const {
  return {front(i), offset[i]};
}

std::uint64_t PatchTable::predicted_bytes(std::uint64_t n) {
  return (n + block) * 28 * sizeof(double);
}

}  // namespace interflect
