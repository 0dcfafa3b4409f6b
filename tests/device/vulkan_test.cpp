#include "interflect/device/vulkan/vulkan.h"

#include <gmock/gmock.h>
#include <gtest/gtest-spi.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>

#include "device/kernel_folder.h"
#include "interflect/base/error.h"
#include "interflect/device/check.h"
#include "interflect/device/check_tools.h"
#include "interflect/device/compile_cache.h"
#include "interflect/device/kernel_arguments.h"
#include "interflect/device/kernel_table.h"
#include "interflect/device/vulkan/api.h"

namespace interflect {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::StartsWith;

std::string describe(const KernelCheck& row) {
  return row.device + " " + row.kernel + " n=" + std::to_string(row.size) + " " + row.parameters + ": error " +
         std::to_string(row.error) + " bound " + std::to_string(row.bound) + " " + row.reason;
}

std::string error_of(const std::function<void()>& action) {
  try {
    action();
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::device) << error.what();
    return error.what();
  }
  return "no error";
}

template <class T>
std::span<const std::byte> bytes_of(const T& block) {
  return std::as_bytes(std::span(&block, 1));
}

std::unique_ptr<Buffer> buffer_of(Device& device, const std::vector<float>& values) {
  auto buffer = device.allocate(values.size() * sizeof(float));
  device.queue().upload(*buffer, 0, std::as_bytes(std::span(values)));
  return buffer;
}

std::vector<float> values_of(Device& device, const Buffer& buffer) {
  std::vector<float> values(buffer.size() / sizeof(float));
  device.queue().download(buffer, 0, std::as_writable_bytes(std::span(values)));
  return values;
}

/// y = F x of a matrix in which every element counts, held against the sums in double.
std::vector<float> product(Device& device, std::uint32_t n, std::uint32_t rows, std::uint32_t columns) {
  const std::uint32_t stride = (n + 15) / 16 * 16;
  std::vector<float> f(std::size_t{rows} * stride), x(std::size_t{columns} * stride);
  for (std::size_t i = 0; i < f.size(); ++i) f[i] = 0.5F + static_cast<float>(i % 1021) / 1024;
  for (std::size_t i = 0; i < x.size(); ++i) x[i] = 0.5F + static_cast<float>(i % 509) / 512;
  const auto fb = buffer_of(device, f), xb = buffer_of(device, x);
  const auto yb = device.allocate(x.size() * sizeof(float));
  const std::uint32_t group = device.info().rows_per_group;
  const auto kernel =
      device.kernel("matvec", {{"COLUMNS", static_cast<int>(columns)}, {"ROWS", static_cast<int>(group)}});
  const MatvecArguments a{n, 0, rows, stride, stride};
  Buffer* const buffers[] = {fb.get(), xb.get(), yb.get()};
  device.queue().launch(*kernel, (rows + group - 1) / group, buffers, bytes_of(a), "Test");
  const std::vector<float> y = values_of(device, *yb);
  for (std::uint32_t c = 0; c < columns; ++c) {
    for (std::uint32_t r = 0; r < rows; ++r) {
      double sum = 0;
      for (std::uint32_t j = 0; j < n; ++j) {
        sum +=
            static_cast<double>(f[std::size_t{r} * stride + j]) * static_cast<double>(x[std::size_t{c} * stride + j]);
      }
      EXPECT_LE(std::abs(static_cast<double>(y[std::size_t{c} * stride + r]) - sum), sum * matvec_bound(n))
          << "row " << r << " column " << c;
    }
  }
  return y;
}

/// Fails a test, of all in this program, that leaves messages of the validation layer: those that come after the last
/// wait() or download(), as of objects that were not destroyed before their device.
struct Leftovers : testing::EmptyTestEventListener {
  void OnTestEnd(const testing::TestInfo&) override { expect_none(); }
  void OnTestSuiteEnd(const testing::TestSuite&) override { expect_none(); }
  static void expect_none() { EXPECT_THAT(vulkan::Messages::all().take(), testing::IsEmpty()); }
};
const bool listening = (testing::UnitTest::GetInstance()->listeners().Append(new Leftovers), true);  // gtest deletes it

