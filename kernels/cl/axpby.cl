#include "blocks.cl"

kernel GROUP_OF_ITEMS void interflect_axpby(global const float* x, global float* y, global const float* sums,
                                 const VectorArguments a) {
  FOR_EACH_BLOCK(item) {
    const Block b = block_of(a, item);
    const float of_x = sums[scalar_at(a, axpby_a, b.column)];
    const float of_y = sums[scalar_at(a, axpby_b, b.column)];
    FOR_EACH_ELEMENT(i, b) store(of_x * load(x, i, b.end) + of_y * load(y, i, b.end), y, i, b.end);
  }
}
