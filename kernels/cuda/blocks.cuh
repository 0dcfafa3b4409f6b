// What the CUDA kernels share: the argument blocks, the fixed trees of a sum, and the blocks of the vector kernels.
//
// A work-group is WORKGROUP = 256 threads, 8 warps. Vector kernels: a block of 1,024 elements is four neighbours for
// each thread, one 16-byte load. Fixed tree of a partial sum: a thread adds its elements in order, the 32 lanes of a
// warp join in a butterfly, then the 8 warps in a tree of three levels: 12 additions for an element.

constexpr unsigned warp_size = 32;
constexpr unsigned warps = WORKGROUP / warp_size;
constexpr unsigned all_lanes = 0xFFFFFFFFU;
static_assert(WORKGROUP == 256, "a block of 1,024 elements is four for each thread, and the trees join eight warps");

using Index = unsigned long long;

// Field by field as in host/device/kernel_arguments.h.
struct StreamArguments {
  unsigned lines;
};
struct MatvecArguments {
  unsigned n, first, rows, row_stride, vector_stride;
};
struct VectorArguments {
  unsigned n, vector_stride, columns, blocks, blocks_per_group, option, slot;
};

constexpr unsigned reduction_block = 1024;
constexpr unsigned scalar_slots = 8;

// Scalars of a column, and sets of partial sums: the names of kernel_arguments.h.
constexpr unsigned slot_target = 0, slot_alpha = 1;
constexpr unsigned slot_cg_gamma_old = 2, slot_cg_gamma = 3, slot_cg_beta = 4, slot_cg_shift = 5;
constexpr unsigned slot_bicgstab_rho = 2, slot_bicgstab_rho_used = 3, slot_bicgstab_shadow = 4;
constexpr unsigned slot_bicgstab_restarts = 5, slot_axpby_a = 6, slot_axpby_b = 7;
constexpr unsigned sum_rr = 0, sum_gamma = 1, sum_delta = 2;
constexpr unsigned sum_xw = 1, sum_ww = 2, sum_zx = 3, sum_zw = 4, sum_xx = 5;

__device__ unsigned lane_id() {
  return threadIdx.x % warp_size;
}
__device__ unsigned warp_id() {
  return threadIdx.x / warp_size;
}

/// The sum over a warp, in every lane.
__device__ float warp_sum(float value) {
#pragma unroll
  for (unsigned offset = warp_size / 2; offset > 0; offset /= 2) value += __shfl_xor_sync(all_lanes, value, offset);
  return value;
}

/// The warps' sums, `stride` floats apart.
__device__ float tree_of_warps(const float* of_warp, unsigned stride) {
  const float left = (of_warp[0] + of_warp[stride]) + (of_warp[2 * stride] + of_warp[3 * stride]);
  const float right = (of_warp[4 * stride] + of_warp[5 * stride]) + (of_warp[6 * stride] + of_warp[7 * stride]);
  return left + right;
}

/// Four neighbouring elements of a vector.
struct Four {
  float v[4];
};

/// One block of one column as a thread sees it: its elements are [begin, begin + count), the column's offset included.
struct Block {
  unsigned column, index, count;
  Index begin;
};

/// A group's work: items [first_item, last_item), each one block of one column.
__device__ Index first_item(const VectorArguments& a) {
  return Index{blockIdx.x} * a.blocks_per_group;
}
__device__ Index last_item(const VectorArguments& a) {
  const Index items = Index{a.columns} * a.blocks;
  const Index last = first_item(a) + a.blocks_per_group;
  return last < items ? last : items;
}
__device__ Block block_of(const VectorArguments& a, Index item) {
  Block block;
  block.column = static_cast<unsigned>(item / a.blocks);
  block.index = static_cast<unsigned>(item % a.blocks);
  const unsigned first = block.index * reduction_block + 4 * threadIdx.x;
  const unsigned left = first < a.n ? a.n - first : 0;
  block.count = left < 4 ? left : 4;
  block.begin = Index{block.column} * a.vector_stride + first;
  return block;
}

