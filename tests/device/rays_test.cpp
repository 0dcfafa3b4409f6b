#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "device/broken_device.h"
#include "device/cuda_on_cpu_device.h"
#include "interflect/base/error.h"
#include "interflect/device/check_tools.h"
#include "interflect/device/hierarchy.h"
#include "interflect/device/kernel_arguments.h"
#include "interflect/device/registry.h"
#include "sanitized.h"

// The hierarchy that devices traverse and the shadow rays through it: on the processor's own kernel, on the CUDA kernel
// as C++, and broken ones.

namespace interflect {
namespace {

using Indices = std::array<std::uint32_t, 3>;
using test::sanitized;

std::string describe(const KernelCheck& row) {
  return row.kernel + " n=" + std::to_string(row.size) + " " + row.parameters + ": error " + std::to_string(row.error) +
         " " + row.reason;
}

struct Mesh {
  std::vector<Vec3> vertices;
  std::vector<Indices> triangles;
};

Mesh soup(std::size_t count) {
  std::mt19937 random(7);
  const auto in_cube = [&] {
    const auto one = [&] { return static_cast<double>(random()) / 4294967296.0 * 10 - 5; };
    const double x = one(), y = one(), z = one();
    return Vec3{x, y, z};
  };
  Mesh mesh;
  for (std::uint32_t k = 0; k < count; ++k) {
    const Vec3 a = in_cube();
    for (const Vec3 p : {a, a + 0.1 * in_cube(), a + 0.1 * in_cube()}) mesh.vertices.push_back(p);
    mesh.triangles.push_back({3 * k, 3 * k + 1, 3 * k + 2});
  }
  return mesh;
}

Mesh identical(std::size_t count) {
  return {{{0, 0, 1}, {1, 0, 1}, {0, 1, 1}}, std::vector<Indices>(count, Indices{0, 1, 2})};
}

/// Triangles that halve in size and distance, so that every cut by area takes off a few.
Mesh shrinking(std::size_t count) {
  Mesh mesh;
  double size = 1e18;
  for (std::uint32_t k = 0; k < count; ++k, size *= 0.93) {
    for (const Vec3 p : {Vec3{size, 0, 0}, Vec3{size, size, 0}, Vec3{size, 0, size}}) mesh.vertices.push_back(p);
    mesh.triangles.push_back({3 * k, 3 * k + 1, 3 * k + 2});
  }
  return mesh;
}

struct Box {
  Vec3 low, high;
};

/// A hierarchy as the kernels read it, walked in double.
class Walk {
 private:
  const Hierarchy& hierarchy_;

 public:
  std::vector<int> node_visits;
  explicit Walk(const Hierarchy& hierarchy) : hierarchy_(hierarchy), node_visits(hierarchy.node_count()) {
    visit(0, 1);
  }
  std::uint32_t levels = 0;
  std::vector<std::array<float, 9>> triangles;  ///< with an extent
  std::size_t outside = 0;                      ///< vertices out of the box that leads to them