/// Under validation, with an empty cache of compiled kernels.
class Vulkan : public testing::Test {
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
  [[nodiscard]] std::uint32_t index() const { return index_; }

 private:
  test::FreshCache cache_;
  test::Variable validation_{"INTERFLECT_VULKAN_VALIDATION", "1"};
  std::uint32_t index_ = 0;
  std::string why_;
};

/// In both shapes.
class VulkanShapes : public Vulkan, public testing::WithParamInterface<const char*> {
 private:
  test::Variable shape_{"INTERFLECT_VULKAN_SHAPE", GetParam()};
};
INSTANTIATE_TEST_SUITE_P(Shape, VulkanShapes, testing::Values("cpu", "gpu"),
                         [](const auto& shape) { return std::string(shape.param); });

void expect_all_pass(Device& device) {
  const std::vector<KernelCheck> rows = check_device(device);
  EXPECT_GT(rows.size(), 700U);
  for (const KernelCheck& row : rows) EXPECT_EQ(row.status, CheckStatus::pass) << describe(row);
  device.queue().wait();  // would throw what validation says
}

TEST_P(VulkanShapes, KernelsStayWithinTheirBoundsOnEveryDevice) {
  std::uint32_t index = 0;
  for (const DeviceEntry& entry : vulkan::list_devices()) {
    const std::uint32_t here = index++;
    EXPECT_EQ(entry.info.id, "vulkan:" + std::to_string(here));
    if (!entry.available) continue;
    const auto device = vulkan::open_device(here);
    EXPECT_EQ(device->info().id, entry.info.id);
    EXPECT_FALSE(entry.info.name.empty());
    EXPECT_FALSE(entry.info.driver.empty());
    EXPECT_EQ(entry.info.hardware.empty(), entry.info.type != DeviceType::gpu);
    expect_all_pass(*device);
  }
}

TEST_F(Vulkan, EverySubgroupSizeAndSharedMemoryGiveTheSameSums) {
  const test::Variable shape("INTERFLECT_VULKAN_SHAPE", "gpu");
  vulkan::Adapter adapter = std::move(vulkan::adapters(vulkan::Instance()).at(index()));
  std::vector<std::string> sizes = {"0"};
  for (std::uint32_t size = adapter.smallest_subgroup; size != 0 && size <= adapter.largest_subgroup; size *= 2) {
    sizes.push_back(std::to_string(size));
  }
  for (const std::string& size : sizes) {
    SCOPED_TRACE("subgroup size " + size);
    const test::Variable forced("INTERFLECT_VULKAN_SUBGROUP", size);
    const auto device = open();
    std::vector<KernelCheck> rows;
    check::check_stream(*device, rows);
    check::check_matvec(*device, rows, {.columns = 3});
    check::check_vectors(*device, rows);
    EXPECT_GT(rows.size(), 450U);
    for (const KernelCheck& row : rows) EXPECT_EQ(row.status, CheckStatus::pass) << describe(row);
    device->queue().wait();  // would throw what validation says
  }
  if (sizes.size() == 1) GTEST_SKIP() << "the device lets choose no subgroup size; shared memory was tested";
}

TEST_P(VulkanShapes, TheSameBitsInTwoRuns) {
  const auto device = open();
  EXPECT_EQ(product(*device, 1313, 65, 4), product(*device, 1313, 65, 4));
  const std::uint32_t n = 5791, stride = 5792;
  const VectorArguments a{n, stride, 1, 6, 1, 0, 0};
  std::vector<float> values(stride);
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = std::sin(static_cast<float>(i));
  const auto x = buffer_of(*device, values), y = buffer_of(*device, values);
  const auto dot = device->kernel("dot", {});
  const auto run = [&] {
    const auto sums = device->allocate(sums_size(1, 6) * sizeof(float));
    Buffer* const buffers[] = {x.get(), y.get(), sums.get()};
    device->queue().launch(*dot, 6, buffers, bytes_of(a), "Test");
    return values_of(*device, *sums);
  };
  const std::vector<float> first = run();
  EXPECT_GT(first[scalar_slots], 0);
  EXPECT_EQ(run(), first);
}

