#include "interflect/schedule/device_form_factors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <optional>

#include "device/kernel_folder.h"
#include "formfactor/meshes.h"
#include "interflect/base/error.h"
#include "interflect/schedule/scheduler.h"
#include "schedule/counting_device.h"
#include "schedule/embree_on_device.h"

// F of S that lies on a device, with S from Embree: matrix, report, products and solve are the host's.

namespace interflect {
namespace {

using namespace test;
using ::testing::HasSubstr;

/// Without its ceiling.
PatchMesh open_room() {
  return Builder()
      .part("floor")
      .plate({0, 0, 0}, {1, 0, 0}, {0, 1, 0}, 4)
      .part("wall")
      .plate({0, 0, 0}, {0, 1, 0}, {0, 0, 1}, 4)
      .mesh();
}

DeviceFormFactors resident(const PatchMesh& mesh, const std::shared_ptr<Counts>& counts,
                           const AssemblyOptions& options = {}) {
  return {std::make_unique<CountingDevice>(counts), mesh, options, nullptr, embree_on_device(mesh, options)};
}

void expect_same(const FormFactorMatrix& a, const FormFactorMatrix& b) {
  ASSERT_EQ(a.size(), b.size());
  for (std::uint32_t i = 0; i < a.size(); ++i) {
    for (std::uint32_t j = 0; j < a.size(); ++j) ASSERT_EQ(a.row(i)[j], b.row(i)[j]) << i << " " << j;
  }
}

TEST(DeviceFormFactors, AreTheHostsToTheBitAndSoIsTheReport) {
  for (const PatchMesh& mesh : {room(4), open_room()}) {
    for (const Closure closure : {Closure::automatic, Closure::on, Closure::off}) {
      AssemblyOptions options;
      options.closure = closure;
      const FormFactors host = assemble(mesh, options);
      DeviceFormFactors there = resident(mesh, std::make_shared<Counts>(), options);
      const AssemblyReport& report = there.report();
      // The closure's products differ in their roundings, by far less than a float's last place.
      ASSERT_EQ(report.scaling.size(), mesh.size());
      for (std::size_t i = 0; i < mesh.size(); ++i) {
        ASSERT_NEAR(report.scaling[i], host.report.scaling[i], 2e-6 * host.report.scaling[i]);
        ASSERT_NEAR(report.row_sum[i], host.report.row_sum[i], 2e-6);
        ASSERT_NEAR(report.row_sum_before[i], host.report.row_sum_before[i], 1e-6);
      }
      EXPECT_EQ(report.closed_scene, host.report.closed_scene);
      EXPECT_EQ(report.closure_applied, host.report.closure_applied);
      EXPECT_NEAR(report.closure_max_change, host.report.closure_max_change, 1e-5);
      EXPECT_EQ(report.pairs_considered, host.report.pairs_considered);
      EXPECT_EQ(report.rays, host.report.rays);
      EXPECT_EQ(report.tile_variance, host.report.tile_variance);
      EXPECT_EQ(report.warnings.size(), host.report.warnings.size());
      EXPECT_DOUBLE_EQ(there.nonzero_fraction(), host.matrix.nonzero_fraction());
      const FormFactorMatrix matrix = there.download();
      if (report.scaling == host.report.scaling) {
        expect_same(matrix, host.matrix);
      } else {
        for (std::uint32_t i = 0; i < matrix.size(); ++i) {
          for (std::uint32_t j = 0; j < matrix.size(); ++j) {
            const auto exact = static_cast<double>(host.matrix.row(i)[j]);
            ASSERT_NEAR(static_cast<double>(matrix.row(i)[j]), exact, 5e-6 * exact);
          }
        }
      }
    }
  }
}

TEST(DeviceFormFactors, OfTheSameScalingHaveTheSameBits) {
  const PatchMesh mesh = room(3);
  AssemblyOptions options;
  options.closure = Closure::off;
  const FormFactors host = assemble(mesh, options);
  expect_same(resident(mesh, std::make_shared<Counts>(), options).download(), host.matrix);
}

TEST(DeviceFormFactors, PanelsAreWholeTileRowsAndGiveTheSameMatrix) {
  const PatchMesh mesh = room(4);  // 240 patches
  const FormFactorMatrix whole = resident(mesh, std::make_shared<Counts>()).download();
  const Variable small("INTERFLECT_MAX_PANEL_BYTES", "70000");
  const auto counts = std::make_shared<Counts>();
  DeviceFormFactors cut = resident(mesh, counts);
  ASSERT_EQ(cut.matrix().panels().size(), 4U);
  for (const DeviceMatrix::Panel& panel : cut.matrix().panels()) EXPECT_EQ(panel.first % 32, 0U);
  EXPECT_EQ(cut.matrix().panels().back().rows, 240U - 3 * 64);
  expect_same(cut.download(), whole);
  EXPECT_EQ(counts->launches["close_rows"], 4U);
}

TEST(DeviceFormFactors, DevicesLimitsCutPanelsOrAreErrorsBeforeAnythingIsAllocated) {
  const PatchMesh mesh = room(4);
  const auto limited = [&](std::uint64_t buffer, std::uint64_t memory) {
    auto counts = std::make_shared<Counts>();
    counts->describe = [=](DeviceInfo& info) {
      info.max_buffer_bytes = buffer;
      info.memory_bytes = memory;
    };
    return counts;
  };
  EXPECT_EQ(resident(mesh, limited(100'000, 1 << 20)).matrix().panels().size(), 3U);
  const auto expect_limit = [&](const std::shared_ptr<Counts>& counts, const std::string& part) {
    try {
      const DeviceFormFactors made = resident(mesh, counts);
      FAIL() << "no error";
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::limit) << error.what();
      EXPECT_THAT(error.what(), HasSubstr(part));
      EXPECT_THAT(error.what(), HasSubstr("--assembly host"));
    }
    EXPECT_EQ(counts->allocations, 0U);
  };
  expect_limit(limited(30'000, 1 << 20), "the device's largest buffer 30000");
  expect_limit(limited(1 << 20, 100'000), "openmp: the form factors of 240 patches need");
}

Columns wave(std::uint32_t n, std::size_t columns) {
  Columns x(columns, std::vector<float>(n));
  for (std::size_t c = 0; c < columns; ++c) {
    for (std::uint32_t i = 0; i < n; ++i) x[c][i] = std::cos(static_cast<float>(i + 11 * c));
  }
  return x;
}

TEST(DeviceFormFactors, ASchedulerOverThemUploadsVectorsOnly) {
  const PatchMesh mesh = room(4);
  const auto n = static_cast<std::uint32_t>(mesh.size());
  const Variable small("INTERFLECT_MAX_PANEL_BYTES", "70000");
  const auto counts = std::make_shared<Counts>();
  DeviceFormFactors there = resident(mesh, counts);
  const FormFactorMatrix f = there.download();
  counts->uploaded_bytes = counts->downloaded_bytes = 0;
  Scheduler scheduler(std::move(there), 3);
  EXPECT_EQ(scheduler.uploaded_bytes(), 0U);
  EXPECT_EQ(scheduler.bytes(), f.bytes());
  EXPECT_EQ(scheduler.storage(), Storage::dense32);
  EXPECT_EQ(scheduler.panel_buffers().size(), 4U);

  const Columns x = wave(n, 3);
  std::vector<std::vector<double>> exact, there_exact;
  exact_product(f, x, exact);
  scheduler.exact_product(x, there_exact);
  Vector in = scheduler.vector(), out = scheduler.vector();
  scheduler.upload(in, x);
  scheduler.apply(in, out);
  Columns y;
  scheduler.download(out, y);
  for (std::size_t c = 0; c < 3; ++c) {
    for (std::uint32_t i = 0; i < n; ++i) {
      ASSERT_NEAR(there_exact[c][i], exact[c][i], 1e-12);
      ASSERT_NEAR(static_cast<double>(y[c][i]), exact[c][i], 1e-6);
    }
  }
  EXPECT_EQ(scheduler.products(), 2U);
  EXPECT_EQ(counts->launches["matvec"], 4U);
  const std::uint64_t vector = std::uint64_t{3} * scheduler.stride() * sizeof(float);
  EXPECT_EQ(counts->uploaded_bytes, 2 * vector);
  EXPECT_EQ(counts->downloaded_bytes, 3 * vector);
  EXPECT_THROW(scheduler.exact_product(wave(n, 2), exact), Error);
  EXPECT_THROW(scheduler.exact_product(wave(n - 1, 3), exact), Error);
}

}  // namespace
}  // namespace interflect
