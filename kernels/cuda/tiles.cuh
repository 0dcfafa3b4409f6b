#include "blocks.cuh"

// What the kernels of tiles of 16-bit elements share: the argument blocks, and which part of a tile a lane takes.
//
// A warp takes a batch of eight tiles at once, 2 KB. Four lanes share a tile: lane l takes tile l / 4, of it the half
// h = l % 2 of the columns (8 of them) and the four rows 2 k + g, g = l / 2 % 2, k = 0 .. 3. So a lane has four 16-byte
// loads under way at once, two rows of a tile are one stretch of 64 bytes, and an element of x that a lane has read
// serves four rows.

// Field by field as in host/device/kernel_arguments.h.
struct TileArguments {
  unsigned n, first, strips, tiles, vector_stride;
};
struct SymmetricArguments {
  unsigned blocks, strips, tiles, block_rows, vector_stride;
};

constexpr unsigned tile_rows = 8, tile_columns = 16;
constexpr unsigned tile_vectors = 16;      // 16-byte vectors of a tile, two for each row
constexpr unsigned batch = warp_size / 4;  // tiles that a warp takes at once
constexpr unsigned rows_of_lane = 4;

__device__ unsigned tile_of_lane() {
  return lane_id() / 4;
}
__device__ unsigned half_of_lane() {
  return lane_id() % 2;
}
__device__ unsigned row_parity_of_lane() {
  return lane_id() / 2 % 2;
}

/// The halves of a lane: four rows, eight columns in two parts of four (two for each 32-bit word).
struct LanePart {
  uint4 row[rows_of_lane];
};

/// Used once: it does not displace what stays in the caches.
__device__ uint4 load_tile(const uint4* at, bool again) {
  return again ? __ldg(at) : __ldcs(at);
}

/// A lane's part of the tile at `tile`, four loads at once.
__device__ LanePart load_part(const uint4* tile, bool again) {
  LanePart part;
#pragma unroll
  for (unsigned k = 0; k < rows_of_lane; ++k) {
    part.row[k] = load_tile(tile + 4 * k + 2 * row_parity_of_lane() + half_of_lane(), again);
  }
  return part;
}

/// Both halves of a word, exactly. NVRTC may have no cuda_fp16.h at run time; its instruction needs none.
__device__ void to_floats(unsigned word, float& low, float& high) {
#ifdef __CUDA_ARCH__
  asm("{\n\t.reg .b16 l, h;\n\tmov.b32 {l, h}, %2;\n\tcvt.f32.f16 %0, l;\n\tcvt.f32.f16 %1, h;\n\t}"
      : "=f"(low), "=f"(high)
      : "r"(word));
#else
  low = half_to_float(word & 0xFFFFU);
  high = half_to_float(word >> 16U);
#endif
}
/// Columns 4 quad .. 4 quad + 3 of a lane's row.
__device__ void to_floats(const uint4& row, unsigned quad, float (&to)[4]) {
  to_floats(quad == 0 ? row.x : row.z, to[0], to[1]);
  to_floats(quad == 0 ? row.y : row.w, to[2], to[3]);
}

/// A strip's row sums over a warp in 5 exchanges; lane l returns row row_of_sum(), the same in four lanes.
__device__ float join_rows(const float (&sum)[rows_of_lane]) {
  const bool upper = (lane_id() & 16U) != 0, odd = (lane_id() & 8U) != 0;
  const float first = (upper ? sum[2] : sum[0]) + __shfl_xor_sync(all_lanes, upper ? sum[0] : sum[2], 16);
  const float second = (upper ? sum[3] : sum[1]) + __shfl_xor_sync(all_lanes, upper ? sum[1] : sum[3], 16);
  float row = (odd ? second : first) + __shfl_xor_sync(all_lanes, odd ? first : second, 8);
  row += __shfl_xor_sync(all_lanes, row, 4);
  row += __shfl_xor_sync(all_lanes, row, 1);
  return row;
}
__device__ unsigned row_of_sum() {
  return 2 * (lane_id() / 8) + row_parity_of_lane();
}
/// Of the four lanes that hold a row's sum, the one that writes it.
__device__ bool writes_row() {
  return (lane_id() & 5U) == 0;
}
