#pragma once

#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "interflect/formfactor/assembly.h"
#include "interflect/scene/patch_mesh.h"

/// Meshes by hand, one group (surface) per part.
namespace interflect::test {

class Builder {
 public:
  /// Starts the next part; triangles that follow belong to it.
  Builder& part(const std::string& name) {
    mesh_.surfaces.push_back({name, name, 0});
    grouping_.names.push_back(name);
    grouping_.of_surface.push_back(static_cast<std::uint32_t>(grouping_.of_surface.size()));
    return *this;
  }

  Builder& triangle(Vec3 a, Vec3 b, Vec3 c) {
    const Vec3 twice = cross(b - a, c - a);
    mesh_.corners.push_back({vertex(a), vertex(b), vertex(c)});
    mesh_.area.push_back(0.5 * length(twice));
    mesh_.centroid.push_back((a + b + c) / 3);
    mesh_.normal.push_back(normalized(twice));
    mesh_.reflectance.push_back({0.5, 0.5, 0.5});
    mesh_.emittance.push_back({1, 1, 1});
    mesh_.surface.push_back(static_cast<std::uint32_t>(mesh_.surfaces.size() - 1));
    mesh_.source.push_back(static_cast<std::uint32_t>(mesh_.source.size()));
    return *this;
  }

  /// The parallelogram o, o + u, o + u + v, o + v, its front along u × v, in n x n cells of two triangles.
  Builder& plate(Vec3 o, Vec3 u, Vec3 v, int n = 1) {
    const auto at = [&](int x, int y) {
      return o + (x / static_cast<double>(n)) * u + (y / static_cast<double>(n)) * v;
    };
    for (int y = 0; y < n; ++y) {
      for (int x = 0; x < n; ++x) {
        triangle(at(x, y), at(x + 1, y), at(x + 1, y + 1));
        triangle(at(x, y), at(x + 1, y + 1), at(x, y + 1));
      }
    }
    return *this;
  }

  /// The box from low to high, seen from inside or outside.
  Builder& box(Vec3 low, Vec3 high, bool inside, int n = 1) {
    const Vec3 d = high - low, x{d.x, 0, 0}, y{0, d.y, 0}, z{0, 0, d.z};
    const auto face = [&](Vec3 o, Vec3 u, Vec3 v) { inside ? plate(o, u, v, n) : plate(o, v, u, n); };
    face(low, x, y);
    face(low + z, y, x);
    face(low, y, z);
    face(low + x, z, y);
    face(low, z, x);
    face(low + y, x, z);
    return *this;
  }

  /// The octahedron's faces cut `levels` times into four, on the sphere.
  Builder& sphere(Vec3 centre, double radius, int levels, bool inside) {
    const Vec3 axes[] = {{1, 0, 0}, {0, 1, 0}, {-1, 0, 0}, {0, -1, 0}};
    for (int k = 0; k < 4; ++k) {
      for (const double up : {1.0, -1.0}) {
        const Vec3 a = axes[k], b = axes[(k + 1) % 4], c{0, 0, up};
        (up > 0) != inside ? cap(centre, radius, a, b, c, levels) : cap(centre, radius, b, a, c, levels);
      }
    }
    return *this;
  }

  /// A regular polygon as a fan about the z axis, corners at `radius`; up: front towards +z.
  Builder& disc(double z, double radius, int corners, bool up) {
    const auto at = [&](int k) {
      const double phi = 2 * std::numbers::pi * k / corners;
      return Vec3{radius * std::cos(phi), radius * std::sin(phi), z};
    };
    for (int k = 0; k < corners; ++k) {
      up ? triangle({0, 0, z}, at(k), at(k + 1)) : triangle({0, 0, z}, at(k + 1), at(k));
    }
    return *this;
  }

  [[nodiscard]] const PatchMesh& mesh() const { return mesh_; }
  [[nodiscard]] const Grouping& grouping() const { return grouping_; }
  /// F from one part to another, by the assembly.
  [[nodiscard]] GroupFactors factors(AssemblyOptions options = {}) const {
    return between(assemble(mesh_, options).matrix, mesh_, grouping_);
  }

 private:
  std::uint32_t vertex(Vec3 p) {
    for (std::size_t k = 0; k < mesh_.vertices.size(); ++k) {
      if (length(mesh_.vertices[k] - p) < 1e-12) return static_cast<std::uint32_t>(k);
    }
    mesh_.vertices.push_back(p);
    return static_cast<std::uint32_t>(mesh_.vertices.size() - 1);
  }

  void cap(Vec3 centre, double radius, Vec3 a, Vec3 b, Vec3 c, int levels) {
    if (levels == 0) {
      triangle(centre + radius * a, centre + radius * b, centre + radius * c);
      return;
    }
    const Vec3 ab = normalized(a + b), bc = normalized(b + c), ca = normalized(c + a);
    cap(centre, radius, a, ab, ca, levels - 1);
    cap(centre, radius, ab, b, bc, levels - 1);
    cap(centre, radius, ca, bc, c, levels - 1);
    cap(centre, radius, ab, bc, ca, levels - 1);
  }

  PatchMesh mesh_;
  Grouping grouping_;
};

/// A closed room with a box in it; the room's sides in n x n cells.
inline PatchMesh room(int n) {
  return Builder()
      .part("room")
      .box({0, 0, 0}, {4, 3, 2.5}, true, n)
      .part("box")
      .box({1, 1, 0.5}, {2, 2, 1.5}, false, 2)
      .mesh();
}

/// Raw factors: no scaling.
inline AssemblyOptions raw(std::uint64_t seed = 1) {
  AssemblyOptions options;
  options.closure = Closure::off;
  options.seed = seed;
  return options;
}

}  // namespace interflect::test
