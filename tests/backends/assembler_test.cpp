// Who assembles for the host: one assembly on a device for all panels, what it says of itself, and who goes on when it
// fails.

#include "assembler.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>

#include "backends/devices.h"
#include "formfactor/meshes.h"
#include "formfactor/panels.h"
#include "interflect/base/error.h"
#include "interflect/formfactor/iff_format.h"
#include "schedule/counting_device.h"
#include "schedule/failing_device.h"

namespace interflect {
namespace {

using namespace test;
using cli::Assembler;
using cli::AssemblyPlace;
using cli::AssemblyUse;

class AssemblerTest : public testing::Test {
 protected:
  void SetUp() override {
    if (const std::string why = why_unavailable("opencl:0"); !why.empty()) GTEST_SKIP() << why;
  }
};

TEST_F(AssemblerTest, PatchesAndHierarchyGoToTheDeviceOnceForAllPanels) {
  const PatchMesh mesh = room(3);  // 156 patches
  const auto counts = std::make_shared<Counts>();
  counts->inner = "opencl:0";
  Candidates candidates({"opencl:0"}, [&](const std::string&) { return std::make_unique<CountingDevice>(counts); });
  Assembler assembler(candidates, AssemblyPlace::device);
  ProgressSink silent;
  AssemblyOptions options;
  const FormFactors whole = assembler.assemble(mesh, options, silent);
  const std::uint64_t allocations = counts->allocations;
  EXPECT_GT(allocations, 0U);

  MemoryStore store(static_cast<std::uint32_t>(mesh.size()), 64);
  options.panels = &store;
  const FormFactors by_panels = assembler.assemble(mesh, options, silent);
  EXPECT_EQ(store.panels.size(), 3U);
  EXPECT_EQ(counts->allocations, 2 * allocations);
  for (std::uint32_t i = 0; i < mesh.size(); ++i) {
    for (std::uint32_t j = 0; j < mesh.size(); ++j) ASSERT_EQ(by_panels.matrix.row(i)[j], whole.matrix.row(i)[j]);
  }
  EXPECT_EQ(by_panels.report.tile_variance, whole.report.tile_variance);
}

TEST_F(AssemblerTest, SaysWhoAssembledAndWhatWentOverTheBus) {
  const PatchMesh mesh = room(3);
  const auto counts = std::make_shared<Counts>();
  counts->inner = "opencl:0";
  Candidates candidates({"opencl:0"}, [&](const std::string&) { return std::make_unique<CountingDevice>(counts); });
  Assembler assembler(candidates, AssemblyPlace::device);
  MemoryStore store(static_cast<std::uint32_t>(mesh.size()), 64);
  ProgressSink silent;
  AssemblyOptions options;
  options.panels = &store;
  static_cast<void>(assembler.assemble(mesh, options, silent));
  EXPECT_EQ(assembler.use().device, "opencl:0");
  const std::uint64_t all = assembler.use().bytes_over_bus, tile = 32 * 32 * sizeof(float);
  EXPECT_GT(all, 5 * tile);
  EXPECT_LE(all, 15 * tile) << "5 rows of tiles, from the diagonal on";
  EXPECT_LT(all, counts->downloaded_bytes) << "counters and variances come too";

  // One panel is missing: its tiles alone come.
  store.panels.erase(1);
  static_cast<void>(assembler.assemble(mesh, options, silent));
  EXPECT_EQ(assembler.use().device, "opencl:0");
  EXPECT_GT(assembler.use().bytes_over_bus, 0U);
  EXPECT_LT(assembler.use().bytes_over_bus, all);

  // Nothing is: no device did anything.
  const std::uint64_t allocations = counts->allocations;
  EXPECT_EQ(assembler.assemble(mesh, options, silent).report.panels_reused, 3U);
  EXPECT_EQ(assembler.use().device, "host");
  EXPECT_EQ(assembler.use().bytes_over_bus, 0U);
  EXPECT_EQ(counts->allocations, allocations);
}

TEST_F(AssemblerTest, ADeviceLostAtAnyCallIsFollowedByTheHost) {
  const PatchMesh mesh = room(2);
  const FormFactors expected = assemble(mesh);
  const std::shared_ptr<Device> inner = open_device("opencl:0");
  constexpr std::uint64_t never = std::numeric_limits<std::uint64_t>::max();
  std::uint64_t calls = never;
  ProgressSink silent;
  // The first does not fail, and tells how many calls there are.
  for (std::uint64_t k = never; k == never || k < calls; k = k == never ? 0 : k + 5) {
    SCOPED_TRACE(k);
    const auto fate = std::make_shared<Fate>();
    fate->fails_at = k;
    Candidates candidates({"failing", "openmp"}, [&](const std::string& id) -> std::unique_ptr<Device> {
      if (id == "failing") return std::make_unique<FailingDevice>(fate, inner);
      return open_device(id);
    });
    Assembler assembler(candidates, AssemblyPlace::device);
    const FormFactors made = assembler.assemble(mesh, {}, silent);
    EXPECT_EQ(fate->live_buffers, 0);
    EXPECT_EQ(fate->live_kernels, 0);
    if (k == never) {
      calls = fate->calls;
      ASSERT_GT(calls, 30U);
      EXPECT_EQ(assembler.use().device, "failing");
      continue;
    }
    ASSERT_EQ(candidates.failures().size(), 1U);
    EXPECT_EQ(candidates.failures()[0].device, "failing");
    EXPECT_EQ(assembler.use().device, "host");
    EXPECT_EQ(assembler.use().bytes_over_bus, 0U);
    for (std::uint32_t i = 0; i < mesh.size(); ++i) {
      for (std::uint32_t j = 0; j < mesh.size(); ++j) ASSERT_EQ(made.matrix.row(i)[j], expected.matrix.row(i)[j]);
    }
  }
}

/// Two devices of one kind share the tiles: S is that of one of them, also when one is lost at any call.
TEST_F(AssemblerTest, TwoDevicesOfOneKindShareTheTiles) {
  const PatchMesh mesh = room(4);
  const std::shared_ptr<Device> inner = open_device("opencl:0");
  ProgressSink silent;
  const auto run = [&](const std::vector<std::shared_ptr<Fate>>& fates, FormFactors& made) {
    Candidates candidates(
        {"one", "openmp", "two"},
        [&](const std::string& id) -> std::unique_ptr<Device> {
          if (id == "openmp") return open_device(id);
          if (id == "one" && fates.empty()) return open_device("opencl:0");
          if (id == "two" && fates.empty()) throw device_error(id, "open", "not there");
          return std::make_unique<FailingDevice>(fates[id == "one" ? 0 : 1], open_device("opencl:0"), id);
        },
        nullptr, SplitOptions{});
    Assembler assembler(candidates, AssemblyPlace::device);
    MemoryStore store(static_cast<std::uint32_t>(mesh.size()), 1024);
    AssemblyOptions options;
    options.panels = &store;  // what is kept has one kind of maker: openmp has no part in it
    made = assembler.assemble(mesh, options, silent);
    EXPECT_EQ(assembler.maker(), iff::maker_opencl);
    return std::pair{candidates.failures(), assembler.use()};
  };
  FormFactors alone, both;
  static_cast<void>(run({}, alone));
  const auto equal = [&](const FormFactors& made) {
    for (std::uint32_t i = 0; i < mesh.size(); ++i) {
      for (std::uint32_t j = 0; j < mesh.size(); ++j) {
        if (made.matrix.row(i)[j] != alone.matrix.row(i)[j]) return false;
      }
    }
    return made.report.tile_variance == alone.report.tile_variance && made.report.rays == alone.report.rays;
  };
  const std::vector<std::shared_ptr<Fate>> whole{std::make_shared<Fate>(), std::make_shared<Fate>()};
  EXPECT_TRUE(run(whole, both).first.empty());
  EXPECT_TRUE(equal(both));
  EXPECT_GT(whole[0]->calls + whole[1]->calls, 20U);
  for (const std::size_t failing : {0U, 1U}) {
    for (const std::uint64_t call : {0U, 5U, 17U}) {
      std::vector<std::shared_ptr<Fate>> fates{std::make_shared<Fate>(), std::make_shared<Fate>()};
      fates[failing]->fails_at = call;
      FormFactors made;
      const auto failures = run(fates, made).first;
      EXPECT_TRUE(equal(made)) << failing << " " << call;
      EXPECT_EQ(failures.size(), fates[failing]->calls > call ? 1U : 0U) << failing << " " << call;
    }
  }
}

/// OpenMP's Embree and a device share the tiles by a fixed split: the same bits again, and row sums that differ from
/// Embree's alone by what rays that graze an edge do.
TEST_F(AssemblerTest, DevicesOfSeveralKindsShareTheTiles) {
  const PatchMesh mesh = room(4);
  ProgressSink silent;
  const auto run = [&](const std::vector<double>& weights, AssemblyUse& use) {
    SplitOptions split;
    split.weights = weights;
    Candidates candidates(
        {"openmp", "opencl:0"}, [](const std::string& id) { return open_device(id); }, nullptr, split);
    Assembler assembler(candidates, AssemblyPlace::device);
    FormFactors made = assembler.assemble(mesh, {}, silent);
    use = assembler.use();
    return made;
  };
  const auto equal = [&](const FormFactors& a, const FormFactors& b) {
    for (std::uint32_t i = 0; i < mesh.size(); ++i) {
      if (!std::equal(a.matrix.row(i).begin(), a.matrix.row(i).end(), b.matrix.row(i).begin())) return false;
    }
    return true;
  };
  const FormFactors alone = assemble(mesh);
  AssemblyUse use;
  const FormFactors shared = run({1, 1}, use), again = run({1, 1}, use);
  EXPECT_EQ(use.device, "openmp,opencl:0");
  EXPECT_GT(use.bytes_over_bus, 0U);
  EXPECT_TRUE(equal(shared, again));
  const FormFactors as_it_comes = run({}, use);
  double largest = 0, far = 0;
  for (std::size_t i = 0; i < mesh.size(); ++i) {
    largest = std::max(largest, alone.report.row_sum_before[i]);
    far = std::max({far, std::abs(shared.report.row_sum_before[i] - alone.report.row_sum_before[i]),
                    std::abs(as_it_comes.report.row_sum_before[i] - alone.report.row_sum_before[i])});
  }
  EXPECT_LE(far, 1e-3 * largest);
  EXPECT_EQ(shared.report.pairs_considered, alone.report.pairs_considered);

  const FormFactors embree = run({1, 0}, use);
  EXPECT_TRUE(equal(embree, alone));
}

}  // namespace
}  // namespace interflect
