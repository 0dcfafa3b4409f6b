#include "interflect/formfactor/shadow_rays.h"

#include <algorithm>

// Highway compiles this file once per instruction set and picks one at run time.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "interflect/formfactor/shadow_rays.cpp"  // NOLINT: read by foreach_target.h
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace interflect::simd::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using sampling::Facet;
using sampling::Float3;
using sampling::Square;
using sampling::step2;
using sampling::step4;

using D = hn::CappedTag<float, FacetBlock::block>;
using DU = hn::RebindToUnsigned<D>;
using V = hn::Vec<D>;
using U = hn::Vec<DU>;

struct Point {
  V x, y, z;
};

HWY_INLINE Point set(const Float3& p) {
  const D d;
  return {hn::Set(d, p.x), hn::Set(d, p.y), hn::Set(d, p.z)};
}
HWY_INLINE Point load(const FacetBlock& block, std::size_t first, std::size_t lane) {
  const D d;
  return {hn::LoadU(d, block.of[first].data() + lane), hn::LoadU(d, block.of[first + 1].data() + lane),
          hn::LoadU(d, block.of[first + 2].data() + lane)};
}
HWY_INLINE V dot(const Point& a, const Point& b) {
  return hn::MulAdd(a.x, b.x, hn::MulAdd(a.y, b.y, hn::Mul(a.z, b.z)));
}
HWY_INLINE Point minus(const Point& a, const Point& b) {
  return {hn::Sub(a.x, b.x), hn::Sub(a.y, b.y), hn::Sub(a.z, b.z)};
}
/// a + s b
HWY_INLINE Point along(const Point& a, V s, const Point& b) {
  return {hn::MulAdd(s, b.x, a.x), hn::MulAdd(s, b.y, a.y), hn::MulAdd(s, b.z, a.z)};
}

/// sampling::unit()
HWY_INLINE V unit(U s) {
  const D d;
  const V whole = hn::ConvertTo(d, hn::BitCast(hn::RebindToSigned<D>(), hn::ShiftRight<9>(s)));
  return hn::Mul(hn::Add(whole, hn::Set(d, 0.5F)), hn::Set(d, 0x1p-23F));
}

/// The point of a triangle, as sampling::in_triangle() has it.
HWY_INLINE Point in_triangle(const Point& corner, const Point& first, const Point& second, V u, V v) {
  const V half = hn::Set(D(), 0.5F);
  const auto above = hn::Gt(v, u);
  const V less = hn::Mul(half, hn::Min(u, v)), rest = hn::Sub(hn::Max(u, v), less);
  return along(along(corner, hn::IfThenElse(above, less, rest), first), hn::IfThenElse(above, rest, less), second);
}

/// Facet::at()
HWY_INLINE Point on(const Facet& f, U u, U v) {
  const D d;
  const V x = unit(u), y = unit(v);
  if (f.share_of_first >= 1) return in_triangle(set(f.corner), set(f.edge[0]), set(f.edge[1]), x, y);
  const V share = hn::Set(d, f.share_of_first);
  const auto first = hn::Lt(x, share);
  const V rest = hn::Set(d, 1 - f.share_of_first);
  const V within = hn::IfThenElse(first, hn::Div(x, share), hn::Div(hn::Sub(x, share), rest));
  const auto pick = [&](float a, float b) { return hn::IfThenElse(first, hn::Set(d, a), hn::Set(d, b)); };
  const auto edge = [&](const Float3& a, const Float3& b) {
    return Point{pick(a.x, b.x), pick(a.y, b.y), pick(a.z, b.z)};
  };
  return in_triangle(set(f.corner), edge(f.edge[0], f.edge[1]), edge(f.edge[1], f.edge[2]), within, y);
}

/// Appends the rays x → y of the lanes in `wanted`.
HWY_INLINE void append(const Point& x, const Point& y, const Point& normal_a, const Point& normal_b, float lift,
                       hn::Mask<D> wanted, hn::Mask<D> weighted, U slot, ShadowRays& out) {
  const D d;
  const DU du;
  const V zero = hn::Zero(d), quarter = hn::Set(d, 0.25F), most = hn::Set(d, lift);
  const Point between = minus(y, x);
  const V above_a = dot(normal_a, between), above_b = hn::Neg(dot(normal_b, between));
  const float shortest = sampling::shortest_in_lifts * lift;
  const V inverse = hn::Div(hn::Set(d, 1), hn::Max(dot(between, between), hn::Set(d, shortest * shortest)));
  const V weight = hn::Mul(hn::Mul(above_a, inverse), hn::Mul(above_b, inverse));
  const auto good = hn::And(hn::And(wanted, hn::Gt(weight, zero)), hn::Gt(hn::Min(above_a, above_b), zero));
  const Point origin = along(x, hn::Min(most, hn::Mul(quarter, above_a)), normal_a);
  const Point end = along(y, hn::Min(most, hn::Mul(quarter, above_b)), normal_b);
  const Point way = minus(end, origin);
  const std::size_t at = out.size;
  const bool all = hn::AllTrue(d, good);
  const auto keep = [&](V value, std::vector<float>& into) {  // a masked store is slow on some processors
    hn::StoreU(all ? value : hn::Compress(value, good), d, into.data() + at);
  };
  keep(origin.x, out.origin[0]);
  keep(origin.y, out.origin[1]);
  keep(origin.z, out.origin[2]);
  keep(way.x, out.direction[0]);
  keep(way.y, out.direction[1]);
  keep(way.z, out.direction[2]);
  keep(hn::IfThenElse(weighted, weight, hn::Set(d, 1)), out.weight);
  const auto good_slots = hn::RebindMask(du, good);
  hn::StoreU(all ? slot : hn::Compress(slot, good_slots), du, out.slot.data() + at);
  out.size += hn::CountTrue(d, good);
}

