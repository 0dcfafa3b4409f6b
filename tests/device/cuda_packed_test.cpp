#include <gtest/gtest.h>

#include <cmath>
#include <iostream>
#include <set>
#include <string>

#include "device/cuda_on_cpu_device.h"
#include "interflect/device/check.h"
#include "interflect/device/check_tools.h"
#include "interflect/device/kernel_arguments.h"
#include "interflect/formfactor/packed_matrix.h"
#include "sanitized.h"

// The CUDA kernels of the 16-bit formats on the processor: every case of the check, shapes that it does not launch, and
// the twins.

namespace interflect {
namespace {

using cuda_on_cpu::Order;
using test::sanitized;  // there a fiber's switch is slow: small sizes, one order, one twin of each kind

class InOrder : public testing::TestWithParam<std::pair<std::string, Order>> {
 protected:
  void SetUp() override {
    if (sanitized && GetParam().second != Order::shuffled) GTEST_SKIP() << "under the sanitizers in one order only";
    cuda_on_cpu::use_order(GetParam().second);
  }
  void TearDown() override { cuda_on_cpu::use_order(Order::forwards); }
};
const auto orders = testing::Values(std::pair("Forwards", Order::forwards), std::pair("Backwards", Order::backwards),
                                    std::pair("Shuffled", Order::shuffled));
const auto name_of_order = [](const auto& info) { return info.param.first; };

std::string describe(const KernelCheck& row) {
  return row.kernel + " n=" + std::to_string(row.size) + " " + row.parameters + ": error " + std::to_string(row.error) +
         " bound " + std::to_string(row.bound) + " " + row.reason;
}

class CudaPacked : public InOrder {};
INSTANTIATE_TEST_SUITE_P(OnCpu, CudaPacked, orders, name_of_order);

TEST_P(CudaPacked, StaysWithinItsBounds) {
  test::CudaOnCpu device;
  std::vector<KernelCheck> rows;
  if (sanitized) std::cout << "under the sanitizers: n up to 65\n";
  check::check_packed(device, rows, {.max_size = sanitized ? 65 : every_size});
  EXPECT_GE(rows.size(), sanitized ? 100U : 272U);
  for (const KernelCheck& row : rows) EXPECT_EQ(row.status, CheckStatus::pass) << describe(row);
}

/// Several strips for a work-group: side by side, or one after the other.
TEST_P(CudaPacked, StripsSideBySideStayWithinTheirBounds) {
  for (const std::uint32_t strips : {2U, 3U, 4U, 8U, 13U}) {
    test::CudaOnCpu device("", test::CudaOnCpu::large, strips * tile_rows);
    std::vector<KernelCheck> rows;
    check::check_packed(device, rows, {.max_size = sanitized ? 65U : 1312U, .columns = 3, .kernel = "tiles16"});
    EXPECT_GT(rows.size(), 10U);
    for (const KernelCheck& row : rows) EXPECT_EQ(row.status, CheckStatus::pass) << strips << " " << describe(row);
  }
}

// A whole product from a matrix in a 16-bit format, through all its kernels.

struct Case {
  std::uint32_t n = 0, columns = 3;
  Storage storage = Storage::sym16;
  std::uint32_t block = 0;
};

/// Reciprocal form factors, some of them zero, for areas that differ.
FormFactorMatrix form_factors(std::uint32_t n, std::vector<double>& area) {
  check::Random random(n);
  area.clear();
  for (std::uint32_t i = 0; i < n; ++i) area.push_back(1 + std::abs(static_cast<double>(random.next())));
  FormFactorMatrix f(n);
  for (std::uint32_t i = 0; i < n; ++i) {
    for (std::uint32_t j = 0; j <= i; ++j) {
      const double s = (i / 40 + j / 24) % 3 == 0 ? 0.0 : 0.3 * std::abs(static_cast<double>(random.next())) / n;
      f.row(i)[j] = static_cast<float>(s / area[i]);
      f.row(j)[i] = static_cast<float>(s / area[j]);
    }
  }
  return f;
}

class Product {
 public:
  Product(Device& device, const PackedMatrix& f, std::uint32_t columns)
      : device_(device),
        f_(f),
        columns_(columns),
        x_(check::Random(7).numbers(std::size_t{columns} * f.stride())),
        vectors_({.n = f.size(),
                  .vector_stride = f.stride(),
                  .columns = columns,
                  .blocks = (f.size() + 1023) / 1024,
                  .blocks_per_group = 1,
                  .option = f.block(),
                  .slot = f.block_rows()}) {}

