#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "backends/devices.h"
#include "device/kernel_folder.h"
#include "interflect/device/check_tools.h"
#include "interflect/device/tuning.h"

// Tuning with a real compiler: a kernel whose source is wrong in one shape.

namespace interflect {
namespace {

std::ptrdiff_t failures(Device& device, int rows) {
  std::vector<KernelCheck> all;
  check::check_matvec(device, all, {.max_size = 300, .columns = tuned_columns, .macros = {{"ROWS", rows}}});
  return std::count_if(all.begin(), all.end(), [](const KernelCheck& row) { return row.status != CheckStatus::pass; });
}

TEST(OpenCLTuning, AKernelThatIsWrongInOneShapeIsNotTakenInIt) {
  const std::string id = "opencl:0";
  if (const std::string why = test::why_unavailable(id); !why.empty()) {
    if (test::required(id)) FAIL() << why;
    GTEST_SKIP() << why;
  }
  test::KernelFolder kernels;
  // In this shape it leaves at once: the fastest there is.
  kernels.replace("cl/matvec.cl", "  const uint last = min(a.rows, first + ROWS);",
                  "  const uint last = ROWS == 16 ? 0 : min(a.rows, first + ROWS);");
  const auto device = open_device(id);
  EXPECT_GT(failures(*device, 16), 0) << "the check sees the shape that it is given";
  EXPECT_EQ(failures(*device, 8), 0);
  const TunedShape shape = search_shape(*device, "matvec", {.seconds = 60, .bytes = 16U << 20});
  EXPECT_NE(shape.chosen.at("ROWS"), 16);
  ASSERT_FALSE(shape.refused.empty());
  EXPECT_THAT(shape.refused.front(), testing::HasSubstr("ROWS=16: n=1 "));
}

}  // namespace
}  // namespace interflect
