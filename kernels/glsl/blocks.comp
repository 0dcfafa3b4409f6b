// What the vector kernels share: items of work, the sums buffer, the fixed tree. Contract: kernels/README.md.
//
// The backend compiles a file once per kernel with KERNEL_name and WORKGROUP defined, and SUBGROUPS where subgroups can
// add. A vector kernel defines SUMS, the binding of its sums buffer if it has one, and TERMS, how many sums it makes of a
// block; then it includes this file, declares its buffers and the function element(), and ends with a main() made of the
// pieces below.

layout(local_size_x = WORKGROUP) in;

layout(push_constant) uniform Arguments {
  uint n;
  uint vector_stride;
  uint columns;
  uint blocks;
  uint blocks_per_group;
  uint option;
  uint slot;
} a;

#define VECTOR(index, name) layout(set = 0, binding = index, std430) restrict buffer Vector_##name { float name[]; };
#define INPUT(index, name) \
  layout(set = 0, binding = index, std430) readonly restrict buffer Vector_##name { float name[]; };

const uint reduction_block = 1024u;
const uint scalar_slots = 8u;

const uint slot_target = 0u;
const uint slot_alpha = 1u;
const uint slot_cg_gamma_old = 2u;
const uint slot_cg_gamma = 3u;
const uint slot_cg_beta = 4u;
const uint slot_cg_shift = 5u;
const uint slot_bicgstab_rho = 2u;
const uint slot_bicgstab_rho_used = 3u;
const uint slot_bicgstab_shadow = 4u;
const uint slot_bicgstab_restarts = 5u;
const uint slot_axpby_a = 6u;
const uint slot_axpby_b = 7u;

const uint sum_rr = 0u;
const uint sum_gamma = 1u;
const uint sum_delta = 2u;
const uint sum_xw = 1u;
const uint sum_ww = 2u;
const uint sum_zx = 3u;
const uint sum_zw = 4u;
const uint sum_xx = 5u;

#ifdef SUMS
layout(set = 0, binding = SUMS, std430) restrict buffer Sums { float sums[]; };
#endif

// The work item at hand: elements [begin, end) of the vectors, the column's offset included.
uint column;
uint block;
uint begin;
uint end;

uint first_item() { return gl_WorkGroupID.y * a.blocks_per_group; }
uint last_item() { return min(first_item() + a.blocks_per_group, a.columns * a.blocks); }

bool take_item(uint item) {
  column = item / a.blocks;
  block = item % a.blocks;
  begin = column * a.vector_stride + block * reduction_block;
  end = column * a.vector_stride + min(a.n, (block + 1u) * reduction_block);
  return true;
}

// For every item of this work-group: `block`, `begin`, ... are set.
#define FOR_EACH_ITEM for (uint item = first_item(), last = last_item(); item < last && take_item(item); ++item)
// The elements of the item that belong to this invocation.
#define FOR_EACH_ELEMENT(i) for (uint i = begin + gl_LocalInvocationIndex; i < end; i += WORKGROUP)

#ifdef SUMS
uint scalar(uint slot) { return slot * a.columns + column; }
uint partial(uint set) { return scalar_slots * a.columns + (set * a.columns + column) * a.blocks; }

// The sum of the column: its blocks in order.
float total(uint set) {
  const uint first = partial(set);
  float sum = 0.0;
  for (uint b = 0u; b < a.blocks; ++b) sum += sums[first + b];
  return sum;
}
#endif

// One invocation writes what is written once per block, or once per column.
bool writes_block() { return gl_LocalInvocationIndex == 0u; }
bool writes_column() { return gl_LocalInvocationIndex == 0u && block == 0u; }

// The quotient when it is a number of usable size, else 0. The bits are compared: a driver may take it that there are
// no NaNs and turn a comparison of floats around.
float quotient_or_zero(float numerator, float denominator) {
  const float q = numerator / denominator;
  return (floatBitsToUint(q) & 0x7FFFFFFFu) < floatBitsToUint(1e30) ? q : 0.0;
}

#ifdef TERMS

// The terms of element i, to be added to the block's sums.
void element(uint i, inout float terms[TERMS]);

// The fixed tree of a block: an invocation adds its elements in order, at most 32 of them before they join its total;
// then the totals of the invocations are added (group_sum.comp). Every invocation gets the sums.
#include "group_sum.comp"

void block_sums(out float result[TERMS]) {
  for (uint t = 0u; t < TERMS; ++t) result[t] = 0.0;
  for (uint first = begin; first < end; first += 32u * WORKGROUP) {
    float terms[TERMS];
    for (uint t = 0u; t < TERMS; ++t) terms[t] = 0.0;
    const uint last = min(end, first + 32u * WORKGROUP);
    for (uint i = first + gl_LocalInvocationIndex; i < last; i += WORKGROUP) element(i, terms);
    for (uint t = 0u; t < TERMS; ++t) result[t] += terms[t];
  }
  for (uint t = 0u; t < TERMS; ++t) result[t] = group_sum(result[t]);
}

void write_sum(uint set, float value) {
  if (writes_block()) sums[partial(set) + block] = value;
}

#endif
