#ifdef KERNEL_dot
#define SUMS 2
#define TERMS 1
#else
#define SUMS 0
#endif
#include "blocks.comp"

#ifdef KERNEL_dot

INPUT(0, x)
INPUT(1, y)

void element(uint i, inout float terms[TERMS]) { terms[0] += x[i] * y[i]; }

void main() {
  FOR_EACH_ITEM {
    float result[TERMS];
    block_sums(result);
    write_sum(a.option, result[0]);
  }
}

#else  // KERNEL_reduce

void main() {
  FOR_EACH_ITEM {
    if (writes_column()) sums[scalar(a.slot)] = total(a.option);
  }
}

#endif