 private:
  void visit(std::uint32_t node, std::uint32_t level) {
    levels = std::max(levels, level);
    ++node_visits[node];
    const auto words = hierarchy_.nodes().subspan(std::size_t{node} * Hierarchy::node_words, Hierarchy::node_words);
    for (std::size_t k = 0; k < 4; ++k) {
      if (k > 0 && words[12 + k] == words[11 + k]) {  // absent: its box is empty
        for (std::size_t axis = 0; axis < 3; ++axis) EXPECT_GT(side(words, 4 + axis, k), side(words, 8 + axis, k));
        continue;
      }
      const Box box{{side(words, 4, k), side(words, 5, k), side(words, 6, k)},
                    {side(words, 8, k), side(words, 9, k), side(words, 10, k)}};
      const std::uint32_t child = words[12 + k];
      if ((child & Hierarchy::leaf_bit) == 0) {
        visit(child, level + 1);
      } else {
        leaf(child & ~Hierarchy::leaf_bit, box);
      }
    }
  }
  static double side(std::span<const std::uint32_t> words, std::size_t word, std::size_t child) {
    float corner = 0;
    std::memcpy(&corner, &words[word % 4], sizeof corner);
    const int exponent = static_cast<int>(words[3] >> (8 * (word % 4)) & 255U) - 127;
    return static_cast<double>(corner) + std::ldexp(words[word] >> (8 * child) & 255U, exponent);
  }
  void leaf(std::uint32_t number, const Box& box) {
    const float* f = &hierarchy_.leaves()[std::size_t{number} * Hierarchy::leaf_floats];
    for (std::size_t k = 0; k < 4; ++k) {
      std::array<float, 9> t{};
      for (std::size_t c = 0; c < 9; ++c) t[c] = f[4 * c + k];
      if (t[0] == t[3] && t[0] == t[6] && t[1] == t[4] && t[1] == t[7] && t[2] == t[5] && t[2] == t[8]) continue;
      triangles.push_back(t);
      for (std::size_t c = 0; c < 3; ++c) {
        const Vec3 p{static_cast<double>(t[3 * c]), static_cast<double>(t[3 * c + 1]),
                     static_cast<double>(t[3 * c + 2])};
        for (int axis = 0; axis < 3; ++axis) outside += p[axis] < box.low[axis] || p[axis] > box.high[axis] ? 1 : 0;
      }
    }
  }
};

void expect_sound(const Mesh& mesh, const std::string& name) {
  const Hierarchy hierarchy(mesh.vertices, mesh.triangles);
  const Walk walk(hierarchy);
  EXPECT_EQ(walk.outside, 0U) << name;
  EXPECT_EQ(walk.levels, hierarchy.levels()) << name;
  EXPECT_LE(walk.levels, Hierarchy::most_levels) << name;
  for (const int visits : walk.node_visits) EXPECT_EQ(visits, 1) << name;
  std::vector<std::array<float, 9>> expected;
  for (const Indices& t : mesh.triangles) {
    auto& corners = expected.emplace_back();
    for (std::size_t c = 0; c < 3; ++c) {
      for (int axis = 0; axis < 3; ++axis) {
        corners[3 * c + static_cast<std::size_t>(axis)] = static_cast<float>(mesh.vertices[t[c]][axis]);
      }
    }
  }
  std::vector<std::array<float, 9>> found = walk.triangles;
  std::sort(found.begin(), found.end());
  std::sort(expected.begin(), expected.end());
  EXPECT_EQ(found, expected) << name;
}

TEST(HierarchyOfTriangles, EveryTriangleIsInOneLeafAndInTheBoxesAboveIt) {
  for (const std::size_t count : {1U, 2U, 3U, 4U, 5U, 16U, 17U, 1000U}) expect_sound(soup(count), "soup");
  expect_sound(identical(10000), "identical");
  const Mesh deep = shrinking(1100);
  expect_sound(deep, "shrinking");
  EXPECT_EQ(Hierarchy(deep.vertices, deep.triangles).levels(), Hierarchy::most_levels) << "the limit is never reached";
}

TEST(HierarchyOfTriangles, IsTheSameEveryTimeAndShallow) {
  const Mesh mesh = soup(5000);
  const Hierarchy first(mesh.vertices, mesh.triangles), second(mesh.vertices, mesh.triangles);
  EXPECT_TRUE(std::equal(first.nodes().begin(), first.nodes().end(), second.nodes().begin(), second.nodes().end()));
  EXPECT_TRUE(std::equal(first.leaves().begin(), first.leaves().end(), second.leaves().begin(), second.leaves().end()));
  EXPECT_LE(first.levels(), 10U);
  EXPECT_LE(first.leaf_count(), 2500U) << "leaves of fewer than two triangles";
  EXPECT_LE(Hierarchy(identical(10000).vertices, identical(10000).triangles).levels(), 7U);
}

TEST(HierarchyOfTriangles, WithoutTrianglesHasARootAndALeafThatHideNothing) {
  const Hierarchy hierarchy({}, {});
  EXPECT_EQ(hierarchy.node_count(), 1U);
  EXPECT_EQ(hierarchy.leaf_count(), 1U);
  EXPECT_EQ(hierarchy.levels(), 1U);
}

TEST(ShadowRays, OpenMPAgreesWithTheReference) {
  const auto device = open_device("openmp");
  std::vector<KernelCheck> rows;
  check::check_rays(*device, rows, {.max_size = sanitized ? 300 : every_size});
  EXPECT_GE(rows.size(), sanitized ? 14U : 22U);
  for (const KernelCheck& row : rows) EXPECT_EQ(row.status, CheckStatus::pass) << describe(row);
}

TEST(ShadowRays, ALaunchThatCannotRunIsRefused) {
  const auto device = open_device("openmp");
  const auto kernel = device->kernel("shadow_rays", {});
  const auto launch = [&](ShadowRayArguments a, std::uint32_t groups, std::size_t ray_floats) {
    // A root without triangles, so that a launch that is not refused ends.
    const Hierarchy hierarchy({}, {});
    const auto nodes = device->allocate(64), leaves = device->allocate(144), rays = device->allocate(4 * ray_floats),
               hidden = device->allocate(4 * 256);
    device->queue().upload(*nodes, 0, std::as_bytes(hierarchy.nodes()));
    Buffer* const buffers[] = {nodes.get(), leaves.get(), rays.get(), hidden.get()};
    device->queue().launch(*kernel, groups, buffers, std::as_bytes(std::span(&a, 1)), "Test");
  };
  launch({.rays = 128, .nodes = 1, .leaves = 1}, 1, 1024);
  EXPECT_THROW(launch({.rays = 0, .nodes = 1, .leaves = 1}, 1, 1024), Error);
  EXPECT_THROW(launch({.rays = 129, .nodes = 1, .leaves = 1}, 1, 2048), Error) << "too many for a group";
  EXPECT_THROW(launch({.rays = 128, .nodes = 1, .leaves = 1}, 1, 1023), Error) << "the rays' buffer is too small";
  EXPECT_THROW(launch({.rays = 1, .nodes = 2, .leaves = 1}, 1, 1024), Error) << "the nodes' buffer is too small";
}

/// Broken in what a hierarchy or a kernel may get wrong, by changing what the kernel reads or wrote.
std::size_t failures(const test::ReplacedKernelDevice::Replacement& replacement) {
  test::ReplacedKernelDevice device(open_device("openmp"), "shadow_rays", replacement);
  std::vector<KernelCheck> rows;
  check::check_rays(device, rows, {.max_size = 300});
  EXPECT_GT(rows.size(), 10U);
  return static_cast<std::size_t>(
      std::count_if(rows.begin(), rows.end(), [](const KernelCheck& r) { return r.status == CheckStatus::fail; }));
}

void run_real(test::Launched& call, std::vector<std::vector<float>>& buffers) {
  const auto device = open_device("openmp");
  std::vector<std::unique_ptr<Buffer>> owners;
  std::vector<Buffer*> pointers;
  for (const auto& values : buffers) {
    owners.push_back(device->allocate(values.size() * sizeof(float)));
    device->queue().upload(*owners.back(), 0, std::as_bytes(std::span(values)));
    pointers.push_back(owners.back().get());
  }
  device->queue().launch(*device->kernel("shadow_rays", {}), call.groups, pointers, call.arguments, "Test");
  device->queue().download(*owners[3], 0, std::as_writable_bytes(std::span(buffers[3])));
  call.buffers[3] = buffers[3];
}

TEST(ShadowRaysTwins, TheReplacementItselfPasses) {
  EXPECT_EQ(failures([](test::Launched& call) {
              auto buffers = call.buffers;
              run_real(call, buffers);
            }),
            0U);
}

TEST(ShadowRaysTwins, ABoxThatIsTooSmallIsSeen) {
  EXPECT_GT(failures([](test::Launched& call) {
              auto buffers = call.buffers;
              const auto nodes = call.as<ShadowRayArguments>().nodes;
              for (std::size_t n = 0; n < nodes; ++n) {  // the high x of each first child, by a tenth of the node
                std::uint32_t word = 0;
                std::memcpy(&word, &buffers[0][16 * n + 8], sizeof word);
                const std::uint32_t high = word & 255U;
                word = (word & ~255U) | (high > 25 ? high - 25 : 0);
                std::memcpy(&buffers[0][16 * n + 8], &word, sizeof word);
              }
              run_real(call, buffers);
            }),
            0U);
}

TEST(ShadowRaysTwins, ASkippedTriangleIsSeen) {
  EXPECT_GT(failures([](test::Launched& call) {
              auto buffers = call.buffers;
              for (std::size_t c = 3; c < 9; ++c)
                buffers[1][4 * c] = buffers[1][4 * (c % 3)];  // the first becomes a point
              run_real(call, buffers);
            }),
            0U);
}

TEST(ShadowRaysTwins, RaysThatGoOnPastTheirEndAreSeen) {
  EXPECT_GT(failures([](test::Launched& call) {
              auto buffers = call.buffers;
              for (std::size_t k = 0; k < call.as<ShadowRayArguments>().rays; ++k) {
                if (buffers[2][8 * k + 7] > 0) buffers[2][8 * k + 7] = 100;
              }
              run_real(call, buffers);
            }),
            0U);
}

// The CUDA kernel as C++.

TEST(CudaRays, AgreeWithTheReference) {
  cuda_on_cpu::use_order(cuda_on_cpu::Order::shuffled);
  test::CudaOnCpu device;
  std::vector<KernelCheck> rows;
  check::check_rays(device, rows, {.max_size = sanitized ? 65 : every_size});
  EXPECT_GE(rows.size(), sanitized ? 10U : 22U);
  for (const KernelCheck& row : rows) EXPECT_EQ(row.status, CheckStatus::pass) << describe(row);
  cuda_on_cpu::use_order(cuda_on_cpu::Order::forwards);
}

class BrokenRays : public testing::TestWithParam<const char*> {};
// tests/device/fake_cuda/CMakeLists.txt says what each is.
INSTANTIATE_TEST_SUITE_P(Defects, BrokenRays,
                         testing::Values("BoxTooSmall", "TriangleSkipped", "FarIgnored", "NearIgnored",
                                         "BacksLetThrough", "EdgesLeak", "ChildForgotten", "StackForgotten",
                                         "LastRayForgotten"),
                         [](const auto& info) { return std::string(info.param); });

TEST_P(BrokenRays, FailTheCheck) {
  test::CudaOnCpu device(GetParam());
  std::vector<KernelCheck> rows;
  check::check_rays(device, rows, {.max_size = 300});
  EXPECT_TRUE(
      std::any_of(rows.begin(), rows.end(), [](const KernelCheck& r) { return r.status == CheckStatus::fail; }));
}

}  // namespace
}  // namespace interflect