// lavapipe ends the loops of an invocation silently after 65,535 iterations; here a plain loop over fours has 262,144.
TEST_P(VulkanShapes, TheLargestProductIsRightAndALargerOneRefused) {
  const auto device = open();
  static_cast<void>(product(*device, largest_n, 3, 3));
  const std::uint32_t n = largest_n + 1, stride = n + 15;
  const auto f = device->allocate(stride * sizeof(float));
  const auto x = device->allocate(stride * sizeof(float)), y = device->allocate(stride * sizeof(float));
  const auto kernel = device->kernel("matvec", {{"COLUMNS", 1}, {"ROWS", 8}});
  const MatvecArguments a{n, 0, 1, stride, stride};
  Buffer* const buffers[] = {f.get(), x.get(), y.get()};
  EXPECT_THAT(error_of([&] { device->queue().launch(*kernel, 1, buffers, bytes_of(a), "Test"); }),
              HasSubstr("n is larger than 1048576"));
}

// Sizes around a piece of the staging memory, 16 MiB.
TEST_P(VulkanShapes, BuffersBeginAsZerosAndKeepTheOrderOfTransfers) {
  const auto device = open();
  for (const std::size_t bytes :
       {std::size_t{1}, std::size_t{4000}, std::size_t{16} << 20, (std::size_t{33} << 20) + 5}) {
    const auto buffer = device->allocate(bytes);
    std::vector<std::byte> values(bytes, std::byte{7});
    device->queue().download(*buffer, 0, values);
    EXPECT_EQ(values, std::vector<std::byte>(bytes)) << bytes;
    for (const std::byte value : {std::byte{1}, std::byte{2}, std::byte{3}}) {
      std::vector<std::byte> passing(bytes, value);
      device->queue().upload(*buffer, 0, passing);
      passing.assign(bytes, std::byte{9});  // may be reused at once
    }
    const std::byte last[] = {std::byte{4}};
    device->queue().upload(*buffer, bytes - 1, last);
    device->queue().download(*buffer, 0, values);
    std::vector<std::byte> expected(bytes, std::byte{3});
    expected.back() = std::byte{4};
    EXPECT_EQ(values, expected) << bytes;
  }
}

// More launches than a submission holds, each needing the one before; then new buffers in place of old ones, whose
// descriptor sets must not be taken for theirs, freed while launches that use them are under way.
TEST_P(VulkanShapes, ManyLaunchesInOrderAndBuffersThatComeAndGo) {
  const auto device = open();
  const std::uint32_t n = 1000;
  const VectorArguments a{n, 1008, 1, 1, 1, 0, 0};
  std::vector<float> scalars(sums_size(1, 1));
  scalars[slot::axpby_a] = scalars[slot::axpby_b] = 1;
  const auto x = buffer_of(*device, std::vector<float>(n, 1.0F)), y = buffer_of(*device, std::vector<float>(n, 0.0F));
  const auto sums = buffer_of(*device, scalars);
  const auto axpby = device->kernel("axpby", {});
  Buffer* const buffers[] = {x.get(), y.get(), sums.get()};
  for (int i = 0; i < 200; ++i) device->queue().launch(*axpby, 1, buffers, bytes_of(a), "Test");
  EXPECT_EQ(values_of(*device, *y), std::vector<float>(n, 200.0F));

  const auto copy = device->kernel("copy", {});
  const StreamArguments lines{n / 16};
  const auto to = device->allocate(n * sizeof(float));
  for (int i = 0; i < 20; ++i) {
    auto from = buffer_of(*device, std::vector<float>(n, static_cast<float>(i)));
    Buffer* const pair[] = {from.get(), to.get()};
    device->queue().launch(*copy, 3, pair, bytes_of(lines), "Test");
    from.reset();
    EXPECT_EQ(values_of(*device, *to).front(), static_cast<float>(i));
  }
}

/// The functions that a device is called by, to replace.
vk::raii::DeviceDispatcher& functions_of(vulkan::Context& context) {
  return const_cast<vk::raii::DeviceDispatcher&>(*context.device.getDispatcher());
}

