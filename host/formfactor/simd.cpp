#include "interflect/formfactor/simd.h"

#include <algorithm>
#include <limits>
#include <numbers>

// Highway compiles this file once per instruction set and picks one at run time.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "interflect/formfactor/simd.cpp"  // NOLINT: read by foreach_target.h
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace interflect::simd::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::ScalableTag<double>;
using V = hn::Vec<D>;

struct Point {
  V x, y, z;
};

template <class Arrays>
Point load(const Arrays& a, std::size_t first, std::size_t j) {
  const D d;
  return {hn::LoadU(d, a[first].data() + j), hn::LoadU(d, a[first + 1].data() + j),
          hn::LoadU(d, a[first + 2].data() + j)};
}

template <class Arrays>
Point broadcast(const Arrays& a, std::size_t first, std::size_t i) {
  const D d;
  return {hn::Set(d, a[first][i]), hn::Set(d, a[first + 1][i]), hn::Set(d, a[first + 2][i])};
}

HWY_INLINE V dot3(const Point& a, const Point& b) {
  return hn::MulAdd(a.x, b.x, hn::MulAdd(a.y, b.y, hn::Mul(a.z, b.z)));
}

HWY_INLINE Point minus(const Point& a, const Point& b) {
  return {hn::Sub(a.x, b.x), hn::Sub(a.y, b.y), hn::Sub(a.z, b.z)};
}

/// Least and largest distance of three corners from a plane.
struct Range {
  V low, high;
};
HWY_INLINE Range distances(const Point& a, const Point& b, const Point& c, const Point& normal, V offset) {
  const V da = hn::Sub(dot3(normal, a), offset), db = hn::Sub(dot3(normal, b), offset),
          dc = hn::Sub(dot3(normal, c), offset);
  return {hn::Min(da, hn::Min(db, dc)), hn::Max(da, hn::Max(db, dc))};
}

/// Σ over 3 x 3 points of cosθ cosθ' r² / r⁴, without the weights and 1/π.
HWY_INLINE V three_by_three(const PatchTable& p, std::size_t i, std::size_t j, const Point& ni, const Point& nj) {
  const D d;
  const V zero = hn::Zero(d);
  V sum = zero;
  for (std::size_t k = 0; k < 9; k += 3) {
    const Point x = broadcast(p.node, k, i);
    for (std::size_t m = 0; m < 9; m += 3) {
      const Point to = minus(load(p.node, m, j), x);
      const V r2 = dot3(to, to);
      const V cosines = hn::Mul(hn::Max(zero, dot3(ni, to)), hn::Max(zero, hn::Neg(dot3(nj, to))));
      sum = hn::Add(sum, hn::Div(cosines, hn::Mul(r2, r2)));
    }
  }
  return sum;
}

void classify(const PatchTable& p, const kernel::Ratios& ratios, std::size_t i, std::size_t first, PairKind* kind,
              double* s) {
  const D d;
  const std::size_t lanes = hn::Lanes(d);
  const Point ni = broadcast(p.normal, 0, i), ci = broadcast(p.centroid, 0, i);
  const Point ai = broadcast(p.corner, 0, i), bi = broadcast(p.corner, 3, i), gi = broadcast(p.corner, 6, i);
  const V offset_i = hn::Set(d, p.offset[i]), radius_i = hn::Set(d, p.radius[i]);
  const V tolerance_i = hn::Set(d, p.tolerance[i]);
  const V weight_i = hn::Set(d, p.area[i] / (9 * std::numbers::pi));
  const auto squared = [&](float x) { return hn::Set(d, static_cast<double>(x) * static_cast<double>(x)); };
  const V three = squared(ratios.three_points), six = squared(ratios.six_points);
  const auto code = [&](PairKind k) { return hn::Set(d, static_cast<double>(k)); };
  HWY_ALIGN std::array<double, PatchTable::block> codes;

  for (std::size_t lane = 0; lane < PatchTable::block; lane += lanes) {
    const std::size_t j = first + lane;
    const Point nj = load(p.normal, 0, j);
    const Range of_j = distances(load(p.corner, 0, j), load(p.corner, 3, j), load(p.corner, 6, j), ni, offset_i);
    const Range of_i = distances(ai, bi, gi, nj, hn::LoadU(d, p.offset.data() + j));
    const V tolerance = hn::Add(tolerance_i, hn::LoadU(d, p.tolerance.data() + j));
    const auto facing = hn::Gt(hn::Min(of_j.high, of_i.high), tolerance);
    if (hn::AllFalse(d, facing)) {
      hn::StoreU(hn::Zero(d), d, codes.data() + lane);
      continue;
    }
    const auto whole = hn::Ge(hn::Min(of_j.low, of_i.low), hn::Neg(tolerance));
    const Point between = minus(load(p.centroid, 0, j), ci);
    const V radii = hn::Add(radius_i, hn::LoadU(d, p.radius.data() + j));
    const V ratio2 = hn::Div(dot3(between, between), hn::Mul(radii, radii));
    V c = code(PairKind::near);
    c = hn::IfThenElse(hn::Gt(ratio2, six), code(PairKind::middle), c);
    c = hn::IfThenElse(hn::Gt(ratio2, three), code(PairKind::far), c);
    c = hn::IfThenElse(whole, c, code(PairKind::straddle));
    c = hn::IfThenElseZero(facing, c);
    hn::StoreU(c, d, codes.data() + lane);
    const V weight = hn::Mul(weight_i, hn::LoadU(d, p.area.data() + j));
    hn::StoreU(hn::Mul(weight, three_by_three(p, i, j, ni, nj)), d, s + lane);
  }
  for (std::size_t k = 0; k < PatchTable::block; ++k) {
    kind[k] = static_cast<PairKind>(static_cast<int>(codes[k]));
  }
}

