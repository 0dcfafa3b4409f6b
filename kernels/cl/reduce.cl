#include "blocks.cl"

kernel GROUP_OF_ITEMS void interflect_dot(global const float* x, global const float* y, global float* sums,
                               const VectorArguments a) {
  SCRATCH(1);
  FOR_EACH_BLOCK(item) {
    const Block b = block_of(a, item);
    lanes sum[1] = {0};
    FOR_EACH_ELEMENT(i, b) sum[0] += load(x, i, b.end) * load(y, i, b.end);
    float xy[1];
    join(sum, 1, scratch, xy);
    if (get_local_id(0) == 0) sums[partial_at(a, a.option, b.column, b.index)] = xy[0];
  }
}

kernel GROUP_OF_ITEMS void interflect_reduce(global float* sums, const VectorArguments a) {
  FOR_EACH_BLOCK(item) {
    const Block b = block_of(a, item);
    if (b.index == 0 && get_local_id(0) == 0) {
      sums[scalar_at(a, a.slot, b.column)] = total(a, sums, a.option, b.column);
    }
  }
}
