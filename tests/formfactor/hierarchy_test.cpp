#include "interflect/device/hierarchy.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <string>
#include <vector>

#include "interflect/device/kernel_arguments.h"
#include "interflect/device/kernel_table.h"
#include "interflect/device/registry.h"
#include "interflect/formfactor/patch_table.h"
#include "interflect/formfactor/sampling.h"
#include "interflect/formfactor/visibility.h"
#include "interflect/scene/scene.h"
#include "sanitized.h"

// The shadow rays of the devices' hierarchy beside Embree's, on the patches of a room.

namespace interflect {
namespace {

using Ray = Visibility::Ray;

struct Room {
  Room()
      : mesh(subdivide(read_scene(std::string(INTERFLECT_SOURCE_DIR) + "/scenes/room-1312.obj"), {})), patches(mesh) {
    for (const Vec3 p : mesh.vertices) vertices.push_back(p - patches.centre);
  }
  PatchMesh mesh;
  PatchTable patches;
  std::vector<Vec3> vertices;
};

/// A point of a triangle, from two words.
Vec3 on_triangle(const std::array<Vec3, 3>& t, sampling::Square s) {
  const sampling::Inside at = sampling::in_triangle(sampling::unit(s.u), sampling::unit(s.v));
  return t[0] + static_cast<double>(at.u) * (t[1] - t[0]) + static_cast<double>(at.v) * (t[2] - t[0]);
}

/// From a point in front of one patch towards a point on another: inside it or, with `edges`, on one of its edges.
std::vector<Ray> rays_of(const PatchTable& p, std::size_t count, bool edges) {
  const double lift = 1e-5 * p.extent;
  std::vector<Ray> rays;
  for (std::uint64_t k = 0; rays.size() < count; ++k) {
    const std::uint64_t pair = sampling::hash(1, k);
    const std::size_t i = static_cast<std::uint32_t>(pair) % p.size, j = (pair >> 32) % p.size;
    const auto at = sampling::word(2, static_cast<std::uint32_t>(k)),
               to = sampling::word(3, static_cast<std::uint32_t>(k));
    const auto t = p.triangle(j);
    const Vec3 target = edges ? t[0] + to.u / 4294967296.0 * (t[1] - t[0]) : on_triangle(t, to);
    const Vec3 x = on_triangle(p.triangle(i), at) + lift * p.front(i);
    const Vec3 d = target + lift * p.front(j) - x;
    if (!(dot(d, p.front(i)) > 0 && dot(d, p.front(j)) < 0)) continue;
    const auto f = [](double v) { return static_cast<float>(v); };
    rays.push_back({{f(x.x), f(x.y), f(x.z)}, 0, {f(d.x), f(d.y), f(d.z)}, edges ? 2.0F : 1.0F});
  }
  return rays;
}

std::vector<bool> by_embree(const Room& room, const std::vector<Ray>& rays) {
  const Visibility visibility(room.vertices, room.mesh.corners);
  const auto hidden = std::make_unique<bool[]>(rays.size());
  visibility.occluded(rays, {hidden.get(), rays.size()});
  return std::vector<bool>(hidden.get(), hidden.get() + rays.size());
}

std::vector<bool> by_kernel(const Room& room, const std::vector<Ray>& rays) {
  const Hierarchy hierarchy(room.vertices, room.mesh.corners);
  const auto device = open_device("openmp");
  const auto filled = [&](std::span<const std::byte> bytes) {
    auto buffer = device->allocate(bytes.size());
    device->queue().upload(*buffer, 0, bytes);
    return buffer;
  };
  const auto nodes = filled(std::as_bytes(hierarchy.nodes())), leaves = filled(std::as_bytes(hierarchy.leaves())),
             from = filled(std::as_bytes(std::span(rays))), to = device->allocate(rays.size() * sizeof(std::uint32_t));
  const ShadowRayArguments a{static_cast<std::uint32_t>(rays.size()), hierarchy.node_count(), hierarchy.leaf_count()};
  Buffer* const buffers[] = {nodes.get(), leaves.get(), from.get(), to.get()};
  device->queue().launch(*device->kernel("shadow_rays", {}), (a.rays + rays_for_a_group - 1) / rays_for_a_group,
                         buffers, std::as_bytes(std::span(&a, 1)), "Test");
  std::vector<std::uint32_t> hidden(rays.size());
  device->queue().download(*to, 0, std::as_writable_bytes(std::span(hidden)));
  return std::vector<bool>(hidden.begin(), hidden.end());
}

std::size_t differing(const std::vector<bool>& a, const std::vector<bool>& b) {
  std::size_t count = 0;
  for (std::size_t k = 0; k < a.size(); ++k) count += a[k] != b[k] ? 1 : 0;
  return count;
}

constexpr std::size_t count = test::sanitized ? 20000 : 100000;

TEST(HierarchyBesideEmbree, OnlyRaysThatGrazeAnEdgeDiffer) {
  const Room room;
  const std::vector<Ray> rays = rays_of(room.patches, count, false);
  const std::vector<bool> embree = by_embree(room, rays), kernel = by_kernel(room, rays);
  const auto hidden = static_cast<std::size_t>(std::count(embree.begin(), embree.end(), true));
  EXPECT_GT(hidden, count / 10);
  EXPECT_LT(hidden, count - count / 10);
  // None differs here; a ray in 100,000 passes within rounding of an edge by chance.
  EXPECT_LE(differing(embree, kernel), 5U);
  // Rays that end half-way: what the comparison is worth.
  std::vector<Ray> shorter = rays;
  for (Ray& ray : shorter) ray.far = 0.5F;
  EXPECT_GT(differing(embree, by_kernel(room, shorter)), 500U);
}

/// Rays aimed at the edges of patches, and past them: nearly all go through two triangles' common edge, which neither
/// may let slip.
TEST(HierarchyBesideEmbree, RaysThroughEdgesDifferByFewAndLeaveNoRoom) {
  const Room room;
  const std::vector<Ray> rays = rays_of(room.patches, count, true);
  const std::vector<bool> embree = by_embree(room, rays), kernel = by_kernel(room, rays);
  const std::size_t differ = differing(embree, kernel);
  RecordProperty("differ", static_cast<int>(differ));
  EXPECT_LE(differ, count / 5000);
}

}  // namespace
}  // namespace interflect
