#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>

#include "device/fake_cuda/fixture.h"
#include "interflect/base/error.h"
#include "interflect/device/check.h"
#include "interflect/device/kernel_arguments.h"
#include "interflect/device/registry.h"
#include "sanitized.h"

// host/device/cuda on a fake driver that runs the kernels on the processor: that it calls the driver by its rules,
// gives everything back and reports each error. It says nothing about a GPU.

namespace interflect {
namespace {

using test::expect_nothing_left;
using test::FakeCuda;
using test::report;
using testing::HasSubstr;

// Under AddressSanitizer the kernels' fibers are slow: there only small sizes are run, and the output says so.
using test::sanitized;

TEST_F(FakeCuda, IsListedWithWhatTheDriverTells) {
  fake_cuda_devices(2);
  std::vector<DeviceEntry> cuda;
  for (DeviceEntry& entry : list_devices()) {
    if (entry.info.backend == "cuda") cuda.push_back(std::move(entry));
  }
  ASSERT_EQ(cuda.size(), 2U);
  const DeviceInfo& info = cuda[1].info;
  EXPECT_TRUE(cuda[1].available) << cuda[1].reason;
  EXPECT_EQ(info.id, "cuda:1");
  EXPECT_EQ(info.name, "Fake GPU (runs on the processor)");
  EXPECT_EQ(info.driver, "CUDA 12.8, NVRTC 12.8");
  EXPECT_EQ(info.type, DeviceType::gpu);
  EXPECT_EQ(info.memory_bytes, std::uint64_t{1} << 30U);
  EXPECT_EQ(info.compute_units, 4U);
  EXPECT_EQ(info.max_groups, 0x7FFFFFFFU);
  EXPECT_EQ(info.hardware, "191a1b1c1d1e1f202122232425262728");
  EXPECT_NE(info.hardware, cuda[0].info.hardware);
  EXPECT_FALSE(info.emulated());
  expect_nothing_left();
}

TEST_F(FakeCuda, WhatIsMissingIsNamed) {
  const auto reason = [] {
    const std::vector<DeviceEntry> all = list_devices();
    EXPECT_EQ(all.at(0).info.id, "cuda:0");
    EXPECT_FALSE(all.at(0).available);
    return all.at(0).reason;
  };
  ::setenv("FAKE_CUDA_INIT", "100", 1);
  EXPECT_EQ(reason(), "libcuda.so.1: cuInit: CUDA_ERROR_NO_DEVICE (100)");
  ::setenv("FAKE_CUDA_INIT", "803", 1);
  EXPECT_EQ(reason(), "libcuda.so.1: cuInit: an error without a name (803)");
  ::unsetenv("FAKE_CUDA_INIT");
  fake_cuda_devices(0);
  EXPECT_EQ(reason(), "libcuda.so.1: there is no device");
  fake_cuda_devices(1);
  ::setenv("INTERFLECT_NVRTC", "/nowhere/libnvrtc.so", 1);
  EXPECT_THAT(reason(), testing::StartsWith("INTERFLECT_NVRTC: /nowhere/libnvrtc.so"));
  try {
    (void)open_device("cuda:0");
    FAIL() << "it opened";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::device);
    EXPECT_THAT(error.what(), HasSubstr("cuda:0: open: INTERFLECT_NVRTC"));
  }
  expect_nothing_left();
}

TEST_F(FakeCuda, AnOldNvrtcOrOneThatDoesNotKnowTheDeviceIsSaidToBe) {
  const std::string nvrtc = "INTERFLECT_NVRTC=" FAKE_CUDA_FOLDER "/libnvrtc.so ";
  const std::string check = "check --device cuda:0 --max-size 1";
  const std::string old = program(nvrtc + "FAKE_NVRTC_VERSION=11.8", check);
  EXPECT_THAT(old, HasSubstr("is NVRTC 11.8, 12 or newer is needed"));
  EXPECT_THAT(old, HasSubstr("\nSTATUS 4\n"));
  // The fake GPU is of capability 9.0: PTX of 8.0 runs on it too.
  EXPECT_THAT(program(nvrtc + "FAKE_NVRTC_NEWEST=85", check), HasSubstr("\nSTATUS 0\n"));
}

TEST_F(FakeCuda, EveryKernelPassesTheCheck) {
  {
    const auto device = open_device("cuda:0");
    if (sanitized) std::cout << "under the sanitizers: only n up to 17\n";
    const std::vector<KernelCheck> rows = check_device(*device, sanitized ? 17 : every_size);
    if (sanitized) {
      EXPECT_GT(rows.size(), 100U);
    } else {
      EXPECT_GE(rows.size(), 1165U) << "cases are missing";
    }
    for (const KernelCheck& row : rows) {
      EXPECT_EQ(row.status, CheckStatus::pass)
          << row.kernel << " " << row.size << " " << row.parameters << " " << row.reason;
    }
  }
  expect_nothing_left();
  EXPECT_THAT(report(), testing::Not(HasSubstr("kernels=0 ")));
}

/// All that a solver does with a device, in little: buffers of several staging chunks, a kernel, launches, the way
/// back.
std::vector<float> small_job() {
  constexpr std::uint32_t n = 1U << 20U;  // floats: with two columns of it three chunks of staging memory
  const auto device = open_device("cuda:0");
  const std::vector<float> ones(2 * n, 1.0F);
  const auto x = device->allocate(ones.size() * sizeof(float) + 4);
  const auto y = device->allocate(ones.size() * sizeof(float) + 4);
  const auto sums = device->allocate(sums_size(2, n / reduction_block) * sizeof(float));
  const std::vector<float> scalars = {3, 3, 5, 5};  // y = 3 x + 5 y
  device->queue().upload(*x, 0, std::as_bytes(std::span(ones)));
  device->queue().upload(*y, 0, std::as_bytes(std::span(ones)));
  device->queue().upload(*sums, std::size_t{slot::axpby_a} * 2 * sizeof(float), std::as_bytes(std::span(scalars)));
  const VectorArguments arguments{.n = n,
                                  .vector_stride = n,
                                  .columns = 2,
                                  .blocks = n / reduction_block,
                                  .blocks_per_group = 256,
                                  .option = 0,
                                  .slot = 0};
  const auto kernel = device->kernel("axpby", {});
  Buffer* const buffers[] = {x.get(), y.get(), sums.get()};
  for (int i = 0; i < 2; ++i) {
    device->queue().launch(*kernel, 8, buffers, std::as_bytes(std::span(&arguments, 1)), "Test");
  }
  device->queue().wait();
  std::vector<float> result(ones.size() + 1);
  device->queue().download(*y, 0, std::as_writable_bytes(std::span(result)));
  return result;
}

bool is_right(const std::vector<float>& result) {
  return std::all_of(result.begin(), result.end() - 1, [](float value) { return value == 43.0F; }) &&
         result.back() == 0;
}

TEST_F(FakeCuda, AJobOfSeveralChunksIsRightAndLeavesNothing) {
  EXPECT_TRUE(is_right(small_job()));
  expect_nothing_left();
}

TEST_F(FakeCuda, EveryCallMayFail) {
  (void)small_job();
  const int calls = fake_cuda_calls();
  ASSERT_GT(calls, 60);
  for (const bool lost : {false, true}) {
    int errors = 0;
    for (int call = 1; call <= calls; ++call) {
      fake_cuda_reset();
      fake_cuda_fail(call, call % 2 == 0 ? 2 : 719, lost);
      try {
        EXPECT_TRUE(is_right(small_job())) << "call " << call << " failed unnoticed";
      } catch (const Error& error) {
        ++errors;
        const std::string name = call % 2 == 0 ? "CUDA_ERROR_OUT_OF_MEMORY (2)" : "CUDA_ERROR_LAUNCH_FAILED (719)";
        EXPECT_EQ(error.kind(), ErrorKind::device) << error.what();
        EXPECT_THAT(error.what(), HasSubstr(name)) << "call " << call;
        EXPECT_THAT(error.what(), testing::StartsWith("cuda:0: ")) << "call " << call;
        EXPECT_THAT(error.what(), HasSubstr(": cu")) << "call " << call;
      }
      EXPECT_THAT(report(), HasSubstr("live=0\n")) << "call " << call << (lost ? ", lost" : "");
    }
    // Only what gives something back, or is tried again, may fail without an error.
    EXPECT_GT(errors, calls - 25);
  }
}

TEST_F(FakeCuda, MoreMemoryThanThereIsIsRefused) {
  const auto device = open_device("cuda:0");
  try {
    (void)device->allocate(std::size_t{3} << 30U);
    FAIL() << "allocated";
  } catch (const Error& error) {
    EXPECT_STREQ(error.what(), "cuda:0: allocate 3221225472 bytes: cuMemAlloc: CUDA_ERROR_OUT_OF_MEMORY (2)");
  }
  EXPECT_EQ(device->allocate(0)->size(), 0U);
  EXPECT_EQ(device->share(std::make_shared<const PageBuffer>(4096)), nullptr);
}

TEST_F(FakeCuda, BuffersAndKernelsMayOutliveTheDevice) {
  {
    auto device = open_device("cuda:0");
    const auto buffer = device->allocate(1000);
    const auto kernel = device->kernel("copy", {});
    device.reset();
    EXPECT_EQ(buffer->size(), 1000U);
  }
  expect_nothing_left();
}

TEST_F(FakeCuda, ACompileErrorShowsFileLineAndLog) {
  std::filesystem::create_directories(folder_ / "cuda");
  std::ofstream(folder_ / "cuda/copy.cu") << "// one\n#error this is line two\n";
  ::setenv("INTERFLECT_KERNEL_DIR", folder_.c_str(), 1);
  const auto device = open_device("cuda:0");
  try {
    (void)device->kernel("copy", {});
    FAIL() << "compiled";
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), testing::StartsWith("cuda:0: compile cuda/copy.cu: cuda/copy.cu(2): error: #error "
                                                  "directive: this is line two\n"));
    EXPECT_THAT(error.what(), HasSubstr("1 error detected"));
  }
}

