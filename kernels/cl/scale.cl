// xs = s * x for every column, s being one vector: kernels/README.md. Memory traffic: 8 bytes read (4 of them once for
// all columns, then from cache) and 4 written for each element.
#include "blocks.cl"

kernel GROUP_OF_ITEMS void interflect_scale(global const float* x, global const float* s, global float* xs,
                                 const VectorArguments a) {
  FOR_EACH_BLOCK(item) {
    const Block b = block_of(a, item);
    const size_t column = (size_t)b.column * a.vector_stride;
    FOR_EACH_ELEMENT(i, b) store(load(s, i - column, a.n) * load(x, i, b.end), xs, i, b.end);
  }
}
