#define SUMS 2
#include "blocks.comp"

INPUT(0, x)
VECTOR(1, y)

void main() {
  FOR_EACH_ITEM {
    const float ax = sums[scalar(slot_axpby_a)];
    const float by = sums[scalar(slot_axpby_b)];
    FOR_EACH_ELEMENT(i) y[i] = ax * x[i] + by * y[i];
  }
}
