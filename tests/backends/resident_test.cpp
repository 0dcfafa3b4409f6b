// F that stays on the device that assembled it, on every backend: what crosses the bus, what the solution is, what a
// failure leads to. And the twins of the kernels in OpenCL C and GLSL.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "backends/devices.h"
#include "cli/program.h"
#include "device/kernel_folder.h"
#include "formfactor/meshes.h"
#include "interflect/base/error.h"
#include "interflect/device/check.h"
#include "interflect/device/check_tools.h"
#include "interflect/schedule/device_form_factors.h"
#include "interflect/solver/fallback.h"
#include "interflect/solver/solver.h"
#include "schedule/counting_device.h"
#include "schedule/embree_on_device.h"
#include "schedule/failing_device.h"
#include "solver/light.h"

namespace interflect {
namespace {

using namespace test;
using ::testing::HasSubstr;

/// What a mesh of grey walls and one bright patch gives a solver.
struct Light {
  explicit Light(const PatchMesh& mesh)
      : reflectance(3, std::vector<float>(mesh.size())), emittance(3, std::vector<float>(mesh.size())) {
    for (std::size_t c = 0; c < 3; ++c) {
      for (std::size_t i = 0; i < mesh.size(); ++i) {
        reflectance[c][i] = 0.3F + 0.2F * static_cast<float>(c);
        emittance[c][i] = i % 7 == c ? 5.0F : 0.0F;
      }
    }
  }
  Columns reflectance, emittance;
};

Columns solved(Scheduler& scheduler, const PatchMesh& mesh) {
  const Light light(mesh);
  Columns b;
  const SolveReport report = solve(scheduler, Method::cg, StopTest{}, mesh.area, light.reflectance, light.emittance, b);
  EXPECT_TRUE(report.converged) << report.reason;
  return b;
}

Columns solved_on_host(const PatchMesh& mesh) {
  const FormFactors factors = assemble(mesh);
  Scheduler scheduler(factors.matrix, openmp(), 3);
  return solved(scheduler, mesh);
}

class Resident : public OnDevice {
 protected:
  void SetUp() override {
    OnDevice::SetUp();
    if (device != nullptr && device->info().backend == "openmp") GTEST_SKIP() << "its S comes from Embree";
  }
};
INSTANTIATE_TEST_SUITE_P(All, Resident, testing::ValuesIn(tested_devices), test_name);

TEST_P(Resident, OfTheSameSTheSolutionIsTheHostsWithinRounding) {
  const PatchMesh mesh = room(4);
  const Variable small("INTERFLECT_MAX_PANEL_BYTES", "70000");  // four panels
  DeviceFormFactors there(std::move(device), mesh, {}, nullptr, embree_on_device(mesh, {}));
  Scheduler scheduler(std::move(there), 3);
  EXPECT_EQ(scheduler.panel_buffers().size(), 4U);
  EXPECT_LT(difference(solved(scheduler, mesh), solved_on_host(mesh)), 5e-6);
}

TEST_P(Resident, AssembledThereTheSolutionIsTheHostsButForGrazingRaysAndFNeverCrossesTheBus) {
  const PatchMesh mesh = room(6);  // 480 patches
  device.reset();
  const auto counts = std::make_shared<Counts>();
  counts->inner = GetParam();
  DeviceFormFactors there(std::make_unique<CountingDevice>(counts), mesh);
  EXPECT_TRUE(there.report().closure_applied);
  EXPECT_NEAR(there.report().after.max, 1, 1e-4);
  EXPECT_NEAR(there.report().after.min, 1, 1e-4);
  const std::uint64_t f = there.matrix().bytes();
  Scheduler scheduler(std::move(there), 3);
  EXPECT_LT(difference(solved(scheduler, mesh), solved_on_host(mesh)), 1e-3);
  EXPECT_EQ(scheduler.uploaded_bytes(), 0U);
  // No transfer has the size of F, nor do all of them together: patches, hierarchy, tiles, vectors.
  EXPECT_LT(counts->largest_transfer, f / 4);
  EXPECT_LT(counts->uploaded_bytes, f / 2);
}

TEST_P(Resident, TilesForTheHostAreThoseThatStayThere) {
  const PatchMesh mesh = room(4);
  AssemblyOptions options;
  options.closure = Closure::off;
  options.maker = [&](const PatchTable& patches, const Blockers& blockers) {
    return std::make_unique<DeviceAssembly>(*device, patches, blockers, options.budget, options.seed);
  };
  struct Sink final : ProgressSink {
    /// The closure does not know how long it takes: a total of 0.
    void begin(std::string_view, std::uint64_t total) override { all += total, stages += total > 0 ? 1 : 0; }
    void advance(std::uint64_t steps) override { done += steps; }
    std::uint64_t all = 0, done = 0, stages = 0;
  } sink;
  const FormFactors host = assemble(mesh, options, &sink);
  EXPECT_EQ(sink.done, sink.all);
  EXPECT_EQ(sink.stages, 1U);
  options.maker = {};
  DeviceFormFactors there(std::move(device), mesh, options);
  const FormFactorMatrix matrix = there.download();
  for (std::uint32_t i = 0; i < matrix.size(); ++i) {
    for (std::uint32_t j = 0; j < matrix.size(); ++j)
      ASSERT_EQ(matrix.row(i)[j], host.matrix.row(i)[j]) << i << " " << j;
  }
  EXPECT_EQ(there.report().rays, host.report.rays);
  EXPECT_EQ(there.report().pairs_considered, host.report.pairs_considered);
  EXPECT_EQ(there.report().tile_variance, host.report.tile_variance);
}

/// A solve that assembles on a device failing at call k, and on the host when it is OpenMP's turn.
struct Attempt {
  std::shared_ptr<Fate> fate = std::make_shared<Fate>();
  std::uint64_t assembled = 0;  ///< calls until F was there
  Columns b;
  FallbackReport result;

