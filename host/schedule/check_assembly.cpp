#include "interflect/schedule/check_assembly.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/device/check_tools.h"
#include "interflect/formfactor/pair_tile.h"
#include "interflect/schedule/device_assembly.h"

namespace interflect::check {

namespace {

/// Triangles by hand, turned so that no face lies along an axis.
class Triangles {
 public:
  explicit Triangles(std::uint64_t seed) : random_(seed) {}

  void add(Vec3 a, Vec3 b, Vec3 c) {
    const auto first = static_cast<std::uint32_t>(mesh_.vertices.size());
    for (const Vec3 p : {a, b, c}) mesh_.vertices.push_back(turned(p));
    mesh_.corners.push_back({first, first + 1, first + 2});
    mesh_.source.push_back(static_cast<std::uint32_t>(mesh_.source.size()));
  }
  /// n x n cells of two triangles; the front along u x v.
  void plate(Vec3 o, Vec3 u, Vec3 v, int n) {
    for (int y = 0; y < n; ++y) {
      for (int x = 0; x < n; ++x) {
        const auto at = [&](int p, int q) { return o + (p / double(n)) * u + (q / double(n)) * v; };
        add(at(x, y), at(x + 1, y), at(x + 1, y + 1));
        add(at(x, y), at(x + 1, y + 1), at(x, y + 1));
      }
    }
  }
  /// The inside of a box, each face n x n cells.
  void room(Vec3 low, Vec3 high, int n) {
    const Vec3 d = high - low, x{d.x, 0, 0}, y{0, d.y, 0}, z{0, 0, d.z};
    plate(low, x, y, n);
    plate(low + z, y, x, n);
    plate(low, y, z, n);
    plate(low + x, z, y, n);
    plate(low, z, x, n);
    plate(low + y, x, z, n);
  }
  /// `count` random triangles of about the size 1 around a point.
  void cloud(Vec3 around, double spread, int count) {
    for (int k = 0; k < count; ++k) {
      const Vec3 c = around + spread * point();
      add(c + 0.6 * point(), c + 0.6 * point(), c + 0.6 * point());
    }
  }
  /// A tiny one that only makes the scene larger.
  void far_away(double distance) { add({distance, 0, 0}, {distance, 1e-3, 0}, {distance, 0, 1e-3}); }

  [[nodiscard]] PatchMesh mesh() && { return std::move(mesh_); }