/// The same place in a vector of one column.
__device__ Block in_column(const VectorArguments& a, Block block) {
  block.begin -= Index{block.column} * a.vector_stride;
  return block;
}

/// Whole fours in one access; at the column's end one by one, since a buffer may end there.
__device__ Four load(const float* x, const Block& block) {
  Four four = {};
  if (block.count == 4) {
    const float4 all = *reinterpret_cast<const float4*>(x + block.begin);
    four = {{all.x, all.y, all.z, all.w}};
  } else {
#pragma unroll
    for (unsigned k = 0; k < 3; ++k) {
      if (k < block.count) four.v[k] = x[block.begin + k];
    }
  }
  return four;
}
__device__ void store(float* x, const Block& block, const Four& four) {
  if (block.count == 4) {
    *reinterpret_cast<float4*>(x + block.begin) = make_float4(four.v[0], four.v[1], four.v[2], four.v[3]);
  } else {
#pragma unroll
    for (unsigned k = 0; k < 3; ++k) {
      if (k < block.count) x[block.begin + k] = four.v[k];
    }
  }
}

/// The float of scalar slot `slot` of a column.
__device__ float& scalar(const VectorArguments& a, float* sums, unsigned slot, unsigned column) {
  return sums[slot * a.columns + column];
}
/// The partial sums of a column in `set`, one for each block.
__device__ float* partials(const VectorArguments& a, float* sums, unsigned set, unsigned column) {
  return sums + scalar_slots * a.columns + (set * a.columns + column) * a.blocks;
}

/// What the threads of a group tell each other.
struct Shared {
  float of_warp[5][warps];
  float total[5];
};

/// Writes the block's partial sums, one for each set. Every thread of the group gives its part.
template <unsigned count>
__device__ void write_partials(const VectorArguments& a, float* sums, const Block& block, const float (&part)[count],
                               const unsigned (&set)[count], Shared& shared) {
#pragma unroll
  for (unsigned s = 0; s < count; ++s) {
    const float sum = warp_sum(part[s]);
    if (lane_id() == 0) shared.of_warp[s][warp_id()] = sum;
  }
  __syncthreads();  // every warp's sum is there
#pragma unroll
  for (unsigned s = 0; s < count; ++s) {
    if (threadIdx.x == s) partials(a, sums, set[s], block.column)[block.index] = tree_of_warps(shared.of_warp[s], 1);
  }
  __syncthreads();  // the next item may write again
}

/// The totals of a column, for all threads: the blocks' sums in order, a warp for each set. It reads 32 of them at
/// once.
template <unsigned count>
__device__ void add_totals(const VectorArguments& a, float* sums, unsigned column, const unsigned (&set)[count],
                           float (&total)[count], Shared& shared) {
  unsigned all = 0;  // the sets as hexadecimal digits, so that a warp picks its own without memory
#pragma unroll
  for (unsigned s = 0; s < count; ++s) all |= set[s] << (4 * s);
  const unsigned mine = all >> (4 * warp_id()) & 15U;
  if (warp_id() < count) {
    const float* partial = partials(a, sums, mine, column);
    float sum = 0;
    for (unsigned first = 0; first < a.blocks; first += warp_size) {
      const unsigned left = a.blocks - first;
      const float value = lane_id() < left ? partial[first + lane_id()] : 0.0F;
      for (unsigned k = 0; k < warp_size && k < left; ++k) sum += __shfl_sync(all_lanes, value, k);
    }
    if (lane_id() == 0) shared.total[warp_id()] = sum;
  }
  __syncthreads();  // every total is there
#pragma unroll
  for (unsigned s = 0; s < count; ++s) total[s] = shared.total[s];
  __syncthreads();  // the next item may write again
}

/// The quotient when it is a number of usable size, else 0: a breakdown must not become a NaN.
__device__ float quotient_or_zero(float numerator, float denominator) {
  const float q = numerator / denominator;
  return fabsf(q) < 1e30F ? q : 0.0F;  // false for a NaN as well
}
