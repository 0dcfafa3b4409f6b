#include "blocks.cl"

/// The norms that matter are near 1; below this a value is as good as zero, and a denormal one is slow on processors.
lanes flushed(lanes value) {
  return select(value, (lanes)0.0f, fabs(value) < 1e-30f);
}

kernel GROUP_OF_ITEMS void interflect_bounce(global const float* y, global const float* rho, global const float* d,
                                  global float* r, global float* x, global float* sums, const VectorArguments a) {
  SCRATCH(2);
  FOR_EACH_BLOCK(item) {
    const Block b = block_of(a, item);
    lanes sum[2] = {0, 0};
    FOR_EACH_ELEMENT(i, b) {
      const lanes bounced = flushed(load(rho, i, b.end) * load(y, i, b.end));
      store(bounced, r, i, b.end);
      if (a.option == 1) store(load(x, i, b.end) + bounced, x, i, b.end);
      sum[0] += bounced * bounced;
      sum[1] += load(d, i, b.end) * bounced * bounced;
    }
    float joined[2];
    join(sum, 2, scratch, joined);
    if (get_local_id(0) == 0) {
      sums[partial_at(a, sum_rr, b.column, b.index)] = joined[0];
      sums[partial_at(a, sum_gamma, b.column, b.index)] = joined[1];
    }
  }
}
