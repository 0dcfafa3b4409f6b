#include <array>
#include <cmath>

#include "interflect/scene/primitives.h"
#include "interflect/scene/welder.h"

namespace interflect {

namespace {

// The published control points, in the published frame (z upwards). The set is symmetric: rim, body, lid and bottom are
// four quarter turns of one quarter, handle and spout are a half and its mirror image. Each quarter is a row of four
// rings: (r, 0), (r, -k), (k, -r), (0, -r) at height z.
struct Ring {
  double r, k, z;
};
constexpr double k56 = 0.56;  // Newell's quarter circle: k = 0.56 r, close to 4 (sqrt(2) - 1) / 3
constexpr Ring ring(double r, double z) {
  return {r, k56 * r, z};
}
using Profile = std::array<Ring, 4>;
constexpr std::array<Profile, 6> profiles{{
    {ring(1.4, 2.4), ring(1.3375, 2.53125), ring(1.4375, 2.53125), ring(1.5, 2.4)},  // rim
    {ring(1.5, 2.4), ring(1.75, 1.875), ring(2, 1.35), ring(2, 0.9)},                // upper body
    {ring(2, 0.9), ring(2, 0.45), ring(1.5, 0.225), ring(1.5, 0.15)},                // lower body
    {ring(1.5, 0.15), ring(1.5, 0.075), ring(1.425, 0), ring(0, 0)},                 // bottom
    {ring(0, 3.15), Ring{0.8, 0.45, 3.15}, ring(0, 2.85), ring(0.2, 2.7)},           // knob
    {ring(0.2, 2.7), ring(0.4, 2.55), ring(1.3, 2.55), ring(1.3, 2.4)},              // lid
}};

// Half a tube: four rows of an inner and an outer point in the plane y = 0, joined across y = -width.
struct Rib {
  double inner_x, inner_z, outer_x, outer_z, width;
};
using Tube = std::array<Rib, 4>;
constexpr std::array<Tube, 4> tubes{{
    {{{-1.6, 2.025, -1.5, 2.25, 0.3},  // upper handle
      {-2.3, 2.025, -2.5, 2.25, 0.3},
      {-2.7, 2.025, -3.0, 2.25, 0.3},
      {-2.7, 1.8, -3.0, 1.8, 0.3}}},
    {{{-2.7, 1.8, -3.0, 1.8, 0.3},  // lower handle
      {-2.7, 1.575, -3.0, 1.35, 0.3},
      {-2.5, 1.125, -2.65, 0.9375, 0.3},
      {-2.0, 0.9, -1.9, 0.6, 0.3}}},
    {{{1.7, 1.425, 1.7, 0.6, 0.66},  // spout
      {2.6, 1.425, 3.1, 0.825, 0.66},
      {2.3, 2.1, 2.4, 2.025, 0.25},
      {2.7, 2.4, 3.3, 2.4, 0.25}}},
    {{{2.7, 2.4, 3.3, 2.4, 0.25},  // its lip
      {2.8, 2.475, 3.525, 2.49375, 0.25},
      {2.9, 2.475, 3.45, 2.5125, 0.15},
      {2.8, 2.4, 3.2, 2.4, 0.15}}},
}};

using Patch = std::array<std::array<Vec3, 4>, 4>;

/// De Casteljau's steps along one curve. std::lerp is exact at 0 and 1 and between equal ends, and treats mirror images
/// alike; so an edge depends on its own control points only, neighbours that share them get the same bits, rings stay
/// level and poles are single points.
Vec3 evaluate(std::array<Vec3, 4> c, double t) {
  for (std::size_t left = 3; left > 0; --left) {
    for (std::size_t i = 0; i < left; ++i) {
      c[i] = {std::lerp(c[i].x, c[i + 1].x, t), std::lerp(c[i].y, c[i + 1].y, t), std::lerp(c[i].z, c[i + 1].z, t)};
    }
  }
  return c[0];
}

Vec3 evaluate(const Patch& patch, double u, double v) {
  return evaluate({evaluate(patch[0], v), evaluate(patch[1], v), evaluate(patch[2], v), evaluate(patch[3], v)}, u);
}

Patch quarter(const Profile& profile) {
  Patch patch;
  for (std::size_t i = 0; i < 4; ++i) {
    const auto [r, k, z] = profile[i];
    patch[i] = {Vec3{r, 0, z}, {r, -k, z}, {k, -r, z}, {0, -r, z}};
  }
  return patch;
}

Patch half(const Tube& tube) {
  Patch patch;
  for (std::size_t i = 0; i < 4; ++i) {
    const auto [ix, iz, ox, oz, w] = tube[i];
    patch[i] = {Vec3{ix, 0, iz}, {ix, -w, iz}, {ox, -w, oz}, {ox, 0, oz}};
  }
  return patch;
}

/// The patch tessellated; `place` moves a sample, and `flip` says that the front is on the other side.
template <class Place>
void tessellate(Welder& mesh, const Patch& patch, int n, bool flip, const Place& place) {
  const auto at = [&](int i, int j) {
    const Vec3 p = place(evaluate(patch, static_cast<double>(i) / n, static_cast<double>(j) / n));
    return Vec3{p.x, p.z, -p.y};  // y upwards
  };
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) {
      const Vec3 a = at(i, j), b = at(i + 1, j), c = at(i + 1, j + 1), d = at(i, j + 1);
      if (flip) {
        mesh.quad(a, d, c, b);
      } else {
        mesh.quad(a, b, c, d);
      }
    }
  }
}

}  // namespace

SurfaceMesh make_teapot(int division) {
  Welder mesh;
  for (const Profile& profile : profiles) {
    const Patch patch = quarter(profile);
    tessellate(mesh, patch, division, true, [](Vec3 p) { return p; });
    tessellate(mesh, patch, division, true, [](Vec3 p) { return Vec3{p.y, -p.x, p.z}; });
    tessellate(mesh, patch, division, true, [](Vec3 p) { return Vec3{-p.x, -p.y, p.z}; });
    tessellate(mesh, patch, division, true, [](Vec3 p) { return Vec3{-p.y, p.x, p.z}; });
  }
  for (const Tube& tube : tubes) {
    const Patch patch = half(tube);
    tessellate(mesh, patch, division, true, [](Vec3 p) { return p; });
    tessellate(mesh, patch, division, false, [](Vec3 p) { return Vec3{p.x, -p.y, p.z}; });
  }
  return mesh.take();
}

}  // namespace interflect
