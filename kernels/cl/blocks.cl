// What the vector kernels share: columns cut into blocks of 1,024 elements, and the fixed tree of a sum. One text for
// both shapes:
//   WORKGROUP = 1   a work-item sweeps a block by vectors of 16 lanes; lane l adds elements l, l + 16, ... in order,
//                   then the lanes in a tree of four levels: 68 additions for an element
//   else            work-item l adds elements l, l + WORKGROUP, ... in order, then the work-items in a tree: 12 additions
//                   at 256 work-items, 22 at 64
// A column's total is the blocks' sums one after the other.

#if WORKGROUP == 1
#define LANES 16
typedef float16 lanes;
#else
#define LANES 1
typedef float lanes;
#endif

#define GROUP_OF_ITEMS __attribute__((reqd_work_group_size(WORKGROUP, 1, 1)))
#define SCRATCH(sums) local float scratch[(sums)*WORKGROUP]

#define BLOCK 1024U
#define SCALAR_SLOTS 8U
enum { slot_target = 0, slot_alpha = 1 };
enum { cg_gamma_old = 2, cg_gamma = 3, cg_beta = 4, cg_shift = 5 };
enum { bicgstab_rho = 2, bicgstab_rho_used = 3, bicgstab_shadow = 4, bicgstab_restarts = 5 };
enum { axpby_a = 6, axpby_b = 7 };
enum { sum_rr = 0, sum_gamma = 1, sum_delta = 2, sum_xw = 1, sum_ww = 2, sum_zx = 3, sum_zw = 4, sum_xx = 5 };

typedef struct {
  uint n, vector_stride, columns, blocks, blocks_per_group, option, slot;
} VectorArguments;

/// One block of one column: elements [begin, end) of the vectors, offset of the column included.
typedef struct {
  uint item, column, index;
  size_t begin, end;
} Block;

Block block_of(const VectorArguments a, uint item) {
  Block b;
  b.item = item;
  b.column = item / a.blocks;
  b.index = item % a.blocks;
  b.begin = (size_t)b.column * a.vector_stride + b.index * BLOCK;
  b.end = (size_t)b.column * a.vector_stride + min(a.n, (b.index + 1) * BLOCK);
  return b;
}

uint first_item(const VectorArguments a) {
  return (uint)get_group_id(0) * a.blocks_per_group;
}
uint last_item(const VectorArguments a) {
  return min(a.columns * a.blocks, first_item(a) + a.blocks_per_group);
}
#define FOR_EACH_BLOCK(item) for (uint item = first_item(a), last = last_item(a); item < last; ++item)

/// The elements of a block that this work-item does, LANES at a time.
#define FOR_EACH_ELEMENT(i, b) for (size_t i = b.begin + get_local_id(0) * LANES; i < b.end; i += WORKGROUP * LANES)

/// Elements i, i + 1, ... below `end`; lanes behind it are 0, whatever the memory holds.
lanes load(global const float* x, size_t i, size_t end) {
#if LANES == 1
  return x[i];
#else
  if (i + LANES <= end) return vload16(0, x + i);
  float part[LANES] = {0};
  for (uint l = 0; i + l < end; ++l) part[l] = x[i + l];
  return vload16(0, part);
#endif
}

void store(lanes value, global float* x, size_t i, size_t end) {
#if LANES == 1
  x[i] = value;
#else
  if (i + LANES <= end) {
    vstore16(value, 0, x + i);
    return;
  }
  float part[LANES];
  vstore16(value, 0, part);
  for (uint l = 0; i + l < end; ++l) x[i + l] = part[l];
#endif
}

/// Where a column's scalar, or a block's partial sum of a set, stands in the sums buffer.
size_t scalar_at(const VectorArguments a, uint slot, uint column) {
  return slot * a.columns + column;
}
size_t partial_at(const VectorArguments a, uint set, uint column, uint block) {
  return SCALAR_SLOTS * a.columns + ((size_t)set * a.columns + column) * a.blocks + block;
}

/// The sum of a column: its blocks in order.
float total(const VectorArguments a, global const float* sums, uint set, uint column) {
  global const float* partial = sums + partial_at(a, set, column, 0);
  float sum = 0;
  for (uint block = 0; block < a.blocks; ++block) sum += partial[block];
  return sum;
}

/// Adds each of `count` sums over all lanes and work-items; work-item 0 has them in result[].
void join(const lanes* sum, uint count, local float* scratch, float* result) {
#if WORKGROUP == 1
  for (uint s = 0; s < count; ++s) {
    const float8 a = sum[s].lo + sum[s].hi;
    const float4 b = a.lo + a.hi;
    const float2 c = b.lo + b.hi;
    result[s] = c.lo + c.hi;
  }
#else
  const uint l = get_local_id(0);
  barrier(CLK_LOCAL_MEM_FENCE);  // the block before has been read
  for (uint s = 0; s < count; ++s) scratch[s * WORKGROUP + l] = sum[s];
  for (uint width = WORKGROUP / 2; width > 0; width /= 2) {
    barrier(CLK_LOCAL_MEM_FENCE);  // the level before is there
    if (l < width) {
      for (uint s = 0; s < count; ++s) scratch[s * WORKGROUP + l] += scratch[s * WORKGROUP + l + width];
    }
  }
  for (uint s = 0; l == 0 && s < count; ++s) result[s] = scratch[s * WORKGROUP];
#endif
}

/// The quotient when it is a number of usable size, else 0: a breakdown must not become a NaN.
float quotient_or_zero(float numerator, float denominator) {
  const float q = numerator / denominator;
  return fabs(q) < 1e30f ? q : 0.0f;  // false for a NaN as well
}
