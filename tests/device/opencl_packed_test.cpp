#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <ostream>
#include <set>
#include <string>
#include <vector>

#include "device/kernel_folder.h"
#include "interflect/base/half.h"
#include "interflect/device/check.h"
#include "interflect/device/check_tools.h"
#include "interflect/device/kernel_arguments.h"
#include "interflect/device/kernel_table.h"
#include "interflect/device/opencl/opencl.h"

// The OpenCL kernels of the 16-bit formats in both shapes.

namespace interflect {
namespace {

std::string describe(const KernelCheck& row) {
  return row.kernel + " n=" + std::to_string(row.size) + " " + row.parameters + ": error " + std::to_string(row.error) +
         " bound " + std::to_string(row.bound) + " " + row.reason;
}

template <class T>
std::unique_ptr<Buffer> buffer_of(Device& device, const std::vector<T>& values) {
  auto buffer = device.allocate(values.size() * sizeof(T));
  device.queue().upload(*buffer, 0, std::as_bytes(std::span(values)));
  return buffer;
}

template <class Arguments>
std::vector<float> run(Device& device, const Kernel& kernel, std::uint32_t groups, const std::vector<Buffer*>& buffers,
                       const Arguments& arguments) {
  device.queue().launch(kernel, groups, buffers, std::as_bytes(std::span(&arguments, 1)), "Test");
  std::vector<float> values(buffers.back()->size() / sizeof(float));
  device.queue().download(*buffers.back(), 0, std::as_writable_bytes(std::span(values)));
  return values;
}

/// The first OpenCL device that is available, with the kernels' shape forced.
class OnOpenCL {
 protected:
  void find() {
    for (const DeviceEntry& entry : opencl::list_devices()) {
      if (entry.available) return;
      why_ = entry.reason;
      ++index_;
    }
    GTEST_SKIP() << "no OpenCL device: " << why_;
  }
  [[nodiscard]] std::unique_ptr<Device> open() const { return opencl::open_device(index_); }

 private:
  std::uint32_t index_ = 0;
  std::string why_;
};

class OpenCLPacked : public OnOpenCL, public testing::TestWithParam<const char*> {
 protected:
  void SetUp() override { find(); }
  [[nodiscard]] static bool cpu() { return GetParam() == std::string("cpu"); }

