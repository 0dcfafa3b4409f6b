#include "interflect/device/opencl/opencl.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <set>

#include "device/kernel_folder.h"
#include "interflect/base/error.h"
#include "interflect/device/check.h"
#include "interflect/device/check_tools.h"
#include "interflect/device/compile_cache.h"
#include "interflect/device/kernel_arguments.h"
#include "interflect/device/kernel_source.h"
#include "interflect/device/kernel_table.h"
#include "interflect/device/opencl/api.h"

namespace interflect {
namespace {

using testing::AllOf;
using testing::HasSubstr;

/// PoCL keeps what it compiles: each process in a folder of its own, set before the first call of OpenCL.
struct DriverCache {
  test::TemporaryFolder folder{"pocl"};
  test::Variable variable{"POCL_CACHE_DIR", folder.path().string()};
};
class OwnDriverCache : public testing::Environment {
  void SetUp() override { static const DriverCache cache; }
};
const auto* const own_driver_cache = testing::AddGlobalTestEnvironment(new OwnDriverCache);  // GoogleTest deletes it

std::string describe(const KernelCheck& row) {
  return row.kernel + " n=" + std::to_string(row.size) + " " + row.parameters + ": error " + std::to_string(row.error) +
         " bound " + std::to_string(row.bound) + " " + row.reason;
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

/// Both shapes of kernels, on the first device that is available; none skips, and says why.
class OpenCL : public testing::TestWithParam<const char*> {
 protected:
  void SetUp() override {
    for (const DeviceEntry& entry : opencl::list_devices()) {
      if (entry.available) return;
      why_ = entry.reason;
      ++index_;
    }
    GTEST_SKIP() << "no OpenCL device: " << why_;
  }
  [[nodiscard]] std::unique_ptr<Device> open() const { return opencl::open_device(index_); }

  /// y = F x of a matrix in which every element counts.
  [[nodiscard]] static std::vector<float> product(Device& device, std::uint32_t n, std::uint32_t rows,
                                                  std::uint32_t columns) {
    const std::uint32_t stride = (n + 15) / 16 * 16;
    std::vector<float> f(std::size_t{rows} * stride), x(std::size_t{columns} * stride);
    for (std::size_t i = 0; i < f.size(); ++i) f[i] = 0.5F + static_cast<float>(i % 1021) / 1024;
    for (std::size_t i = 0; i < x.size(); ++i) x[i] = 0.5F + static_cast<float>(i % 509) / 512;
    const auto fb = buffer_of(device, f), xb = buffer_of(device, x);
    const auto yb = device.allocate(x.size() * sizeof(float));
    const int group = static_cast<int>(device.info().rows_per_group);
    const auto kernel = device.kernel("matvec", {{"COLUMNS", static_cast<int>(columns)}, {"ROWS", group}});
    const MatvecArguments a{n, 0, rows, stride, stride};
    Buffer* const buffers[] = {fb.get(), xb.get(), yb.get()};
    device.queue().launch(*kernel, (rows + device.info().rows_per_group - 1) / device.info().rows_per_group, buffers,
                          bytes_of(a), "Test");
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

 private:
  test::FreshCache cache_;
  test::Variable shape_{"INTERFLECT_OPENCL_SHAPE", GetParam()};
  std::uint32_t index_ = 0;
  std::string why_;
};
INSTANTIATE_TEST_SUITE_P(Shape, OpenCL, testing::Values("cpu", "gpu"),
                         [](const auto& shape) { return std::string(shape.param); });

/// The shape that the device chooses itself goes through every case in tests/backends; here the other one, through each
/// way of cutting columns into chunks (each number of columns is compiled anew, and slowly).
TEST_P(OpenCL, KernelsStayWithinTheirBoundsOnEveryDevice) {
  std::uint32_t index = 0;
  std::string its_own;
  bool checked = false;
  for (const DeviceEntry& entry : opencl::list_devices()) {
    const std::uint32_t here = index++;
    if (!entry.available) continue;
    const auto device = opencl::open_device(here);
    EXPECT_EQ(device->info().id, "opencl:" + std::to_string(here));
    EXPECT_FALSE(device->info().name.empty());
    EXPECT_FALSE(device->info().driver.empty());
    const std::string own = device->info().type == DeviceType::cpu ? "cpu" : "gpu";
    if (GetParam() == own) {
      its_own += " " + device->info().id;
      continue;
    }
    checked = true;
    std::vector<KernelCheck> rows;
    check::check_stream(*device, rows);
    for (const std::uint32_t columns : {3U, 6U}) check::check_matvec(*device, rows, {.columns = columns});
    check::check_vectors(*device, rows);
    EXPECT_GT(rows.size(), 500U);
    for (const KernelCheck& row : rows) EXPECT_EQ(row.status, CheckStatus::pass) << describe(row);
  }
  if (!checked) GTEST_SKIP() << "no check here: tests/backends checks the shape " << GetParam() << " of" << its_own;
}

TEST_P(OpenCL, TheSameBitsInTwoRuns) {
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

TEST_P(OpenCL, TheLargestProductIsRightAndALargerOneRefused) {
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

/// A kernel of matvec.cl in the GPU's shape for work-groups of 64, which no device here takes by itself.
struct SmallGroups {
  explicit SmallGroups(const opencl::Found& found) {
    cl_int code = CL_SUCCESS;
    context = opencl::Context(clCreateContext(nullptr, 1, &found.device, nullptr, nullptr, &code));
    opencl::succeed(code, "test", "open", "clCreateContext");
    queue = opencl::CommandQueue(clCreateCommandQueue(context.get(), found.device, 0, &code));
    opencl::succeed(code, "test", "open", "clCreateCommandQueue");
    const CompileKey key{"opencl", "a device", "a driver",
                         "-cl-std=CL1.2 -DWORKGROUP=64 -DWIDTH=8 -DCOLUMNS=1 -DROWS=8",
                         kernel_source("cl", "matvec.cl")};
    program = opencl::load_program(context.get(), found.device, key, "test", "kernel matvec");
    entry = opencl::EntryPoint(clCreateKernel(program.get(), "interflect_matvec", &code));
    opencl::succeed(code, "test", "kernel", "clCreateKernel");
  }

  /// y = f x for one row of n columns.
  [[nodiscard]] float product(std::vector<float> f, std::vector<float> x) const {
    const auto n = static_cast<std::uint32_t>(x.size());
    std::vector<float> y(16);
    std::array<opencl::Memory, 3> memory;
    cl_uint index = 0;
    for (std::vector<float>* values : {&f, &x, &y}) {
      cl_int code = CL_SUCCESS;
      memory[index] = opencl::Memory(clCreateBuffer(context.get(), CL_MEM_READ_WRITE | CL_MEM_COPY_HOST_PTR,
                                                    values->size() * sizeof(float), values->data(), &code));
      opencl::succeed(code, "test", "product", "clCreateBuffer");
      cl_mem handle = memory[index].get();
      opencl::succeed(clSetKernelArg(entry.get(), index++, sizeof handle, &handle), "test", "product",
                      "clSetKernelArg");
    }
    const MatvecArguments a{n, 0, 1, n, n};
    opencl::succeed(clSetKernelArg(entry.get(), index, sizeof a, &a), "test", "product", "clSetKernelArg");
    const std::size_t items = 64;
    opencl::succeed(clEnqueueNDRangeKernel(queue.get(), entry.get(), 1, nullptr, &items, &items, 0, nullptr, nullptr),
                    "test", "product", "clEnqueueNDRangeKernel");
    opencl::succeed(clEnqueueReadBuffer(queue.get(), memory[2].get(), CL_TRUE, 0, y.size() * sizeof(float), y.data(), 0,
                                        nullptr, nullptr),
                    "test", "product", "clEnqueueReadBuffer");
    return y[0];
  }

  opencl::Context context;
  opencl::CommandQueue queue;
  opencl::Program program;
  opencl::EntryPoint entry;
};

/// Every work-item's first product is 1 and its later ones are just too small to be added to that: all that go into the
/// accumulator that holds the 1 are lost. With one accumulator for the whole row these are more than the bound allows.
double error_of_a_long_row(const opencl::Found& found) {
  constexpr std::uint32_t n = 65536, workgroup = 64;
  const std::vector<float> f(n, 1);
  std::vector<float> x(n, 0.95F * 0x1p-24F);
  for (std::uint32_t j = 0; j < 4 * workgroup; j += 4) x[j] = 1;
  double exact = 0;
  for (const float value : x) exact += static_cast<double>(value);
  return std::abs(static_cast<double>(SmallGroups(found).product(f, x)) - exact) / exact;
}

TEST(OpenCLMatvec, ALongRowStaysWithinItsBoundInSmallWorkGroups) {
  const std::vector<opencl::Found> all = opencl::find_devices();
  const auto found = std::find_if(all.begin(), all.end(), [](const opencl::Found& f) { return f.device != nullptr; });
  if (found == all.end()) GTEST_SKIP() << "no OpenCL device: " << all.front().reason;
  test::KernelFolder folder;
  EXPECT_LE(error_of_a_long_row(*found), matvec_bound(65536));
  folder.replace("cl/matvec.cl", "#define BLOCK 64U", "#define BLOCK 1024U");
  EXPECT_GT(error_of_a_long_row(*found), matvec_bound(65536)) << "the twin: one accumulator for the whole row";
}

TEST_P(OpenCL, BuffersBeginAsZerosAndKeepTheOrderOfTransfers) {
  const auto device = open();
  for (const std::size_t bytes : {std::size_t{1}, std::size_t{4000}, (std::size_t{6} << 20) + 5}) {
    const auto buffer = device->allocate(bytes);
    std::vector<std::byte> values(bytes, std::byte{7});
    device->queue().download(*buffer, 0, values);
    EXPECT_EQ(values, std::vector<std::byte>(bytes)) << bytes;
    for (const std::byte value : {std::byte{1}, std::byte{2}, std::byte{3}}) {
      std::vector<std::byte> passing(bytes, value);
      device->queue().upload(*buffer, 0, passing);
      passing.assign(bytes, std::byte{9});  // may be reused at once
    }
    device->queue().download(*buffer, 0, values);
    EXPECT_EQ(values, std::vector<std::byte>(bytes, std::byte{3})) << bytes;
  }
}

TEST_P(OpenCL, SharedMemoryIsUsedInPlaceAndOutlivesItsOwner) {
  const auto device = open();
  auto memory = std::make_shared<PageBuffer>(4096);
  const auto shared = device->share(memory);
  if (device->info().type != DeviceType::cpu) {
    EXPECT_EQ(shared, nullptr);
    return;
  }
  ASSERT_NE(shared, nullptr);
  memory->data()[3] = std::byte{5};
  const auto to = device->allocate(4096);
  const auto copy = device->kernel("copy", {});
  const StreamArguments arguments{64};
  Buffer* const out[] = {shared.get(), to.get()};
  Buffer* const back[] = {to.get(), shared.get()};
  device->queue().launch(*copy, 1, out, bytes_of(arguments), "Out");
  std::array<std::byte, 1> seen{};
  device->queue().download(*to, 3, seen);
  EXPECT_EQ(seen[0], std::byte{5});
  EXPECT_THAT(error_of([&] { device->queue().launch(*copy, 1, back, bytes_of(arguments), "Back"); }),
              AllOf(HasSubstr("copy"), HasSubstr("read only")));
  EXPECT_THAT(error_of([&] { device->queue().upload(*shared, 0, seen); }), HasSubstr("read only"));
}

TEST_P(OpenCL, SharedMemoryIsFreedWithItsBuffer) {
  const auto device = open();
  auto memory = std::make_shared<PageBuffer>(4096);
  const std::weak_ptr<PageBuffer> watch = memory;
  auto shared = device->share(std::move(memory));
  if (shared == nullptr) GTEST_SKIP() << "not a CPU device: it shares nothing";
  EXPECT_FALSE(watch.expired());
  shared.reset();
  EXPECT_TRUE(watch.expired());
}

TEST_P(OpenCL, RefusesMemoryThatNoMachineHas) {
  const auto device = open();
  EXPECT_THAT(error_of([&] { static_cast<void>(device->allocate(SIZE_MAX / 2)); }),
              AllOf(HasSubstr("opencl:"), HasSubstr("allocate")));
}

TEST_P(OpenCL, ACompileErrorNamesFileAndLine) {
  const auto device = open();
  test::KernelFolder folder;
  folder.replace("cl/axpby.cl", "#include \"blocks.cl\"\n", "#include \"blocks.cl\"\nthis is not OpenCL;\n");
  const std::string error = error_of([&] { static_cast<void>(device->kernel("axpby", {})); });
  const std::string first_line = error.substr(0, error.find('\n'));
  EXPECT_THAT(first_line, AllOf(HasSubstr("kernel axpby"), HasSubstr("cl/axpby.cl:2"), HasSubstr("CL_BUILD_PROGRAM_")));
  EXPECT_GT(error.size(), first_line.size()) << "the log";
}

TEST_P(OpenCL, CompiledKernelsComeFromTheCacheUntilSomethingChanges) {
  test::KernelFolder folder;
  const auto compiled_by = [&](const Macros& macros) {
    const CompileStatistics before = compile_statistics();
    static_cast<void>(open()->kernel("read", macros));
    const CompileStatistics after = compile_statistics();
    EXPECT_EQ(after.compiled + after.from_cache, before.compiled + before.from_cache + 1);
    EXPECT_GT(after.seconds, before.seconds);
    return after.compiled - before.compiled;
  };
  EXPECT_EQ(compiled_by({{"STREAMS", 1}}), 1U);
  EXPECT_EQ(compiled_by({{"STREAMS", 1}}), 0U);
  EXPECT_EQ(compiled_by({{"STREAMS", 2}}), 1U) << "other macros";
  for (const auto& entry : std::filesystem::directory_iterator(folder.cache().entries())) {
    std::fstream file(entry.path(), std::ios::in | std::ios::out | std::ios::binary);
    file.seekp(-100, std::ios::end);
    file << "damage";
  }
  EXPECT_EQ(compiled_by({{"STREAMS", 1}}), 1U) << "a damaged entry";
  EXPECT_EQ(compiled_by({{"STREAMS", 1}}), 0U);
  folder.replace("cl/read.cl", "// Reads", "// It reads");
  EXPECT_EQ(compiled_by({{"STREAMS", 1}}), 1U) << "another source";
}

TEST_P(OpenCL, ManyKernelsOfAFileAreCompiledOnce) {
  const auto device = open();
  const CompileStatistics before = compile_statistics();
  for (const char* name : {"bicgstab_product", "bicgstab_half", "bicgstab_step"}) {
    EXPECT_EQ(device->kernel(name, {})->name(), name);
  }
  EXPECT_EQ(compile_statistics().compiled, before.compiled + 1);
}

/// What a binary that the driver refuses comes to: the program is there all the same, and the next one from the cache.
TEST_P(OpenCL, ABinaryThatTheDriverRefusesIsCompiledAnew) {
  for (const opencl::Found& found : opencl::find_devices()) {
    if (found.device == nullptr) continue;
    cl_int code = CL_SUCCESS;
    const opencl::Context context(clCreateContext(nullptr, 1, &found.device, nullptr, nullptr, &code));
    ASSERT_EQ(code, CL_SUCCESS);
    CompileKey key{"opencl", "a device", "a driver", "", "kernel void nothing(global float* x) { x[0] = 1; }"};
    for (const std::string options : {"-DA", "-DA -DB"}) {  // two drivers' versions, changed macros: other keys
      key.options = options;
      key.driver += options;
      static_cast<void>(cached_compile(key, [] { return std::vector<std::byte>(1000, std::byte{0x5A}); }));
      const CompileStatistics before = compile_statistics();
      EXPECT_NE(opencl::load_program(context.get(), found.device, key, "opencl:0", "kernel nothing"), nullptr);
      EXPECT_EQ(compile_statistics().compiled, before.compiled + 1);
      EXPECT_NE(opencl::load_program(context.get(), found.device, key, "opencl:0", "kernel nothing"), nullptr);
      EXPECT_EQ(compile_statistics().compiled, before.compiled + 1);
    }
  }
}

/// A kernel of a file with one thing wrong with it.
struct Mutation {
  std::string name, shape, file, from, to;
  std::set<std::string> broken;  ///< the kernels that must fail; no other may
};

void PrintTo(const Mutation& mutation, std::ostream* out) {
  *out << mutation.shape << ": " << mutation.name;
}

class BrokenOpenCL : public testing::TestWithParam<Mutation> {};

TEST_P(BrokenOpenCL, FailsTheCheck) {
  const Mutation& mutation = GetParam();
  const std::vector<DeviceEntry> all = opencl::list_devices();
  const auto entry = std::find_if(all.begin(), all.end(), [](const DeviceEntry& e) { return e.available; });
  if (entry == all.end()) GTEST_SKIP() << "no OpenCL device: " << all.front().reason;
  test::KernelFolder folder;
  const test::Variable shape("INTERFLECT_OPENCL_SHAPE", mutation.shape);
  folder.replace(mutation.file, mutation.from, mutation.to);
  const auto device = opencl::open_device(static_cast<std::uint32_t>(entry - all.begin()));
  std::vector<KernelCheck> rows;  // of the kernels that the file can break: each is compiled anew
  if (mutation.file == "cl/read.cl") check::check_stream(*device, rows);
  if (mutation.file == "cl/matvec.cl") check::check_matvec(*device, rows, {.max_size = 1312, .columns = 3});
  if (mutation.file == "cl/blocks.cl") {
    for (const std::string_view kernel : {"dot", "axpby", "cg_step"}) {
      check::check_vectors(*device, rows, {.max_size = 1312, .kernel = kernel});
    }
  }
  std::set<std::string> failed;
  for (const KernelCheck& row : rows) {
    if (row.status != CheckStatus::pass) failed.insert(row.kernel);
    EXPECT_THAT(row.reason, testing::Not(HasSubstr("clBuildProgram"))) << "broken in another way than meant";
  }
  EXPECT_EQ(failed, mutation.broken);
}

const std::set<std::string> with_sums{"dot", "cg_step"};
const std::set<std::string> with_vectors{"dot", "axpby", "cg_step"};

std::vector<Mutation> mutations() {
  return {
      {"TailOfAVectorDropped", "cpu", "cl/matvec.cl", "if (left > 0)", "if (left < 0)", {"matvec"}},
      {"PaddingRead", "cpu", "cl/matvec.cl", "MULTIPLY(j, PART)", "MULTIPLY(j, WHOLE)", {"matvec"}},
      {"SecondBlockForgotten",
       "cpu",
       "cl/matvec.cl",
       "total[q][c] += sum[q][c]",
       "total[q][c] = sum[q][c]",
       {"matvec"}},
      {"WrongStride", "cpu", "cl/matvec.cl", "(size_t)c * a.vector_stride", "(size_t)c * a.row_stride", {"matvec"}},
      {"TailDropped", "cpu", "cl/blocks.cl", "i + l < end; ++l) part", "i + l + 1 < end; ++l) part", with_vectors},
      {"WrongVectorStride", "cpu", "cl/blocks.cl", "b.column * a.vector_stride", "b.column * (a.vector_stride - 16)",
       with_vectors},
      {"LaneForgotten", "cpu", "cl/blocks.cl", "result[s] = c.lo + c.hi", "result[s] = c.lo", with_sums},
      {"TailDropped", "gpu", "cl/matvec.cl", "j + 4 <= n ? v :", "j + 4 <= n ? v : 0.0f *", {"matvec"}},
      {"PaddingRead", "gpu", "cl/matvec.cl", "j + 4 <= n ? v", "true ? v", {"matvec"}},
      {"LevelBarrierRemoved",
       "gpu",
       "cl/matvec.cl",
       "    barrier(CLK_LOCAL_MEM_FENCE);\n    if (part",
       "    if (part",
       {"matvec"}},
      {"SumBarrierRemoved",
       "gpu",
       "cl/matvec.cl",
       "  barrier(CLK_LOCAL_MEM_FENCE);\n  local float* row",
       "  local float* row",
       {"matvec"}},
      {"BarrierRemoved", "gpu", "cl/blocks.cl", "barrier(CLK_LOCAL_MEM_FENCE);  // the level before is there", "",
       with_sums},
      {"ReadBarrierRemoved", "gpu", "cl/read.cl", "barrier(CLK_LOCAL_MEM_FENCE);", "", {"read"}},
      {"TailDropped", "gpu", "cl/blocks.cl", "i < b.end;", "i + 1 < b.end;", with_vectors},
      {"WrongStride", "gpu", "cl/blocks.cl", "i += WORKGROUP * LANES", "i += 2 * WORKGROUP * LANES", with_vectors},
  };
}
INSTANTIATE_TEST_SUITE_P(Twin, BrokenOpenCL, testing::ValuesIn(mutations()), [](const auto& mutation) {
  const Mutation& m = mutation.param;
  return m.shape + m.name + m.file.substr(3, m.file.find('.') - 3);
});

TEST(OpenCLList, AnUnknownShapeIsTheReasonWhyNoDeviceIsAvailable) {
  const std::vector<opencl::Found> found = opencl::find_devices();
  if (found.front().device == nullptr) GTEST_SKIP() << "no OpenCL device: " << found.front().reason;
  const test::Variable shape("INTERFLECT_OPENCL_SHAPE", "tpu");
  const auto names_it = AllOf(HasSubstr("INTERFLECT_OPENCL_SHAPE: 'tpu'"), HasSubstr("neither cpu nor gpu"));
  const std::vector<DeviceEntry> all = opencl::list_devices();
  ASSERT_EQ(all.size(), found.size());
  for (const DeviceEntry& entry : all) EXPECT_FALSE(entry.available) << entry.info.id;
  EXPECT_FALSE(all[0].info.name.empty()) << "listed all the same";
  EXPECT_THAT(all[0].reason, names_it);
  EXPECT_EQ(error_of([] { static_cast<void>(opencl::open_device(0)); }), "opencl:0: open: " + all[0].reason);
}

/// In a fresh process, since the loader looks for drivers once: what is listed where there is none.
[[noreturn]] void list_without_drivers() {
  ::setenv("OCL_ICD_VENDORS", "/nonexistent", 1);
  const std::vector<DeviceEntry> all = opencl::list_devices();
  const bool one = all.size() == 1 && all[0].info.id == "opencl:0" && !all[0].available;
  std::fputs(all.empty() ? "nothing" : all[0].reason.c_str(), stderr);
  std::exit(one && error_of([] { static_cast<void>(opencl::open_device(0)); }).starts_with("opencl:0: open: no Open")
                ? 0
                : 1);
}

TEST(OpenCLListDeathTest, SaysThatNoDriverIsInstalled) {
  testing::GTEST_FLAG(death_test_style) = "threadsafe";
  EXPECT_EXIT(list_without_drivers(), testing::ExitedWithCode(0), "no OpenCL platform found: is a driver");
}

TEST(OpenCLCodes, HaveTheirNames) {
  EXPECT_EQ(opencl::code_text(CL_OUT_OF_RESOURCES), "CL_OUT_OF_RESOURCES (-5)");
  EXPECT_EQ(opencl::code_text(-9999), "OpenCL error -9999");
  EXPECT_EQ(error_of([] { opencl::succeed(CL_INVALID_VALUE, "opencl:7", "wait", "clFinish"); }),
            "opencl:7: wait: clFinish: CL_INVALID_VALUE (-30)");
}

}  // namespace
}  // namespace interflect
