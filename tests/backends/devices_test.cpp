// What every device does, whatever its backend: memory, transfers, kernels by name, checked launches, the same bits.

#include "backends/devices.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cstring>
#include <functional>

#include "interflect/base/error.h"
#include "interflect/device/check.h"
#include "interflect/device/check_tools.h"
#include "interflect/device/kernel_arguments.h"

namespace interflect {
namespace {

using testing::AllOf;
using testing::HasSubstr;

class Devices : public test::OnDevice {
 protected:
  void expect_device_error(const testing::Matcher<std::string>& message, const std::function<void()>& action) {
    try {
      action();
      FAIL() << "no error";
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::device) << error.what();
      EXPECT_THAT(std::string(error.what()), AllOf(HasSubstr(GetParam()), message));
    }
  }
  /// A matvec of two columns with buffers of these sizes in floats.
  void launch(MatvecArguments arguments, std::array<std::size_t, 3> floats) {
    const auto kernel = device->kernel("matvec", {{"COLUMNS", 2}});
    std::array<std::unique_ptr<Buffer>, 3> owners;
    std::array<Buffer*, 3> buffers{};
    for (std::size_t i = 0; i < 3; ++i) {
      owners[i] = device->allocate(floats[i] * sizeof(float));
      buffers[i] = owners[i].get();
    }
    device->queue().launch(*kernel, 1, buffers, std::as_bytes(std::span(&arguments, 1)), "Test");
  }
};

TEST_P(Devices, StatesWhatItIs) {
  const DeviceInfo& info = device->info();
  EXPECT_EQ(info.id, GetParam());
  EXPECT_EQ(info.backend, info.id.substr(0, info.id.find(':')));
  EXPECT_FALSE(info.name.empty());
  EXPECT_FALSE(info.driver.empty());
  EXPECT_GT(info.memory_bytes, std::uint64_t{1} << 20);
  EXPECT_GE(info.max_buffer_bytes, std::uint64_t{1} << 20);
  EXPECT_EQ(info.emulated(), info.type == DeviceType::cpu && info.backend != "openmp");
}

TEST_P(Devices, BuffersBeginAsZerosAndGiveBackWhatWasUploaded) {
  for (const std::size_t bytes : {std::size_t{1}, std::size_t{4000}, (std::size_t{3} << 20) + 5}) {
    const auto buffer = device->allocate(bytes);
    EXPECT_EQ(buffer->size(), bytes);
    std::vector<std::byte> values(bytes, std::byte{7});
    device->queue().download(*buffer, 0, values);
    EXPECT_EQ(values, std::vector<std::byte>(bytes)) << bytes;
    const std::array<std::byte, 1> last{std::byte{9}};
    device->queue().upload(*buffer, bytes - 1, last);
    values.back() = std::byte{9};
    std::vector<std::byte> again(bytes);
    device->queue().download(*buffer, 0, again);
    EXPECT_EQ(again, values) << bytes;
  }
}

TEST_P(Devices, TransfersOutOfRangeAreErrors) {
  const auto buffer = device->allocate(64);
  std::array<std::byte, 65> bytes{};
  expect_device_error(AllOf(HasSubstr("upload"), HasSubstr("64")), [&] { device->queue().upload(*buffer, 0, bytes); });
  expect_device_error(HasSubstr("upload"), [&] { device->queue().upload(*buffer, 65, {}); });
  expect_device_error(HasSubstr("upload"),
                      [&] { device->queue().upload(*buffer, SIZE_MAX, std::span(bytes).first(2)); });
  expect_device_error(HasSubstr("download"), [&] { device->queue().download(*buffer, 1, std::span(bytes).first(64)); });
  device->queue().upload(*buffer, 64, {});
}

TEST_P(Devices, SharedMemoryIsUsedInPlaceAndNeverWritten) {
  const auto memory = std::make_shared<PageBuffer>(256);
  memory->data()[3] = std::byte{5};
  const auto shared = device->share(memory);
  if (shared == nullptr) GTEST_SKIP() << GetParam() << " does not share the host's memory";
  EXPECT_EQ(shared->size(), 256U);
  std::array<std::byte, 1> seen{};
  device->queue().download(*shared, 3, seen);
  EXPECT_EQ(seen[0], std::byte{5});
  expect_device_error(HasSubstr("read only"), [&] { device->queue().upload(*shared, 0, seen); });
  const auto other = device->allocate(256);
  const auto copy = device->kernel("copy", {});
  const StreamArguments arguments{4};
  const auto bytes = std::as_bytes(std::span(&arguments, 1));
  Buffer* const from_shared[] = {shared.get(), other.get()};
  Buffer* const to_shared[] = {other.get(), shared.get()};
  device->queue().launch(*copy, 1, from_shared, bytes, "Out");
  device->queue().download(*other, 3, seen);
  EXPECT_EQ(seen[0], std::byte{5});
  expect_device_error(AllOf(HasSubstr("copy"), HasSubstr("Back"), HasSubstr("buffer 1")),
                      [&] { device->queue().launch(*copy, 1, to_shared, bytes, "Back"); });
  expect_device_error(HasSubstr("share"), [&] { static_cast<void>(device->share(nullptr)); });
}

TEST_P(Devices, SharedMemoryOutlivesItsOwner) {
  auto memory = std::make_shared<PageBuffer>(64);
  const std::weak_ptr<PageBuffer> watch = memory;
  auto shared = device->share(std::move(memory));
  if (shared == nullptr) GTEST_SKIP() << GetParam() << " does not share the host's memory";
  EXPECT_FALSE(watch.expired());
  shared.reset();
  EXPECT_TRUE(watch.expired());
}

TEST_P(Devices, RefusesMemoryThatNoMachineHas) {
  expect_device_error(HasSubstr("allocate"), [&] { static_cast<void>(device->allocate(SIZE_MAX / 2)); });
}

TEST_P(Devices, KernelsAreKnownByNameAndMacros) {
  EXPECT_EQ(device->kernel("matvec", {{"COLUMNS", 24}})->name(), "matvec");
  EXPECT_EQ(device->kernel("matvec", {{"COLUMNS", 3}, {"WORKGROUP", 64}})->name(), "matvec") << "others' macros";
  const auto make = [&](std::string_view name, const Macros& macros) {
    return [=, this] { static_cast<void>(device->kernel(name, macros)); };
  };
  expect_device_error(AllOf(HasSubstr("matwek"), HasSubstr("unknown")), make("matwek", {}));
  expect_device_error(AllOf(HasSubstr("COLUMNS"), HasSubstr("not given")), make("matvec", {}));
  expect_device_error(AllOf(HasSubstr("COLUMNS"), HasSubstr("25")), make("matvec", {{"COLUMNS", 25}}));
  expect_device_error(HasSubstr("COLUMNS"), make("matvec", {{"COLUMNS", 0}}));
}

TEST_P(Devices, LaunchesAreCheckedBeforeTheyRun) {
  const auto kernel = device->kernel("matvec", {{"COLUMNS", 1}});
  const auto a = device->allocate(64);
  const auto b = device->allocate(64);
  const MatvecArguments arguments{1, 0, 1, 16, 16};
  const auto block = std::as_bytes(std::span(&arguments, 1));
  const auto run = [&](std::vector<Buffer*> buffers, std::span<const std::byte> bytes) {
    return [=, this, &kernel] { device->queue().launch(*kernel, 1, buffers, bytes, "Label"); };
  };
  expect_device_error(AllOf(HasSubstr("matvec"), HasSubstr("Label"), HasSubstr("2 buffers")),
                      run({a.get(), b.get()}, block));
  expect_device_error(HasSubstr("argument block of 19 bytes"), run({a.get(), a.get(), b.get()}, block.first(19)));
  expect_device_error(HasSubstr("buffer 1 is missing"), run({a.get(), nullptr, b.get()}, block));
  expect_device_error(HasSubstr("are the same"), run({a.get(), b.get(), b.get()}, block));
  run({a.get(), a.get(), b.get()}, block)();
}

TEST_P(Devices, AKernelRefusesWhatDoesNotFit) {
  const MatvecArguments good{.n = 2, .first = 14, .rows = 2, .row_stride = 16, .vector_stride = 16};
  launch(good, {32, 32, 32});
  expect_device_error(HasSubstr("buffer 0 holds 124 bytes, 128 are needed"), [&] { launch(good, {31, 32, 32}); });
  expect_device_error(HasSubstr("buffer 1 holds"), [&] { launch(good, {32, 31, 32}); });
  expect_device_error(HasSubstr("buffer 2 holds"), [&] { launch(good, {32, 32, 31}); });
  const auto with = [&](auto change) {
    MatvecArguments arguments = good;
    change(arguments);
    return [=, this] { launch(arguments, {1000, 1000, 1000}); };
  };
  expect_device_error(HasSubstr("multiple of 16"), with([](auto& a) { a.row_stride = 17; }));
  expect_device_error(HasSubstr("multiple of 16"), with([](auto& a) { a.vector_stride = 24; }));
  expect_device_error(HasSubstr("n is larger"), with([](auto& a) { a.n = 17; }));
  expect_device_error(HasSubstr("behind the vector"), with([](auto& a) { a.first = 15; }));
  expect_device_error(HasSubstr("behind the vector"), with([](auto& a) { a.first = 0xFFFFFFFF; }));
  expect_device_error(HasSubstr("buffer 0 holds"), with([](auto& a) { a.row_stride = 0xFFFFFFF0; }));
}

/// A buffer of a backend that is not OpenMP.
struct ForeignBuffer final : Buffer {
  ForeignBuffer() : Buffer(64) {}
};

TEST_P(Devices, BuffersOfOtherDevicesAreErrors) {
  ForeignBuffer foreign;
  std::array<std::byte, 4> bytes{};
  expect_device_error(HasSubstr("another device"), [&] { device->queue().upload(foreign, 0, bytes); });
  expect_device_error(HasSubstr("another device"), [&] { device->queue().download(foreign, 0, bytes); });
}

/// The matvec of a fixed problem, as bits.
std::vector<float> product(Device& device, std::uint32_t n, std::uint32_t columns) {
  const std::uint32_t stride = (n + 15) / 16 * 16;
  check::Random random(n);
  const auto filled = [&](std::size_t count) {
    auto buffer = device.allocate(count * sizeof(float));
    const std::vector<float> values = random.numbers(count);
    device.queue().upload(*buffer, 0, std::as_bytes(std::span(values)));
    return buffer;
  };
  const auto f = filled(std::size_t{n} * stride), x = filled(std::size_t{columns} * stride);
  const auto y = device.allocate(std::size_t{columns} * stride * sizeof(float));
  const std::uint32_t rows = device.info().rows_per_group;
  const auto kernel =
      device.kernel("matvec", {{"COLUMNS", static_cast<int>(columns)}, {"ROWS", static_cast<int>(rows)}});
  const MatvecArguments arguments{.n = n, .first = 0, .rows = n, .row_stride = stride, .vector_stride = stride};
  Buffer* const buffers[] = {f.get(), x.get(), y.get()};
  device.queue().launch(*kernel, (n + rows - 1) / rows, buffers, std::as_bytes(std::span(&arguments, 1)), "Test");
  std::vector<float> result(std::size_t{columns} * stride);
  device.queue().download(*y, 0, std::as_writable_bytes(std::span(result)));
  return result;
}

TEST_P(Devices, TwoRunsOfAProductGiveTheSameBits) {
  const std::vector<float> first = product(*device, 1312, 3);
  EXPECT_NE(first[0], 0);
  for (int run = 0; run < 3; ++run) {
    const std::vector<float> again = product(*device, 1312, 3);
    EXPECT_EQ(std::memcmp(first.data(), again.data(), first.size() * sizeof(float)), 0);
  }
}

TEST_P(Devices, TwoRunsOfAReductionGiveTheSameBits) {
  constexpr std::uint32_t n = 17128, columns = 3, stride = 17136;
  const VectorArguments shape{n, stride, columns, (n + reduction_block - 1) / reduction_block, 1, 0, 0};
  const std::vector<float> values = check::Random(7).numbers(std::size_t{columns} * stride);
  const auto x = device->allocate(values.size() * sizeof(float));
  device->queue().upload(*x, 0, std::as_bytes(std::span(values)));
  const auto y = device->allocate(values.size() * sizeof(float));
  device->queue().upload(*y, 0, std::as_bytes(std::span(values)));
  const auto kernel = device->kernel("dot", {});
  std::vector<float> first;
  for (const std::uint32_t per_group : {1U, 1U, 5U, device->info().blocks_per_group}) {  // no shape matters
    VectorArguments arguments = shape;
    arguments.blocks_per_group = per_group;
    const auto sums = device->allocate(sums_size(columns, shape.blocks) * sizeof(float));
    Buffer* const buffers[] = {x.get(), y.get(), sums.get()};
    device->queue().launch(*kernel, (columns * shape.blocks + per_group - 1) / per_group, buffers,
                           std::as_bytes(std::span(&arguments, 1)), "Test");
    std::vector<float> result(sums->size() / sizeof(float));
    device->queue().download(*sums, 0, std::as_writable_bytes(std::span(result)));
    if (first.empty()) first = result;
    EXPECT_EQ(std::memcmp(first.data(), result.data(), result.size() * sizeof(float)), 0) << per_group;
  }
  EXPECT_GT(first[scalar_slots * columns], 0);
}

/// 1,048,576 columns: past the 65,535 iterations that an invocation's loops may have on some drivers.
TEST_P(Devices, TheLargestProductIsWholeAndALargerOneIsRefused) {
  constexpr std::uint32_t n = 1U << 20, rows = 3, columns = 3;
  if (std::uint64_t{columns} * n * sizeof(float) > device->info().max_buffer_bytes) GTEST_SKIP() << "small buffers";
  const auto ones = [&](std::size_t count) {
    auto buffer = device->allocate(count * sizeof(float));
    const std::vector<float> values(count, 1.0F);
    device->queue().upload(*buffer, 0, std::as_bytes(std::span(values)));
    return buffer;
  };
  const auto f = ones(std::size_t{rows} * n), x = ones(std::size_t{columns} * n);
  const auto y = device->allocate(std::size_t{columns} * n * sizeof(float));
  const auto kernel = device->kernel("matvec", {{"COLUMNS", columns}});
  MatvecArguments arguments{.n = n, .first = 0, .rows = rows, .row_stride = n, .vector_stride = n};
  Buffer* const buffers[] = {f.get(), x.get(), y.get()};
  device->queue().launch(*kernel, 1, buffers, std::as_bytes(std::span(&arguments, 1)), "Test");
  std::vector<float> result(std::size_t{columns} * n);
  device->queue().download(*y, 0, std::as_writable_bytes(std::span(result)));
  for (std::size_t c = 0; c < columns; ++c) {
    for (std::size_t r = 0; r < rows; ++r) EXPECT_EQ(result[c * n + r], static_cast<float>(n));  // exact in fp32
    EXPECT_EQ(result[c * n + rows], 0);
  }
  arguments.n = n + 1;
  arguments.row_stride = arguments.vector_stride = n + 16;
  expect_device_error(HasSubstr("n is larger than 1048576"), [&] {
    device->queue().launch(*kernel, 1, buffers, std::as_bytes(std::span(&arguments, 1)), "Test");
  });
}

TEST_P(Devices, EveryKernelPassesItsCheck) {
  std::size_t passed = 0;
  for (const KernelCheck& row : check_device(*device)) {
    EXPECT_EQ(row.status, CheckStatus::pass) << row.kernel << " " << row.parameters << " n=" << row.size << ": "
                                             << row.reason << " (" << row.error << " of " << row.bound << ")";
    passed += row.status == CheckStatus::pass ? 1 : 0;
  }
  EXPECT_GT(passed, 700U);
}

INSTANTIATE_TEST_SUITE_P(All, Devices, testing::ValuesIn(test::tested_devices), test::test_name);

}  // namespace
}  // namespace interflect
