#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "formfactor/meshes.h"
#include "interflect/formfactor/blockers.h"
#include "interflect/formfactor/pair_tile.h"
#include "interflect/formfactor/patch_table.h"

/// Deliberately broken form factors, so that every bound has a twin that it must reject.
namespace interflect::test {

/// |value − exact| <= bound, as a result that both a test and its twin can ask.
inline ::testing::AssertionResult near(double value, double exact, double bound) {
  const double off = std::abs(value - exact);
  return (off <= bound ? ::testing::AssertionSuccess() : ::testing::AssertionFailure())
         << value << " is off by " << off << " from " << exact << ", bound " << bound;
}

/// The assembly's own worker over all pairs, unscaled, but with blockers of the caller's choice.
inline FormFactorMatrix factors_with(const PatchMesh& mesh, const Blockers& blockers) {
  const PatchTable patches(mesh);
  FormFactorMatrix f(static_cast<std::uint32_t>(mesh.size()));
  PairTile tile(patches, blockers, 1);
  for (std::size_t r = 0; r < patches.blocks(); ++r) {
    for (std::size_t c = r; c < patches.blocks(); ++c) {
      if (!tile.compute(r, c)) continue;
      for (std::size_t a = 0; a < PairTile::block; ++a) {
        for (std::size_t b = 0; b < PairTile::block; ++b) {
          const std::size_t i = r * PairTile::block + a, j = c * PairTile::block + b;
          if (i >= j || j >= mesh.size()) continue;
          f.row(static_cast<std::uint32_t>(i))[j] = static_cast<float>(tile.s(a, b) / mesh.area[i]);
          f.row(static_cast<std::uint32_t>(j))[i] = static_cast<float>(tile.s(a, b) / mesh.area[j]);
        }
      }
    }
  }
  return f;
}

/// Broken: no ray ever meets anything.
inline FormFactorMatrix blind(const PatchMesh& mesh) {
  return factors_with(mesh, Blockers({}, {}));
}
inline GroupFactors blind(const Builder& b) {
  return between(blind(b.mesh()), b.mesh(), b.grouping());
}

/// Broken: the rays also meet a triangle that is not there.
inline FormFactorMatrix with_a_ghost(const PatchMesh& mesh, const std::array<Vec3, 3>& ghost) {
  const PatchTable patches(mesh);
  std::vector<Vec3> vertices;
  for (const Vec3 p : mesh.vertices) vertices.push_back(p - patches.centre);
  std::vector<std::array<std::uint32_t, 3>> triangles = mesh.corners;
  const auto first = static_cast<std::uint32_t>(vertices.size());
  triangles.push_back({first, first + 1, first + 2});
  for (const Vec3 p : ghost) vertices.push_back(p - patches.centre);
  return factors_with(mesh, Blockers(vertices, triangles));
}

/// Broken: every factor times `by`.
inline FormFactorMatrix scaled(FormFactorMatrix f, float by) {
  for (std::uint32_t i = 0; i < f.size(); ++i) {
    for (float& x : f.row(i)) x *= by;
  }
  return f;
}
inline GroupFactors scaled(GroupFactors f, double by) {
  for (auto& row : f.factors) {
    for (double& x : row) x *= by;
  }
  return f;
}

}  // namespace interflect::test
