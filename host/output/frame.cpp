#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "interflect/output/lens.h"
#include "interflect/output/output.h"
#include "interflect/output/sight.h"
#include "interflect/output/tone.h"

namespace interflect {

namespace {

constexpr double degree = std::numbers::pi / 180;
constexpr double inside_fov = 65 * degree, outside_fov = 40 * degree;

/// Direction k of n, spread evenly over the sphere (a Fibonacci spiral).
Vec3 sphere_direction(int k, int n) {
  const double z = 1 - (2 * k + 1.0) / n, r = std::sqrt(1 - z * z);
  const double angle = k * std::numbers::pi * (3 - std::sqrt(5.0));
  return {r * std::cos(angle), r * std::sin(angle), z};
}

/// The axis along which light falls, else the short one, else y (see output.h).
Vec3 find_up(const PatchMesh& mesh, Vec3 size) {
  Vec3 shine{};
  double lamps = 0;
  for (std::size_t i = 0; i < mesh.size(); ++i) {
    if (!emits(mesh.emittance[i])) continue;
    shine += mesh.normal[i] * mesh.area[i];
    lamps += mesh.area[i];
  }
  if (lamps > 0) {
    shine = shine / lamps;
    if (shine.y < -0.5) return {0, 1, 0};
    if (shine.z < -0.5) return {0, 0, 1};
  }
  return size.z < 0.8 * size.x && size.z < 0.8 * size.y ? Vec3{0, 0, 1} : Vec3{0, 1, 0};
}

/// What surrounds a point, over all directions.
struct Surroundings {
  double front = 0;    ///< share of directions that meet a front
  double back = 0;     ///< ... a back; the rest meets nothing
  double nearest = 0;  ///< distance of the nearest front
};

/// What a camera shows, from a coarse grid of rays.
struct View {
  double front = 0, back = 0;  ///< shares of the rays
  double near = 0;             ///< share of the rays that meet something close by
  double diversity = 0;        ///< exp of the entropy of what is seen by surface and direction of its normal
  double depth = 0;            ///< mean distance
};

class Framing {
 public:
  Framing(const PatchMesh& mesh, double aspect)
      : mesh_(mesh), aspect_(aspect), sight_(mesh), up_(find_up(mesh, sight_.high() - sight_.low())) {
    ahead_ = cross(up_, side_);
    double area = 0;
    for (std::size_t i = 0; i < mesh.size(); ++i) {
      centre_ += mesh.centroid[i] * mesh.area[i];
      area += mesh.area[i];
    }
    centre_ = area > 0 ? centre_ / area : Vec3{};
  }

  [[nodiscard]] Camera choose() const {
    if (mesh_.size() == 0) return {};
    Camera best;
    double score = 0;
    try_inside(best, score);
    if (score <= 0) try_outside(best, score);
    return best;
  }

 private:
  /// A point of the bounding box: 0..1 to the side, upwards, ahead.
  [[nodiscard]] Vec3 at(double s, double h, double a) const {
    const Vec3 low = sight_.low(), size = sight_.high() - low;
    const auto along = [&](Vec3 axis, double t) {
      const double extent = dot(size, axis), begin = dot(low, axis);
      return axis * (begin + t * extent);
    };
    return along(side_, s) + along(up_, h) + along(Vec3{std::abs(ahead_.x), std::abs(ahead_.y), std::abs(ahead_.z)}, a);
  }

  [[nodiscard]] Surroundings surroundings(Vec3 eye) const {
    constexpr int rays = 128;
    Surroundings s;
    s.nearest = sight_.extent();
    int fronts = 0;
    for (int k = 0; k < rays; ++k) {
      const auto seen = sight_.first(eye, sphere_direction(k, rays));
      if (!seen) continue;
      if (!seen->front) {
        s.back += 1.0 / rays;
        continue;
      }
      ++fronts;
      s.nearest = std::min(s.nearest, seen->distance);
    }
    s.front = static_cast<double>(fronts) / rays;
    return s;
  }

  [[nodiscard]] View view(const Camera& camera) const {
    constexpr int across = 48, down = 27;
    constexpr double rays = across * down;
    const Lens lens(camera, aspect_);
    std::vector<std::uint64_t> kinds;
    View v;
    for (int k = 0; k < across * down; ++k) {
      const int column = k % across, row = k / across;
      const Vec3 direction = normalized(lens.direction((column + 0.5) / across, (row + 0.5) / down));
      const auto seen = sight_.first(camera.eye, direction);
      if (!seen) continue;
      (seen->front ? v.front : v.back) += 1 / rays;
      if (!seen->front) continue;
      v.depth += seen->distance / rays;
      if (seen->distance < 0.12 * sight_.extent()) v.near += 1 / rays;
      kinds.push_back(kind(seen->patch));
    }
    std::sort(kinds.begin(), kinds.end());
    double entropy = 0;
    for (auto it = kinds.begin(); it != kinds.end();) {
      const auto end = std::upper_bound(it, kinds.end(), *it);
      const double share = static_cast<double>(end - it) / static_cast<double>(kinds.size());
      entropy -= share * std::log(share);
      it = end;
    }
    v.diversity = std::exp(entropy);
    return v;
  }