 private:
  test::FreshCache cache_;
  test::Variable shape_{"INTERFLECT_OPENCL_SHAPE", GetParam()};
};
INSTANTIATE_TEST_SUITE_P(Shape, OpenCLPacked, testing::Values("cpu", "gpu"),
                         [](const auto& shape) { return std::string(shape.param); });

/// Through each way of cutting columns into chunks; tests/backends has all cases in the shape that the device chooses.
TEST_P(OpenCLPacked, KernelsStayWithinTheirBounds) {
  const auto device = open();
  std::vector<KernelCheck> rows;
  for (const std::uint32_t columns : {3U, 7U}) check::check_packed(*device, rows, {.columns = columns});
  EXPECT_GT(rows.size(), 150U);
  for (const KernelCheck& row : rows) EXPECT_EQ(row.status, CheckStatus::pass) << describe(row);
}

/// A block that is wider than its work-group is done in several ranges of tile columns: with groups of 256 none is, so
/// that here ranges are made small. 6 tile columns do not divide a block, nor do 12 work-items a group.
TEST_P(OpenCLPacked, ABlockInSeveralRangesIsRight) {
  if (cpu()) GTEST_SKIP() << "the processors' shape has no ranges";
  test::KernelFolder folder;
  const std::string range = "(TILES_ACROSS < WORKGROUP / 2U ? TILES_ACROSS : WORKGROUP / 2U)";
  const auto failed = [&] {
    std::vector<KernelCheck> rows;
    check::check_packed(*open(), rows, {.max_size = 513, .columns = 3, .kernel = "sym16"});
    EXPECT_GT(rows.size(), 30U);
    return std::count_if(rows.begin(), rows.end(), [](const auto& row) { return row.status != CheckStatus::pass; });
  };
  folder.replace("cl/sym16.cl", range, "(TILES_ACROSS < 6U ? TILES_ACROSS : 6U)");
  EXPECT_EQ(failed(), 0);
  folder.replace("cl/sym16.cl", "w->lane < RANGE) w->scratch", "w->lane < 0) w->scratch");
  EXPECT_GT(failed(), 0) << "the twin: a range finds the tiles of the one before";
}

/// y of one strip of the largest n: every product but a few is just too small to be added to 1, and these few, the
/// first ones, stand where each accumulator has one. In one accumulator for the whole row all small ones were lost.
double error_of_a_long_row(Device& device, bool cpu) {
  const std::uint32_t n = largest_n, count = n / tile_columns;
  std::vector<float> x(n, 0.95F * 0x1p-24F);
  if (cpu) {
    std::fill_n(x.begin(), tile_columns, 1.0F);  // a lane each
  } else {
    for (std::uint32_t j = 0; j < 1024; j += 8) x[j] = 1;  // a work-item each
  }
  double exact = 0;
  for (const float value : x) exact += static_cast<double>(value);
  std::vector<std::uint32_t> index{0, count};
  for (std::uint32_t t = 0; t < count; ++t) index.push_back(t);
  const auto tiles = buffer_of(device, std::vector<Half>(std::size_t{count} * tile_elements, to_half(1.0F)));
  const auto index_ = buffer_of(device, index);
  const auto x_ = buffer_of(device, x), t = buffer_of(device, std::vector<float>(tile_rows, 1.0F));
  const auto y = device.allocate(x.size() * sizeof(float));
  const TileArguments a{.n = n, .first = 0, .strips = 1, .tiles = count, .vector_stride = n};
  const auto kernel = device.kernel("tiles16", {{"COLUMNS", 1}, {"STRIPS", 1}});
  const std::vector<float> sums = run(device, *kernel, 1, {tiles.get(), index_.get(), x_.get(), t.get(), y.get()}, a);
  double worst = 0;
  for (std::uint32_t q = 0; q < tile_rows; ++q) {
    worst = std::max(worst, std::abs(static_cast<double>(sums[q]) - exact) / exact);
  }
  return worst;
}

TEST_P(OpenCLPacked, ALongRowStaysWithinItsBound) {
  test::KernelFolder folder;
  EXPECT_LE(error_of_a_long_row(*open(), cpu()), packed_bound(largest_n));
  folder.replace("cl/tiles16.cl", cpu() ? "#define SEGMENT 256U" : "#define SEGMENT 128U", "#define SEGMENT 65536U");
  EXPECT_GT(error_of_a_long_row(*open(), cpu()), packed_bound(largest_n)) << "the twin: one accumulator for the row";
}

TEST_P(OpenCLPacked, TheSameBitsInTwoRuns) {
  const auto device = open();
  constexpr std::uint32_t block = 128, n = 2 * block, columns = 3, across = block / tile_columns;
  // Two of the three blocks: (0, 0) and (0, 1), full.
  std::vector<std::uint32_t> index{0, 0, 0, 16, 0, 1, 16, 32}, begin{0}, column;
  for (std::uint32_t s = 0; s < 32; ++s) {
    index.push_back(s % 16);
    for (std::uint32_t t = 0; t < across; ++t) column.push_back(t);
    begin.push_back(static_cast<std::uint32_t>(column.size()));
  }
  index.insert(index.end(), begin.begin(), begin.end());
  index.insert(index.end(), column.begin(), column.end());
  check::Random random(1);
  std::vector<Half> elements(column.size() * tile_elements);
  for (Half& element : elements) element = to_half(random.next());
  const auto tiles = buffer_of(*device, elements);
  const auto index_ = buffer_of(*device, index), x = buffer_of(*device, random.numbers(n * columns));
  const SymmetricArguments a{.blocks = 2,
                             .strips = 32,
                             .tiles = static_cast<std::uint32_t>(column.size()),
                             .block_rows = 2,
                             .vector_stride = n};
  const auto kernel = device->kernel("sym16", {{"COLUMNS", columns}, {"BLOCK", block}});
  const auto once = [&] {
    const auto partial = device->allocate(std::size_t{4} * columns * block * sizeof(float));
    return run(*device, *kernel, 2, {tiles.get(), index_.get(), x.get(), partial.get()}, a);
  };
  const std::vector<float> first = once();
  EXPECT_NE(first[0], 0);
  EXPECT_EQ(once(), first);
}

/// A kernel of a file with one thing wrong with it.
struct Mutation {
  std::string name, shape, file, from, to;
  std::string broken;  ///< the kernel that must fail; no other may
  std::uint32_t columns = 3;
};

void PrintTo(const Mutation& mutation, std::ostream* out) {
  *out << mutation.shape << ": " << mutation.name;
}

class BrokenOpenCLPacked : public OnOpenCL, public testing::TestWithParam<Mutation> {
  void SetUp() override { find(); }
};

TEST_P(BrokenOpenCLPacked, FailsTheCheck) {
  const Mutation& mutation = GetParam();
  test::KernelFolder folder;
  const test::Variable shape("INTERFLECT_OPENCL_SHAPE", mutation.shape);
  folder.replace(mutation.file, mutation.from, mutation.to);
  const auto device = open();
  std::vector<KernelCheck> rows;  // of the kernels that the file can break: each is compiled anew
  if (mutation.file == "cl/scale.cl") check::check_packed(*device, rows, {.max_size = 1025, .kernel = "scale"});
  if (mutation.file == "cl/tiles16.cl" || mutation.file == "cl/tiles.cl") {
    check::check_packed(*device, rows, {.max_size = 5791, .columns = mutation.columns, .kernel = "tiles16"});
  }
  if (mutation.file == "cl/sym16.cl") {
    check::check_packed(*device, rows, {.max_size = 300, .columns = mutation.columns, .kernel = "sym16"});
    check::check_packed(*device, rows, {.max_size = 300, .kernel = "sym16_fold"});
  }
  std::set<std::string> failed;
  for (const KernelCheck& row : rows) {
    if (row.status != CheckStatus::pass) failed.insert(row.kernel);
    EXPECT_THAT(row.reason, testing::Not(testing::HasSubstr("clBuildProgram"))) << "broken in another way than meant";
  }
  EXPECT_EQ(failed, std::set<std::string>{mutation.broken});
}

/// What is one text for both shapes.
std::vector<Mutation> in_both(const std::vector<Mutation>& mutations) {
  std::vector<Mutation> all;
  for (const Mutation& mutation : mutations) {
    for (const char* shape : {"cpu", "gpu"}) {
      all.push_back(mutation);
      all.back().shape = shape;
    }
  }
  return all;
}

std::vector<Mutation> vector_mutations() {
  const std::string sym16 = "cl/sym16.cl", fold = "sym16_fold";
  return in_both({
      {"WrongIndexOfS", "", "cl/scale.cl", "load(s, i - column, a.n)", "load(s, i - b.begin, a.n)", "scale"},
      {"SlotForgotten", "", sym16, "k < block_rows; ++k", "k + 1 < block_rows; ++k", fold},
      {"DiagonalForgotten", "", sym16, "sum += load(from", "sum += k == row / block ? 0.0f : load(from", fold},
      {"WrongIndexOfT", "", sym16, "load(t, row, a.n)", "load(t, row % block, a.n)", fold},
  });
}

std::vector<Mutation> processor_mutations() {
  const std::string shape = "cpu", tiles16 = "cl/tiles16.cl", sym16 = "cl/sym16.cl";
  const std::string each_row = "EACH(q, STRIP) {\n        const vector h";
  const std::string but_one = "EACH(q, STRIP - 1) {\n        const vector h";
  return {
      {"RowDropped", shape, tiles16, each_row, but_one, "tiles16"},
      {"TileDropped", shape, tiles16, "k < count; ++k", "k + 1 < count; ++k", "tiles16"},
      {"SegmentForgotten", shape, tiles16, "total[q][c] += sum", "total[q][c] = sum", "tiles16"},
      {"WrongIndexOfT", shape, tiles16, "(t + first) * sums", "t * sums", "tiles16"},
      {"RowsPastTheEnd", shape, tiles16, "q < STRIP && first + q < a.n; ++q) out[q] = t[first + q]",
       "q < STRIP; ++q) out[q] = t[min(first + q, a.n - 1)]", "tiles16"},
      {"LanesForgotten", shape, "cl/tiles.cl", "return last.even + last.odd", "return last.even", "tiles16"},
      {"RowDropped", shape, sym16, each_row, but_one, "sym16"},
      {"StripDropped", shape, sym16, "s < b.end; ++s", "s + 1 < b.end; ++s", "sym16"},
      {"ColumnSumsLost", shape, sym16, "+= down[c]", "= down[c]", "sym16"},
      {"DiagonalsColumnsLost", shape, sym16, "+= row_sums", "= row_sums", "sym16"},
      {"NoZeros", shape, sym16, "i < SLOT; i += WIDTH", "i < SLOT / 2; i += WIDTH", "sym16"},
      {"WrongSlot", shape, sym16, "entry.y * a.block_rows + entry.x", "entry.x * a.block_rows + entry.y", "sym16"},
      {"LaterColumnsLikeTheFirst", shape, tiles16, "x + (size_t)k * CHUNK * a.vector_stride, CHUNK, total[part][k]",
       "x, CHUNK, total[part][k]", "tiles16", 24},
      {"LaterColumnsAddedToTheFirst", shape, sym16, "b.columns + k * CHUNK * BLOCK, CHUNK", "b.columns, CHUNK", "sym16",
       24},
  };
}

std::vector<Mutation> gpu_mutations() {
  const std::string shape = "gpu", tiles16 = "cl/tiles16.cl", sym16 = "cl/sym16.cl";
  const std::string barrier = "barrier(CLK_LOCAL_MEM_FENCE);\n    ";
  return {
      {"RowDropped", shape, tiles16, "EACH(r, ROWS) sum[c][r] = dot_of", "EACH(r, ROWS - 1) sum[c][r] = dot_of",
       "tiles16"},
      {"TileDropped", shape, tiles16, "k < to; k", "k + 1 < to; k", "tiles16"},
      {"PartForgotten", shape, tiles16, "EACH(k, PER_PART - 1)", "EACH(k, PER_PART - 2)", "tiles16"},
      {"BarrierRemoved", shape, tiles16, barrier + "if (part < width)", "if (part < width)", "tiles16"},
      {"WrongIndexOfT", shape, tiles16, "= t[q]", "= t[0]", "tiles16"},
      {"RowsPastTheEnd", shape, tiles16,
       "part == 0 && q < rows) {\n    EACH_COLUMN(c) y[(size_t)c * stride + q] = t[q]",
       "part == 0) {\n    EACH_COLUMN(c) y[(size_t)c * stride + q] = t[min(q, rows - 1)]", "tiles16"},
      {"RowDropped", shape, sym16, "EACH(r, 4) {", "EACH(r, 3) {", "sym16"},
      {"ColumnSumsLost", shape, sym16, "[r]), down[c]);", "[r]), (float8)0.0f);", "sym16"},
      {"LanesForgotten", shape, sym16, "k < LANES; k += PARTS", "k < LANES / 2; k += PARTS", "sym16"},
      {"PartForgotten", shape, sym16, "(part[2] + part[3])", "part[2]", "sym16"},
      {"PhaseForgotten", shape, sym16, "phase = 1; phase < PHASES", "phase = 1; phase + 1 < PHASES", "sym16"},
      {"DiagonalsRowsLost", shape, sym16, "w->b.diagonal ? *to + sum : sum", "sum", "sym16"},
      {"TileOfAStripBefore", shape, sym16, "k < begins[0] || k >= begins[1]", "k == NOWHERE", "sym16"},
      {"BarrierRemoved", shape, sym16, barrier + "there = load", "there = load", "sym16"},
      {"LaterColumnsLikeTheFirst", shape, tiles16, "x + column, t, y + column, CHUNK, row",
       "x, t, y + column, CHUNK, row", "tiles16", 24},
      {"LaterColumnsAddedToTheFirst", shape, sym16, "w.b.columns + slot, CHUNK", "w.b.columns, CHUNK", "sym16", 24},
  };
}

std::string name_of(const testing::TestParamInfo<Mutation>& info) {
  const Mutation& m = info.param;
  return m.shape + m.name + m.broken;
}
INSTANTIATE_TEST_SUITE_P(Vectors, BrokenOpenCLPacked, testing::ValuesIn(vector_mutations()), name_of);
INSTANTIATE_TEST_SUITE_P(Processor, BrokenOpenCLPacked, testing::ValuesIn(processor_mutations()), name_of);
INSTANTIATE_TEST_SUITE_P(Gpu, BrokenOpenCLPacked, testing::ValuesIn(gpu_mutations()), name_of);

}  // namespace
}  // namespace interflect
