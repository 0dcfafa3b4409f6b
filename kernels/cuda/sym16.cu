#include "tiles.cuh"

// One triangle of a symmetric matrix, each tile used for its rows and for its columns. Contracts and error bounds:
// kernels/README.md.

#ifdef BLOCK

// A work-group takes a block. Its warps take the block's strips in turn, a strip's tiles in batches of eight
// (tiles.cuh), each of which is asked for while the one before is multiplied. Row sums stay in registers across a
// strip, which one warp has for itself; column sums are in shared memory, a copy for each warp, to which a batch is
// added at once: its tiles have different columns. So no two threads ever write the same sum between two barriers.
//
// Memory traffic of a launch: each tile once, 256 bytes and 4 of index, 8 for each strip, 16 for each block; x once for
// each block; partial once, 8 COLUMNS BLOCK bytes for each block. The sums of a warp take 4 KB at most: of BLOCK = 256
// three columns are taken at once, of 512 two, of 1,024 one, and as often the tiles are read.
//
// Order of sums: row: at most BLOCK / 16 products in a lane, 16 lanes in a tree of 4 levels. Column: four rows in a
// lane by fused multiply-add, two lanes, then the batches of a warp in order, at most BLOCK / 64 of them, and 8 warps
// in a tree of 3.

constexpr unsigned most = BLOCK <= 256 ? 3 : BLOCK <= 512 ? 2 : 1;
constexpr unsigned chunks = (COLUMNS + most - 1) / most;
constexpr unsigned chunk = (COLUMNS + chunks - 1) / chunks;  // columns at once
constexpr unsigned most_strips = BLOCK / tile_rows;

struct alignas(16) Memory {
  float sums[warps + 1][chunk][BLOCK];             // column sums of each warp, then the row sums
  float x[chunk][BLOCK], x_of_rows[chunk][BLOCK];  // of the block's columns and rows
  unsigned strip[most_strips], begin[most_strips + 1];
};

/// The panel's index.
struct Index16 {
  const unsigned *block, *strip, *begin, *column;
};
__device__ Index16 parts_of(const unsigned* index, const SymmetricArguments& a) {
  const unsigned* strip = index + 4 * a.blocks;
  const unsigned* begin = strip + a.strips;
  return {index, strip, begin, begin + a.strips + 1};
}

__device__ void begin_sums(Memory& m) {
  float4* sums = reinterpret_cast<float4*>(&m.sums[0][0][0]);
  for (unsigned i = threadIdx.x; i < (warps + 1) * chunk * BLOCK / 4; i += WORKGROUP) {
    sums[i] = make_float4(0, 0, 0, 0);
  }
}
/// Elements first .. first + BLOCK - 1 of columns c .. c + chunk - 1, zeros behind the vector's stride.
__device__ void load_x(float (&to)[chunk][BLOCK], const float* xs, const SymmetricArguments& a, unsigned first,
                       unsigned c) {
  for (unsigned i = 4 * threadIdx.x; i < chunk * BLOCK; i += 4 * WORKGROUP) {
    const unsigned k = i / BLOCK, j = i % BLOCK;
    const bool there = c + k < COLUMNS && first + j < a.vector_stride;
    const float* from = xs + Index{c + k} * a.vector_stride + first + j;
    float4& four = *reinterpret_cast<float4*>(&to[k][j]);
    four = there ? __ldg(reinterpret_cast<const float4*>(from)) : make_float4(0, 0, 0, 0);
  }
}
__device__ void load_index(Memory& m, const Index16& index, unsigned first_strip, unsigned strips) {
  for (unsigned i = threadIdx.x; i < strips; i += WORKGROUP) m.strip[i] = __ldg(index.strip + first_strip + i);
  for (unsigned i = threadIdx.x; i <= strips; i += WORKGROUP) m.begin[i] = __ldg(index.begin + first_strip + i);
}