TEST_P(VulkanShapes, AnIterationWaitsOnce) {
  static PFN_vkWaitForFences wait;
  static int waits;
  const auto context = vulkan::open_context(index());
  wait = std::exchange(functions_of(*context).vkWaitForFences, [](auto... arguments) {
    ++waits;
    return wait(arguments...);
  });
  const auto device = vulkan::open_device(context, true);
  const auto from = buffer_of(*device, std::vector<float>(16, 1.0F)), to = device->allocate(64);
  const auto copy = device->kernel("copy", {});
  Buffer* const pair[] = {from.get(), to.get()};
  for (int i = 0; i < 5; ++i) {
    device->queue().wait();
    waits = 0;
    for (int k = 0; k < 3; ++k) device->queue().launch(*copy, 1, pair, bytes_of(StreamArguments{1}), "Test");
    EXPECT_EQ(values_of(*device, *to), std::vector<float>(16, 1.0F));
    EXPECT_EQ(waits, 1);
  }
}

// A buffer goes and what was launched before cannot be handed over: nobody may read old contents as the result.
TEST_P(VulkanShapes, LaunchesLostWhenABufferGoesAreReported) {
  const auto context = vulkan::open_context(index());
  const auto device = vulkan::open_device(context, true);
  Queue& queue = device->queue();
  const auto from = buffer_of(*device, std::vector<float>(16, 1.0F)), to = device->allocate(64);
  const auto copy = device->kernel("copy", {});
  Buffer* const pair[] = {from.get(), to.get()};
  const auto launch = [&] { queue.launch(*copy, 1, pair, bytes_of(StreamArguments{1}), "Test"); };
  const std::function<void()> uses[] = {launch, [&] { static_cast<void>(values_of(*device, *to)); },
                                        [&] { queue.upload(*to, 0, bytes_of(1.0F)); }, [&] { queue.wait(); }};
  for (const auto& use : uses) {
    auto other = device->allocate(64);
    launch();
    auto& submit = functions_of(*context).vkQueueSubmit;
    const auto real = std::exchange(submit, [](auto...) { return VK_ERROR_OUT_OF_DEVICE_MEMORY; });
    other.reset();
    submit = real;
    EXPECT_THAT(error_of(use), HasSubstr("commands before it were lost: VK_ERROR_OUT_OF_DEVICE_MEMORY (-2)"));
  }
  launch();
  EXPECT_EQ(values_of(*device, *to), std::vector<float>(16, 1.0F));
}

TEST_P(VulkanShapes, BuffersAndKernelsMayOutliveTheirDevice) {
  auto device = open();
  const auto buffer = device->allocate(64);
  const auto kernel = device->kernel("copy", {});
  device.reset();
  EXPECT_EQ(buffer->size(), 64U);
}

TEST_P(VulkanShapes, RefusesMemoryThatNoMachineHas) {
  const auto device = open();
  EXPECT_THAT(error_of([&] { static_cast<void>(device->allocate(SIZE_MAX / 2)); }),
              AllOf(StartsWith("vulkan:"), HasSubstr("allocate")));
  EXPECT_EQ(device->share(std::make_shared<PageBuffer>(4096)), nullptr);
}

TEST_F(Vulkan, ACompileErrorNamesFileAndLine) {
  const auto device = open();
  test::KernelFolder folder;
  folder.replace("glsl/axpby.comp", "VECTOR(1, y)\n", "VECTOR(1, y)\nthis is not GLSL;\n");
  const std::string error = error_of([&] { static_cast<void>(device->kernel("axpby", {})); });
  const std::string first_line = error.substr(0, error.find('\n'));
  EXPECT_THAT(first_line, AllOf(HasSubstr("kernel axpby"), HasSubstr("glsl/axpby.comp:6")));
  EXPECT_GT(error.size(), first_line.size() + 10) << "the log";
}