  Attempt(const PatchMesh& mesh, const FormFactorMatrix& host, const std::shared_ptr<Device>& inner,
          const DeviceFormFactors::Assemble& assemble, std::uint64_t fails_at) {
    fate->fails_at = fails_at;
    Candidates candidates({"failing", "openmp"}, [&](const std::string& id) -> std::unique_ptr<Device> {
      if (id == "failing") return std::make_unique<FailingDevice>(fate, inner);
      return open_device("openmp");
    });
    const Place place = [&](std::vector<std::unique_ptr<Device>> devices) {
      if (devices.front()->info().id == "failing") {
        DeviceFormFactors there(std::move(devices.front()), mesh, {}, nullptr, assemble);
        assembled = fate->calls;
        return std::make_unique<Scheduler>(std::move(there), 3U);
      }
      return std::make_unique<Scheduler>(host, std::move(devices), 3U);
    };
    const Light light(mesh);
    result = solve_on(candidates, place, Method::cg, {}, mesh.area, light.reflectance, light.emittance, b, nullptr, 0);
  }
};

void expect_fallback_at_every(std::uint64_t step, const PatchMesh& mesh, const std::shared_ptr<Device>& inner,
                              const DeviceFormFactors::Assemble& assemble) {
  const FormFactorMatrix host = interflect::assemble(mesh).matrix;
  const Attempt whole(mesh, host, inner, assemble, std::numeric_limits<std::uint64_t>::max());
  EXPECT_TRUE(whole.result.failures.empty());
  ASSERT_GT(whole.assembled, 10U);
  ASSERT_GT(whole.fate->calls, whole.assembled + 20);
  bool in_assembly = false, went_on = false;
  for (std::uint64_t k = 0; k < whole.fate->calls; k += step) {
    SCOPED_TRACE(k);
    const Attempt run(mesh, host, inner, assemble, k);
    ASSERT_EQ(run.result.failures.size(), 1U);
    EXPECT_THAT(run.result.failures[0].reason, HasSubstr("failing: " + run.fate->operations.back() + ": lost (-4)"));
    EXPECT_TRUE(run.result.report.converged);
    EXPECT_LT(difference(run.b, whole.b), 1e-3);
    EXPECT_EQ(run.fate->live_buffers, 0);
    EXPECT_EQ(run.fate->live_kernels, 0);
    EXPECT_EQ(run.result.devices.back(), "openmp");
    in_assembly = in_assembly || run.assembled == 0;
    went_on = went_on || run.result.devices.size() == 2;
  }
  EXPECT_TRUE(in_assembly) << "some calls belong to the assembly";
  EXPECT_TRUE(went_on) << "an iterate of the lost device is kept";
}

TEST(ResidentFallback, ADeviceLostAtAnyCallOfClosureOrSolveIsFollowedByTheHost) {
  const PatchMesh mesh = room(2);
  expect_fallback_at_every(3, mesh, open_device("openmp"), embree_on_device(mesh, {}));
}

TEST(ResidentFallback, ADeviceLostInTheAssemblyIsFollowedByTheHost) {
  if (const std::string why = why_unavailable("opencl:0"); !why.empty()) GTEST_SKIP() << why;
  expect_fallback_at_every(19, room(2), open_device("opencl:0"), {});
}

// The twins: a text of a kernel replaced, in both shapes where the backend has two.

struct Defect {
  std::string device, shape, kernel, from, to;
};

class BrokenResidentKernel : public testing::TestWithParam<Defect> {};
INSTANTIATE_TEST_SUITE_P(
    Twin, BrokenResidentKernel,
    testing::Values(Defect{"opencl:0", "cpu", "matvec_exact", "sum->lo += t + e;", "sum->lo += t;"},
                    Defect{"opencl:0", "gpu", "matvec_exact", "sum->lo += t + e;", "sum->lo += e;"},
                    Defect{"opencl:0", "cpu", "matvec_exact", "TWO_SUM(lanes, sum->hi, p, s, t);",
                           "const lanes s = fma(f, x, sum->hi); const lanes t = p - (s - sum->hi);"},
                    Defect{"opencl:0", "cpu", "matvec_exact", "k < LANES; ++k", "k + 1 < LANES; ++k"},
                    Defect{"opencl:0", "gpu", "matvec_exact", "j + k < n;", "j + k + 1 < n;"},
                    Defect{"opencl:0", "cpu", "close_rows", "j + k < a.n", "j + k + 1 < a.n"},
                    Defect{"opencl:0", "gpu", "close_rows", "by * dj", "d[0] * dj"},
                    Defect{"opencl:0", "gpu", "close_rows", "counts[l] += counts[l + width];", ""},
                    Defect{"vulkan:0", "", "matvec_exact", "precise ", ""},
                    Defect{"vulkan:0", "", "matvec_exact", "(s.y + e)", "s.y"},
                    Defect{"vulkan:0", "", "matvec_exact", "0xFFFFF000u", "0xFFFFFF00u"},
                    Defect{"vulkan:0", "", "matvec_exact", "(a.n + 3u) / 4u", "a.n / 4u"},
                    Defect{"vulkan:0", "", "close_rows", "min(4u, a.n - j * 4u)", "4u"},
                    Defect{"vulkan:0", "", "close_rows", "width > 0u", "width > 1u"},
                    Defect{"vulkan:0", "", "close_rows", " && old[k] != 0.0", ""}),
    [](const auto& info) { return info.param.kernel + "_" + std::to_string(info.index); });

TEST_P(BrokenResidentKernel, FailsTheCheck) {
  const Defect& defect = GetParam();
  if (const std::string why = why_unavailable(defect.device); !why.empty()) GTEST_SKIP() << why;
  std::optional<Variable> shape;
  if (!defect.shape.empty()) shape.emplace("INTERFLECT_OPENCL_SHAPE", defect.shape);
  KernelFolder kernels;
  kernels.replace(
      (defect.device == "vulkan:0" ? "glsl/" : "cl/") + defect.kernel + (defect.device == "vulkan:0" ? ".comp" : ".cl"),
      defect.from, defect.to);
  std::vector<KernelCheck> rows;
  check::check_resident(*open_device(defect.device), rows, {.max_size = 65, .columns = 3, .kernel = defect.kernel});
  std::size_t failed = 0;
  for (const KernelCheck& row : rows) {
    EXPECT_THAT(row.reason, testing::Not(HasSubstr(defect.device))) << "the twin does not run";
    failed += row.status == CheckStatus::fail ? 1 : 0;
  }
  EXPECT_GT(failed, 0U);
  EXPECT_GT(rows.size(), 10U);
}

TEST(ResidentKernelsInBothShapes, PassTheirCheck) {
  if (const std::string why = why_unavailable("opencl:0"); !why.empty()) GTEST_SKIP() << why;
  const Variable shape("INTERFLECT_OPENCL_SHAPE", "gpu");  // the processors' is checked with all other kernels
  std::vector<KernelCheck> rows;
  check::check_resident(*open_device("opencl:0"), rows);
  for (const KernelCheck& row : rows) {
    EXPECT_EQ(row.status, CheckStatus::pass) << row.kernel << " n=" << row.size << " " << row.parameters << ": "
                                             << row.error << " of " << row.bound << " " << row.reason;
  }
}

/// The longest loops: 1,048,576 columns.
TEST_P(Resident, TheLargestExactProductIsWhole) {
  constexpr std::uint32_t n = 1U << 20, rows = 3;
  if (std::uint64_t{rows} * n * sizeof(float) > device->info().max_buffer_bytes) GTEST_SKIP() << "small buffers";
  const std::vector<float> values(std::size_t{rows} * n, 1.0F + 0x1p-20F);
  const auto f = device->allocate(values.size() * sizeof(float)), x = device->allocate(n * sizeof(float));
  device->queue().upload(*f, 0, std::as_bytes(std::span(values)));
  device->queue().upload(*x, 0, std::as_bytes(std::span(values).first(n)));
  const auto y = device->allocate(2 * n * sizeof(float)), of_rows = device->allocate(3 * n * sizeof(float));
  const MatvecArguments arguments{.n = n, .first = 0, .rows = rows, .row_stride = n, .vector_stride = n};
  const auto block = std::as_bytes(std::span(&arguments, 1));
  Buffer* const of_product[] = {f.get(), x.get(), y.get()};
  device->queue().launch(*device->kernel("matvec_exact", {{"COLUMNS", 1}}), 1, of_product, block, "Test");
  Buffer* const of_closing[] = {f.get(), x.get(), x.get(), of_rows.get()};
  device->queue().launch(*device->kernel("close_rows", {}), 1, of_closing, block, "Test");
  std::vector<float> hi(rows), lo(rows), count(rows);
  device->queue().download(*y, 0, std::as_writable_bytes(std::span(hi)));
  device->queue().download(*y, n * sizeof(float), std::as_writable_bytes(std::span(lo)));
  device->queue().download(*of_rows, 2 * n * sizeof(float), std::as_writable_bytes(std::span(count)));
  const double one = 1 + 0x1p-20, exact = n * one * one;
  for (std::size_t r = 0; r < rows; ++r) {
    EXPECT_NEAR(static_cast<double>(hi[r]) + static_cast<double>(lo[r]), exact, matvec_exact_bound(n) * exact);
    EXPECT_EQ(count[r], static_cast<float>(n));
  }
}

}  // namespace
}  // namespace interflect