double dot(const float* row, const float* x, std::size_t n) {
  const hn::ScalableTag<float> f;
  const std::size_t lanes = hn::Lanes(f);
  constexpr std::size_t chunk = 1024;
  double sum = 0;
  for (std::size_t start = 0; start < n; start += chunk) {
    const std::size_t end = std::min(n, start + chunk);
    auto a = hn::Zero(f), b = hn::Zero(f);
    std::size_t j = start;
    for (; j + 2 * lanes <= end; j += 2 * lanes) {
      a = hn::MulAdd(hn::LoadU(f, row + j), hn::LoadU(f, x + j), a);
      b = hn::MulAdd(hn::LoadU(f, row + j + lanes), hn::LoadU(f, x + j + lanes), b);
    }
    sum += static_cast<double>(hn::GetLane(hn::SumOfLanes(f, hn::Add(a, b))));
    for (; j < end; ++j) sum += static_cast<double>(row[j]) * static_cast<double>(x[j]);
  }
  return sum;
}

Extremes scale(float* row, float factor, const float* x, std::size_t n) {
  const hn::ScalableTag<float> f;
  const std::size_t lanes = hn::Lanes(f);
  const auto by = hn::Set(f, factor), zero = hn::Zero(f);
  auto low = hn::Set(f, std::numeric_limits<float>::infinity()), high = zero;
  std::size_t j = 0;
  for (; j + lanes <= n; j += lanes) {
    const auto old = hn::LoadU(f, row + j), xj = hn::LoadU(f, x + j);
    const auto present = hn::Ne(old, zero);
    low = hn::IfThenElse(present, hn::Min(low, xj), low);
    high = hn::IfThenElse(present, hn::Max(high, xj), high);
    hn::StoreU(hn::Mul(old, hn::Mul(by, xj)), f, row + j);
  }
  Extremes out{hn::GetLane(hn::MinOfLanes(f, low)), hn::GetLane(hn::MaxOfLanes(f, high))};
  for (; j < n; ++j) {
    if (row[j] != 0) out = {std::min(out.low, x[j]), std::max(out.high, x[j])};
    row[j] *= factor * x[j];
  }
  return out;
}

}  // namespace interflect::simd::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace interflect::simd {

HWY_EXPORT(classify);
HWY_EXPORT(dot);
HWY_EXPORT(scale);

void classify(const PatchTable& patches, const kernel::Ratios& ratios, std::size_t i, std::size_t first,
              std::span<PairKind, PatchTable::block> kind, std::span<double, PatchTable::block> s) {
  HWY_DYNAMIC_DISPATCH(classify)(patches, ratios, i, first, kind.data(), s.data());
}

double dot(std::span<const float> row, std::span<const float> x) {
  return HWY_DYNAMIC_DISPATCH(dot)(row.data(), x.data(), std::min(row.size(), x.size()));
}

Extremes scale(std::span<float> row, float factor, std::span<const float> x) {
  return HWY_DYNAMIC_DISPATCH(scale)(row.data(), factor, x.data(), std::min(row.size(), x.size()));
}

}  // namespace interflect::simd
#endif
