// The words of kernels/shared/ in CUDA. kernels/README.md, "Shared code", says what each means; the same words stand in
// cl/shared.cl and glsl/shared.comp.

#define FUNCTION __device__

using uint = unsigned;
using vec4 = float4;
using uvec4 = uint4;
#include "../shared/vectors.h"

// The hierarchy's buffers as parameters and arguments of a function; both end with a comma.
#define HIERARCHY_PARAMETERS                                   \
  [[maybe_unused]] const uvec4 *__restrict__ hierarchy_nodes, \
      [[maybe_unused]] const vec4 *__restrict__ hierarchy_leaves,
#define HIERARCHY hierarchy_nodes, hierarchy_leaves,
#define NODE_WORDS(i) __ldg(hierarchy_nodes + (i))
#define LEAF_FOUR(i) __ldg(hierarchy_leaves + (i))

FUNCTION float float_of_bits(uint bits) { return __uint_as_float(bits); }
FUNCTION uint bits_of_float(float value) { return __float_as_uint(value); }
/// a b - c d, exactly the negative of c d - a b: not contracted.
FUNCTION float product_difference(float a, float b, float c, float d) { return __fsub_rn(__fmul_rn(a, b), __fmul_rn(c, d)); }
FUNCTION float square_root(float value) { return sqrtf(value); }
