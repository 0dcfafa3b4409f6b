// Compiled once per instruction set, with INTERFLECT_EIGEN_FUNCTION and INTERFLECT_EIGEN_NAMESPACE given: Eigen's
// namespace is renamed, so that the linker cannot put one set's inline functions in the place of another's.
#include <cmath>
#include <complex>
#include <cstddef>  // before the renaming: the standard library's names stay as they are
#include <cstdlib>
#include <cstring>
#include <functional>
#include <limits>
#include <sstream>
#include <vector>

#define Eigen INTERFLECT_EIGEN_NAMESPACE
#define EIGEN_NO_IO
#define EIGEN_NO_DEBUG
#include <Eigen/Core>

#include "interflect/peers/eigen_product.h"

namespace interflect::peers {

namespace {

template <int Order>
using F = Eigen::Map<const Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Order>, Eigen::Unaligned,
                     Eigen::OuterStride<>>;
template <int Order>
using X = Eigen::Map<const Eigen::Matrix<float, Eigen::Dynamic, 3, Order>>;
template <int Order>
using Y = Eigen::Map<Eigen::Matrix<float, Eigen::Dynamic, 3, Order>, Eigen::Unaligned, Eigen::OuterStride<>>;

template <int FOrder, int XOrder>
void rows_of(const EigenProduct& p, std::ptrdiff_t first, std::ptrdiff_t count) {
  const std::ptrdiff_t f_step = FOrder == Eigen::RowMajor ? p.stride : 1;
  const std::ptrdiff_t y_step = XOrder == Eigen::RowMajor ? 3 : 1;
  const F<FOrder> f(p.f + first * f_step, count, p.n, Eigen::OuterStride<>(p.stride));
  const X<XOrder> x(p.x, p.n, 3);
  Y<XOrder> y(p.y + first * y_step, count, 3, Eigen::OuterStride<>(XOrder == Eigen::RowMajor ? 3 : p.n));
  if (p.vectors) {
    for (int c = 0; c < 3; ++c) y.col(c).noalias() = f * x.col(c);
  } else {
    y.noalias() = f * x;
  }
}

template <int FOrder, int XOrder>
void all_rows(const EigenProduct& p) {
  if (p.threads == 0) {
    rows_of<FOrder, XOrder>(p, 0, p.rows);
    return;
  }
#pragma omp parallel for schedule(static) num_threads(p.threads)
  for (int t = 0; t < p.threads; ++t) {
    const std::ptrdiff_t first = p.rows * t / p.threads / 16 * 16;
    const std::ptrdiff_t end = t + 1 == p.threads ? p.rows : p.rows * (t + 1) / p.threads / 16 * 16;
    if (end > first) rows_of<FOrder, XOrder>(p, first, end - first);
  }
}

}  // namespace

void INTERFLECT_EIGEN_FUNCTION(const EigenProduct& p) {
  if (p.f_by_columns) {
    p.x_by_rows ? all_rows<Eigen::ColMajor, Eigen::RowMajor>(p) : all_rows<Eigen::ColMajor, Eigen::ColMajor>(p);
  } else {
    p.x_by_rows ? all_rows<Eigen::RowMajor, Eigen::RowMajor>(p) : all_rows<Eigen::RowMajor, Eigen::ColMajor>(p);
  }
}

}  // namespace interflect::peers