/// A lane's part of a tile times x of its columns and x of its rows: row sums, and the sums of its 8 columns over its
/// four rows.
__device__ void multiply(const LanePart& part, const float4 (&x)[chunk][2], const float (&xi)[chunk][rows_of_lane],
                         float (&row)[chunk][rows_of_lane], float (&column)[chunk][2][4]) {
#pragma unroll
  for (unsigned quad = 0; quad < 2; ++quad) {
#pragma unroll
    for (unsigned r = 0; r < rows_of_lane; ++r) {
      float h[4];
      to_floats(part.row[r], quad, h);
#pragma unroll
      for (unsigned c = 0; c < chunk; ++c) {
        row[c][r] = fmaf(h[0], x[c][quad].x, row[c][r]);
        row[c][r] = fmaf(h[1], x[c][quad].y, row[c][r]);
        row[c][r] = fmaf(h[2], x[c][quad].z, row[c][r]);
        row[c][r] = fmaf(h[3], x[c][quad].w, row[c][r]);
#pragma unroll
        for (unsigned l = 0; l < 4; ++l) {
          column[c][quad][l] = r == 0 ? h[l] * xi[c][r] : fmaf(h[l], xi[c][r], column[c][quad][l]);
        }
      }
    }
  }
}

/// Adds a batch's column sums to the warp's copy. Two lanes have the same columns: one takes the first four of them,
/// the other the last. `there`: the lane has a tile, whose column it is.
__device__ void add_columns(float (&columns)[chunk][BLOCK], const float (&part)[chunk][2][4], unsigned tile_column,
                            bool there) {
  const bool last = row_parity_of_lane() != 0;
  const unsigned at = tile_columns * tile_column + 8 * half_of_lane() + 4 * row_parity_of_lane();
  float sum[chunk][4];
#pragma unroll
  for (unsigned c = 0; c < chunk; ++c) {
#pragma unroll
    for (unsigned l = 0; l < 4; ++l) {
      const float given = last ? part[c][0][l] : part[c][1][l];
      sum[c][l] = (last ? part[c][1][l] : part[c][0][l]) + __shfl_xor_sync(all_lanes, given, 2);
    }
  }
  __syncwarp();  // the batch before has written
#pragma unroll
  for (unsigned c = 0; c < chunk; ++c) {
    if (!there) continue;
    float4& to = *reinterpret_cast<float4*>(&columns[c][at]);
    const float4 so_far = to;
    to = make_float4(so_far.x + sum[c][0], so_far.y + sum[c][1], so_far.z + sum[c][2], so_far.w + sum[c][3]);
  }
}

/// A batch of a warp: tiles [from, end) of strip s, eight at most; s = strips: none.
struct Batch {
  unsigned s, from, end;
};
__device__ Batch batch_at(const Memory& m, unsigned s, unsigned strips) {
  if (s >= strips) return {strips, 0, 0};
  return {s, m.begin[s], m.begin[s + 1]};
}
__device__ Batch batch_after(const Memory& m, const Batch& b, unsigned strips) {
  if (b.end - b.from > batch) return {b.s, b.from + batch, b.end};
  return batch_at(m, b.s + warps, strips);
}

/// What a lane reads of a batch.
struct Loaded {
  LanePart part;
  unsigned column;
  bool there;
};
__device__ Loaded load_batch(const uint4* tiles, const unsigned* tile_column, const Batch& b) {
  const unsigned k = b.from + tile_of_lane();
  Loaded loaded = {{}, 0, k < b.end};
  if (loaded.there) {
    loaded.part = load_part(tiles + Index{k} * tile_vectors, chunks > 1);
    loaded.column = __ldg(tile_column + k);
  }
  return loaded;
}

/// All strips of a warp. While a batch is multiplied the next one is under way, that of another strip too.
__device__ void multiply_strips(Memory& m, const uint4* tiles, const unsigned* tile_column, unsigned strips) {
  float row[chunk][rows_of_lane] = {}, xi[chunk][rows_of_lane] = {};
  Batch now = batch_at(m, warp_id(), strips);
  unsigned of_xi = strips;  // the strip whose x is in xi
  Loaded loaded = load_batch(tiles, tile_column, now);
  while (now.s < strips) {
    const Loaded mine = loaded;
    const Batch next = batch_after(m, now, strips);
    loaded = load_batch(tiles, tile_column, next);
    const unsigned first = tile_rows * m.strip[now.s];
    float4 x[chunk][2];
#pragma unroll
    for (unsigned c = 0; c < chunk; ++c) {
      const float4* of_tile = reinterpret_cast<const float4*>(&m.x[c][tile_columns * mine.column]);
      x[c][0] = of_tile[2 * half_of_lane()];
      x[c][1] = of_tile[2 * half_of_lane() + 1];
      if (of_xi == now.s) continue;
#pragma unroll
      for (unsigned r = 0; r < rows_of_lane; ++r) xi[c][r] = m.x_of_rows[c][first + 2 * r + row_parity_of_lane()];
    }
    of_xi = now.s;
    float of_columns[chunk][2][4];
    multiply(mine.part, x, xi, row, of_columns);
    add_columns(m.sums[warp_id()], of_columns, mine.column, mine.there);
    if (next.s != now.s) {
#pragma unroll
      for (unsigned c = 0; c < chunk; ++c) {
        const float sum = join_rows(row[c]);
        if (writes_row()) m.sums[warps][c][first + row_of_sum()] = sum;
#pragma unroll
        for (unsigned r = 0; r < rows_of_lane; ++r) row[c][r] = 0;
      }
    }
    now = next;
  }
}

