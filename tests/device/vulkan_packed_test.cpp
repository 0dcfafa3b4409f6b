#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "device/kernel_folder.h"
#include "interflect/base/half.h"
#include "interflect/device/check_tools.h"
#include "interflect/device/kernel_arguments.h"
#include "interflect/device/vulkan/vulkan.h"

// The Vulkan kernels of the 16-bit formats: within their bounds in every shape, and broken ones outside.

namespace interflect {
namespace {

using testing::HasSubstr;
using testing::Not;

std::string describe(const KernelCheck& row) {
  return row.kernel + " n=" + std::to_string(row.size) + " " + row.parameters + ": error " + std::to_string(row.error) +
         " bound " + std::to_string(row.bound) + " " + row.reason;
}

/// Under validation, with an empty cache of compiled kernels.
class VulkanPacked : public testing::Test {
 protected:
  void SetUp() override {
    for (const DeviceEntry& entry : vulkan::list_devices()) {
      if (entry.available) return;
      why_ = entry.info.id + ": " + entry.reason;
      ++index_;
    }
    GTEST_SKIP() << "no Vulkan device: " << why_;
  }
  /// The first device that is available.
  [[nodiscard]] std::unique_ptr<Device> open() const { return vulkan::open_device(index_); }

 private:
  test::FreshCache cache_;
  test::Variable validation_{"INTERFLECT_VULKAN_VALIDATION", "1"};
  std::uint32_t index_ = 0;
  std::string why_;
};

/// INTERFLECT_VULKAN_SHAPE and INTERFLECT_VULKAN_SUBGROUP: the device's subgroups, or none.
struct Setting {
  const char* shape;
  const char* subgroup;
};
void PrintTo(const Setting& setting, std::ostream* out) {
  *out << setting.shape << (*setting.subgroup == '\0' ? "" : "NoSubgroups");
}

class VulkanPackedShapes : public VulkanPacked, public testing::WithParamInterface<Setting> {
 private:
  test::Variable shape_{"INTERFLECT_VULKAN_SHAPE", GetParam().shape};
  test::Variable subgroup_{"INTERFLECT_VULKAN_SUBGROUP", GetParam().subgroup};
};
INSTANTIATE_TEST_SUITE_P(Setting, VulkanPackedShapes,
                         testing::Values(Setting{"cpu", ""}, Setting{"cpu", "0"}, Setting{"gpu", ""},
                                         Setting{"gpu", "0"}),
                         testing::PrintToStringParamName());

TEST_P(VulkanPackedShapes, KernelsStayWithinTheirBounds) {
  const auto device = open();
  std::vector<KernelCheck> rows;
  check::check_packed(*device, rows);
  EXPECT_GT(rows.size(), 250U);
  for (const KernelCheck& row : rows) EXPECT_EQ(row.status, CheckStatus::pass) << describe(row);
  device->queue().wait();  // would throw what validation says
}

template <class T>
std::unique_ptr<Buffer> buffer_of(Device& device, const std::vector<T>& values) {
  auto buffer = device.allocate(values.size() * sizeof(T));
  device.queue().upload(*buffer, 0, std::as_bytes(std::span(values)));
  return buffer;
}

/// The partial sums of the three blocks of a matrix of 256 rows without zeros.
std::vector<std::uint32_t> bits_of_sym16(Device& device) {
  constexpr std::uint32_t block = 128, strips = 16, tiles = 8, columns = 3, stride = 256;
  const SymmetricArguments a{3, 3 * strips, 3 * strips * tiles, 2, stride};
  std::vector<std::uint32_t> index;
  const std::uint32_t places[3][2] = {{0, 0}, {0, 1}, {1, 1}};
  for (std::uint32_t k = 0; k < 3; ++k) {
    index.insert(index.end(), {places[k][0], places[k][1], k * strips, (k + 1) * strips});
  }
  for (std::uint32_t s = 0; s < a.strips; ++s) index.push_back(s % strips);
  for (std::uint32_t s = 0; s <= a.strips; ++s) index.push_back(s * tiles);
  for (std::uint32_t t = 0; t < a.tiles; ++t) index.push_back(t % tiles);
  std::vector<Half> halves(std::size_t{a.tiles} * tile_elements);
  for (std::size_t i = 0; i < halves.size(); ++i) halves[i] = to_half(std::sin(static_cast<float>(i)));
  std::vector<float> x(std::size_t{columns} * stride);
  for (std::size_t i = 0; i < x.size(); ++i) x[i] = std::cos(static_cast<float>(i));
  const auto elements = buffer_of(device, halves), lists = buffer_of(device, index), xs = buffer_of(device, x);
  const auto partial = device.allocate(std::size_t{4} * columns * block * sizeof(float));
  const auto kernel = device.kernel("sym16", {{"COLUMNS", columns}, {"BLOCK", block}});
  Buffer* const buffers[] = {elements.get(), lists.get(), xs.get(), partial.get()};
  device.queue().launch(*kernel, a.blocks, buffers, std::as_bytes(std::span(&a, 1)), "Test");
  std::vector<std::uint32_t> bits(partial->size() / sizeof(float));
  device.queue().download(*partial, 0, std::as_writable_bytes(std::span(bits)));
  return bits;
}

TEST_P(VulkanPackedShapes, TheSameBitsInTwoRuns) {
  const auto device = open();
  const std::vector<std::uint32_t> first = bits_of_sym16(*device);
  EXPECT_THAT(first, testing::Each(testing::Ne(0U)));
  EXPECT_EQ(bits_of_sym16(*device), first);
}

// The twins: a broken kernel fails the check.

struct Defect {
  const char* name;
  const char* file;
  const char* from;
  const char* to;
  const char* kernel;  ///< whose cases must show it
  const char* shape;
  const char* subgroup;
};

void PrintTo(const Defect& defect, std::ostream* out) {
  *out << defect.shape << ", " << defect.file;
}

class BrokenPackedKernel : public VulkanPacked, public testing::WithParamInterface<Defect> {};

TEST_P(BrokenPackedKernel, FailsTheCheck) {
  const Defect& defect = GetParam();
  const test::Variable shape("INTERFLECT_VULKAN_SHAPE", defect.shape);
  const test::Variable subgroup("INTERFLECT_VULKAN_SUBGROUP", defect.subgroup);
  test::KernelFolder folder;
  folder.replace(defect.file, defect.from, defect.to);
  const auto device = open();
  std::vector<KernelCheck> rows;
  check::check_packed(*device, rows, {.max_size = 1312, .columns = 3, .kernel = defect.kernel});
  std::size_t failed = 0;
  for (const KernelCheck& row : rows) {
    if (row.status != CheckStatus::fail) continue;
    EXPECT_THAT(row.reason, Not(HasSubstr("ERROR"))) << "it does not even compile";
    ++failed;
  }
  EXPECT_GT(failed, 0U);
}

constexpr const char* row_check =
    "row < a.n && column_of(c) < COLUMNS) {\n        y[column_of(c) * a.vector_stride + row] = t[row]";
constexpr const char* no_row_check =
    "column_of(c) < COLUMNS) {\n        y[column_of(c) * a.vector_stride + row] = t[min(row, a.n - 1u)]";
constexpr const char* flushed = "(unpackHalf2x16(words.x) * step(vec2(6.2e-5), abs(unpackHalf2x16(words.x))))";
INSTANTIATE_TEST_SUITE_P(
    Twin, BrokenPackedKernel,
    testing::Values(
        Defect{"WrongScaleIndex", "glsl/scale.comp", "s[i - column * a.vector_stride]", "s[i - begin]", "scale", "cpu",
               ""},
        Defect{"TileRowsDropped", "glsl/tiles16.comp", "2u * r", "0u", "tiles16", "cpu", ""},
        Defect{"WrongTileColumn", "glsl/tiles16.comp", "a.strips + 1u + k", "a.strips + k", "tiles16", "cpu", ""},
        Defect{"ScaleOfThePanelsFirstRows", "glsl/tiles16.comp", "t[row]", "t[row - a.first]", "tiles16", "gpu", ""},
        Defect{"RowsPastNStored", "glsl/tiles16.comp", row_check, no_row_check, "tiles16", "gpu", ""},
        Defect{"SubnormalHalvesFlushed", "glsl/halves.comp", "unpackHalf2x16(words.x)", flushed, "tiles16", "cpu", ""},
        Defect{"ColumnSumsLost", "glsl/sym16.comp", "add_four(to + 1u, sum[c].high)", "{}", "sym16", "cpu", "0"},
        Defect{"HighColumnSumsLost", "glsl/sym16_exchange.comp", "own_half() + 1u, high##c",
               "own_half() + 1u, vec4(0.0)", "sym16", "cpu", ""},
        Defect{"FarTilesOfAStripSkipped", "glsl/sym16_exchange.comp", "(own_bit - 1u)", "0u", "sym16", "cpu", ""},
        Defect{"MissingTilesTaken", "glsl/sym16_exchange.comp", "(step & own_bit) != 0u ? ~0u : 0u", "~0u", "sym16",
               "cpu", ""},
        Defect{"StripsNotListed", "glsl/sym16_exchange.comp", "    t += 8u;\n  } while (t < count)",
               "    t += 16u;\n  } while (t < count)", "sym16", "cpu", ""},
        Defect{"TileColumnsBeforeNotCounted", "glsl/sym16_exchange.comp", "bitCount(strip.z & before.x)", "0", "sym16",
               "cpu", ""},
        Defect{"ColumnSumsOfAPartLost", "glsl/sym16.comp", "part < ROW_PARTS", "part < 1u", "sym16", "gpu", ""},
        Defect{"RowSumsNotExchanged", "glsl/sym16_exchange.comp", "halve(sum1, vec4(0.0), 4u)", "sum1", "sym16", "cpu",
               ""},
        Defect{"SumsNotCleared", "glsl/sym16.comp", "  clear_sums();\n", "", "sym16", "cpu", ""},
        Defect{"TilesBeforeNotCounted", "glsl/sym16.comp", "bitCount(strip.z & before.x)", "0", "sym16", "gpu", ""},
        Defect{"BarrierOfTheSharesRemoved", "glsl/sym16.comp", "  barrier();\n  // Row", "  // Row", "sym16", "gpu",
               ""},
        Defect{"BarrierOfTheSlicesRemoved", "glsl/sym16.comp", "  barrier();\n  for (uint k", "  for (uint k", "sym16",
               "gpu", "0"},
        Defect{"FoldForgetsASlot", "glsl/sym16.comp", "j + u < a.slot", "j + u + 1u < a.slot", "sym16_fold", "cpu", ""},
        Defect{"FoldTakesTheWrongScale", "glsl/sym16.comp", "t[k + u]", "t[k]", "sym16_fold", "gpu", ""}),
    [](const auto& defect) { return std::string(defect.param.name); });

}  // namespace
}  // namespace interflect
