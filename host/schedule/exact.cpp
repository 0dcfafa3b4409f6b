// F x in double on the host. Memory traffic: F once; each value of F is widened once per group of three columns.

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "interflect/schedule/exact.cpp"  // once per instruction set
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <cstddef>
#include <vector>

#include "interflect/base/error.h"
#include "interflect/schedule/scheduler.h"

HWY_BEFORE_NAMESPACE();
namespace interflect::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// y[q][c] = Σ_j rows[q][j] * columns[c][j] over `length` values, a multiple of 16, for `Rows` rows and `Count` columns
/// at once: as many independent sums as keep the arithmetic units busy.
template <std::size_t Rows, std::size_t Count>
HWY_INLINE void multiply(const float* const* HWY_RESTRICT rows, const double* const* HWY_RESTRICT columns,
                         std::size_t length, double (*HWY_RESTRICT y)[3]) {
  const hn::CappedTag<double, 8> d;
  const hn::Rebind<float, decltype(d)> narrow;
  hn::Vec<decltype(d)> sum[Rows][Count];
  for (std::size_t q = 0; q < Rows; ++q) {
    for (std::size_t c = 0; c < Count; ++c) sum[q][c] = hn::Zero(d);
  }
  for (std::size_t j = 0; j < length; j += hn::MaxLanes(d)) {
    hn::Vec<decltype(d)> x[Count];
    for (std::size_t c = 0; c < Count; ++c) x[c] = hn::LoadU(d, columns[c] + j);
    for (std::size_t q = 0; q < Rows; ++q) {
      const auto f = hn::PromoteTo(d, hn::LoadU(narrow, rows[q] + j));
      for (std::size_t c = 0; c < Count; ++c) sum[q][c] = hn::MulAdd(f, x[c], sum[q][c]);
    }
  }
  for (std::size_t q = 0; q < Rows; ++q) {
    for (std::size_t c = 0; c < Count; ++c) y[q][c] = hn::GetLane(hn::SumOfLanes(d, sum[q][c]));
  }
}

HWY_ATTR void multiply_rows(const float* const* rows, const double* const* columns, std::size_t count,
                            std::size_t length, double (*y)[3]) {
  switch (count) {
    case 1: multiply<4, 1>(rows, columns, length, y); break;
    case 2: multiply<4, 2>(rows, columns, length, y); break;
    default: multiply<4, 3>(rows, columns, length, y); break;
  }
}

}  // namespace interflect::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace interflect {

HWY_EXPORT(multiply_rows);

void exact_product(const FormFactorMatrix& form_factors, const Columns& x, std::vector<std::vector<double>>& y) {
  constexpr std::uint32_t strip = 4;
  const std::uint32_t n = form_factors.size();
  const std::size_t length = form_factors.stride();  // rows are padded with zeros to it
  std::vector<std::vector<double>> wide;
  std::vector<const double*> column;
  for (const std::vector<float>& values : x) {
    if (values.size() != n) throw Error(ErrorKind::internal, "exact product: a column of the wrong length");
    wide.emplace_back(values.begin(), values.end()).resize(length);
    column.push_back(wide.back().data());
  }
  y.assign(x.size(), std::vector<double>(n));
#pragma omp parallel for schedule(static)
  for (std::uint32_t first = 0; first < n; first += strip) {
    const float* rows[strip];
    for (std::uint32_t q = 0; q < strip; ++q) rows[q] = form_factors.row(std::min(first + q, n - 1)).data();
    for (std::size_t c = 0; c < column.size(); c += 3) {
      const std::size_t count = std::min<std::size_t>(3, column.size() - c);
      double sums[strip][3];
      HWY_DYNAMIC_DISPATCH(multiply_rows)(rows, column.data() + c, count, length, sums);
      for (std::uint32_t q = 0; q < std::min(strip, n - first); ++q) {
        for (std::size_t k = 0; k < count; ++k) y[c + k][first + q] = sums[q][k];
      }
    }
  }
}

}  // namespace interflect

#endif
