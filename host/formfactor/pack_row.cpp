#include "interflect/formfactor/pack_row.h"

// Highway compiles this file once per instruction set and picks one at run time.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "interflect/formfactor/pack_row.cpp"  // NOLINT: read by foreach_target.h
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace interflect::simd::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

void pack_row(const float* row, const std::uint32_t* order, const float* inverse, float scale, std::size_t first,
              std::size_t n, Half* out) {
  std::size_t k = first;
#if HWY_TARGET <= HWY_AVX2  // with gathers, and a conversion that rounds to nearest
  const hn::CappedTag<float, 16> d;
  const hn::RebindToSigned<decltype(d)> di;
  const hn::Rebind<hwy::float16_t, decltype(d)> dh;
  const auto factor = hn::Set(d, scale);
  for (; k + hn::Lanes(d) <= n; k += hn::Lanes(d)) {
    const auto from = hn::LoadU(di, reinterpret_cast<const std::int32_t*>(order) + k);
    const auto value = hn::Mul(hn::GatherIndex(d, row, from), hn::Mul(factor, hn::LoadU(d, inverse + k)));
    hn::StoreU(hn::DemoteTo(dh, value), dh, reinterpret_cast<hwy::float16_t*>(out) + k);
  }
#endif
  for (; k < n; ++k) out[k] = to_half(row[order[k]] * (scale * inverse[k]));
}

}  // namespace interflect::simd::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace interflect::simd {

HWY_EXPORT(pack_row);

void pack_row(const float* row, const std::uint32_t* order, const float* inverse, float scale, std::size_t first,
              std::size_t n, Half* out) {
  HWY_DYNAMIC_DISPATCH(pack_row)(row, order, inverse, scale, first, n, out);
}

}  // namespace interflect::simd

#endif