TEST_F(FakeCuda, TheProgramChecksAndSolvesOnIt) {
  const std::string nvrtc = "INTERFLECT_NVRTC=" FAKE_CUDA_FOLDER "/libnvrtc.so ";
  const std::string checked = program(nvrtc, "check --device cuda:0 --max-size 2");  // EveryKernel... runs all
  EXPECT_THAT(checked, HasSubstr("\nSTATUS 0\n")) << checked;
  EXPECT_THAT(checked, HasSubstr("live=0\n"));
  const std::string scene = INTERFLECT_SOURCE_DIR "/scenes/cornell-box.obj --patches 100";
  for (const char* method : {"cg", "bicgstab", "jacobi"}) {
    std::vector<std::vector<double>> answers;
    for (const char* device : {"cuda:0", "openmp"}) {
      const std::string file = (folder_ / (std::string(device) + ".csv")).string();
      const std::string solved = program(
          nvrtc, "solve " + scene + " --quiet --method " + method + " --device " + device + " -o '" + file + "'");
      ASSERT_THAT(solved, HasSubstr("\nSTATUS 0\n")) << solved;
      EXPECT_THAT(solved, HasSubstr("live=0\n"));
      EXPECT_THAT(solved, testing::Not(HasSubstr("broken")));
      if (std::string(device) == "cuda:0") {
        EXPECT_THAT(solved, testing::Not(HasSubstr("kernels=0 ")));
      }
      auto& values = answers.emplace_back();
      std::ifstream lines(file);
      std::string line;
      std::getline(lines, line);
      while (std::getline(lines, line)) {
        std::vector<std::string> fields;
        std::istringstream parts(line);
        for (std::string field; std::getline(parts, field, ',');) fields.push_back(field);
        for (std::size_t i = 15; i < 18; ++i) values.push_back(std::stod(fields.at(i)));  // b_r, b_g, b_b
      }
    }
    ASSERT_EQ(answers[0].size(), answers[1].size());
    ASSERT_GT(answers[0].size(), 100U);
    const double largest = *std::max_element(answers[1].begin(), answers[1].end());
    for (std::size_t i = 0; i < answers[0].size(); ++i)
      ASSERT_NEAR(answers[0][i], answers[1][i], 2e-5 * largest) << method;
  }
}