TEST_F(Vulkan, CompiledKernelsComeFromTheCacheUntilDamagedOrChanged) {
  test::KernelFolder folder;
  const auto device = open();
  const auto compiled_by = [&](int streams) {
    const CompileStatistics before = compile_statistics();
    static_cast<void>(device->kernel("read", {{"STREAMS", streams}}));
    const CompileStatistics after = compile_statistics();
    EXPECT_EQ(after.compiled + after.from_cache, before.compiled + before.from_cache + 1);
    EXPECT_GT(after.seconds, before.seconds);
    return after.compiled - before.compiled;
  };
  EXPECT_EQ(compiled_by(1), 1U);
  EXPECT_EQ(compiled_by(1), 0U);
  EXPECT_EQ(compiled_by(2), 1U) << "another macro";
  for (const auto& entry : std::filesystem::directory_iterator(folder.cache().entries())) {
    std::filesystem::resize_file(entry.path(), std::filesystem::file_size(entry.path()) - 4);
  }
  EXPECT_EQ(compiled_by(1), 1U) << "damaged";
  EXPECT_EQ(compiled_by(1), 0U);
  folder.replace("glsl/read.comp", "void main() {", "// another source\nvoid main() {");
  EXPECT_EQ(compiled_by(1), 1U) << "another source";
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

class BrokenVulkanKernel : public Vulkan, public testing::WithParamInterface<Defect> {};

TEST_P(BrokenVulkanKernel, FailsTheCheck) {
  const Defect& defect = GetParam();
  const test::Variable shape("INTERFLECT_VULKAN_SHAPE", defect.shape);
  const test::Variable subgroup("INTERFLECT_VULKAN_SUBGROUP", defect.subgroup);
  test::KernelFolder folder;
  folder.replace(defect.file, defect.from, defect.to);
  std::size_t failed = 0;
  const auto device = open();
  std::vector<KernelCheck> rows;
  if (defect.kernel == std::string_view("matvec")) {
    check::check_matvec(*device, rows, {.max_size = 1312, .columns = 3});
  } else {
    check::check_vectors(*device, rows);
  }
  for (const KernelCheck& row : rows) {
    if (row.kernel != defect.kernel || row.status != CheckStatus::fail) continue;
    EXPECT_THAT(row.reason, testing::Not(HasSubstr("ERROR"))) << "it does not even compile";
    ++failed;
  }
  EXPECT_GT(failed, 0U);
}

constexpr const char* tree_barrier = "    }\n    barrier();\n";
INSTANTIATE_TEST_SUITE_P(
    Twin, BrokenVulkanKernel,
    testing::Values(
        Defect{"TailOfMatvecDropped", "glsl/matvec.comp", "a.n % 4u != 0u", "false", "matvec", "cpu", ""},
        Defect{"PaddingOfMatvecRead", "glsl/matvec.comp", "uvec4(a.n % 4u)", "uvec4(4u)", "matvec", "gpu", ""},
        Defect{"WrongRowStride", "glsl/matvec.comp", "a.row_stride / 4u", "(a.n + 3u) / 4u", "matvec", "cpu", ""},
        Defect{"WrongVectorStride", "glsl/matvec.comp", "a.vector_stride / 4u", "a.row_stride / 4u", "matvec", "gpu",
               ""},
        Defect{"RowsPastTheLastStored", "glsl/matvec.comp", "row_of(r) < a.rows && ", "", "matvec", "cpu", ""},
        Defect{"BarrierOfTheTreeRemoved", "glsl/group_sum.comp", tree_barrier, "    }\n", "dot", "gpu", "0"},
        Defect{"BarrierOfTheRowsRemoved", "glsl/matvec.comp", "  barrier();\n", "", "matvec", "gpu", ""},
        Defect{"TailOfABlockDropped", "glsl/blocks.comp", "min(a.n, ", "min(a.n / 16u * 16u, ", "axpby", "cpu", ""},
        Defect{"LastBlockNotInATotal", "glsl/blocks.comp", "b < a.blocks", "b + 1u < a.blocks", "reduce", "gpu", ""}),
    [](const auto& defect) { return std::string(defect.param.name); });

// Validation, and what the environment can say.

/// Two launches, the second of which overwrites what the first one reads and writes.
std::string two_launches(Device& device) {
  const VectorArguments a{16, 16, 1, 1, 1, 0, 0};
  const auto x = device.allocate(64), y = device.allocate(64), sums = device.allocate(sums_size(1, 1) * sizeof(float));
  const auto axpby = device.kernel("axpby", {});
  Buffer* const there[] = {x.get(), y.get(), sums.get()};
  Buffer* const back[] = {y.get(), x.get(), sums.get()};
  return error_of([&] {
    device.queue().launch(*axpby, 1, there, bytes_of(a), "There");
    device.queue().launch(*axpby, 1, back, bytes_of(a), "Back");
    device.queue().wait();
  });
}

TEST_F(Vulkan, ARemovedBarrierIsReported) {
  EXPECT_EQ(two_launches(*open()), "no error");
  EXPECT_THAT(two_launches(*vulkan::open_device(vulkan::open_context(index()), false)),
              AllOf(StartsWith("vulkan:"), HasSubstr("wait"), HasSubstr("SYNC-HAZARD")));
}

TEST_F(Vulkan, ALeakedObjectFailsTheTest) {
  {
    const auto context = vulkan::open_context(index());
    const vk::BufferCreateInfo buffer({}, 64, vk::BufferUsageFlagBits::eStorageBuffer);
    static_cast<void>((*context->device).createBuffer(buffer, nullptr, *context->device.getDispatcher()));
  }
  const testing::TestInfo& test = *testing::UnitTest::GetInstance()->current_test_info();
  EXPECT_NONFATAL_FAILURE(Leftovers().OnTestEnd(test), "VkBuffer");
  Leftovers().OnTestEnd(test);  // they are taken
}

TEST_F(Vulkan, WithoutItsLayerValidationIsAnErrorThatSaysSo) {
  const test::TemporaryFolder empty("layers");
  const test::Variable path("VK_LAYER_PATH", empty.path().string());
  const std::vector<DeviceEntry> entries = vulkan::list_devices();
  ASSERT_EQ(entries.size(), 1U);
  EXPECT_FALSE(entries[0].available);
  EXPECT_THAT(entries[0].reason, HasSubstr("VK_LAYER_KHRONOS_validation is not installed"));
  EXPECT_THAT(error_of([&] { static_cast<void>(open()); }), HasSubstr("VK_LAYER_KHRONOS_validation"));
}

TEST(VulkanEnvironment, WithoutADriverOneEntrySaysWhy) {
  const test::TemporaryFolder empty("drivers");
  const test::Variable old_name("VK_ICD_FILENAMES", (empty.path() / "none.json").string());
  const test::Variable new_name("VK_DRIVER_FILES", (empty.path() / "none.json").string());
  const std::vector<DeviceEntry> entries = vulkan::list_devices();
  ASSERT_EQ(entries.size(), 1U);
  EXPECT_EQ(entries[0].info.id, "vulkan:0");
  EXPECT_EQ(entries[0].info.backend, "vulkan");
  EXPECT_FALSE(entries[0].available);
  EXPECT_EQ(entries[0].reason, "no Vulkan driver found: VK_ERROR_INCOMPATIBLE_DRIVER (-9)");
  EXPECT_THAT(error_of([] { static_cast<void>(vulkan::open_device(0)); }), HasSubstr("VK_ERROR_INCOMPATIBLE_DRIVER"));
}

TEST_F(Vulkan, AValueThatTheEnvironmentCannotHaveIsAnError) {
  for (const char* const name :
       {"INTERFLECT_VULKAN_SHAPE", "INTERFLECT_VULKAN_SUBGROUP", "INTERFLECT_VULKAN_VALIDATION"}) {
    const test::Variable wrong(name, "3");
    const std::string cause = std::string(name) + ": '3' ";
    EXPECT_THAT(error_of([&] { static_cast<void>(open()); }),
                StartsWith("vulkan:" + std::to_string(index()) + ": open: " + cause));
    for (const DeviceEntry& entry : vulkan::list_devices()) {
      EXPECT_FALSE(entry.available);
      EXPECT_THAT(entry.reason, StartsWith(cause));
    }
  }
}

}  // namespace
}  // namespace interflect
