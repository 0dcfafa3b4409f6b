#include "tiles.cuh"

// y = t ∘ (H xs) for the tiles of one panel. Contract and error bound: kernels/README.md.
//
// A work-group takes STRIPS strips, up to eight of them side by side: 8 warps for one strip, 4 for each of two, 2 for
// each of four, one for each of eight or more. A strip's warps take its batches of eight tiles (tiles.cuh) in turn. The
// tile column of the batch after is read ahead, so that elements and x of a batch are asked for at the same time: 4
// loads of 16 bytes of elements, 2 for each column of x.
//
// Memory traffic of a launch: each tile once, 256 bytes and 4 of index. x comes from the first-level cache, 192 bytes
// for each tile and 3 columns; strips side by side read the same x at about the same time. More than 4 columns are
// taken in chunks: the tiles then come in segments of 64 for each warp, from memory once and from L2 for the others.
//
// Order of sums: a lane adds the products of a segment by fused multiply-add, at most 1,024; 16 lanes join in a tree of
// 4 levels; a warp adds its segments in order; the strip's warps join in a tree of up to 3; then t.

constexpr unsigned side_by_side = STRIPS >= 8 ? 8 : STRIPS >= 4 ? 4 : STRIPS >= 2 ? 2 : 1;
constexpr unsigned parts = warps / side_by_side;  // warps for a strip
constexpr unsigned step = parts * batch;
constexpr unsigned chunks = (COLUMNS + 3) / 4;
constexpr unsigned chunk = (COLUMNS + chunks - 1) / chunks;   // columns in registers at once
constexpr unsigned segment = (chunks == 1 ? 128 : 8) * step;  // tiles of a strip

/// sum[c][k] += Σ tile[k][l] xs[c][l] over this lane's tiles in [k, end), for its rows and columns.
__device__ void multiply(const uint4* tiles, const unsigned* tile_column, const float4* xs,
                         const unsigned (&column)[chunk], unsigned k, unsigned end, float (&sum)[chunk][rows_of_lane]) {
  unsigned next = k < end ? __ldg(tile_column + k) : 0;
  for (; k < end; k += step) {
    const unsigned at = 4 * next + 2 * half_of_lane();
    const LanePart part = load_part(tiles + Index{k} * tile_vectors, chunks > 1);
    if (k + step < end) next = __ldg(tile_column + k + step);
    float4 x[chunk][2];
#pragma unroll
    for (unsigned c = 0; c < chunk; ++c) {
      x[c][0] = __ldg(xs + column[c] + at);
      x[c][1] = __ldg(xs + column[c] + at + 1);
    }
#pragma unroll
    for (unsigned r = 0; r < rows_of_lane; ++r) {
#pragma unroll
      for (unsigned quad = 0; quad < 2; ++quad) {
        float h[4];
        to_floats(part.row[r], quad, h);
#pragma unroll
        for (unsigned c = 0; c < chunk; ++c) {
          sum[c][r] = fmaf(h[0], x[c][quad].x, sum[c][r]);
          sum[c][r] = fmaf(h[1], x[c][quad].y, sum[c][r]);
          sum[c][r] = fmaf(h[2], x[c][quad].z, sum[c][r]);
          sum[c][r] = fmaf(h[3], x[c][quad].w, sum[c][r]);
        }
      }
    }
  }
}

/// The sums over the warps of a strip, `COLUMNS * tile_rows` floats apart.
__device__ float join_parts(const float* of_warp) {
  constexpr unsigned stride = COLUMNS * tile_rows;
  if (parts == 8) return tree_of_warps(of_warp, stride);
  if (parts == 4) return (of_warp[0] + of_warp[stride]) + (of_warp[2 * stride] + of_warp[3 * stride]);
  if (parts == 2) return of_warp[0] + of_warp[stride];
  return of_warp[0];
}

extern "C" __global__ void __launch_bounds__(WORKGROUP, chunks == 1 ? 3 : 2)
    tiles16(const float* __restrict__ tiles, const unsigned* __restrict__ index, const float* __restrict__ xs,
            const float* __restrict__ t, float* __restrict__ y, const TileArguments a) {
  __shared__ float of_warp[warps][COLUMNS * tile_rows];
  const unsigned* tile_begin = index;
  const unsigned* tile_column = index + a.strips + 1;
  const unsigned part = warp_id() % parts;
  for (unsigned from = 0; from < STRIPS; from += side_by_side) {
    const unsigned in_group = from + warp_id() / parts;
    const Index strip = Index{blockIdx.x} * STRIPS + in_group;
    const bool there = in_group < STRIPS && strip < a.strips;
    const unsigned begin = there ? __ldg(tile_begin + strip) : 0;
    const unsigned end = there ? __ldg(tile_begin + strip + 1) : 0;
    unsigned at = begin;
    do {  // an empty strip's sums are zeros
      const unsigned segment_end = end - at < segment ? end : at + segment;
      for (unsigned c = 0; c < COLUMNS; c += chunk) {
        unsigned column[chunk];
#pragma unroll
        for (unsigned k = 0; k < chunk; ++k) {
          column[k] = (c + k < COLUMNS ? c + k : COLUMNS - 1) * (a.vector_stride / 4);
        }
        float sum[chunk][rows_of_lane] = {};
        multiply(reinterpret_cast<const uint4*>(tiles), tile_column, reinterpret_cast<const float4*>(xs), column,
                 at + part * batch + tile_of_lane(), segment_end, sum);
#pragma unroll
        for (unsigned k = 0; k < chunk; ++k) {
          const float row = join_rows(sum[k]);
          if (c + k < COLUMNS && writes_row()) {
            float& so_far = of_warp[warp_id()][(c + k) * tile_rows + row_of_sum()];
            so_far = at == begin ? row : so_far + row;
          }
        }
      }
      at = segment_end;
    } while (at < end);
    __syncthreads();  // every warp's sums are there
    for (unsigned k = threadIdx.x; k < side_by_side * COLUMNS * tile_rows; k += WORKGROUP) {
      const unsigned place = k / (COLUMNS * tile_rows), c = k / tile_rows % COLUMNS, q = k % tile_rows;
      const Index of_strip = Index{blockIdx.x} * STRIPS + from + place;
      const Index i = a.first + of_strip * tile_rows + q;
      if (from + place < STRIPS && of_strip < a.strips && i < a.n) {
        y[Index{c} * a.vector_stride + i] = t[i] * join_parts(of_warp[place * parts] + c * tile_rows + q);
      }
    }
    __syncthreads();  // the next strips may write again
  }
}
