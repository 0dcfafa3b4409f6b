#pragma once

#include <array>
#include <cstddef>
#include <span>

#include "interflect/base/vec3.h"

/// The geometry of one pair of patches, without occlusion. Everything here is in double precision and pure.
/// S = ∫_A ∫_B cosθ_x cosθ_y / (π |x − y|²) dy dx, symmetric in its arguments; F_AB = S / |A|.
namespace interflect::kernel {

/// A planar convex polygon, counter-clockwise from its front: a patch, or the part of it that another patch's plane
/// leaves (a triangle cut by one plane has at most four corners).
struct Polygon {
  std::array<Vec3, 4> corner{};
  std::size_t size = 0;

  Polygon() = default;
  explicit Polygon(const std::array<Vec3, 3>& t) : corner{t[0], t[1], t[2], {}}, size(3) {}
  [[nodiscard]] std::span<const Vec3> corners() const { return {corner.data(), size}; }
  /// Triangles 0 .. size − 3 of the fan around corner 0.
  [[nodiscard]] std::array<Vec3, 3> fan(std::size_t k) const { return {corner[0], corner[k + 1], corner[k + 2]}; }
};

/// The points x with normal·x = offset; its front is where normal·x > offset.
struct Plane {
  Vec3 normal{};
  double offset = 0;
  [[nodiscard]] double distance(Vec3 x) const { return dot(normal, x) - offset; }
};

[[nodiscard]] double area(const Polygon& a);
[[nodiscard]] Vec3 centroid(const Polygon& a);

/// The part of a triangle in front of the plane; empty (size 0) when nothing is. Corners within `on_plane` of the plane
/// lie on it: rounding does not decide which corner comes first, so that all backends place their samples alike.
[[nodiscard]] Polygon clip(const std::array<Vec3, 3>& triangle, const Plane& plane, double on_plane = 0);

/// ∫∫ ln|x − y| dx·dy over the edges a0→a1 and b0→b1: one integration in closed form, the other by Gauss-Legendre with
/// points graded towards the places where the inner integral is not smooth; both in closed form when the edges are
/// collinear. (Mitalas and Stephenson 1966; Walton, NISTIR 6925, 2002.)
[[nodiscard]] double edge_pair(Vec3 a0, Vec3 a1, Vec3 b0, Vec3 b1);

/// S by the contour form, 1/(2π) Σ over edge pairs of edge_pair(). Good to about 1e-8 of the areas at any distance;
/// both polygons must lie in front of each other.
[[nodiscard]] double contour(const Polygon& a, const Polygon& b);

/// The points of a quadrature over a polygon, with their shares of its area.
struct Samples {
  struct Sample {
    Vec3 position;
    double weight;
  };
  std::array<Sample, 12> sample;
  std::size_t size = 0;
  Vec3 normal;
};
[[nodiscard]] Samples samples(const Polygon& a, int points);
[[nodiscard]] double quadrature(const Samples& a, const Samples& b);

/// S by quadrature over both areas: `points` per triangle of the fan, 3 (degree 2) or 6 (degree 4).
[[nodiscard]] double quadrature(const Polygon& a, const Polygon& b, int points);

/// Distance of the centroids over the sum of the radii (largest distance of a corner from the centroid) from which 3 x
/// 3 or 6 x 6 points do; the contour form below. Measured against the contour form on random pairs of triangles
/// (tests/formfactor/kernel_test.cpp): with these ratios the quadrature is off by at most 5e-6 of F, rms 2e-4 and 5e-5
/// of S. A pair of facets of a sphere just beyond the contour's limit was seen 2.2e-5 of F off (0.3 % of its S).
struct Ratios {
  float three_points = 3.0F, six_points = 1.5F;
};

/// S by whichever of the above fits the distance.
[[nodiscard]] double unoccluded(const Polygon& a, const Polygon& b, const Ratios& ratios = {});

}  // namespace interflect::kernel
