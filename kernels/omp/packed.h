// What the kernels over tiles of halves share: kernels/omp/tiles16.cpp, sym16.cpp. Included once per instruction set,
// inside HWY_BEFORE_NAMESPACE and interflect::omp::HWY_NAMESPACE; no include guard for that reason.

namespace hn = hwy::HWY_NAMESPACE;

using Tag = hn::CappedTag<float, 16>;
using Vector = hn::Vec<Tag>;

constexpr std::size_t lanes = hn::MaxLanes(Tag());
constexpr std::size_t parts = tile_columns / lanes;  // vectors in a row of a tile
constexpr std::size_t group = 3;                     // columns of x in registers at once
// Rows of a tile in registers at once: accumulators, three vectors of x and one of the tile fit 32 or 16 registers.
constexpr std::size_t strip_rows = lanes == 16 ? 8 : 4;

/// Keeps the vector in a register: without it GCC repeats the load in every fused multiply-add.
HWY_INLINE void keep([[maybe_unused]] Vector& v) {
#if HWY_ARCH_X86 && HWY_TARGET != HWY_SCALAR && HWY_TARGET != HWY_EMU128
  asm("" : "+v"(v.raw));
#endif
}

/// `lanes` halves as floats.
HWY_INLINE Vector load_halves(const Half* from) {
  const Tag d;
  const hn::Rebind<hwy::float16_t, Tag> dh;
  return hn::PromoteTo(d, hn::Load(dh, reinterpret_cast<const hwy::float16_t*>(from)));
}
