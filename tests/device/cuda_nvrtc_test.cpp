#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <regex>
#include <set>
#include <sstream>
#include <string>

#include "interflect/base/error.h"
#include "interflect/device/cuda/api.h"
#include "interflect/device/kernel_table.h"
#include "sanitized.h"

// The CUDA kernels compiled for real GPUs, where NVRTC is installed. No GPU is needed, nothing runs.

namespace interflect {
namespace {

using testing::HasSubstr;

using test::sanitized;  // NVRTC is several times slower

constexpr int newest_driver = 99;  // takes whatever NVRTC there is

/// Skips aloud where there is no NVRTC.
class CudaNvrtc : public testing::Test {
 protected:
  void SetUp() override {
    std::string reason;
    nvrtc_ = cuda::Nvrtc::open(newest_driver, reason);
    if (nvrtc_ == nullptr) GTEST_SKIP() << "the CUDA kernels are not compiled: " << reason;
  }
  void TearDown() override {
    ::unsetenv("INTERFLECT_KERNEL_DIR");
    ::unsetenv("INTERFLECT_NVRTC");
  }
  const cuda::Nvrtc* nvrtc_ = nullptr;
};

/// The sets of macros of a file of kernels/cuda/.
std::vector<Macros> variants(std::string_view file) {
  std::vector<Macros> all;
  if (file == "matvec") {
    // One column, the three of light, a whole chunk, one more, many.
    for (const int columns : {1, 3, 6, 7, 24}) all.push_back({{"COLUMNS", columns}, {"ROWS", 8}});
  } else if (file == "matvec_exact") {
    for (const int columns : {1, 3, 7, 24}) all.push_back({{"COLUMNS", columns}});
  } else if (file == "tiles16") {
    for (const int columns : {1, 3, 4, 7, 24}) all.push_back({{"COLUMNS", columns}, {"STRIPS", 1}});
    for (const int strips : {2, 4, 8}) all.push_back({{"COLUMNS", 3}, {"STRIPS", strips}});
  } else if (file == "sym16") {
    all.emplace_back();  // sym16_fold
    for (const int columns : {1, 2, 3, 4, 24}) all.push_back({{"COLUMNS", columns}, {"BLOCK", 256}});
    for (const int block : {16, 128, 512, 1024}) all.push_back({{"COLUMNS", 3}, {"BLOCK", block}});
  } else if (file == "read") {
    for (const int streams : {1, 2, 4, 8}) all.push_back({{"STREAMS", streams}});
  } else {
    all.emplace_back();
  }
  for (Macros& macros : all) macros.emplace("WORKGROUP", 256);
  return all;
}

struct Figures {
  std::string kernel;
  int registers = 0, shared_bytes = 0, stack_bytes = 0, spill_bytes = 0;
};

/// What the compiler says of each kernel when it is asked for its statistics.
std::vector<Figures> figures_of(const std::string& log) {
  const auto number = [](const std::string& line, const char* pattern) {
    std::smatch found;
    return std::regex_search(line, found, std::regex(pattern)) ? std::stoi(found[1]) : 0;
  };
  std::vector<Figures> all;
  std::istringstream lines(log);
  for (std::string line; std::getline(lines, line);) {
    std::smatch found;
    if (std::regex_search(line, found, std::regex("Compiling entry function '(\\w+)'"))) all.push_back({found[1]});
    if (all.empty()) continue;
    Figures& last = all.back();
    last.registers = std::max(last.registers, number(line, "Used (\\d+) registers"));
    last.shared_bytes = std::max(last.shared_bytes, number(line, "(\\d+) bytes smem"));
    last.stack_bytes = std::max(last.stack_bytes, number(line, "(\\d+) bytes stack frame"));
    last.spill_bytes = std::max(
        {last.spill_bytes, number(line, "(\\d+) bytes spill stores"), number(line, "(\\d+) bytes spill loads")});
  }
  return all;
}

std::string text(const Macros& macros) {
  std::string all;
  for (const auto& [name, value] : macros) {
    if (name != "WORKGROUP") all += " " + name + "=" + std::to_string(value);
  }
  return all;
}

TEST_F(CudaNvrtc, CompilesEveryKernelWithoutSpilling) {
  std::cout << "NVRTC " << nvrtc_->version() << "\n";
  if (sanitized) std::cout << "under the sanitizers: one architecture, axpby.cu and copy.cu only\n";
  std::size_t targets = 0;
  for (const int architecture : {70, 80, 90, 120}) {
    if (sanitized && architecture != 90) continue;
    const std::string target = "sm_" + std::to_string(architecture);
    if (nvrtc_->target(architecture) != target) {
      std::cout << target << ": this NVRTC does not know it, not compiled\n";
      continue;
    }
    ++targets;
    std::set<std::string_view> files;
    std::set<std::string> found;
    for (const KernelLine& line : kernel_table()) {
      if (!sanitized || line.file == "axpby" || line.file == "copy") files.insert(line.file);
    }
    for (const std::string_view file : files) {
      for (const Macros& macros : variants(file)) {
        const CompileKey key = cuda::compile_key(*nvrtc_, target, file, macros);
        std::vector<std::string> options = {"--ptxas-options=-v"};
        std::istringstream lines(key.options);
        for (std::string option; std::getline(lines, option);) options.push_back(option);
        const auto compiled = nvrtc_->compile(key.source, std::string(file), options);
        ASSERT_FALSE(compiled.binary.empty()) << target << " " << file << text(macros) << "\n" << compiled.log;
        EXPECT_THAT(compiled.log, testing::Not(HasSubstr("warning"))) << compiled.log;
        const std::vector<Figures> all = figures_of(compiled.log);
        ASSERT_FALSE(all.empty()) << "no figures in: " << compiled.log;
        for (const Figures& f : all) {
          found.insert(f.kernel);
          std::cout << target << " " << f.kernel << text(macros) << ": " << f.registers << " registers, "
                    << f.shared_bytes << " bytes shared, " << f.spill_bytes << " spilt\n";
          EXPECT_GT(f.registers, 0);
          EXPECT_LE(f.registers, 128) << "two work-groups of 256 threads must fit a multiprocessor";
          EXPECT_LE(f.shared_bytes, 48 << 10) << "more cannot be declared";
          EXPECT_EQ(f.spill_bytes, 0);
          // What a ray has still to visit: a word for each level of the hierarchy.
          EXPECT_LE(f.stack_bytes, file == "shadow_rays" || f.kernel == "tile_rays" ? 80 : 0);
        }
      }
    }
    for (const KernelLine& line : kernel_table()) {
      EXPECT_EQ(found.count(std::string(line.name)), files.count(line.file)) << line.name;
    }
  }
  EXPECT_GE(targets, sanitized ? 1U : 2U) << "an NVRTC that knows hardly any of them";
}

/// A kernel that keeps too much in registers: figures that could not see it would be worth nothing.
TEST_F(CudaNvrtc, SpillsAreSeen) {
  const std::string source = R"(extern "C" __global__ void __launch_bounds__(1024, 2) big(float* data) {
    float all[64];
    for (int i = 0; i < 64; ++i) all[i] = data[i * 1024 + threadIdx.x];
    __syncthreads();
    for (int k = 0; k < 3; ++k)
      for (int i = 0; i < 64; ++i) all[i] = all[i] * all[(i * 7 + 1) % 64] + data[i];
    for (int i = 0; i < 64; ++i) data[i * 1024 + threadIdx.x] = all[i];
  })";
  const auto compiled =
      nvrtc_->compile(source, "big", {"--gpu-architecture=" + nvrtc_->target(90), "--ptxas-options=-v"});
  const std::vector<Figures> all = figures_of(compiled.log);
  ASSERT_EQ(all.size(), 1U) << compiled.log;
  EXPECT_GT(all[0].spill_bytes + all[0].stack_bytes, 0) << compiled.log;
}

