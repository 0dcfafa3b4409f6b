// The assembly of S on the devices: as through Embree but where a ray grazes an edge, the same light after the closure,
// the same bits every time, and broken kernels that are seen.

#include "interflect/formfactor/assembly.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numeric>

#include "backends/devices.h"
#include "device/kernel_folder.h"
#include "formfactor/meshes.h"
#include "interflect/base/error.h"
#include "interflect/formfactor/pair_tile.h"
#include "interflect/schedule/check_assembly.h"
#include "interflect/schedule/device_assembly.h"
#include "interflect/solver/solver.h"
#include "sanitized.h"
#include "schedule/counting_device.h"

namespace interflect {
namespace {

constexpr std::uint64_t seed = 1;

struct Scenery {
  explicit Scenery(PatchMesh made) : mesh(std::move(made)) {}
  Scenery(const std::string& scene, double divide)
      : mesh(subdivide(read_scene(std::string(INTERFLECT_SOURCE_DIR) + "/scenes/" + scene), {.divide = divide})) {}
  PatchMesh mesh;
  PatchTable patches{mesh};
  Blockers blockers{mesh, patches};
  [[nodiscard]] std::size_t size() const { return patches.size; }
};

using Matrix = std::vector<float>;  ///< n x n, dense

/// S on a device, in panels of so many rows (0: one panel), a stride of 16 or more beyond n.
Matrix on_device(Device& device, const Scenery& scene, const DevicePace& pace = {}, std::uint32_t panel_rows = 0,
                 DeviceAssemblyFacts* facts = nullptr, const RayBudget& budget = {}) {
  const auto n = static_cast<std::uint32_t>(scene.size()), stride = (n / 16 + 1) * 16;
  if (panel_rows == 0) panel_rows = n;
  std::vector<std::unique_ptr<Buffer>> buffers;
  std::vector<DevicePanel> panels;
  for (std::uint32_t first = 0; first < n; first += panel_rows) {
    const std::uint32_t rows = std::min(panel_rows, n - first);
    buffers.push_back(device.allocate(std::size_t{rows} * stride * sizeof(float)));
    panels.push_back({first, rows, buffers.back().get()});
  }
  ProgressSink silent;
  const auto found = assemble_on(device, scene.patches, scene.blockers, budget, seed, panels, stride, 0,
                                 static_cast<std::uint32_t>(scene.patches.blocks()), silent, pace);
  if (facts != nullptr) *facts = found;
  Matrix s(std::size_t{n} * n), rows;
  for (const DevicePanel& panel : panels) {
    rows.resize(std::size_t{panel.rows} * stride);
    device.queue().download(*panel.buffer, 0, std::as_writable_bytes(std::span(rows)));
    for (std::uint32_t r = 0; r < panel.rows; ++r) {
      const auto row = rows.begin() + static_cast<std::ptrdiff_t>(std::size_t{r} * stride);
      std::copy(row, row + n, s.begin() + static_cast<std::ptrdiff_t>(std::size_t{panel.first + r} * n));
      EXPECT_TRUE(std::all_of(row + n, row + stride, [](float x) { return x == 0; })) << "padding of row " << r;
    }
  }
  return s;
}

Matrix through_embree(const Scenery& scene, TileFacts& facts, const RayBudget& budget) {
  const std::size_t n = scene.size(), blocks = scene.patches.blocks();
  Matrix s(n * n);
  PairTile tile(scene.patches, scene.blockers, seed, budget);
  for (std::size_t r = 0; r < blocks; ++r) {
    for (std::size_t c = r; c < blocks; ++c) {
      const bool any = tile.compute(r, c);
      facts.variance.push_back(any ? static_cast<float>(tile.variance()) : 0.0F);
      for (std::size_t p = 0; any && p < PairTile::block * PairTile::block; ++p) {
        const std::size_t a = p / PairTile::block, b = p % PairTile::block;
        const std::size_t i = r * PairTile::block + a, j = c * PairTile::block + b;
        if (i < j && j < n) s[i * n + j] = s[j * n + i] = static_cast<float>(tile.s(a, b));
      }
    }
  }
  facts.pairs_considered = tile.considered();
  facts.pairs_analytic = tile.analytic();
  facts.rays = tile.rays();
  return s;
}

struct Difference {
  double row_sum = 0;          ///< the largest, of row sums of F
  double beyond_rounding = 0;  ///< share of the pairs that are not 0 in either
  bool symmetric = true;
};
Difference difference(const Scenery& scene, const Matrix& a, const Matrix& b) {
  const std::size_t n = scene.size();
  Difference out;
  std::size_t pairs = 0, differ = 0;
  for (std::size_t i = 0; i < n; ++i) {
    double sum = 0;
    for (std::size_t j = 0; j < n; ++j) {
      const double x = static_cast<double>(a[i * n + j]), y = static_cast<double>(b[i * n + j]);
      sum += x - y;
      pairs += x != 0 || y != 0 ? 1U : 0U;
      const double least = std::min(scene.patches.area[i], scene.patches.area[j]);
      differ += std::abs(x - y) > std::max(1e-4 * std::max(x, y), 2e-6 * least) ? 1U : 0U;
      out.symmetric = out.symmetric && std::memcmp(&a[i * n + j], &a[j * n + i], sizeof(float)) == 0;
    }
    out.row_sum = std::max(out.row_sum, std::abs(sum) / scene.patches.area[i]);
  }
  out.beyond_rounding = static_cast<double>(differ) / static_cast<double>(std::max<std::size_t>(1, pairs));
  return out;
}

class AssemblyOnDevice : public test::OnDevice {};
INSTANTIATE_TEST_SUITE_P(All, AssemblyOnDevice, testing::Values("opencl:0", "vulkan:0", "cuda:0"), test::test_name);

/// Gives the tiles of a matrix.
class Replay final : public TileMaker {
 public:
  explicit Replay(const Matrix& s, std::size_t n) : s_(s), n_(n) {}
  [[nodiscard]] TileFacts make(std::size_t first, std::size_t end, const TileSink& sink,
                               ProgressSink& /*progress*/) override {
    const std::size_t blocks = (n_ + 31) / 32;
    std::vector<float> tile(32 * 32);
    for (std::size_t r = first; r < end; ++r) {
      for (std::size_t c = r; c < blocks; ++c) {
        for (std::size_t p = 0; p < tile.size(); ++p) {
          const std::size_t i = 32 * r + p / 32, j = 32 * c + p % 32;
          tile[p] = i < n_ && j < n_ ? s_[i * n_ + j] : 0;
        }
        sink(r, c, tile);
      }
    }
    TileFacts facts;
    facts.variance.resize(tiles_in_rows(first, end, blocks));
    return facts;
  }