void first_rays(const Facet& a, Square word_a, std::uint32_t i, const FacetBlock& columns, std::uint32_t first,
                const FirstRay* wanted, std::uint32_t slot, float lift, ShadowRays& out) {
  const D d;
  const DU du;
  const Point normal = set(a.normal);
  const auto code = [&](FirstRay r) { return hn::Set(du, static_cast<std::uint32_t>(r)); };
  for (std::size_t lane = 0; lane < FacetBlock::block; lane += hn::Lanes(d)) {
    const U want = hn::LoadU(du, reinterpret_cast<const std::uint32_t*>(wanted) + lane);
    const auto any = hn::Ne(want, code(FirstRay::none));
    if (hn::AllFalse(du, any)) continue;
    const U b = hn::Iota(du, static_cast<std::uint32_t>(lane)), j = hn::Add(b, hn::Set(du, first));
    const Point x = on(a, hn::Add(hn::Set(du, word_a.u), hn::Mul(j, hn::Set(du, step2[0]))),
                       hn::Add(hn::Set(du, word_a.v), hn::Mul(j, hn::Set(du, step2[1]))));
    const U u = hn::Add(hn::LoadU(du, columns.u.data() + lane), hn::Set(du, i * step2[0]));
    const U v = hn::Add(hn::LoadU(du, columns.v.data() + lane), hn::Set(du, i * step2[1]));
    const Point y =
        in_triangle(load(columns, 0, lane), load(columns, 3, lane), load(columns, 6, lane), unit(u), unit(v));
    append(x, y, normal, load(columns, 9, lane), lift, hn::RebindMask(d, any),
           hn::RebindMask(d, hn::Eq(want, code(FirstRay::weighted))), hn::Add(b, hn::Set(du, slot)), out);
  }
}

void rays_of(const RayStream& stream, std::uint32_t first, std::uint32_t count, float lift, ShadowRays& out) {
  const D d;
  const DU du;
  const Point normal_a = set(stream.a.normal), normal_b = set(stream.b.normal);
  const U slot = hn::Set(du, stream.slot);
  const auto weighted = hn::RebindMask(d, hn::Eq(hn::Set(du, stream.weighted ? 1U : 0U), hn::Set(du, 1U)));
  for (std::uint32_t lane = 0; lane < count; lane += static_cast<std::uint32_t>(hn::Lanes(d))) {
    const U k = hn::Iota(du, first + lane);
    const auto coordinate = [&](std::uint32_t start, std::uint32_t step) {
      return hn::Add(hn::Set(du, start), hn::Mul(k, hn::Set(du, step)));
    };
    const Point x = on(stream.a, coordinate(stream.from.u, step4[0]), coordinate(stream.from.v, step4[1]));
    const Point y = on(stream.b, coordinate(stream.to.u, step4[2]), coordinate(stream.to.v, step4[3]));
    append(x, y, normal_a, normal_b, lift, hn::FirstN(d, count - lane), weighted, slot, out);
  }
}

}  // namespace interflect::simd::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace interflect {

void FacetBlock::set(std::size_t k, const sampling::Facet& facet, sampling::Square word) {
  std::size_t row = 0;
  for (const sampling::Float3& p : {facet.corner, facet.edge[0], facet.edge[1], facet.normal}) {
    of[row++][k] = p.x;
    of[row++][k] = p.y;
    of[row++][k] = p.z;
  }
  u[k] = word.u;
  v[k] = word.v;
}

namespace simd {

HWY_EXPORT(first_rays);
HWY_EXPORT(rays_of);

void first_rays(const sampling::Facet& a, sampling::Square word_a, std::uint32_t i, const FacetBlock& columns,
                std::uint32_t first, const std::array<FirstRay, FacetBlock::block>& wanted, std::uint32_t slot,
                float lift, ShadowRays& out) {
  HWY_DYNAMIC_DISPATCH(first_rays)(a, word_a, i, columns, first, wanted.data(), slot, lift, out);
}

void rays_of(const RayStream& stream, std::uint32_t first, std::uint32_t count, float lift, ShadowRays& out) {
  HWY_DYNAMIC_DISPATCH(rays_of)(stream, first, count, lift, out);
}

}  // namespace simd
}  // namespace interflect
#endif
