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
HWY_INLINE Vector load_halves(const interflect::Half* from) {
  const Tag d;
  const hn::Rebind<hwy::float16_t, Tag> dh;
  return hn::PromoteTo(d, hn::Load(dh, reinterpret_cast<const hwy::float16_t*>(from)));
}

/// Asks for the cache lines of the tile `ahead` bytes behind this one: a single stream would not fill the memory's
/// pipeline otherwise. Past the buffer's end it does nothing.
HWY_INLINE void prefetch_tile(const interflect::Half* tile, std::size_t ahead) {
  const char* line = reinterpret_cast<const char*>(tile) + ahead;
  for (std::size_t byte = 0; byte < tile_elements * sizeof(interflect::Half); byte += 64)
    __builtin_prefetch(line + byte, 0, 3);
}

/// to[q] += the sum of all lanes of sum[q] for `strip_rows` vectors: neighbours are added, two vectors at a time become
/// one, until each row is one lane.
HWY_INLINE void add_lane_sums(const Vector (&sum)[strip_rows], float* HWY_RESTRICT to) {
#if HWY_TARGET == HWY_SCALAR
  for (std::size_t q = 0; q < strip_rows; ++q) to[q] += hn::GetLane(sum[q]);
#else
  const Tag d;
  const auto pairs = [d](Vector a, Vector b) { return hn::Add(hn::ConcatEven(d, b, a), hn::ConcatOdd(d, b, a)); };
  Vector joined = pairs(pairs(sum[0], sum[1]), pairs(sum[2], sum[3]));
  if constexpr (strip_rows == 8) joined = pairs(joined, pairs(pairs(sum[4], sum[5]), pairs(sum[6], sum[7])));
  for (std::size_t left = lanes; left > strip_rows; left /= 2) joined = pairs(joined, joined);
  if constexpr (lanes == strip_rows) {
    hn::StoreU(hn::Add(hn::LoadU(d, to), joined), d, to);
  } else {
    const hn::Half<Tag> half;
    hn::StoreU(hn::Add(hn::LoadU(half, to), hn::LowerHalf(half, joined)), half, to);
  }
#endif
}
