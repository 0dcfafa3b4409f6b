#include "interflect/formfactor/blockers.h"

#include <gtest/gtest.h>

#include <random>

#include "formfactor/meshes.h"

namespace interflect {
namespace {

/// Random boxes and triangles: where a ray between the boxes meets the triangle, the shaft must not be called empty.
/// Counts how often it rightly is, and how often a shaft whose second box is left out (the twin) misses a blocker.
TEST(Blockers, NoRayInAnEmptyShaftMeetsAnything) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> d(-1, 1), size(0, 0.3), unit(0, 1);
  const auto point = [&] { return Vec3{d(random), d(random), d(random)}; };
  int empty = 0, hit = 0, missed_by_the_twin = 0;
  for (int k = 0; k < 6000; ++k) {
    const Vec3 a = point(), b = point(), c = point();
    const Box from{a, a + Vec3{size(random), size(random), size(random)}},
        to{b, b + Vec3{size(random), size(random), size(random)}};
    const Blockers blockers({c, c + 0.7 * point(), c + 0.7 * point()}, {{0, 1, 2}});
    const auto in = [&](const Box& box) {
      return Vec3{box.low.x + unit(random) * (box.high.x - box.low.x),
                  box.low.y + unit(random) * (box.high.y - box.low.y),
                  box.low.z + unit(random) * (box.high.z - box.low.z)};
    };
    bool met = false;
    for (int ray = 0; ray < 100 && !met; ++ray) {
      const Vec3 x = in(from), way = in(to)-x;
      const std::array<Visibility::Ray, 1> rays{
          {{{static_cast<float>(x.x), static_cast<float>(x.y), static_cast<float>(x.z)},
            0,
            {static_cast<float>(way.x), static_cast<float>(way.y), static_cast<float>(way.z)},
            1}}};
      blockers.visibility().occluded(rays, {&met, 1});
    }
    // A plane that nothing is behind, as the assembly gives one per patch.
    const auto any = [&](const Box& second) {
      Shaft shaft(from, second, 1e-6);
      shaft.from = shaft.to = {{{0, 0, 1}, -10}};
      std::size_t hint = 0;
      return blockers.any_in(shaft, hint);
    };
    const bool somewhere = any(to);
    if (met) {
      ASSERT_TRUE(somewhere) << k;
      missed_by_the_twin += any(from) ? 0 : 1;
    }
    hit += met ? 1 : 0;
    empty += somewhere ? 0 : 1;
  }
  EXPECT_GT(hit, 100);
  EXPECT_GT(empty, 1000);
  EXPECT_GT(missed_by_the_twin, 50);
}

/// What lies behind a plane that all rays start in front of hides nothing; one of two planes is not enough.
TEST(Blockers, WhatLiesBehindThePatchesIsNoBlocker) {
  const Blockers blockers({{-1, -1, 0.5}, {1, -1, 0.5}, {0, 1, 0.5}}, {{0, 1, 2}});
  Shaft shaft({{-1, -1, 0}, {1, 1, 0.1}}, {{-1, -1, 1}, {1, 1, 1.1}}, 1e-6);
  shaft.from = shaft.to = {{{0, 0, 1}, -10}};
  std::size_t hint = 0;
  EXPECT_TRUE(blockers.any_in(shaft, hint));
  shaft.from = {{{0, 0, 1}, 0.5}};
  EXPECT_FALSE(blockers.any_in(shaft, hint)) << "in the plane itself";
  shaft.from.push_back({{0, 0, 1}, 0.2});
  EXPECT_TRUE(blockers.any_in(shaft, hint)) << "another patch looks at its front";
}

/// Both sides of a plate are one triangle, front and back.
TEST(Blockers, TwoSidesAreOneTriangle) {
  test::Builder b;
  b.part("plate").triangle({0, 0, 0}, {1, 0, 0}, {0, 1, 0}).triangle({0, 0, 0}, {0, 1, 0}, {1, 0, 0});
  b.triangle({0, 0, 1}, {1, 0, 1}, {0, 1, 1});
  const PatchTable patches(b.mesh());
  const Blockers blockers(b.mesh(), patches);
  EXPECT_EQ(blockers.two_sided(), (std::vector<bool>{true, false}));
}

}  // namespace
}  // namespace interflect
