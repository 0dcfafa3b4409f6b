#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>

// The words of kernels/shared/ in C++. kernels/README.md, "Shared code", says what each means; the same words stand in
// cl/shared.cl, glsl/shared.comp and cuda/shared.cuh.

#define FUNCTION [[maybe_unused]] inline

namespace interflect::omp::shared {

using uint = std::uint32_t;
struct vec4 {
  float x, y, z, w;
};
struct uvec4 {
  uint x, y, z, w;
};
#include "shared/vectors.h"

FUNCTION float float_of_bits(uint bits) {
  float value = 0;
  std::memcpy(&value, &bits, sizeof value);
  return value;
}
FUNCTION uint bits_of_float(float value) {
  uint bits = 0;
  std::memcpy(&bits, &value, sizeof bits);
  return bits;
}
/// a b - c d, exactly the negative of c d - a b: not contracted.
FUNCTION float product_difference(float a, float b, float c, float d) {
  const float left = a * b, right = c * d;
  return left - right;
}
FUNCTION float square_root(float value) {
  return std::sqrt(value);
}

}  // namespace interflect::omp::shared

// The hierarchy's buffers as parameters and arguments of a function; both end with a comma.
#define HIERARCHY_PARAMETERS \
  [[maybe_unused]] const uvec4 *hierarchy_nodes, [[maybe_unused]] const vec4 *hierarchy_leaves,
#define HIERARCHY hierarchy_nodes, hierarchy_leaves,
#define NODE_WORDS(i) hierarchy_nodes[i]
#define LEAF_FOUR(i) hierarchy_leaves[i]
