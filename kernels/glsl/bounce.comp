#define SUMS 5
#define TERMS 2
#include "blocks.comp"

INPUT(0, y)
INPUT(1, rho)
INPUT(2, d)
VECTOR(3, r)
VECTOR(4, x)

void element(uint i, inout float terms[TERMS]) {
  float bounced = rho[i] * y[i];
  if (abs(bounced) < 1e-30) bounced = 0.0;  // as good as zero, and denormal numbers are slow on a CPU
  r[i] = bounced;
  if (a.option == 1u) x[i] += bounced;
  terms[0] += bounced * bounced;
  terms[1] += d[i] * bounced * bounced;
}

void main() {
  FOR_EACH_ITEM {
    float result[TERMS];
    block_sums(result);
    write_sum(sum_rr, result[0]);
    write_sum(sum_gamma, result[1]);
  }
}
