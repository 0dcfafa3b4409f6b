#include "interflect/formfactor/patch_order.h"

#include <gtest/gtest.h>
#include <omp.h>

#include <algorithm>
#include <bit>
#include <limits>
#include <numeric>
#include <random>
#include <set>

#include "formfactor/meshes.h"
#include "interflect/base/error.h"
#include "interflect/formfactor/assembly.h"
#include "interflect/formfactor/patch_clusters.h"
#include "interflect/formfactor/zero_pattern.h"

namespace interflect {
namespace {

using Order = std::vector<std::uint32_t>;

Order index_order(std::size_t n) {
  Order order(n);
  std::iota(order.begin(), order.end(), 0);
  return order;
}

Order shuffled(std::size_t n) {
  Order order = index_order(n);
  std::mt19937 random(7);
  for (std::size_t k = n; k > 1; --k) std::swap(order[k - 1], order[random() % k]);  // std::shuffle differs by library
  return order;
}

bool is_permutation_of(const Order& order, std::size_t n) {
  return order.size() == n && std::set<std::uint32_t>(order.begin(), order.end()).size() == n &&
         std::all_of(order.begin(), order.end(), [&](std::uint32_t i) { return i < n; });
}

/// 1 where sees(i, j), else 0.
template <class Sees>
FormFactorMatrix matrix(std::uint32_t n, Sees sees) {
  FormFactorMatrix f(n);
  for (std::uint32_t i = 0; i < n; ++i) {
    for (std::uint32_t j = 0; j < n; ++j) f.row(i)[j] = sees(i, j) ? 1.0F : 0.0F;
  }
  return f;
}

/// F with its patches in another order.
FormFactorMatrix reordered(const FormFactorMatrix& f, const Order& order) {
  FormFactorMatrix out(f.size());
  for (std::uint32_t i = 0; i < f.size(); ++i) {
    for (std::uint32_t j = 0; j < f.size(); ++j) out.row(i)[j] = f.row(order[i])[order[j]];
  }
  return out;
}

PatchMesh reordered(const PatchMesh& mesh, const Order& order) {
  PatchMesh out;
  for (const std::uint32_t i : order) {
    out.corners.push_back(mesh.corners[i]);
    out.centroid.push_back(mesh.centroid[i]);
    out.normal.push_back(mesh.normal[i]);
  }
  return out;
}

/// The definition, element by element.
TileCount counted_plainly(const FormFactorMatrix& f, const Order& order) {
  const std::uint32_t n = f.size();
  std::set<std::pair<std::uint32_t, std::uint32_t>> all, stored, upper;
  TileCount count;
  for (std::uint32_t i = 0; i < n; ++i) {
    for (std::uint32_t j = 0; j < n; ++j) {
      const std::pair tile(i / 8, j / 16);
      all.insert(tile);
      if (i <= j) upper.insert(tile);
      if (f.row(order[i])[order[j]] == 0) continue;
      stored.insert(tile);
      ++count.nonzero_elements;
    }
  }
  count.tiles = all.size();
  count.stored = stored.size();
  count.triangle_tiles = upper.size();
  for (const auto& tile : upper) count.triangle_stored += stored.count(tile);
  return count;
}

void expect_same(const TileCount& a, const TileCount& b) {
  EXPECT_EQ(a.tiles, b.tiles);
  EXPECT_EQ(a.stored, b.stored);
  EXPECT_EQ(a.triangle_tiles, b.triangle_tiles);
  EXPECT_EQ(a.triangle_stored, b.triangle_stored);
  EXPECT_EQ(a.nonzero_elements, b.nonzero_elements);
}

/// A room with a plate across and two boxes in it, a lamp-like sphere: planes, curves and shadows.
test::Builder occluded_room() {
  test::Builder room;
  room.part("walls").box({0, 0, 0}, {4, 3, 2.5}, true, 6);
  room.part("screen").box({1.9, 0.2, 0}, {2.0, 2.0, 1.8}, false, 3);
  room.part("table").box({0.5, 0.5, 0.6}, {1.3, 1.3, 0.7}, false, 3);
  room.part("ball").sphere({3, 1.5, 1}, 0.4, 2, false);
  return room;
}

TEST(CountTiles, ByHand) {
  // 17 patches: 3 rows of tiles (8, 8, 1), 2 columns of tiles (16, 1). Tiles that touch row <= column: those of the
  // first column from rows 0 and 8 on, all three of the second.
  const auto pairs =
      matrix(17, [](std::uint32_t i, std::uint32_t j) { return (i == 0 && j == 16) || (i == 16 && j == 0); });
  const TileCount count = count_tiles(pairs, index_order(17));
  EXPECT_EQ(count.tiles, 6U);
  EXPECT_EQ(count.triangle_tiles, 5U);
  EXPECT_EQ(count.stored, 2U) << "(0, 16) and (16, 0)";
  EXPECT_EQ(count.triangle_stored, 1U) << "(0, 16)";
  EXPECT_EQ(count.nonzero_elements, 2U);
  EXPECT_DOUBLE_EQ(count.stored_fraction(), 2.0 / 6);
  EXPECT_DOUBLE_EQ(count.triangle_stored_fraction(), 1.0 / 5);

  Order order = index_order(17);  // patch 16 beside patch 0: one tile holds both
  std::rotate(order.begin() + 1, order.end() - 1, order.end());
  EXPECT_EQ(count_tiles(pairs, order).stored, 1U);
  EXPECT_EQ(count_tiles(pairs, order).triangle_stored, 1U);
}

TEST(CountTiles, IsItsDefinitionAtAllSizes) {
  for (const std::uint32_t n : {1U, 7U, 8U, 9U, 15U, 16U, 17U, 63U, 64U, 65U, 130U}) {
    std::mt19937 random(n);
    FormFactorMatrix f(n);
    for (std::uint32_t i = 0; i < n; ++i) {
      for (float& x : f.row(i)) x = random() % 200 == 0 ? 1e-30F : random() % 2 == 0 ? 0.0F : -0.0F;
    }
    for (const Order& order : {index_order(n), shuffled(n)}) {
      SCOPED_TRACE(n);
      expect_same(count_tiles(f, order), counted_plainly(f, order));
    }
  }
}

TEST(CountTiles, RefusesWhatIsNoOrder) {
  const FormFactorMatrix f(5);
  for (const Order& wrong : {Order{}, Order{0, 1, 2, 3}, Order{0, 1, 2, 3, 3}, Order{0, 1, 2, 3, 5}, index_order(6)}) {
    EXPECT_THROW((void)count_tiles(f, wrong), Error);
  }
}

TEST(ZeroPattern, MarksAndCounts) {
  for (const std::size_t n : {0U, 1U, 63U, 64U, 65U, 200U}) {
    std::vector<float> row(n);
    std::vector<std::uint64_t> bits((n + 63) / 64), expected(bits.size());
    std::uint64_t count = 0;
    for (std::size_t j = 0; j < n; ++j) {
      const float kinds[] = {0, 1, -0.0F, std::numeric_limits<float>::denorm_min(),
                             std::numeric_limits<float>::quiet_NaN()};
      row[j] = kinds[j * 3 % 5];
      if (row[j] == 0) continue;
      expected[j / 64] |= std::uint64_t{1} << (j % 64);
      ++count;
    }
    EXPECT_EQ(simd::mark_nonzeros(row, bits), count);
    EXPECT_EQ(bits, expected);
    if (n == 0) continue;
    std::fill(row.begin(), row.end(), 0.0F);
    EXPECT_EQ(simd::mark_nonzeros(row, bits), 0U);
    EXPECT_EQ(bits, expected) << "what was marked stays";
  }
}

TEST(ZeroPattern, CountsDifferingBits) {
  constexpr std::size_t words = 24, rows = 5;
  std::mt19937_64 random(3);
  std::vector<std::uint64_t> bits(words * rows);
  for (std::uint64_t& word : bits) word = random() & random();
  const std::vector<std::uint32_t> others{4, 0, 2, 2, 1};
  std::vector<std::uint32_t> count(others.size());
  simd::differing_bits(bits, words, 2, others, count);
  for (std::size_t k = 0; k < others.size(); ++k) {
    int expected = 0;
    for (std::size_t w = 0; w < words; ++w)
      expected += std::popcount(bits[2 * words + w] ^ bits[others[k] * words + w]);
    EXPECT_EQ(count[k], static_cast<std::uint32_t>(expected));
  }
}

TEST(PatchOrder, JoinsThePatchesThatSeeTheSame) {
  // Four kinds of patches, dealt out like cards; kind 0 sees kind 1, kind 2 sees kind 3. Joined by kind, 32 of 64
  // patches of each: a quarter of the tiles.
  const auto kinds = matrix(256, [](std::uint32_t i, std::uint32_t j) { return (i % 4 ^ j % 4) == 1; });
  EXPECT_EQ(count_tiles(kinds, index_order(256)).stored_fraction(), 1.0);
  EXPECT_EQ(count_tiles(kinds, patch_order(kinds)).stored_fraction(), 0.25);
}

TEST(PatchOrder, StoresFewerTilesThanFileOrderAndThanAnyShuffledOne) {
  const test::Builder room = occluded_room();
  const FormFactorMatrix f = assemble(room.mesh(), test::raw()).matrix;
  const std::uint32_t n = f.size();
  const auto stored = [&](const Order& order) { return static_cast<double>(count_tiles(f, order).stored); };
  const double by_index = stored(index_order(n)), by_view = stored(patch_order(f));
  ASSERT_LT(f.nonzero_fraction(), 0.5);
  EXPECT_TRUE(is_permutation_of(patch_order(f), n));
  EXPECT_LT(by_view, 0.85 * by_index);
  EXPECT_LT(by_index, stored(shuffled(n)));
  EXPECT_EQ(patch_order(room.mesh(), f), patch_order(f)) << "the file's order is as good as the mesh's";

  // Out of a file that has them in no order at all.
  const Order mixed = shuffled(n);
  const FormFactorMatrix g = reordered(f, mixed);
  const PatchMesh mesh = reordered(room.mesh(), mixed);
  EXPECT_LT(count_tiles(g, patch_order(g)).stored_fraction(), 0.7 * count_tiles(g, index_order(n)).stored_fraction());
  EXPECT_LT(static_cast<double>(count_tiles(g, patch_order(mesh, g)).stored), by_index);
  EXPECT_NE(patch_order(mesh, g), patch_order(g)) << "the mesh has an order, the file has none";
}

TEST(PatchOrder, DoesNotDependOnTheNumberOfThreads) {
  const test::Builder room = occluded_room();
  const FormFactorMatrix f = assemble(room.mesh(), test::raw()).matrix;
  const int before = omp_get_max_threads();
  omp_set_num_threads(1);
  const Order one = patch_order(room.mesh(), f), one_without_mesh = patch_order(f);
  const TileCount count = count_tiles(f, one);
  for (const int threads : {2, 3, 8}) {
    omp_set_num_threads(threads);
    EXPECT_EQ(patch_order(room.mesh(), f), one);
    EXPECT_EQ(patch_order(f), one_without_mesh);
    expect_same(count_tiles(f, one), count);
  }
  omp_set_num_threads(before);
}

TEST(PatchOrder, AnyMatrixGivesAPermutation) {
  for (const std::uint32_t n : {0U, 1U, 2U, 7U, 8U, 15U, 16U, 17U, 31U, 33U, 300U, 1030U}) {
    SCOPED_TRACE(n);
    std::mt19937 random(n);
    const auto nothing = matrix(n, [](auto, auto) { return false; });
    const auto everything = matrix(n, [](auto, auto) { return true; });
    const auto chance = matrix(n, [&](auto, auto) { return random() % 3 == 0; });
    const auto lonely = matrix(n, [](auto i, auto j) { return i / 20 == 0 && j == i; });
    for (const FormFactorMatrix* f : {&nothing, &everything, &chance, &lonely}) {
      const Order order = patch_order(*f);
      EXPECT_TRUE(is_permutation_of(order, n));
      EXPECT_LE(count_tiles(*f, order).stored, count_tiles(*f, index_order(n)).stored);
      EXPECT_TRUE(is_permutation_of(joined_by_view(*f, shuffled(n)), n)) << "from any order";
    }
  }
}

TEST(PatchOrder, WhatIsLeftOverFillsTheLastTileInWholeBlocks) {
  // 16 + 8 + 4 + 2 + 1 patches, dealt out: five kinds that see nothing but their own.
  const auto kind = [](std::uint32_t i) { return i < 16 ? 0 : i < 24 ? 1 : i < 28 ? 2 : i < 30 ? 3 : 4; };
  const Order mixed = shuffled(31);
  const auto f = matrix(31, [&](auto i, auto j) { return kind(mixed[i]) == kind(mixed[j]); });
  const Order order = joined_by_view(f, index_order(31));
  Order kinds;
  for (const std::uint32_t i : order) kinds.push_back(static_cast<std::uint32_t>(kind(mixed[i])));
  EXPECT_TRUE(std::is_sorted(kinds.begin(), kinds.end())) << ::testing::PrintToString(kinds);
}

TEST(PatchOrder, AMeshOfAnotherSizeIsRefused) {
  const test::Builder room = occluded_room();
  EXPECT_THROW((void)patch_order(room.mesh(), FormFactorMatrix(3)), Error);
}

TEST(SpatialOrder, KeepsThoseTogetherThatAreNearAndLookTheSameWay) {
  const PatchMesh mesh = test::Builder().part("box").box({0, 0, 0}, {1, 1, 1}, true, 4).mesh();
  const Order order = spatial_order(mesh.centroid, mesh.normal);
  ASSERT_TRUE(is_permutation_of(order, mesh.size()));
  int turns = 0;
  double way = 0;
  for (std::size_t k = 1; k < order.size(); ++k) {
    turns += mesh.normal[order[k]] == mesh.normal[order[k - 1]] ? 0 : 1;
    way += length(mesh.centroid[order[k]] - mesh.centroid[order[k - 1]]);
  }
  EXPECT_LE(turns, 12) << "six sides of 32, each in few pieces";
  EXPECT_LT(way / static_cast<double>(order.size()), 0.35) << "cells of 0.25";

  EXPECT_TRUE(spatial_order({}, {}).empty());
  const std::vector<Vec3> same(20, Vec3{1, 2, 3}), up(20, Vec3{0, 0, 1});
  EXPECT_EQ(spatial_order(same, up), index_order(20));
}

}  // namespace
}  // namespace interflect
