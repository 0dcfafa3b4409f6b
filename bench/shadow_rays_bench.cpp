// Shadow rays through the hierarchy of each device beside Embree: rays between patches, tile by tile as the assembly
// sends them, one ray for each pair of a tile that faces each other. All devices in turn, several rounds, the best of
// each.
//
//   shadow_rays_bench SCENE [RAYS [ROUNDS [DEVICE ...]]]      default 1,000,000 rays, 5 rounds, openmp opencl:0
//   vulkan:0

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <ctime>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "interflect/base/error.h"
#include "interflect/base/timer.h"
#include "interflect/device/hierarchy.h"
#include "interflect/device/kernel_arguments.h"
#include "interflect/device/kernel_table.h"
#include "interflect/device/registry.h"
#include "interflect/formfactor/patch_table.h"
#include "interflect/formfactor/sampling.h"
#include "interflect/formfactor/visibility.h"
#include "interflect/scene/patch_mesh.h"
#include "interflect/scene/scene.h"

namespace {

using namespace interflect;
using Ray = Visibility::Ray;

struct Room {
  explicit Room(const std::string& file)
      : mesh(subdivide(read_scene(file), {})), patches(mesh), vertices(mesh.vertices), triangles(mesh.corners) {
    for (Vec3& p : vertices) p = p - patches.centre;
  }
  PatchMesh mesh;
  PatchTable patches;
  std::vector<Vec3> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;
};

/// A point of a triangle, from two words.
Vec3 on_triangle(const std::array<Vec3, 3>& t, sampling::Square s) {
  const sampling::Inside at = sampling::in_triangle(sampling::unit(s.u), sampling::unit(s.v));
  return t[0] + static_cast<double>(at.u) * (t[1] - t[0]) + static_cast<double>(at.v) * (t[2] - t[0]);
}

/// Rays of random tiles.
std::vector<Ray> rays_of(const Room& room, std::size_t count) {
  constexpr std::size_t block = PatchTable::block;
  const PatchTable& p = room.patches;
  const double lift = 1e-5 * p.extent;
  std::vector<Ray> rays;
  for (std::uint64_t tile = 0; rays.size() < count; ++tile) {
    const std::uint64_t random = sampling::hash(1, tile);
    const std::size_t rows = random % p.blocks(), columns = (random >> 32) % p.blocks();
    for (std::size_t i = rows * block; i < std::min(p.size, (rows + 1) * block); ++i) {
      for (std::size_t j = columns * block; j < std::min(p.size, (columns + 1) * block); ++j) {
        const auto from =
            sampling::start(sampling::word(2, static_cast<std::uint32_t>(i)), static_cast<std::uint32_t>(j));
        const auto to =
            sampling::start(sampling::word(3, static_cast<std::uint32_t>(j)), static_cast<std::uint32_t>(i));
        const Vec3 x = on_triangle(p.triangle(i), from) + lift * p.front(i);
        const Vec3 d = on_triangle(p.triangle(j), to) + lift * p.front(j) - x;
        if (j <= i || dot(d, p.front(i)) <= 0 || dot(d, p.front(j)) >= 0) continue;
        rays.push_back({{static_cast<float>(x.x), static_cast<float>(x.y), static_cast<float>(x.z)},
                        0,
                        {static_cast<float>(d.x), static_cast<float>(d.y), static_cast<float>(d.z)},
                        1});
      }
    }
  }
  rays.resize(count);
  return rays;
}

/// One way to trace the rays: traces and says in how many seconds; the answers.
class Tracer {
 public:
  explicit Tracer(std::string of) : name(std::move(of)) {}
  virtual ~Tracer() = default;
  virtual void trace() = 0;
  virtual std::vector<bool> hidden() = 0;
  std::string name;
  double best = std::numeric_limits<double>::infinity();
  double best_of_core = best;  ///< processor time, which a busy machine distorts less
};

class Embree final : public Tracer {
 public:
  Embree(const Room& room, const std::vector<Ray>& rays)
      : Tracer("Embree"), rays_(rays), visibility_(room.vertices, room.triangles), out_(new bool[rays.size()]) {}
  void trace() override {
    constexpr std::size_t batch = 4096;
#pragma omp parallel for schedule(dynamic)
    for (std::size_t first = 0; first < rays_.size(); first += batch) {
      const std::size_t size = std::min(batch, rays_.size() - first);
      visibility_.occluded({rays_.data() + first, size}, {out_.get() + first, size});
    }
  }
  std::vector<bool> hidden() override {
    return std::vector<bool>(out_.get(), out_.get() + rays_.size());
  }

