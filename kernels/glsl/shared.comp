// The words of kernels/shared/ in GLSL. kernels/README.md, "Shared code", says what each means; the same words stand in
// cl/shared.cl and cuda/shared.cuh.
#include "fours.comp"

#define FUNCTION
#define STRUCT(name) struct name
#define TABLE(type, name, size) const type name[size] = type[size](
#define END_TABLE );

#define VEC2(x, y) vec2(x, y)
#define VEC3(x, y, z) vec3(x, y, z)
#define VEC4(x, y, z, w) vec4(x, y, z, w)
#define FILL4(x) vec4(x)
#define TO_FLOAT(x) float(x)
#define TO_UINT(x) uint(x)
#define TO_INT(x) int(x)
#define float_of_bits(x) uintBitsToFloat(x)
#define bits_of_float(x) floatBitsToUint(x)
#define bytes_of(x) vec4(uvec4((x) & 255u, ((x) >> 8) & 255u, ((x) >> 16) & 255u, (x) >> 24))
#define smaller(a, b) min(a, b)
#define larger(a, b) max(a, b)
#define absolute(x) abs(x)
#define square_root(x) sqrt(x)
#define MULTIPLY_ADD(a, b, c) ((a) * (b) + (c))
/// a b - c d, exactly the negative of c d - a b: not to be contracted.
float product_difference(float a, float b, float c, float d) {
  precise const float difference = a * b - c * d;
  return difference;
}

#define PACKET 1
#define REAL float
#define LANES bool
#define FILL_REAL(x) (x)
#define ANY(lanes) (lanes)

// A kernel declares the hierarchy's buffers with INPUT_WORDS(binding, hierarchy_nodes) and INPUT_FOURS(binding,
// hierarchy_leaves) before it includes shared/occluded.h.
#define HIERARCHY_PARAMETERS
#define HIERARCHY
#define NODE_WORDS(i) WORDS(hierarchy_nodes, i)
#define LEAF_FOUR(i) FOUR(hierarchy_leaves, i)