TEST_F(CudaNvrtc, AnErrorShowsFileAndLineAndTheCompilersLog) {
  const std::filesystem::path folder =
      std::filesystem::path(testing::TempDir()) / ("cuda_compile_error_" + std::to_string(::getpid()));
  std::filesystem::create_directories(folder / "cuda");
  std::filesystem::copy_file(std::filesystem::path(INTERFLECT_SOURCE_DIR) / "kernels/cuda/blocks.cuh",
                             folder / "cuda/blocks.cuh", std::filesystem::copy_options::overwrite_existing);
  std::ofstream(folder / "cuda/axpby.cu") << "#include \"blocks.cuh\"\n\nextern \"C\" __global__ void axpby() {\n"
                                          << "  nonsense = 1;\n}\n";
  ::setenv("INTERFLECT_KERNEL_DIR", folder.c_str(), 1);
  const CompileKey key = cuda::compile_key(*nvrtc_, nvrtc_->target(90), "axpby", {{"WORKGROUP", 256}});
  try {
    (void)cuda::compile(*nvrtc_, key, "cuda:0", "axpby");
    FAIL() << "it compiled";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::device);
    const std::string all = error.what();
    const std::string first = all.substr(0, all.find('\n'));
    EXPECT_THAT(first, HasSubstr("cuda:0: compile cuda/axpby.cu: cuda/axpby.cu(4): error"));
    EXPECT_THAT(first, HasSubstr("nonsense"));
    EXPECT_GT(all.size(), first.size() + 20) << "the log is missing";
  }
  std::filesystem::remove_all(folder);
}

