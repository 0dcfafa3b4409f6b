// What the kernels of the 16-bit formats share: tiles of 8 rows x 16 columns of halves, row-major, 256 bytes.

#define TILE_ROWS 8U
#define TILE_COLUMNS 16U
#define TILE 128U  // halves of a tile
#define CHUNK 3    // columns of x in registers at once
#define CHUNKS ((COLUMNS + CHUNK - 1) / CHUNK)
#define LEFT_OVER (COLUMNS % CHUNK)
#define INLINE __attribute__((always_inline))

#ifdef FP_FAST_FMAF
#define FMA(a, b, c) fma(a, b, c)
#else
#define FMA(a, b, c) ((a) * (b) + (c))
#endif

/// The columns of a chunk; `columns` is a constant once the function is inlined, the loop's end must be one before.
#define EACH_COLUMN(c) _Pragma("unroll") for (uint c = 0; c < CHUNK; ++c) if (c < columns)
#define EACH(i, count) _Pragma("unroll") for (uint i = 0; i < (count); ++i)

#if WORKGROUP == 1

#ifndef __has_builtin
#define __has_builtin(name) 0
#endif

// Processors: a tile's row is PIECES vectors; STRIP rows by CHUNK columns of accumulators, the vectors of x and one of
// halves fill 32 or 16 registers.
#if WIDTH == 16
#define STRIP 8U
typedef float16 vector;
typedef float8 strip;
#else
#define STRIP 4U
typedef float4 strip;
#if WIDTH == 8
typedef float8 vector;
#else
typedef float4 vector;
#endif
#endif
#define PIECES (TILE_COLUMNS / WIDTH)

// Vectors of x, of slots and of their rows are aligned, and PoCL's vstore16 would take four stores for one.
#define VECTOR(p) (*(global const vector*)(p))
#define VECTOR_OUT(p) (*(global vector*)(p))
#define STRIP_OUT(p) (*(global strip*)(p))

/// WIDTH halves as fp32. A function, not a macro: LLVM takes registers of 512 bits only into functions with such a vector
/// among arguments or results, or into which one of these was inlined.
INLINE vector floats_at(global const half* p) {
#if WIDTH == 16 && defined(__AVX512F__) && __has_builtin(__builtin_convertvector)
  typedef __fp16 halves __attribute__((ext_vector_type(16)));
  return __builtin_convertvector(*(global const halves*)p, float16);  // one instruction; PoCL's vload_half16 is three
#elif WIDTH == 16
  return vload_half16(0, p);
#elif WIDTH == 8
  return vload_half8(0, p);
#else
  return vload_half4(0, p);
#endif
}

/// Fetches what lies 12 KiB ahead: processors fetch by themselves only to the end of a page, and 4 KiB are a fourth
/// slower here than 8 to 32. Harmless behind the end. (oclgrind, which compiles to SPIR, does not know it.)
#if __has_builtin(__builtin_prefetch) && !defined(__SPIR__) && !defined(__SPIR64__)
#define AHEAD (48U * TILE)
#define FETCH_AHEAD(tile)                                                                  \
  EACH(line, TILE / 32) {                                                                  \
    __builtin_prefetch((const private void*)((size_t)((tile) + AHEAD + line * 32)), 0, 0); \
  }
#else
#define FETCH_AHEAD(tile)
#endif

/// The sums over the lanes of a strip's vectors, in a tree; v[q * CHUNK] is row q's.
strip row_sums(const vector* v) {
#if WIDTH == 16
  float16 two[4];
  EACH(k, 4) {
    const float16 a = v[2 * k * CHUNK], b = v[(2 * k + 1) * CHUNK];
    two[k] = (float16)(a.lo, b.lo) + (float16)(a.hi, b.hi);
  }
  float16 four[2];
  EACH(k, 2) {
    const float16 a = two[2 * k], b = two[2 * k + 1];
    four[k] = (float16)(a.s0123, a.s89ab, b.s0123, b.s89ab) + (float16)(a.s4567, a.scdef, b.s4567, b.scdef);
  }
  const float16 a = four[0], b = four[1];
  const float16 last = (float16)(a.s01, a.s45, a.s89, a.scd, b.s01, b.s45, b.s89, b.scd) +
                       (float16)(a.s23, a.s67, a.sab, a.sef, b.s23, b.s67, b.sab, b.sef);
#elif WIDTH == 8
  float8 two[2];
  EACH(k, 2) {
    const float8 a = v[2 * k * CHUNK], b = v[(2 * k + 1) * CHUNK];
    two[k] = (float8)(a.lo, b.lo) + (float8)(a.hi, b.hi);
  }
  const float8 a = two[0], b = two[1];
  const float8 last = (float8)(a.s01, a.s45, b.s01, b.s45) + (float8)(a.s23, a.s67, b.s23, b.s67);
#else
  const float4 a = (float4)(v[0].lo, v[CHUNK].lo) + (float4)(v[0].hi, v[CHUNK].hi);
  const float4 b = (float4)(v[2 * CHUNK].lo, v[3 * CHUNK].lo) + (float4)(v[2 * CHUNK].hi, v[3 * CHUNK].hi);
  const float8 last = (float8)(a, b);
#endif
  return last.even + last.odd;
}

#else

/// Eight halves, loaded as one of 16 bytes, as fp32.
INLINE float8 floats_of(uint4 halves) {
  return vload_half8(0, (const private half*)&halves);
}

/// sum + h x
INLINE float dot_of(float8 h, float8 x, float sum) {
  sum = FMA(h.s0, x.s0, sum);
  sum = FMA(h.s1, x.s1, sum);
  sum = FMA(h.s2, x.s2, sum);
  sum = FMA(h.s3, x.s3, sum);
  sum = FMA(h.s4, x.s4, sum);
  sum = FMA(h.s5, x.s5, sum);
  sum = FMA(h.s6, x.s6, sum);
  return FMA(h.s7, x.s7, sum);
}

#endif
