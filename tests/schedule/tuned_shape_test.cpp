#include <gtest/gtest.h>

#include <memory>

#include "device/kernel_folder.h"
#include "device/shaped_device.h"
#include "interflect/device/tuning.h"
#include "interflect/schedule/scheduler.h"

// What is kept by tuning is what a Scheduler launches with; results stay.

namespace interflect {
namespace {

constexpr std::uint32_t n = 300;

FormFactorMatrix matrix() {
  FormFactorMatrix f(n);
  for (std::uint32_t i = 0; i < n; ++i) {
    const std::span<float> row = f.row(i);
    for (std::uint32_t j = 0; j < n; ++j) row[j] = 1.0F / static_cast<float>(n + (i * 7 + j * 7) % 31);
  }
  return f;
}

struct Applied {
  std::shared_ptr<test::Shaping> shaping = std::make_shared<test::Shaping>();
  Columns y;
};

template <class Matrix>
Applied run(const Matrix& f, std::uint32_t columns) {
  Applied result;
  result.shaping->describe = [](DeviceInfo& info) {
    info.backend = "opencl";  // OpenMP has no groups to shape
    info.rows_per_group = 8;
    info.max_groups = 1U << 20;
  };
  std::vector<std::unique_ptr<Device>> devices;
  devices.push_back(std::make_unique<test::ShapedDevice>(result.shaping));
  Scheduler scheduler(f, std::move(devices), columns);
  Columns x(columns, std::vector<float>(n));
  for (std::uint32_t c = 0; c < columns; ++c) {
    for (std::uint32_t i = 0; i < n; ++i) x[c][i] = static_cast<float>((i * 31 + c) % 17) - 5.0F;
  }
  Vector in = scheduler.vector(), out = scheduler.vector();
  scheduler.upload(in, x);
  scheduler.apply(in, out);
  scheduler.download(out, result.y);
  return result;
}

DeviceInfo info_of(const Applied& run) {
  return test::ShapedDevice(run.shaping).info();
}

class TunedShapes : public testing::Test {
 protected:
  test::FreshCache cache;
  test::ShapeSources sources;
  test::Variable allowed{"INTERFLECT_TUNING", "on"};
};

TEST_F(TunedShapes, MatvecIsLaunchedWithTheRowsThatAreKept) {
  const FormFactorMatrix f = matrix();
  const Applied before = run(f, 3);
  EXPECT_EQ(before.shaping->macros.at("matvec").at("ROWS"), 8);
  EXPECT_EQ(before.shaping->groups.at("matvec"), 38U);
  ASSERT_EQ(keep_shape(info_of(before), {.kernel = "matvec", .standard = {{"ROWS", 8}}, .chosen = {{"ROWS", 32}}}), "");
  const Applied after = run(f, 3);
  EXPECT_EQ(after.shaping->macros.at("matvec").at("ROWS"), 32);
  EXPECT_EQ(after.shaping->groups.at("matvec"), 10U);
  EXPECT_EQ(after.y, before.y);
  EXPECT_EQ(run(f, 2).shaping->macros.at("matvec").at("ROWS"), 8) << "another number of columns";
  const test::Variable off("INTERFLECT_TUNING", "off");
  EXPECT_EQ(run(f, 3).shaping->macros.at("matvec").at("ROWS"), 8);
}

TEST_F(TunedShapes, TilesAndBlocksToo) {
  const FormFactorMatrix f = matrix();
  const std::vector<double> area(n, 1.0);
  const PackedMatrix tiles(f, area, Storage::dense16);
  const Applied before = run(tiles, 3);
  EXPECT_EQ(before.shaping->groups.at("tiles16"), 38U);
  TunedShape shape{.kernel = "tiles16"};
  for (const TunableMacro& macro : tunable_macros(info_of(before), "tiles16")) {
    shape.standard[macro.name] = macro.standard;
  }
  shape.chosen = shape.standard;
  ASSERT_TRUE(shape.chosen.contains("STRIPS"));
  shape.chosen["STRIPS"] = 4;
  ASSERT_EQ(keep_shape(info_of(before), shape), "");
  const Applied after = run(tiles, 3);
  EXPECT_EQ(after.shaping->macros.at("tiles16").at("STRIPS"), 4);
  EXPECT_EQ(after.shaping->groups.at("tiles16"), 10U);
  EXPECT_EQ(after.y, before.y);

  const PackedMatrix symmetric(f, area, Storage::sym16);
  const Applied halved = run(symmetric, 3);
  EXPECT_EQ(halved.shaping->macros.at("sym16").at("BLOCK"), static_cast<int>(symmetric.block()));
}

TEST_F(TunedShapes, TheBlockThatIsKeptFitsTheMatrix) {
  const FormFactorMatrix f = matrix();
  const std::vector<double> area(n, 1.0);
  PackedMatrix::Options options;
  options.block = 128;
  const PackedMatrix with(f, area, Storage::sym16, std::move(options)), without(f, area, Storage::dense16);
  const Applied a = run(with, 3), b = run(without, 3);
  EXPECT_EQ(a.shaping->macros.at("sym16").at("BLOCK"), 128);
  for (std::uint32_t c = 0; c < 3; ++c) {
    for (std::uint32_t i = 0; i < n; ++i) EXPECT_NEAR(a.y[c][i], b.y[c][i], 1e-3);
  }
}

}  // namespace
}  // namespace interflect
