// F x in double on the host. Memory traffic: F once; each value of F is widened once per group of three columns.

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "interflect/schedule/exact.cpp"  // once per instruction set
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <cstddef>
#include <span>
#include <vector>

#include "interflect/base/error.h"
#include "interflect/schedule/exact_rows.h"
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

void exact_rows(const float* elements, std::uint32_t rows, std::size_t stride,
                const std::vector<std::vector<double>>& x, std::uint32_t first, std::vector<std::vector<double>>& y) {
  constexpr std::uint32_t strip = 4;
  std::vector<const double*> column;
  for (const std::vector<double>& values : x) column.push_back(values.data());
#pragma omp parallel for schedule(static)
  for (std::uint32_t r = 0; r < rows; r += strip) {
    const float* of_strip[strip];
    for (std::uint32_t q = 0; q < strip; ++q) of_strip[q] = elements + std::min(r + q, rows - 1) * stride;
    for (std::size_t c = 0; c < column.size(); c += 3) {
      const std::size_t count = std::min<std::size_t>(3, column.size() - c);
      double sums[strip][3];
      HWY_DYNAMIC_DISPATCH(multiply_rows)(of_strip, column.data() + c, count, stride, sums);
      for (std::uint32_t q = 0; q < std::min(strip, rows - r); ++q) {
        for (std::size_t k = 0; k < count; ++k) y[c + k][first + r + q] = sums[q][k];
      }
    }
  }
}

namespace {

/// The columns in double and with zeros up to the stride, multiplied by s where there is one.
std::vector<std::vector<double>> widened(const Columns& x, std::size_t n, std::size_t stride,
                                         std::span<const float> s = {}) {
  std::vector<std::vector<double>> wide;
  for (const std::vector<float>& values : x) {
    if (values.size() != n) throw Error(ErrorKind::internal, "exact product: a column of the wrong length");
    std::vector<double>& column = wide.emplace_back(values.begin(), values.end());
    for (std::size_t i = 0; i < s.size(); ++i) column[i] *= static_cast<double>(s[i]);
    column.resize(stride);
  }
  return wide;
}

}  // namespace

void exact_product(const FormFactorMatrix& form_factors, const Columns& x, std::vector<std::vector<double>>& y) {
  const std::size_t stride = form_factors.stride();
  const auto wide = widened(x, form_factors.size(), stride);
  y.assign(x.size(), std::vector<double>(form_factors.size()));
  for (const Panel& panel : form_factors.panels()) {
    exact_rows(reinterpret_cast<const float*>(panel.data->data()), panel.rows, stride, wide, panel.first, y);
  }
}

void exact_product(const StreamedMatrix& form_factors, const Columns& x, std::vector<std::vector<double>>& y) {
  const std::size_t stride = form_factors.stride();
  const auto wide = widened(x, form_factors.size(), stride, form_factors.scale_in());
  y.assign(x.size(), std::vector<double>(form_factors.size()));
  form_factors.stream().pass([&](const PanelStream::View& view) {
    exact_rows(reinterpret_cast<const float*>(view.memory->data()), view.rows, stride, wide, view.first, y);
  });
  for (std::vector<double>& column : y) {
    for (std::size_t i = 0; i < column.size(); ++i) column[i] *= static_cast<double>(form_factors.scale_out()[i]);
  }
}

}  // namespace interflect

#endif
