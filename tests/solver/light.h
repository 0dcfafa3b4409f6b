#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "interflect/scene/patch_mesh.h"
#include "interflect/schedule/scheduler.h"

namespace interflect::test {

/// What a mesh gives a solver, a column per channel.
struct MeshLight {
  explicit MeshLight(const PatchMesh& mesh)
      : reflectance(3, std::vector<float>(mesh.size())), emittance(3, std::vector<float>(mesh.size())) {
    for (std::size_t c = 0; c < 3; ++c) {
      for (std::size_t i = 0; i < mesh.size(); ++i) {
        reflectance[c][i] = static_cast<float>(mesh.reflectance[i][c]);
        emittance[c][i] = static_cast<float>(mesh.emittance[i][c]);
      }
    }
  }
  Columns reflectance, emittance;
};

/// The largest difference, as a share of the largest element of b. A NaN comes through.
inline double difference(const Columns& a, const Columns& b) {
  double largest = 0, off = 0;
  for (std::size_t c = 0; c < a.size(); ++c) {
    for (std::size_t i = 0; i < a[c].size(); ++i) {
      largest = std::max(largest, std::abs(static_cast<double>(b[c][i])));
      const double d = std::abs(static_cast<double>(a[c][i]) - static_cast<double>(b[c][i]));
      off = d <= off ? off : d;
    }
  }
  return off / largest;
}

}  // namespace interflect::test
