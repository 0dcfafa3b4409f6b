// xs = s * x, element by element, for all columns. Contract: kernels/README.md.
#include "blocks.comp"

INPUT(0, x)
INPUT(1, s)
VECTOR(2, xs)

void main() {
  FOR_EACH_ITEM {
    FOR_EACH_ELEMENT(i) xs[i] = s[i - column * a.vector_stride] * x[i];
  }
}