 private:
  const std::vector<Ray>& rays_;
  Visibility visibility_;
  std::unique_ptr<bool[]> out_;
};

class OnDevice final : public Tracer {
 public:
  OnDevice(const std::string& id, const Hierarchy& hierarchy, const std::vector<Ray>& rays)
      : Tracer(id),
        device_(open_device(id)),
        kernel_(device_->kernel("shadow_rays", {})),
        nodes_(filled(std::as_bytes(hierarchy.nodes()))),
        leaves_(filled(std::as_bytes(hierarchy.leaves()))),
        rays_(filled(std::as_bytes(std::span(rays)))),
        hidden_(device_->allocate(rays.size() * sizeof(std::uint32_t))),
        arguments_{static_cast<std::uint32_t>(rays.size()), hierarchy.node_count(), hierarchy.leaf_count()} {
    device_->queue().wait();
  }
  void trace() override {
    Buffer* const buffers[] = {nodes_.get(), leaves_.get(), rays_.get(), hidden_.get()};
    const std::uint32_t groups = (arguments_.rays + rays_for_a_group - 1) / rays_for_a_group;
    device_->queue().launch(*kernel_, groups, buffers, std::as_bytes(std::span(&arguments_, 1)), "Bench");
    device_->queue().wait();
  }
  std::vector<bool> hidden() override {
    std::vector<std::uint32_t> all(arguments_.rays);
    device_->queue().download(*hidden_, 0, std::as_writable_bytes(std::span(all)));
    return std::vector<bool>(all.begin(), all.end());
  }

 private:
  std::unique_ptr<Buffer> filled(std::span<const std::byte> bytes) {
    auto buffer = device_->allocate(bytes.size());
    device_->queue().upload(*buffer, 0, bytes);
    return buffer;
  }
  std::unique_ptr<Device> device_;
  std::unique_ptr<Kernel> kernel_;
  std::unique_ptr<Buffer> nodes_, leaves_, rays_, hidden_;
  ShadowRayArguments arguments_;
};

void run(const std::string& file, std::size_t count, int rounds, const std::vector<std::string>& devices) {
  const Room room(file);
  const std::vector<Ray> rays = rays_of(room, count);
  const Timer built;
  const Hierarchy hierarchy(room.vertices, room.triangles);
  fmt::print("{} triangles, {} nodes, {} leaves, {} levels, built in {:.3f} s; {} rays\n", room.triangles.size(),
             hierarchy.node_count(), hierarchy.leaf_count(), hierarchy.levels(), built.seconds(), rays.size());
  std::vector<std::unique_ptr<Tracer>> all;
  all.push_back(std::make_unique<Embree>(room, rays));
  for (const std::string& id : devices) all.push_back(std::make_unique<OnDevice>(id, hierarchy, rays));
  for (int round = 0; round < rounds; ++round) {
    for (const auto& tracer : all) {
      const Timer timer;
      const std::clock_t before = std::clock();
      tracer->trace();
      tracer->best = std::min(tracer->best, timer.seconds());
      tracer->best_of_core =
          std::min(tracer->best_of_core, static_cast<double>(std::clock() - before) / CLOCKS_PER_SEC);
    }
  }
  const std::vector<bool> expected = all.front()->hidden();
  for (const auto& tracer : all) {
    const std::vector<bool> hidden = tracer->hidden();
    std::size_t differ = 0;
    for (std::size_t k = 0; k < hidden.size(); ++k) differ += hidden[k] != expected[k] ? 1 : 0;
    const double millions = 1e-6 * static_cast<double>(rays.size());
    fmt::print(
        "{:10} {:7.2f} million rays/s, {:.3f} of Embree's; {:6.2f} million for a core's second, {:.3f} of Embree's; "
        "{} rays hidden, {} differ from Embree's\n",
        tracer->name, millions / tracer->best, all.front()->best / tracer->best, millions / tracer->best_of_core,
        all.front()->best_of_core / tracer->best_of_core, std::count(hidden.begin(), hidden.end(), true), differ);
  }
}

}  // namespace

int main(int count, char** words) {
  try {
    if (count < 2) {
      throw interflect::Error(interflect::ErrorKind::usage, "shadow_rays_bench SCENE [RAYS [ROUNDS [DEVICE ...]]]");
    }
    const std::size_t rays = count > 2 ? std::strtoull(words[2], nullptr, 10) : 1000000;
    const int rounds = count > 3 ? std::atoi(words[3]) : 5;
    std::vector<std::string> devices(words + std::min(count, 4), words + count);
    if (devices.empty()) devices = {"openmp", "opencl:0", "vulkan:0"};
    run(words[1], rays, rounds, devices);
    return 0;
  } catch (const interflect::Error& error) {
    fmt::print(stderr, "{}\n", error.what());
    return interflect::exit_status(error.kind());
  }
}
