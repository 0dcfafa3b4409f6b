#include "interflect/formfactor/visibility.h"

#include <embree3/rtcore.h>
#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <type_traits>

#include "interflect/base/error.h"

namespace interflect {

namespace {

struct ReleaseDevice {
  void operator()(RTCDevice device) const noexcept { rtcReleaseDevice(device); }
};
struct ReleaseScene {
  void operator()(RTCScene scene) const noexcept { rtcReleaseScene(scene); }
};
struct ReleaseGeometry {
  void operator()(RTCGeometry geometry) const noexcept { rtcReleaseGeometry(geometry); }
};
using DeviceHandle = std::unique_ptr<std::remove_pointer_t<RTCDevice>, ReleaseDevice>;
using SceneHandle = std::unique_ptr<std::remove_pointer_t<RTCScene>, ReleaseScene>;
using GeometryHandle = std::unique_ptr<std::remove_pointer_t<RTCGeometry>, ReleaseGeometry>;

void check(RTCDevice device) {
  const RTCError error = rtcGetDeviceError(device);
  if (error == RTC_ERROR_NONE) return;
  const ErrorKind kind = error == RTC_ERROR_OUT_OF_MEMORY ? ErrorKind::limit : ErrorKind::internal;
  throw Error(kind, fmt::format("Embree: error {}", static_cast<int>(error)));
}

constexpr std::size_t stream = 1024;

RTCRayHit query_of(const Visibility::Ray& ray) {
  RTCRayHit query{};
  query.ray.org_x = ray.origin[0];
  query.ray.org_y = ray.origin[1];
  query.ray.org_z = ray.origin[2];
  query.ray.dir_x = ray.direction[0];
  query.ray.dir_y = ray.direction[1];
  query.ray.dir_z = ray.direction[2];
  query.ray.tnear = ray.near;
  query.ray.tfar = ray.far;
  query.ray.mask = ~0U;
  query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
  return query;
}

Visibility::Hit hit_of(const RTCRayHit& query) {
  if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return {Visibility::nothing};
  // Embree's geometric normal is (b − a) × (c − a): the front looks along it.
  const float towards =
      query.hit.Ng_x * query.ray.dir_x + query.hit.Ng_y * query.ray.dir_y + query.hit.Ng_z * query.ray.dir_z;
  return {query.hit.primID, query.ray.tfar, query.hit.u, query.hit.v, towards < 0};
}

}  // namespace

struct Visibility::Impl {
  DeviceHandle device;
  SceneHandle scene;
};

Visibility::Visibility(std::span<const Vec3> vertices, std::span<const std::array<std::uint32_t, 3>> triangles)
    : impl_(std::make_unique<Impl>()) {
  impl_->device.reset(rtcNewDevice(nullptr));
  RTCDevice device = impl_->device.get();
  check(device);
  impl_->scene.reset(rtcNewScene(device));
  rtcSetSceneFlags(impl_->scene.get(), RTC_SCENE_FLAG_ROBUST);
  rtcSetSceneBuildQuality(impl_->scene.get(), RTC_BUILD_QUALITY_HIGH);
  if (!triangles.empty()) {
    const GeometryHandle geometry(rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE));
    auto* positions = static_cast<float*>(rtcSetNewGeometryBuffer(
        geometry.get(), RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 3 * sizeof(float), vertices.size()));
    auto* indices = static_cast<std::uint32_t*>(rtcSetNewGeometryBuffer(
        geometry.get(), RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 3 * sizeof(std::uint32_t), triangles.size()));
    check(device);
    for (const Vec3& p : vertices) {
      *positions++ = static_cast<float>(p.x);
      *positions++ = static_cast<float>(p.y);
      *positions++ = static_cast<float>(p.z);
    }
    for (const auto& t : triangles) indices = std::copy(t.begin(), t.end(), indices);
    rtcCommitGeometry(geometry.get());
    rtcAttachGeometryByID(impl_->scene.get(), geometry.get(), 0);
  }
  rtcCommitScene(impl_->scene.get());
  check(device);
}

Visibility::~Visibility() = default;

std::optional<Visibility::Hit> Visibility::closest(const Ray& ray) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  RTCRayHit query = query_of(ray);
  rtcIntersect1(impl_->scene.get(), &context, &query);
  const Hit hit = hit_of(query);
  return hit.triangle == nothing ? std::nullopt : std::optional(hit);
}

void Visibility::closest(std::span<const Ray> rays, std::span<Hit> hits) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  constexpr std::size_t at_once = 256;   // 20 KiB on the stack
  std::array<RTCRayHit, at_once> batch;  // NOLINT: filled below
  for (std::size_t first = 0; first < rays.size(); first += at_once) {
    const std::size_t count = std::min(at_once, rays.size() - first);
    for (std::size_t k = 0; k < count; ++k) batch[k] = query_of(rays[first + k]);
    rtcIntersect1M(impl_->scene.get(), &context, batch.data(), static_cast<unsigned>(count), sizeof(RTCRayHit));
    for (std::size_t k = 0; k < count; ++k) hits[first + k] = hit_of(batch[k]);
  }
}

void Visibility::occluded(std::span<const Ray> rays, std::span<bool> occluded) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  std::array<RTCRay, stream> batch;  // NOLINT: filled below, 48 KiB
  while (!rays.empty()) {
    const std::size_t count = std::min(rays.size(), stream);
    for (std::size_t k = 0; k < count; ++k) {
      const Ray& ray = rays[k];
      batch[k] = RTCRay{ray.origin[0],
                        ray.origin[1],
                        ray.origin[2],
                        ray.near,
                        ray.direction[0],
                        ray.direction[1],
                        ray.direction[2],
                        0,
                        ray.far,
                        ~0U,
                        static_cast<unsigned>(k),
                        0};
    }
    rtcOccluded1M(impl_->scene.get(), &context, batch.data(), static_cast<unsigned>(count), sizeof(RTCRay));
    for (std::size_t k = 0; k < count; ++k) occluded[k] = batch[k].tfar < 0;
    rays = rays.subspan(count);
    occluded = occluded.subspan(count);
  }
}

void Visibility::occluded(ShadowRays& rays) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  std::fill_n(rays.far.begin(), rays.size, 1.0F);
  for (std::size_t first = 0; first < rays.size; first += stream) {
    RTCRayNp batch{};  // time, mask, id and flags stay null: not used
    batch.org_x = rays.origin[0].data() + first;
    batch.org_y = rays.origin[1].data() + first;
    batch.org_z = rays.origin[2].data() + first;
    batch.dir_x = rays.direction[0].data() + first;
    batch.dir_y = rays.direction[1].data() + first;
    batch.dir_z = rays.direction[2].data() + first;
    batch.tnear = rays.near.data() + first;
    batch.tfar = rays.far.data() + first;
    rtcOccludedNp(impl_->scene.get(), &context, &batch,
                  static_cast<unsigned>(std::min<std::size_t>(stream, rays.size - first)));
  }
}

}  // namespace interflect
