#include "interflect/scene/primitives.h"

#include <fmt/format.h>

#include <algorithm>

#include "interflect/base/error.h"
#include "interflect/scene/affine.h"
#include "interflect/scene/welder.h"

namespace interflect {

namespace {

constexpr double radius = 0.5;

int globe_bands(int division) {
  return std::max(2, division / 2);
}

SurfaceMesh make_cuboid(int n) {
  Welder mesh;
  const auto at = [n](int i) { return static_cast<double>(i) / n - 0.5; };
  for (int axis = 0; axis < 3; ++axis) {
    for (const double side : {-0.5, 0.5}) {
      // The two axes of the face, in the order that makes their cross product point outwards.
      const auto corner = [&](int i, int j) {
        std::array<double, 3> p{};
        p[static_cast<std::size_t>(axis)] = side;
        p[static_cast<std::size_t>((axis + (side > 0 ? 1 : 2)) % 3)] = at(i);
        p[static_cast<std::size_t>((axis + (side > 0 ? 2 : 1)) % 3)] = at(j);
        return Vec3{p[0], p[1], p[2]};
      };
      for (int j = 0; j < n; ++j) {
        for (int i = 0; i < n; ++i) mesh.quad(corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1));
      }
    }
  }
  return mesh.take();
}

SurfaceMesh make_barrel(int n) {
  Welder mesh;
  const auto rim = [n](int i, double y) {
    const auto [c, s] = cos_sin_degrees(360.0 * (i % n) / n);
    return Vec3{radius * c, y, radius * s};
  };
  for (int i = 0; i < n; ++i) {
    mesh.quad(rim(i, 0.5), rim(i + 1, 0.5), rim(i + 1, -0.5), rim(i, -0.5));
    mesh.triangle(rim(i + 1, 0.5), rim(i, 0.5), {0, 0.5, 0});
    mesh.triangle(rim(i, -0.5), rim(i + 1, -0.5), {0, -0.5, 0});
  }
  return mesh.take();
}

SurfaceMesh make_globe(int n) {
  Welder mesh;
  const int bands = globe_bands(n);
  const auto at = [&](int i, int j) {  // i around, j from the top
    if (j == 0 || j == bands) return Vec3{0, j == 0 ? radius : -radius, 0};
    const auto [up, out] = cos_sin_degrees(180.0 * j / bands);
    const auto [c, s] = cos_sin_degrees(360.0 * (i % n) / n);
    return Vec3{radius * out * c, radius * up, radius * out * s};
  };
  for (int j = 1; j <= bands; ++j) {
    for (int i = 1; i <= n; ++i) mesh.quad(at(i, j), at(i - 1, j), at(i - 1, j - 1), at(i, j - 1));
  }
  return mesh.take();
}

}  // namespace

DivisionRange division_range(Primitive primitive) {
  switch (primitive) {
    case Primitive::cuboid: return {1, 1, 256};
    case Primitive::barrel: return {3, 20, 4096};
    case Primitive::globe: return {3, 20, 512};
    case Primitive::teapot: break;
  }
  return {1, 8, 64};
}

std::uint64_t primitive_triangles(Primitive primitive, int division) {
  const auto n = static_cast<std::uint64_t>(division);
  switch (primitive) {
    case Primitive::cuboid: return 12 * n * n;
    case Primitive::barrel: return 4 * n;
    case Primitive::globe: return 2 * n * static_cast<std::uint64_t>(globe_bands(division) - 1);
    case Primitive::teapot: break;
  }
  return 64 * n * n - 8 * n;
}

SurfaceMesh make_primitive(Primitive primitive, int division) {
  const DivisionRange range = division_range(primitive);
  if (division < range.least || division > range.most) {
    throw Error(ErrorKind::internal,
                fmt::format("division {} of a primitive is not in {}..{}", division, range.least, range.most));
  }
  switch (primitive) {
    case Primitive::cuboid: return make_cuboid(division);
    case Primitive::barrel: return make_barrel(division);
    case Primitive::globe: return make_globe(division);
    case Primitive::teapot: break;
  }
  return make_teapot(division);
}

}  // namespace interflect
