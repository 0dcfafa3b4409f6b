#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>

#include "interflect/base/vec3.h"
#include "interflect/formfactor/shadow_rays.h"

namespace interflect {

/// Rays against a set of triangles, through Embree. Safe to use from several threads at once.
class Visibility {
 public:
  /// Builds the hierarchy over triangles given as indices into vertices. Throws a limit or internal Error when Embree
  /// does.
  Visibility(std::span<const Vec3> vertices, std::span<const std::array<std::uint32_t, 3>> triangles);
  Visibility(const Visibility&) = delete;
  Visibility& operator=(const Visibility&) = delete;
  ~Visibility();

  /// The nearest triangle along origin + t direction, near < t < far.
  struct Hit {
    std::uint32_t triangle = 0;
    float t = 0;
    float u = 0, v = 0;  ///< barycentric: point = (1 − u − v) a + u b + v c
    bool front = false;  ///< the ray met the side from which the vertices run counter-clockwise
  };
  struct Ray {
    std::array<float, 3> origin{};
    float near = 0;
    std::array<float, 3> direction{};
    float far = 0;
  };
  [[nodiscard]] std::optional<Hit> closest(const Ray& ray) const;
  /// The same for many rays, which is several times as fast where neighbours in the list are neighbours in space.
  /// hits[k].triangle is `nothing` where ray k meets none.
  static constexpr std::uint32_t nothing = 0xFFFFFFFF;
  void closest(std::span<const Ray> rays, std::span<Hit> hits) const;

  /// occluded[k] = whether anything lies on rays[k] between near and far. Fastest in streams of about 1,000 rays,
  /// sorted so that neighbours start and end near each other.
  void occluded(std::span<const Ray> rays, std::span<bool> occluded) const;
  /// The same for rays[0 .. size): sets far.
  void occluded(ShadowRays& rays) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace interflect
