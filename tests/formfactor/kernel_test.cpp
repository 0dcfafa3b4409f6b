#include "interflect/formfactor/kernel.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

namespace interflect::kernel {
namespace {

using Corners = std::array<Vec3, 3>;

/// A random triangle of about the given size around a point, its front towards `to`.
Corners random_triangle(std::mt19937& random, Vec3 at, double size, Vec3 to) {
  std::uniform_real_distribution<double> d(-0.5, 0.5);
  for (;;) {
    Corners t;
    for (Vec3& p : t) p = at + size * Vec3{d(random), d(random), d(random)};
    Vec3 n = cross(t[1] - t[0], t[2] - t[0]);
    if (length(n) < 0.2 * size * size) continue;  // no slivers
    if (dot(n, to - at) < 0) std::swap(t[1], t[2]);
    return t;
  }
}

bool in_front(const Corners& t, const Corners& of) {
  const Vec3 n = normalized(cross(of[1] - of[0], of[2] - of[0]));
  return std::all_of(t.begin(), t.end(), [&](Vec3 p) { return dot(n, p - of[0]) > 0; });
}

double ratio(const Corners& a, const Corners& b) {
  const Vec3 ca = centroid(Polygon(a)), cb = centroid(Polygon(b));
  double ra = 0, rb = 0;
  for (const Vec3 p : a) ra = std::max(ra, length(p - ca));
  for (const Vec3 p : b) rb = std::max(rb, length(p - cb));
  return length(ca - cb) / (ra + rb);
}

/// Both patches cut into 4^levels pieces, 6 x 6 points on each pair: needs no contour.
double brute_force(const Corners& a, const Corners& b, int levels) {
  if (levels == 0) return quadrature(Polygon(a), Polygon(b), 6);
  const auto quarters = [](const Corners& t) {
    const Vec3 ab = 0.5 * (t[0] + t[1]), bc = 0.5 * (t[1] + t[2]), ca = 0.5 * (t[2] + t[0]);
    return std::array<Corners, 4>{{{t[0], ab, ca}, {ab, t[1], bc}, {ca, bc, t[2]}, {ab, bc, ca}}};
  };
  double sum = 0;
  for (const Corners& x : quarters(a)) {
    for (const Corners& y : quarters(b)) sum += brute_force(x, y, levels - 1);
  }
  return sum;
}

/// What quadrature and contour differ by at the distances where the assembly changes over; as a share of S.
TEST(Kernel, EachMethodIsGoodWhereItIsUsed) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> d(-1, 1), distance(0.5, 8);
  double too_near_three = 0, too_near_six = 0, too_coarse = 0;  // twins: each method where it is not used
  double worst_three = 0, worst_six = 0, worst_contour = 0, squares_three = 0, squares_six = 0;
  int three = 0, six = 0, near = 0;
  while (three < 400 || six < 400 || near < 100) {
    const Vec3 way = normalized({d(random), d(random), d(random)}), at = distance(random) * way;
    const Corners a = random_triangle(random, {}, 1, at), b = random_triangle(random, at, 1, {});
    if (!in_front(a, b) || !in_front(b, a)) continue;
    const double exact = contour(Polygon(a), Polygon(b)), q = ratio(a, b);
    const double share = exact / area(Polygon(a));
    if (q > Ratios{}.three_points) {
      const double error = std::abs(quadrature(Polygon(a), Polygon(b), 3) / exact - 1);
      squares_three += error * error;
      worst_three = std::max(worst_three, std::abs(quadrature(Polygon(a), Polygon(b), 3) - exact) / area(Polygon(a)));
      ++three;
    } else if (q > Ratios{}.six_points) {
      const double error = std::abs(quadrature(Polygon(a), Polygon(b), 6) / exact - 1);
      squares_six += error * error;
      worst_six = std::max(worst_six, error * share);
      ++six;
    } else if (near < 100 && q > 0.8) {
      worst_contour = std::max(worst_contour, std::abs(brute_force(a, b, 3) - exact) / area(Polygon(a)));
      too_coarse = std::max(too_coarse, std::abs(brute_force(a, b, 0) - exact) / area(Polygon(a)));
      too_near_three = std::max(too_near_three, std::abs(quadrature(Polygon(a), Polygon(b), 3) / exact - 1) * share);
      too_near_six = std::max(too_near_six, std::abs(quadrature(Polygon(a), Polygon(b), 6) / exact - 1) * share);
      ++near;
    }
  }
  RecordProperty("rms_three", std::to_string(std::sqrt(squares_three / three)));
  RecordProperty("rms_six", std::to_string(std::sqrt(squares_six / six)));
  EXPECT_LT(worst_three, 5e-6) << "of F";
  EXPECT_LT(worst_six, 5e-6) << "of F";
  EXPECT_LT(worst_contour, 2e-6) << "of F";
  EXPECT_GT(too_near_three, 5e-6) << "twin: the bound sees three points where they do not do";
  EXPECT_GT(too_near_six, 5e-6) << "twin: and six";
  EXPECT_GT(too_coarse, 2e-6) << "twin: a reference that is not cut finely enough";
  // As shares of S, pairs at grazing angles included.
  EXPECT_LT(std::sqrt(squares_three / three), 5e-4);
  EXPECT_LT(std::sqrt(squares_six / six), 5e-4);
}

/// Two halves of a square folded at their common edge (touching), against a fine subdivision of the perpendicular
/// squares' exact value: additivity of S over pieces that share edges and corners.
TEST(Kernel, TouchingPiecesAddUp) {
  const auto floor_piece = [](double x0, double x1, double y0, double y1) {
    return std::array<Corners, 2>{
        {{Vec3{x0, y0, 0}, Vec3{x1, y0, 0}, Vec3{x1, y1, 0}}, {Vec3{x0, y0, 0}, Vec3{x1, y1, 0}, Vec3{x0, y1, 0}}}};
  };
  const auto wall_piece = [](double x0, double x1, double z0, double z1) {
    return std::array<Corners, 2>{
        {{Vec3{x0, 0, z0}, Vec3{x0, 0, z1}, Vec3{x1, 0, z1}}, {Vec3{x0, 0, z0}, Vec3{x1, 0, z1}, Vec3{x1, 0, z0}}}};
  };
  // Cuts at thirds on the floor and at halves on the wall: edges that overlap without being equal.
  double sum = 0;
  for (int a = 0; a < 9; ++a) {
    for (int b = 0; b < 4; ++b) {
      for (const auto& s : floor_piece(a % 3 / 3.0, (a % 3 + 1) / 3.0, a / 3 / 3.0, (a / 3 + 1) / 3.0)) {
        for (const auto& t : wall_piece(b % 2 / 2.0, (b % 2 + 1) / 2.0, b / 2 / 2.0, (b / 2 + 1) / 2.0)) {
          sum += contour(Polygon(s), Polygon(t));
        }
      }
    }
  }
  EXPECT_NEAR(sum, 0.200043776075403, 1e-6);
}

TEST(Kernel, EdgePairOfEqualEdges) {
  const Vec3 a{1, 2, 3}, b{1.5, 2, 3};
  const double closed = 0.25 * (std::log(0.5) - 1.5);  // L² (ln L − 3/2)
  EXPECT_NEAR(edge_pair(a, b, a, b), closed, 1e-14);
  EXPECT_NEAR(edge_pair(a, b, b, a), -closed, 1e-14);
  EXPECT_NEAR(edge_pair(a, b, a + Vec3{0, 1e-7, 0}, b + Vec3{0, 1e-7, 0}), closed, 1e-6) << "nearly equal";
  EXPECT_EQ(edge_pair(a, b, a, a + Vec3{0, 1, 0}), 0) << "perpendicular";
}

TEST(Kernel, TheContourIsSymmetricAndScalesWithTheArea) {
  std::mt19937 random(3);
  const Vec3 at{0.3, 0.2, 1};
  for (int k = 0; k < 50; ++k) {
    const Corners a = random_triangle(random, {}, 1, at), b = random_triangle(random, at, 1, {});
    if (!in_front(a, b) || !in_front(b, a)) continue;
    const double s = contour(Polygon(a), Polygon(b));
    EXPECT_NEAR(contour(Polygon(b), Polygon(a)), s, 1e-6 * s + 1e-9);
    Corners a1000 = a, b1000 = b;
    for (Vec3& p : a1000) p = 1000 * p;
    for (Vec3& p : b1000) p = 1000 * p;
    EXPECT_NEAR(contour(Polygon(a1000), Polygon(b1000)) / 1e6, s, 1e-9);
  }
}

TEST(Kernel, ClipKeepsWhatLiesInFront) {
  const Corners t{Vec3{0, 0, -1}, Vec3{2, 0, 1}, Vec3{0, 2, 1}};
  const Plane up{{0, 0, 1}, 0}, down{{0, 0, -1}, 0};
  const Polygon above = clip(t, up), below = clip(t, down);
  EXPECT_EQ(above.size, 4U);
  EXPECT_EQ(below.size, 3U);
  EXPECT_NEAR(area(above) + area(below), area(Polygon(t)), 1e-14);
  EXPECT_NEAR(area(below) / area(Polygon(t)), 0.25, 1e-14);
  EXPECT_EQ(clip(t, {{0, 0, 1}, 2}).size, 0U);
  EXPECT_EQ(clip(t, {{0, 0, 1}, -2}).size, 3U);
  EXPECT_EQ(clip(t, {{0, 0, 1}, 1}).size, 0U) << "an edge alone is nothing";
}

// A fan that began at another corner would give every sample another place.
TEST(Kernel, ClipPutsTheSameCornerFirstWhateverRoundingSays) {
  const Plane plane{{0, 0, 1}, 0};
  const Corners exact{Vec3{0, 0, 0}, Vec3{1, 0, 0}, Vec3{0, 1, 1}};
  const Polygon expected = clip(exact, plane, 1e-9);
  ASSERT_EQ(expected.size, 3U);
  for (const double a : {-1e-12, 0.0, 1e-12}) {
    for (const double b : {-1e-12, 0.0, 1e-12}) {
      Corners t = exact;
      t[0].z = a;
      t[1].z = b;
      const Polygon part = clip(t, plane, 1e-9);
      ASSERT_EQ(part.size, 3U) << a << ' ' << b;
      for (std::size_t k = 0; k < 3; ++k) EXPECT_NEAR(length(part.corner[k] - expected.corner[k]), 0, 1e-11);
    }
  }
  Corners t = exact;
  t[0].z = -1e-12;
  t[1].z = 1e-12;
  EXPECT_GT(length(clip(t, plane).corner[0] - expected.corner[0]), 0.1) << "without it the first corner moves";
}

}  // namespace
}  // namespace interflect::kernel
