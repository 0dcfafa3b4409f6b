#include "interflect/device/openmp/openmp.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <omp.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <functional>

#include "interflect/base/error.h"
#include "interflect/device/bandwidth.h"
#include "interflect/device/kernel_arguments.h"
#include "interflect/device/openmp/simd.h"
#include "interflect/device/registry.h"

namespace interflect {
namespace {

using testing::AllOf;
using testing::HasSubstr;

void expect_error(ErrorKind kind, const testing::Matcher<std::string>& message, const std::function<void()>& action) {
  try {
    action();
    FAIL() << "no error";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), kind) << error.what();
    EXPECT_THAT(std::string(error.what()), message);
  }
}

class OpenMP : public testing::Test {
 protected:
  void expect_device_error(const testing::Matcher<std::string>& message, const std::function<void()>& action) {
    expect_error(ErrorKind::device, AllOf(HasSubstr("openmp"), message), action);
  }
  /// A matvec of two rows and columns with buffers of these sizes in floats.
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

  std::unique_ptr<Device> device = open_device("openmp");
};

TEST_F(OpenMP, StatesWhatItIs) {
  const DeviceInfo& info = device->info();
  EXPECT_EQ(info.id, "openmp");
  EXPECT_EQ(info.backend, "openmp");
  EXPECT_EQ(info.type, DeviceType::cpu);
  EXPECT_FALSE(info.name.empty());
  EXPECT_THAT(info.driver, AllOf(HasSubstr("OpenMP"), HasSubstr(openmp::simd_target())));
  EXPECT_GT(info.memory_bytes, std::uint64_t{1} << 20);
  EXPECT_EQ(info.compute_units, static_cast<std::uint32_t>(omp_get_max_threads()));
}

TEST_F(OpenMP, BuffersBeginAsZerosAndGiveBackWhatWasUploaded) {
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

TEST_F(OpenMP, TransfersOutOfRangeAreErrors) {
  const auto buffer = device->allocate(64);
  std::array<std::byte, 65> bytes{};
  expect_device_error(AllOf(HasSubstr("upload"), HasSubstr("64")), [&] { device->queue().upload(*buffer, 0, bytes); });
  expect_device_error(HasSubstr("upload"), [&] { device->queue().upload(*buffer, 65, {}); });
  expect_device_error(HasSubstr("upload"),
                      [&] { device->queue().upload(*buffer, SIZE_MAX, std::span(bytes).first(2)); });
  expect_device_error(HasSubstr("download"), [&] { device->queue().download(*buffer, 1, std::span(bytes).first(64)); });
  device->queue().upload(*buffer, 64, {});
}

TEST_F(OpenMP, SharedMemoryIsUsedInPlaceAndNeverWritten) {
  const auto memory = std::make_shared<PageBuffer>(256);
  const auto shared = device->share(memory);
  EXPECT_EQ(shared->size(), 256U);
  memory->data()[3] = std::byte{5};
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

TEST_F(OpenMP, SharedMemoryOutlivesItsOwner) {
  auto memory = std::make_shared<PageBuffer>(64);
  const std::weak_ptr<PageBuffer> watch = memory;
  auto shared = device->share(std::move(memory));
  EXPECT_FALSE(watch.expired());
  shared.reset();
  EXPECT_TRUE(watch.expired());
}

TEST_F(OpenMP, RefusesMemoryThatNoMachineHas) {
  expect_device_error(HasSubstr("allocate"), [&] { static_cast<void>(device->allocate(SIZE_MAX / 2)); });
}

TEST_F(OpenMP, KernelsAreKnownByNameAndMacros) {
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

TEST_F(OpenMP, LaunchesAreCheckedBeforeTheyRun) {
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

TEST_F(OpenMP, AKernelRefusesWhatDoesNotFit) {
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

TEST_F(OpenMP, BuffersOfOtherDevicesAreErrors) {
  ForeignBuffer foreign;
  std::array<std::byte, 4> bytes{};
  expect_device_error(HasSubstr("another device"), [&] { device->queue().upload(foreign, 0, bytes); });
  expect_device_error(HasSubstr("another device"), [&] { device->queue().download(foreign, 0, bytes); });
}

TEST(SimdTarget, AnUnknownNameIsAUsageErrorThatListsTheValidOnes) {
  expect_error(ErrorKind::usage, AllOf(HasSubstr("'AVX9'"), HasSubstr(openmp::simd_targets().back())),
               [] { openmp::use_simd_target("AVX9"); });
}

/// Opens the device in a fresh process with INTERFLECT_SIMD set; exits with 0 when it uses that target, 2 for an Error.
[[noreturn]] void open_with(const std::string& target) {
  ::setenv("INTERFLECT_SIMD", target.c_str(), 1);
  try {
    const auto device = open_device("openmp");
    std::exit(openmp::simd_target() == target && device->info().driver.ends_with(target) ? 0 : 1);
  } catch (const Error& error) {
    std::fputs(error.what(), stderr);
    std::exit(exit_status(error.kind()));
  }
}

TEST(SimdTargetDeathTest, TheEnvironmentNamesOne) {
  testing::GTEST_FLAG(death_test_style) = "threadsafe";
  EXPECT_EXIT(open_with(openmp::simd_targets().back()), testing::ExitedWithCode(0), "");
  EXPECT_EXIT(open_with("AVX9"), testing::ExitedWithCode(2), "INTERFLECT_SIMD: 'AVX9'");
}

}  // namespace
}  // namespace interflect