TEST_F(FakeCuda, ASolveWhoseDeviceFailsSaysSo) {
  const std::string nvrtc = "INTERFLECT_NVRTC=" FAKE_CUDA_FOLDER "/libnvrtc.so ";
  const std::string solve = "solve " INTERFLECT_SOURCE_DIR
                            "/scenes/cornell-box.obj --patches 60 --quiet --device cuda:0 -o '" +
                            (folder_ / "b.csv").string() + "'";
  const std::string whole = program(nvrtc, solve);
  const int calls = std::stoi(whole.substr(whole.find("calls=") + 6));
  ASSERT_GT(calls, 100);
  for (int call = 20; call < calls; call += calls / 8) {
    const std::string failed = program(nvrtc + "FAKE_CUDA_LOST=1 FAKE_CUDA_FAIL=" + std::to_string(call), solve);
    const bool gave_back = failed.find("\nSTATUS 0\n") != std::string::npos;  // failed when all was done
    if (!gave_back) {
      EXPECT_THAT(failed, HasSubstr("\nSTATUS 4\n")) << "call " << call << "\n" << failed;
      EXPECT_THAT(failed, HasSubstr("CUDA_ERROR_UNKNOWN (999)")) << "call " << call;
    }
    EXPECT_THAT(failed, HasSubstr("live=0\n")) << "call " << call << "\n" << failed;
  }
}

}  // namespace
}  // namespace interflect