  /// Patches that look alike: same surface, normals in the same of 27 directions.
  [[nodiscard]] std::uint64_t kind(std::uint32_t patch) const {
    const Vec3 n = mesh_.normal[patch];
    std::uint64_t code = mesh_.surface[patch];
    for (int axis = 0; axis < 3; ++axis) code = 3 * code + static_cast<std::uint64_t>(std::lround(n[axis]) + 1);
    return code;
  }

  void try_inside(Camera& best, double& score) const;
  void try_outside(Camera& best, double& score) const;
  [[nodiscard]] Camera from_outside(double azimuth, double elevation) const;

  const PatchMesh& mesh_;
  double aspect_;
  Sight sight_;
  Vec3 up_, side_{1, 0, 0}, ahead_, centre_;  // up is y or z
};

/// Positions on a grid at about eye height, those in free space only; each looks at the centre and to both sides of it.
/// Only in a room: half of the free positions at least are surrounded by fronts, but for a window.
void Framing::try_inside(Camera& best, double& score) const {
  constexpr int grid = 12;
  constexpr double surrounded = 0.95;
  std::vector<Vec3> eyes;
  int free = 0, enclosed = 0;
  for (const double height : {0.55, 0.62, 0.48}) {
    for (int k = 0; k < grid * grid; ++k) {
      const int column = k % grid, row = k / grid;
      const Vec3 eye = at((column + 0.5) / grid, height, (row + 0.5) / grid);
      const Surroundings around = surroundings(eye);
      if (around.back > 0.005) continue;
      ++free;
      if (around.front > surrounded && around.nearest > 0.03 * sight_.extent()) eyes.push_back(eye);
      if (around.front > surrounded) ++enclosed;
    }
  }
  if (2 * enclosed < free) return;
  const Vec3 centre = centre_ - up_ * (0.04 * sight_.extent());
  for (const Vec3 eye : eyes) {
    if (length(centre - eye) < 0.1 * sight_.extent()) continue;
    for (const double turn : {0.0, 0.2, -0.2}) {
      const Vec3 ahead = centre - eye, aside = cross(ahead, up_);
      const Camera camera{eye, eye + ahead + aside * turn, up_, inside_fov};
      const View v = view(camera);
      const double value =
          v.front * (1 - 2 * v.back) * (1 - 2 * v.near) * std::sqrt(v.diversity) * v.depth / sight_.extent();
      if (value > score * (1 + 1e-9)) score = value, best = camera;
    }
  }
}

/// From this side, just far enough away to have the whole bounding box in the picture.
Camera Framing::from_outside(double azimuth, double elevation) const {
  const Vec3 middle = at(0.5, 0.5, 0.5);
  const Vec3 towards =
      (side_ * std::sin(azimuth) + ahead_ * std::cos(azimuth)) * std::cos(elevation) + up_ * std::sin(elevation);
  Camera camera{middle + towards, middle, up_, outside_fov};
  const Lens lens(camera, aspect_);
  double distance = 0;
  for (int k = 0; k < 8; ++k) {
    const Vec3 corner = at(k & 1, (k >> 1) & 1, (k >> 2) & 1) - middle;
    const double across = std::abs(dot(corner, lens.right())) / lens.half_width();
    const double upwards = std::abs(dot(corner, lens.up())) / lens.half_height();
    distance = std::max(distance, 1.04 * std::max(across, upwards) + dot(corner, towards));
  }
  camera.eye = middle + towards * distance;
  return camera;
}

void Framing::try_outside(Camera& best, double& score) const {
  best = from_outside(0, 0);
  for (const double elevation : {0.0, 15.0, 30.0, 50.0, -20.0}) {
    for (int turn = 0; turn < 24; ++turn) {
      const Camera camera = from_outside(turn * 15 * degree, elevation * degree);
      const View v = view(camera);
      const double met = v.front + v.back;
      if (met <= 0) continue;
      // Backs spoil a view: what lies behind them is seen through them, but not as part of the same space.
      const double value = v.front * v.front / met * std::sqrt(v.diversity) * (elevation < 0 ? 0.7 : 1);
      if (value > score * (1 + 1e-9)) score = value, best = camera;
    }
  }
}

}  // namespace

Camera frame_scene(const PatchMesh& mesh, double aspect) {
  return Framing(mesh, aspect).choose();
}

}  // namespace interflect