TEST_F(CudaNvrtc, TargetsTheDeviceOrTheNewestBelowIt) {
  const int newest = nvrtc_->architectures().back();
  EXPECT_EQ(nvrtc_->target(newest), "sm_" + std::to_string(newest));
  EXPECT_EQ(nvrtc_->target(newest + 1), "compute_" + std::to_string(newest));
  EXPECT_EQ(nvrtc_->target(nvrtc_->architectures().front() - 1), "");
  const CompileKey key = cuda::compile_key(*nvrtc_, nvrtc_->target(newest + 1), "copy", {{"WORKGROUP", 256}});
  const std::vector<std::byte> ptx = cuda::compile(*nvrtc_, key, "cuda:0", "copy");
  EXPECT_THAT(std::string(reinterpret_cast<const char*>(ptx.data())), HasSubstr(".entry copy"));
}

TEST_F(CudaNvrtc, TheCubinsKeyNamesEverythingItDependsOn) {
  const CompileKey key =
      cuda::compile_key(*nvrtc_, "sm_90", "matvec", {{"COLUMNS", 3}, {"ROWS", 8}, {"WORKGROUP", 256}});
  EXPECT_EQ(key.device, "sm_90");
  EXPECT_EQ(key.driver, "NVRTC " + nvrtc_->version());
  EXPECT_THAT(key.options, HasSubstr("-DCOLUMNS=3\n-DROWS=8\n-DWORKGROUP=256"));
  EXPECT_THAT(key.source, HasSubstr("#line 1 \"cuda/blocks.cuh\""));
}

TEST(CudaNvrtcMissing, TheReasonNamesWhatWasAskedForOrWhereItWasLookedFor) {
  ::setenv("INTERFLECT_NVRTC", "/nowhere/libnvrtc.so", 1);
  std::string reason;
  EXPECT_EQ(cuda::Nvrtc::open(newest_driver, reason), nullptr);
  EXPECT_THAT(reason, testing::StartsWith("INTERFLECT_NVRTC: /nowhere/libnvrtc.so"));
  ::setenv("INTERFLECT_NVRTC", "libm.so.6", 1);
  EXPECT_EQ(cuda::Nvrtc::open(newest_driver, reason), nullptr);
  EXPECT_EQ(reason, "INTERFLECT_NVRTC: libm.so.6 is not a usable NVRTC, 12 or newer is needed");
  ::unsetenv("INTERFLECT_NVRTC");
}

}  // namespace
}  // namespace interflect