  std::vector<float> run() {
    const auto x = filled(std::as_bytes(std::span(x_))), s = filled(std::as_bytes(f_.scale_in())),
               t = filled(std::as_bytes(f_.scale_out()));
    const auto xs = device_.allocate(x_.size() * sizeof(float)), y = device_.allocate(x_.size() * sizeof(float));
    const std::size_t side = f_.block_rows();
    const auto partial =
        device_.allocate(std::max<std::size_t>(side * side * columns_ * f_.block(), 1) * sizeof(float));
    launch("scale", {}, columns_ * vectors_.blocks, {x.get(), s.get(), xs.get()}, vectors_);
    for (const PackedMatrix::Panel& panel : f_.panels(std::max(40000U, 2 * f_.block() * f_.block()), 1000000)) {
      const auto tiles = filled(panel.elements), index = filled(std::as_bytes(std::span(panel.index)));
      if (f_.storage() == Storage::sym16) {
        const SymmetricArguments a{panel.units, panel.strips, panel.tiles, f_.block_rows(), f_.stride()};
        launch("sym16", {{"COLUMNS", static_cast<int>(columns_)}, {"BLOCK", static_cast<int>(f_.block())}}, a.blocks,
               {tiles.get(), index.get(), xs.get(), partial.get()}, a);
      } else {
        const TileArguments a{f_.size(), panel.first * tile_rows, panel.strips, panel.tiles, f_.stride()};
        launch("tiles16", {{"COLUMNS", static_cast<int>(columns_)}, {"STRIPS", 1}}, a.strips,
               {tiles.get(), index.get(), xs.get(), t.get(), y.get()}, a);
      }
    }
    if (f_.storage() == Storage::sym16) {
      launch("sym16_fold", {}, columns_ * vectors_.blocks, {partial.get(), t.get(), y.get()}, vectors_);
    }
    std::vector<float> result(x_.size());
    device_.queue().download(*y, 0, std::as_writable_bytes(std::span(result)));
    return result;
  }

  /// By H itself, in double: element i of column c, and the sum of what was added, in size.
  struct Exact {
    double value = 0, magnitude = 0;
  };
  std::vector<Exact> exact() const {
    std::vector<Exact> y(x_.size());
    for (std::uint32_t unit = 0; unit < f_.units(); ++unit) {
      f_.for_each_strip(unit, [&](std::uint32_t row, std::span<const std::uint32_t> columns, const Half* tiles) {
        for (std::size_t e = 0; e < columns.size() * tile_elements; ++e) {
          const auto q = static_cast<std::uint32_t>(e % tile_elements / tile_columns);
          const auto l = static_cast<std::uint32_t>(e % tile_columns);
          const std::uint32_t i = row + q, j = columns[e / tile_elements] * tile_columns + l;
          if (i >= f_.size() || j >= f_.size()) continue;
          add(y, i, j, tiles[e]);
          if (f_.storage() == Storage::sym16) add(y, j, i, tiles[e]);
        }
      });
    }
    return y;
  }

 private:
  void add(std::vector<Exact>& y, std::uint32_t i, std::uint32_t j, Half h) const {
    for (std::size_t c = 0; c < columns_; ++c) {
      const double term = static_cast<double>(f_.scale_out()[i]) * static_cast<double>(from_half(h)) *
                          static_cast<double>(f_.scale_in()[j]) * static_cast<double>(x_[c * f_.stride() + j]);
      y[c * f_.stride() + i].value += term;
      y[c * f_.stride() + i].magnitude += std::abs(term);
    }
  }
  std::unique_ptr<Buffer> filled(std::span<const std::byte> bytes) {
    auto buffer = device_.allocate(std::max<std::size_t>(bytes.size(), 4));
    device_.queue().upload(*buffer, 0, bytes);
    return buffer;
  }
  template <class Arguments>
  void launch(std::string_view name, const Macros& macros, std::uint32_t groups, std::initializer_list<Buffer*> buffers,
              const Arguments& a) {
    const auto kernel = device_.kernel(name, macros);
    device_.queue().launch(*kernel, groups, std::span(buffers.begin(), buffers.size()), std::as_bytes(std::span(&a, 1)),
                           "Test");
  }