 private:
  const Matrix& s_;
  std::size_t n_;
};

/// The red radiosities of S after its closure.
std::vector<float> light(const Scenery& scene, const Matrix& s) {
  AssemblyOptions options{.seed = seed};
  options.maker = [&](const PatchTable&, const Blockers&) { return std::make_unique<Replay>(s, scene.size()); };
  const FormFactors factors = assemble(scene.mesh, options);
  Columns reflectance(1, std::vector<float>(scene.size())), emittance = reflectance, radiosity;
  for (std::size_t i = 0; i < scene.size(); ++i) {
    reflectance[0][i] = static_cast<float>(scene.mesh.reflectance[i][0]);
    emittance[0][i] = static_cast<float>(scene.mesh.emittance[i][0]);
  }
  std::vector<std::unique_ptr<Device>> devices;
  devices.push_back(open_device("openmp"));
  Scheduler scheduler(factors.matrix, std::move(devices), 1);
  const SolveReport report =
      solve(scheduler, Method::cg, StopTest{}, scene.mesh.area, reflectance, emittance, radiosity);
  EXPECT_TRUE(report.converged);
  return radiosity.at(0);
}

void compare(Device& device, const char* name, const Scenery& scene, double row_sum, double share,
             const RayBudget& budget = {}) {
  TileFacts facts;
  DeviceAssemblyFacts found;
  const Matrix reference = through_embree(scene, facts, budget), s = on_device(device, scene, {}, 0, &found, budget);
  const Difference off = difference(scene, s, reference);
  const std::vector<float> expected = light(scene, reference), own = light(scene, s);
  double largest = 0, light_off = 0;
  for (std::size_t i = 0; i < scene.size(); ++i) {
    largest = std::max(largest, static_cast<double>(expected[i]));
    light_off = std::max(light_off, std::abs(static_cast<double>(own[i]) - static_cast<double>(expected[i])));
  }
  std::printf(
      "%s, %s: row sums differ by %.1e, radiosities by %.1e of the largest, %.1e of the pairs beyond rounding\n",
      device.info().id.c_str(), name, off.row_sum, light_off / largest, off.beyond_rounding);
  EXPECT_LE(off.row_sum, row_sum);
  EXPECT_LE(off.beyond_rounding, share);
  EXPECT_TRUE(off.symmetric);
  EXPECT_GT(largest, 0);
  EXPECT_LE(light_off, 1e-3 * largest);
  const auto about = [](std::uint64_t x) { return static_cast<double>(x); };
  EXPECT_NEAR(about(found.pairs_considered), about(facts.pairs_considered), 1e-4 * about(facts.pairs_considered));
  EXPECT_NEAR(about(found.pairs_analytic), about(facts.pairs_analytic), 1e-3 * about(facts.pairs_analytic) + 1);
  EXPECT_NEAR(about(found.rays), about(facts.rays), 1e-2 * about(facts.rays));
  ASSERT_EQ(found.tile_variance.size(), facts.variance.size());
  const auto sum = [](const std::vector<float>& all) { return std::accumulate(all.begin(), all.end(), 0.0); };
  std::printf("%s, %s: variance %.4e, through Embree %.4e\n", device.info().id.c_str(), name, sum(found.tile_variance),
              sum(facts.variance));
  EXPECT_GT(sum(facts.variance), 0);
  EXPECT_NEAR(sum(found.tile_variance), sum(facts.variance), 0.03 * sum(facts.variance));
}

// Measured: row sums 1.1e-6 and 1.0e-4, radiosities 2.7e-6 in the room, 6e-4 of its pairs.
TEST_P(AssemblyOnDevice, IsThatThroughEmbreeButForGrazingRaysInTheCornellBox) {
  compare(*device, "Cornell box", {"cornell-box.obj", test::sanitized ? 20000.0 : 5000.0}, 5e-6, 1e-3);
}
TEST_P(AssemblyOnDevice, IsThatThroughEmbreeButForGrazingRaysInARoom) {
  if (test::sanitized) GTEST_SKIP() << "too large for a run under the sanitizers";
  compare(*device, "room", {"room-1312.obj", 1}, 4e-4, 5e-3);
}
// Up to 320 rays in a pair's pilot, 40,960 in all.
TEST_P(AssemblyOnDevice, IsThatThroughEmbreeWithManyRaysToo) {
  const RayBudget high = budget_of(accuracy_of("high"));
  ASSERT_GT(high.most_in_pilot, 127U);
  compare(*device, "few patches, accuracy high", Scenery(test::room(2)), 2e-5, 4e-3, high);
}

TEST_P(AssemblyOnDevice, IsTheSameBitsInBatchesOfAnySize) {
  const Scenery scene("cornell-box.obj", 20000);
  const Matrix first = on_device(*device, scene);
  ASSERT_GT(*std::max_element(first.begin(), first.end()), 0.0F);
  const auto same = [&](const Matrix& other) {
    return std::memcmp(first.data(), other.data(), first.size() * sizeof(float)) == 0;
  };
  EXPECT_TRUE(same(on_device(*device, scene)));
  EXPECT_TRUE(same(on_device(*device, scene, {.first_tiles = 1, .most_tiles = 1})));
  EXPECT_TRUE(same(on_device(*device, scene, {.launch_seconds = 1e-4, .first_tiles = 3, .most_tiles = 5})));
  EXPECT_TRUE(same(on_device(*device, scene, {.launch_seconds = 10, .first_tiles = 1000}, 37)));
}

/// Where the rays of a batch find no room it is done again in halves; where those of one tile do not, that is said.
TEST_P(AssemblyOnDevice, WithLittleRoomForRaysItIsTheSameBits) {
  const Scenery scene("cornell-box.obj", 20000);
  const Matrix first = on_device(*device, scene);
  const auto counts = std::make_shared<test::Counts>();
  counts->inner = GetParam();
  test::CountingDevice counting(counts);
  const DevicePace little{.first_tiles = 1000, .most_chunks = 20000};
  EXPECT_EQ(on_device(counting, scene, little), first);
  // Every attempt begins with tile_kinds; only those with room for their rays end with tile_finish.
  EXPECT_GT(counts->launches.at("tile_kinds"), counts->launches.at("tile_finish"));
  EXPECT_GT(counts->launches.at("tile_finish"), 1U);
  const auto expect_refused = [&](const DevicePace& pace, const RayBudget& budget, const char* cause) {
    try {
      on_device(*device, scene, pace, 0, nullptr, budget);
      FAIL() << "no error";
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::device);
      EXPECT_NE(std::string(error.what()).find(cause), std::string::npos) << error.what();
    }
  };
  expect_refused({.most_chunks = 3}, {}, "the rays of a single tile");
  RayBudget longer;
  longer.most_in_pilot = 8192;
  expect_refused({}, longer, "more than 8191 rays in the pilot");
}

/// Row blocks one after the other make what all at once make.
TEST_P(AssemblyOnDevice, RunsOfRowsAddUpToTheWhole) {
  const Scenery scene("cornell-box.obj", 20000);
  const Matrix whole = on_device(*device, scene);
  const std::size_t n = scene.size(), blocks = scene.patches.blocks();
  Matrix s(n * n);
  DeviceAssembly assembly(*device, scene.patches, scene.blockers, {}, seed);
  ProgressSink silent;
  const auto take = [&](std::size_t r, std::size_t c, std::span<const float> tile) {
    for (std::size_t p = 0; p < tile.size(); ++p) {
      const std::size_t i = 32 * r + p / 32, j = 32 * c + p % 32;
      if (i < j && j < n) s[i * n + j] = s[j * n + i] = tile[p];
    }
  };
  for (const auto& [first, end] : {std::pair(std::size_t{0}, blocks / 3), std::pair(blocks / 3, blocks)}) {
    const TileFacts facts = assembly.make(first, end, take, silent);
    EXPECT_EQ(facts.variance.size(), tiles_in_rows(first, end, blocks));
  }
  EXPECT_EQ(s, whole);
}

TEST_P(AssemblyOnDevice, StaysWithinTheBoundsOfTheCheck) {
  std::vector<KernelCheck> rows;
  check::check_assembly(*device, rows);
  EXPECT_EQ(rows.size(), 9U);
  for (const KernelCheck& row : rows) {
    EXPECT_EQ(row.status, CheckStatus::pass) << row.parameters << " " << row.error << " " << row.reason;
  }
}

struct Twin {
  const char *name, *file, *from, *to, *seen_by;
};
// Each breaks the text that all languages share.
constexpr Twin twins[] = {
    {"edge dropped", "shared/contour.h", "for (uint m = 0u; m < b.size", "for (uint m = 1u; m < b.size", "near"},
    {"mirror forgotten", "shared/tile_store.h", "PANEL_AT(row_j, i) = s;", "PANEL_AT(row_j, i) = 0.0f;", "far"},
    {"low parts forgotten", "shared/pairs.h", "(y.hi - x.hi) + (y.lo - x.lo)", "(y.hi - x.hi)", "small"},
    {"part behind seen", "shared/pairs.h", "if (kind == STRADDLE) return part_in_front(y, x, d);", "", "straddle"},
    {"hits ignored", "shared/tile_rays.h", "sums.hidden += ray.weight", "sums.hidden += 0.0f", "hidden"},
    {"one sample for all", "shared/tile_rays.h", "source.to_u + k * 2700274807u", "source.to_u", "hidden"},
};

TEST_P(AssemblyOnDevice, TwinsAreSeen) {
  for (const Twin& twin : twins) {
    // PoCL takes seconds to compile them: one will do, in the code that the others have not.
    const bool few = device->info().backend == "opencl" && device->info().emulated();
    if (few && std::string(twin.name) != "hits ignored") continue;
    test::KernelFolder folder;
    folder.replace(twin.file, twin.from, twin.to);
    if (std::string(twin.name) == "hits ignored") {  // where an invocation traces several rays
      folder.replace(twin.file, "if (((found >> k) & 1u) == 0u) continue;", "continue;");
    }
    std::vector<KernelCheck> rows;
    check::check_assembly(*open_device(GetParam()), rows, twin.seen_by);
    ASSERT_EQ(rows.size(), 1U);
    EXPECT_EQ(rows[0].status, CheckStatus::fail) << twin.name;
    EXPECT_GT(rows[0].error, rows[0].bound) << twin.name << ": " << rows[0].reason;
  }
}

TEST(AssemblyOnOpenMP, IsUnsupportedAndSaysWhy) {
  std::vector<KernelCheck> rows;
  check::check_assembly(*open_device("openmp"), rows);
  ASSERT_EQ(rows.size(), 1U);
  EXPECT_EQ(rows[0].status, CheckStatus::unsupported);
  EXPECT_NE(rows[0].reason.find("Embree"), std::string::npos);
}

}  // namespace
}  // namespace interflect