 private:
  [[nodiscard]] Vec3 point() {
    const auto next = [&] { return static_cast<double>(random_.next()) / 1.5; };
    const double x = next(), y = next(), z = next();
    return {x, y, z};
  }
  [[nodiscard]] static Vec3 turned(Vec3 p) {
    const double c = std::cos(0.7), s = std::sin(0.7), e = std::cos(0.4), t = std::sin(0.4);
    const Vec3 q{c * p.x - s * p.y, s * p.x + c * p.y, p.z};
    return {q.x, e * q.y - t * q.z, t * q.y + e * q.z};
  }
  Random random_;
  PatchMesh mesh_;
};

struct Case {
  const char* name;
  double bound;
  PatchMesh (*mesh)();
  std::uint32_t rays = 0;  ///< of every pair
};

// The bounds without rays are four times what was measured on PoCL and lavapipe, at most: the contour form's sums in
// single precision, and for far pairs rounding alone. With rays: every ray ends as it does in double precision, so that
// an hidden share is off by the rounding of the weights.
const Case cases[] = {
    {"far", 1.5e-10,
     [] {
       Triangles t(1);
       t.plate({0, 0, 0}, {0, 2, 0}, {0, 0, 2}, 4);
       t.plate({25, 1, 0}, {3, 0, 2}, {1, 2, 0}, 4);
       return std::move(t).mesh();
     }},
    {"middle", 3e-8,
     [] {
       Triangles t(2);
       t.plate({0, 0, 0}, {0, 1, 0}, {0, 0, 1}, 2);
       t.plate({1.6, 0.2, 0}, {0.1, 0, 1}, {0.2, 1, 0}, 2);
       return std::move(t).mesh();
     }},
    {"near", 1e-6,
     [] {
       Triangles t(3);
       for (int k = 0; k < 20; ++k) {
         t.plate({0.3 * k, 0, 0}, {0.3, 0, 0}, {0, 0.2 + 0.02 * k, 0}, 1);
         t.plate({0.3 * k, 0, 0.11}, {0, 0.2, 0}, {0.3, 0, 0.002 * k}, 1);
       }
       return std::move(t).mesh();
     }},
    {"straddle", 2.4e-5,
     [] {
       Triangles t(4);
       t.cloud({0, 0, 0}, 1, 96);
       return std::move(t).mesh();
     }},
    {"coplanar", 1e-12,
     [] {
       Triangles t(5);
       t.plate({0, 0, 0}, {3, 0.5, 0.2}, {-0.4, 3, 0.1}, 5);
       return std::move(t).mesh();
     }},
    {"touching", 1.2e-6,
     [] {
       Triangles t(6);
       t.room({0, 0, 0}, {1, 1.3, 0.9}, 3);
       return std::move(t).mesh();
     }},
    {"small", 1e-6,  // a room of centimetres in a scene of 100 m
     [] {
       Triangles t(7);
       t.room({30, 5, 2}, {30.05, 5.04, 2.03}, 2);
       t.far_away(-100);
       return std::move(t).mesh();
     }},
    {"hidden", 1.5e-6,
     [] {
       Triangles t(8);
       t.room({0, 0, 0}, {3, 4, 2.5}, 2);
       t.plate({0.5, 1, 1.1}, {1.7, 0.3, 0.2}, {-0.2, 1.6, 0.1}, 2);
       t.plate({2.5, 3, 0.3}, {-0.1, 0.2, 1.6}, {-1.4, 0.1, 0.1}, 2);
       return std::move(t).mesh();
     },
     64},
    {"many rays", 6e-7,  // the most that any accuracy gives a pair at first
     [] {
       Triangles t(9);
       t.plate({0, 0, 0}, {2, 0, 0}, {0, 2, 0}, 1);
       t.plate({0, 0, 2}, {0, 2, 0}, {2, 0, 0}, 1);
       t.add({0.5, 0.4, 1}, {1.6, 0.7, 1.1}, {0.8, 1.5, 0.9});
       return std::move(t).mesh();
     },
     4096},
};

constexpr std::uint64_t seed = 7;

/// Every pair gets so many rays, whatever they find.
RayBudget fixed_rays(std::uint32_t rays) {
  RayBudget budget;
  budget.most_in_pilot = rays;
  budget.pilot_per_factor = 1e12F;
  budget.rays_per_factor = 0;
  budget.fewest_when_mixed = 0;
  budget.split_from = 1e12F;
  return budget;
}

/// Moeller and Trumbore 1997: whether the segment meets the triangle inside.
bool meets(Vec3 origin, Vec3 direction, const std::array<Vec3, 3>& t) {
  const Vec3 e = t[1] - t[0], f = t[2] - t[0], p = cross(direction, f);
  const double determinant = dot(e, p);
  if (determinant == 0) return false;
  const Vec3 s = origin - t[0], q = cross(s, e);
  const double u = dot(s, p) / determinant, v = dot(direction, q) / determinant, at = dot(f, q) / determinant;
  return u >= 0 && v >= 0 && u + v <= 1 && at > 0 && at < 1;
}

/// The share of a pair's rays that all triangles leave.
double visible_share(const PatchTable& patches, std::uint32_t i, std::uint32_t j, const RayBudget& budget, double s) {
  const auto facet = [&](std::size_t patch, std::size_t other) {
    const kernel::Polygon whole(patches.triangle(patch)),
        part = kernel::clip(patches.triangle(patch), patches.plane(other),
                            patches.tolerance[patch] + patches.tolerance[other]);
    const bool straddles = kernel::area(whole) - kernel::area(part) > patches.tolerance[patch] * patches.radius[patch];
    return sampling::Facet(straddles ? part : whole, patches.front(patch));
  };
  const sampling::Facet a = facet(i, j), b = facet(j, i);
  const sampling::Square from = sampling::start(sampling::word(seed, i), j),
                         to = sampling::start(sampling::word(seed + 1, j), i);
  const Vec3 d{patches.centroid[0][i] - patches.centroid[0][j], patches.centroid[1][i] - patches.centroid[1][j],
               patches.centroid[2][i] - patches.centroid[2][j]};
  const double radii = patches.radius[i] + patches.radius[j];
  const bool far = length(d) > static_cast<double>(budget.ratios.three_points) * radii;
  double total = 0, free = 0;
  for (std::uint32_t k = 0; k < budget.most_in_pilot && s > 0; ++k) {
    const sampling::ShadowRay ray = sampling::shadow_ray(a, b, from, to, k, static_cast<float>(2e-6 * patches.extent));
    if (!(ray.weight > 0)) continue;
    const auto wide = [](sampling::Float3 v) { return Vec3{double(v.x), double(v.y), double(v.z)}; };
    bool hit = false;
    for (std::size_t t = 0; t < patches.size && !hit; ++t)
      hit = meets(wide(ray.origin), wide(ray.direction), patches.triangle(t));
    const double weight = far ? 1 : static_cast<double>(ray.weight);
    total += weight;
    if (!hit) free += weight;
  }
  return total > 0 ? free / total : 1;
}

std::vector<double> reference(const PatchTable& patches, const RayBudget& budget) {
  const std::size_t n = patches.size;
  std::vector<double> s(n * n);
  const Blockers nothing({}, {});
  PairTile tile(patches, nothing, seed, budget);
  for (std::size_t r = 0; r < patches.blocks(); ++r) {
    for (std::size_t c = r; c < patches.blocks(); ++c) {
      if (!tile.compute(r, c)) continue;
      for (std::size_t p = 0; p < PairTile::block * PairTile::block; ++p) {
        const std::size_t i = r * PairTile::block + p / PairTile::block, j = c * PairTile::block + p % PairTile::block;
        if (i >= j || j >= n) continue;
        double value = tile.s(p / PairTile::block, p % PairTile::block);
        if (budget.most_in_pilot > 0) {
          value *= visible_share(patches, static_cast<std::uint32_t>(i), static_cast<std::uint32_t>(j), budget, value);
        }
        s[i * n + j] = s[j * n + i] = value;
      }
    }
  }
  return s;
}

/// S in two panels whose padding holds sentinels.
Finding run_case(Device& device, const Case& which) {
  const PatchMesh mesh = which.mesh();
  const PatchTable patches(mesh);
  const Blockers nothing({}, {}), all(mesh, patches);
  const auto n = static_cast<std::uint32_t>(patches.size), stride = (n / 16 + 2) * 16, cut = n / 3;
  const auto rows_of = [&](std::uint32_t rows) {
    std::vector<float> values(std::size_t{rows} * stride, 0.0F);
    for (std::size_t k = 0; k < values.size(); ++k) values[k] = k % stride < n ? 0.0F : sentinel();
    return GuardedBuffer(device, values);
  };
  const GuardedBuffer first = rows_of(cut), second = rows_of(n - cut);
  const DevicePanel panels[] = {{0, cut, first.get()}, {cut, n - cut, second.get()}};
  ProgressSink silent;
  const RayBudget budget = fixed_rays(which.rays);
  static_cast<void>(assemble_on(device, patches, which.rays > 0 ? all : nothing, budget, seed, panels, stride, 0,
                                static_cast<std::uint32_t>(patches.blocks()), silent));
  std::vector<float> s = first.values(device);
  const std::vector<float> rest = second.values(device);
  s.insert(s.end(), rest.begin(), rest.end());
  const std::vector<double> expected = reference(patches, budget);
  Finding finding;
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j < stride; ++j) {
      const float value = s[i * stride + j];
      if (j >= n) {
        if (!is_sentinel(value)) finding.wrong = "the padding of a row was written";
        continue;
      }
      compare(finding, value, expected[i * n + j], std::min(patches.area[i], patches.area[j]));
      if (s[j * stride + i] != value) finding.wrong = "S is not symmetric";
    }
  }
  return finding;
}

}  // namespace

void check_assembly(Device& device, std::vector<KernelCheck>& rows, std::string_view only) {
  for (const Case& which : cases) {
    if (!only.empty() && only != which.name) continue;
    KernelCheck row;
    row.device = device.info().id;
    row.kernel = "assembly";
    row.parameters = fmt::format("{} seed={}", which.name, seed);
    row.bound = which.bound;
    if (device.info().backend == "openmp") {
      row.status = CheckStatus::unsupported;
      row.reason = "on the CPU the form factors come from Embree";
      rows.push_back(std::move(row));
      return;
    }
    row.size = which.mesh().size();
    add_case(rows, std::move(row), [&] { return run_case(device, which); });
  }
}

}  // namespace interflect::check
