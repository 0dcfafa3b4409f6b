// Devices of different backends that work together: OpenMP, OpenCL (PoCL) and Vulkan (lavapipe).
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "backends/devices.h"
#include "interflect/device/check.h"
#include "interflect/formfactor/patch_order.h"
#include "interflect/solver/fallback.h"
#include "schedule/failing_device.h"
#include "schedule/products.h"
#include "solver/reference.h"
#include "solver/room.h"

namespace interflect::test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

const std::vector<std::string> mixed{"openmp", "opencl:0", "vulkan:0"};

class MixedTeam : public testing::Test {
 protected:
  void SetUp() override {
    for (const std::string& id : mixed) {
      const std::string why = why_unavailable(id);
      if (!why.empty() && required(id)) FAIL() << id << ": " << why;
      if (!why.empty()) GTEST_SKIP() << id << ": " << why;
    }
  }
};

std::vector<std::unique_ptr<Device>> opened(const std::vector<std::string>& ids) {
  std::vector<std::unique_ptr<Device>> devices;
  for (const std::string& id : ids) devices.push_back(open_device(id));
  return devices;
}

const Room& room() {
  static const Room made = make_room(12, 4);  // 864 patches
  return made;
}

Columns wave(std::size_t columns) {
  return positive_wave(room().form_factors.size(), columns);
}

/// All terms are positive: the bound of the kernel that each row comes from.
TEST_F(MixedTeam, ProductsKeepTheKernelsBoundAndTheSameSplitGivesTheSameBits) {
  const Columns x = wave(3);
  std::vector<std::vector<double>> exact;
  exact_product(room().form_factors, x, exact);
  const SplitOptions split{.weights = {2, 2, 1}, .said = {}};
  std::vector<std::string> order = mixed;
  do {  // whoever is first
    Scheduler scheduler(room().form_factors, opened(order), 3, split);
    const Columns y = applied(scheduler, x);
    EXPECT_THAT(scheduler.failures(), testing::IsEmpty());
    EXPECT_LT(largest_error(y, exact), matvec_bound(room().form_factors.size())) << order[0];
    EXPECT_EQ(applied(scheduler, x), y);
    Scheduler again(room().form_factors, opened(order), 3, split);
    EXPECT_EQ(applied(again, x), y) << order[0];
    std::rotate(order.begin(), order.begin() + 1, order.end());
  } while (order != mixed);
}

TEST_F(MixedTeam, SixteenBitFormats) {
  const Columns x = wave(3);
  for (const Storage storage : {Storage::dense16, Storage::tiled16, Storage::sym16}) {
    PackedMatrix::Options options;
    options.order = patch_order(room().form_factors);
    options.block = 128;
    const PackedMatrix f(room().form_factors, room().area, storage, options);
    std::vector<std::vector<double>> exact;
    exact_product(f, x, exact);
    Scheduler scheduler(f, opened(mixed), 3, {.weights = {1, 1, 1}, .said = {}});
    const Columns y = applied(scheduler, x);
    EXPECT_LT(largest_error(y, exact), 2e-5) << name(storage);
    EXPECT_EQ(applied(scheduler, x), y);
    ASSERT_EQ(scheduler.shares().size(), 3U);
    for (const DeviceShare& share : scheduler.shares()) EXPECT_GT(share.share, 0.2) << name(storage) << share.device;
  }
}

/// A solve in which the OpenCL device is lost after some products: the others end it.
TEST_F(MixedTeam, ASolveGoesOnWithoutALostDevice) {
  const Light light = lamp_light(room(), 0.8F);
  const auto fate = std::make_shared<Fate>();
  const auto run = [&] {
    Candidates candidates(
        {"openmp", "failing", "vulkan:0"},
        [&](const std::string& id) -> std::unique_ptr<Device> {
          if (id == "failing") return std::make_unique<FailingDevice>(fate, open_device("opencl:0"));
          return open_device(id);
        },
        nullptr, SplitOptions{.weights = {1, 1, 1}, .said = {}});
    Columns b;
    FallbackReport report =
        solve_on(candidates, room().form_factors, Method::cg, {}, room().area, light.reflectance, light.emittance, b);
    EXPECT_TRUE(report.report.converged);
    const Doubles exact = reference_solution(room().form_factors, light.reflectance, light.emittance);
    for (std::size_t c = 0; c < b.size(); ++c) EXPECT_LT(relative_to_maximum(b[c], exact[c]), 1e-5);
    return report;
  };
  EXPECT_THAT(run().devices, ElementsAre("openmp", "failing", "vulkan:0"));
  fate->fails_at = fate->calls / 2;
  fate->calls = 0;
  const FallbackReport report = run();
  ASSERT_EQ(report.failures.size(), 1U);
  EXPECT_THAT(report.failures[0].reason, HasSubstr("lost (-4)"));
  EXPECT_EQ(report.shares[1].share, 0);
  EXPECT_GT(report.shares[2].share, 0.3);
}

}  // namespace
}  // namespace interflect::test