  Device& device_;
  const PackedMatrix& f_;
  std::uint32_t columns_;
  std::vector<float> x_;
  VectorArguments vectors_;
};

void PrintTo(const Case& c, std::ostream* out) {
  *out << name(c.storage) << " n=" << c.n << " columns=" << c.columns << " block=" << c.block;
}
class CudaPackedProduct : public testing::TestWithParam<Case> {};
INSTANTIATE_TEST_SUITE_P(Of, CudaPackedProduct,
                         testing::Values(Case{333, 3, Storage::dense16}, Case{333, 3, Storage::tiled16},
                                         Case{333, 3, Storage::sym16, 176}, Case{333, 7, Storage::sym16, 128},
                                         Case{333, 3, Storage::sym16, 16}, Case{600, 3, Storage::sym16, 512}),
                         [](const auto& info) {
                           return std::string(name(info.param.storage)) + "_" + std::to_string(info.index);
                         });

TEST_P(CudaPackedProduct, IsThatOfTheStoredMatrixAndTheSameBitsInEveryOrderOfTheThreads) {
  const Case& c = GetParam();
  if (sanitized && c.n > 333) GTEST_SKIP() << "under the sanitizers only small sizes";
  std::vector<double> area;
  const FormFactorMatrix dense = form_factors(c.n, area);
  const PackedMatrix f(dense, area, c.storage, {.block = c.block});
  test::CudaOnCpu device;
  Product product(device, f, c.columns);
  const std::vector<float> y = product.run();
  const std::vector<Product::Exact> exact = product.exact();
  const double bound = (c.storage == Storage::sym16 ? sym16_bound(c.block) + check::rounding_bound(c.n / c.block + 5)
                                                    : packed_bound(c.n) + check::rounding_bound(3));
  double largest = 0;
  for (std::size_t i = 0; i < y.size(); ++i) {
    EXPECT_NEAR(y[i], exact[i].value, bound * exact[i].magnitude) << i;
    largest = std::max(largest, exact[i].magnitude);
  }
  EXPECT_GT(largest, 0.1);  // it is no product with zeros
  for (const Order order : {Order::backwards, Order::shuffled}) {
    if (sanitized) continue;
    cuda_on_cpu::use_order(order);
    EXPECT_EQ(product.run(), y);
  }
  cuda_on_cpu::use_order(Order::forwards);
}

// The twins. A defect is a text that is replaced in a kernel; fake_cuda/CMakeLists.txt lists them.

struct Defect {
  std::string name;
  std::string kernel;  ///< in which it must show, in one order of the threads or another
  std::uint32_t columns = 3;
  std::uint64_t max_size = 257;
};
void PrintTo(const Defect& defect, std::ostream* out) {
  *out << defect.name << " in " << defect.kernel;
}

class BrokenPackedKernel : public testing::TestWithParam<Defect> {};

TEST_P(BrokenPackedKernel, FailsTheCheck) {
  const Defect& defect = GetParam();
  const std::set<std::string> few = {"RowDropped", "ColumnsLost", "SlotForgotten", "WrongScale"};
  if (sanitized && few.count(defect.name) == 0) GTEST_SKIP() << "under the sanitizers only one twin of each kind";
  std::size_t failed = 0, ran = 0;
  for (const Order order : {Order::forwards, Order::backwards, Order::shuffled}) {
    if (failed != 0) continue;
    cuda_on_cpu::use_order(order);
    test::CudaOnCpu device(defect.name);
    std::vector<KernelCheck> rows;
    check::check_packed(device, rows,
                        {.max_size = defect.max_size, .columns = defect.columns, .kernel = defect.kernel});
    for (const KernelCheck& row : rows) {
      ran += row.status == CheckStatus::unsupported ? 0 : 1;
      failed += row.status == CheckStatus::fail ? 1 : 0;
    }
  }
  cuda_on_cpu::use_order(Order::forwards);
  EXPECT_GT(ran, 0U);
  EXPECT_GT(failed, 0U);
}

INSTANTIATE_TEST_SUITE_P(
    Twin, BrokenPackedKernel,
    testing::Values(Defect{"RowDropped", "tiles16"}, Defect{"HalvesSwapped", "tiles16"},
                    Defect{"WrongBatch", "tiles16", 3, 1312}, Defect{"TilesOfTheNextStrip", "tiles16"},
                    Defect{"WarpForgotten", "tiles16", 3, 1312}, Defect{"LanesNotJoined", "tiles16"},
                    Defect{"SegmentsForgotten", "tiles16", 7, 40000}, Defect{"WrongScale", "tiles16"},
                    Defect{"LastRowDropped", "tiles16"}, Defect{"WarpsNotAwaited", "tiles16"},
                    Defect{"RowDropped", "sym16"}, Defect{"ColumnsLost", "sym16"},
                    Defect{"ColumnsOfHalfTheRows", "sym16"}, Defect{"WarpForgotten", "sym16"},
                    Defect{"WrongStrip", "sym16"}, Defect{"SlotTransposed", "sym16"}, Defect{"DiagonalOnce", "sym16"},
                    Defect{"SumsBegunLate", "sym16"}, Defect{"WarpsNotAwaited", "sym16"},
                    Defect{"ColumnsNotAwaited", "sym16", 7}, Defect{"TilesOfTheNextStrip", "sym16"},
                    Defect{"SlotForgotten", "sym16_fold", 3, 5791}, Defect{"WrongScale", "sym16_fold"},
                    Defect{"WrongScale", "scale"}),
    [](const auto& info) { return info.param.name + "_" + info.param.kernel; });

/// The defect of a missing barrier between the strips of a work-group shows only where it takes more than are side by
/// side.
TEST(BrokenPackedKernelTwin, ABarrierBetweenStripsIsMissed) {
  std::size_t failed = 0;
  for (const Order order : {Order::forwards, Order::backwards, Order::shuffled}) {
    cuda_on_cpu::use_order(order);
    test::CudaOnCpu device("StripsNotAwaited", test::CudaOnCpu::large, 13 * tile_rows);
    std::vector<KernelCheck> rows;
    check::check_packed(device, rows, {.max_size = 257, .columns = 3, .kernel = "tiles16"});
    for (const KernelCheck& row : rows) failed += row.status == CheckStatus::fail ? 1 : 0;
  }
  cuda_on_cpu::use_order(Order::forwards);
  EXPECT_GT(failed, 0U);
}

}  // namespace
}  // namespace interflect