/// Columns c .. c + chunk - 1 of both slots.
__device__ void write_slots(const Memory& m, float* partial, const SymmetricArguments& a, unsigned block_row,
                            unsigned block_column, unsigned c) {
  constexpr unsigned slot = COLUMNS * BLOCK;
  float* rows = partial + (Index{block_row} * a.block_rows + block_column) * slot;
  float* columns = partial + (Index{block_column} * a.block_rows + block_row) * slot;
  for (unsigned i = threadIdx.x; i < chunk * BLOCK; i += WORKGROUP) {
    if (c + i / BLOCK >= COLUMNS) continue;
    const float* sums = &m.sums[0][0][0] + i;
    const float of_column = tree_of_warps(sums, chunk * BLOCK), of_row = sums[warps * chunk * BLOCK];
    if (block_row == block_column) {
      rows[c * BLOCK + i] = of_row + of_column;
    } else {
      rows[c * BLOCK + i] = of_row;
      columns[c * BLOCK + i] = of_column;
    }
  }
}

extern "C" __global__ void __launch_bounds__(WORKGROUP, 2)
    sym16(const float* __restrict__ tiles, const unsigned* __restrict__ all, const float* __restrict__ xs,
          float* __restrict__ partial, const SymmetricArguments a) {
  __shared__ Memory m;
  const Index16 index = parts_of(all, a);
  const uint4 block = *reinterpret_cast<const uint4*>(index.block + 4 * Index{blockIdx.x});
  const unsigned block_row = block.x, block_column = block.y, first_strip = block.z, strips = block.w - block.z;
  for (unsigned c = 0; c < COLUMNS; c += chunk) {
    begin_sums(m);
    load_x(m.x, xs, a, block_column * BLOCK, c);
    load_x(m.x_of_rows, xs, a, block_row * BLOCK, c);
    load_index(m, index, first_strip, strips);
    __syncthreads();  // the block's index and x are there, the sums are zero
    multiply_strips(m, reinterpret_cast<const uint4*>(tiles), index.column, strips);
    __syncthreads();  // every warp's sums are there
    write_slots(m, partial, a, block_row, block_column, c);
    __syncthreads();  // the next columns may begin
  }
}

#else

// A thread adds the slots of four elements in order, with sixteen 16-byte loads under way.
//
// Memory traffic of a launch: partial once, 4 COLUMNS n block_rows bytes, most of which are still in L2; y once.

constexpr unsigned in_flight = 16;

__device__ void add(float4& sum, const float4& part) {
  sum.x += part.x;
  sum.y += part.y;
  sum.z += part.z;
  sum.w += part.w;
}

extern "C" __global__ void __launch_bounds__(WORKGROUP, 2)
    sym16_fold(const float* __restrict__ partial, const float* __restrict__ t, float* __restrict__ y,
               const VectorArguments a) {
  for (Index item = first_item(a); item < last_item(a); ++item) {
    const Block block = block_of(a, item);
    if (block.count == 0) continue;
    const unsigned i = block.index * reduction_block + 4 * threadIdx.x, side = a.option, slots = a.slot;
    const Index slot = Index{a.columns} * side / 4;  // in fours
    const float4* first =
        reinterpret_cast<const float4*>(partial) + i / side * slots * slot + (block.column * side + i % side) / 4;
    float4 sum = {};
    unsigned j = 0;
    for (; j + in_flight <= slots; j += in_flight) {
      float4 part[in_flight];
#pragma unroll
      for (unsigned k = 0; k < in_flight; ++k) part[k] = __ldcs(first + (j + k) * slot);
#pragma unroll
      for (unsigned k = 0; k < in_flight; ++k) add(sum, part[k]);
    }
    for (; j < slots; ++j) add(sum, __ldg(first + j * slot));
    const Four ti = load(t, in_column(a, block));
    store(y, block, {{ti.v[0] * sum.x, ti.v[1] * sum.y, ti.v[2] * sum.z, ti.v[3] * sum.w}});
  }
}

#endif
