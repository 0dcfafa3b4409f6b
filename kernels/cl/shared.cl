// The words of kernels/shared/ in OpenCL C. kernels/README.md, "Shared code", says what each means; the same words stand in
// glsl/shared.comp and cuda/shared.cuh.

#define FUNCTION
#define STRUCT(name) typedef struct name##_ name; struct name##_
#define TABLE(type, name, size) constant type name[size] = {
#define END_TABLE };

#define vec2 float2
#define vec3 float3
#define vec4 float4
#define uvec4 uint4
#define VEC2(x, y) ((float2)(x, y))
#define VEC3(x, y, z) ((float3)(x, y, z))
#define VEC4(x, y, z, w) ((float4)(x, y, z, w))
#define FILL4(x) ((float4)(x))
#define TO_FLOAT(x) ((float)(x))
#define TO_UINT(x) ((uint)(x))
#define TO_INT(x) ((int)(x))
#define float_of_bits(x) as_float(x)
#define bits_of_float(x) as_uint(x)
#define bytes_of(x) convert_float4(as_uchar4(x))
#define smaller(a, b) min(a, b)
#define larger(a, b) max(a, b)
#define absolute(x) fabs(x)
#define square_root(x) sqrt(x)

#pragma OPENCL FP_CONTRACT OFF  // what product_difference() needs
#ifdef FP_FAST_FMAF
#define MULTIPLY_ADD(a, b, c) fma(a, b, c)
#else
#define MULTIPLY_ADD(a, b, c) ((a) * (b) + (c))
#endif
#define product_difference(a, b, c, d) ((a) * (b) - (c) * (d))

// On processors an invocation traces PACKET rays at once.
#if WORKGROUP > 1
#define PACKET 1
#define REAL float
#define LANES bool
#define FILL_REAL(x) (x)
#define ANY(lanes) (lanes)
#else
#ifndef PACKET
#define PACKET WIDTH
#endif
#if PACKET == 16
#define REAL float16
#define LANES int16
#define LOAD_REAL(from) vload16(0, from)
#define STORE_REAL(value, to) vstore16(value, 0, to)
#elif PACKET == 8
#define REAL float8
#define LANES int8
#define LOAD_REAL(from) vload8(0, from)
#define STORE_REAL(value, to) vstore8(value, 0, to)
#else
#define REAL float4
#define LANES int4
#define LOAD_REAL(from) vload4(0, from)
#define STORE_REAL(value, to) vstore4(value, 0, to)
#endif
#define FILL_REAL(x) ((REAL)(x))
#define ANY(lanes) any_lane(lanes)
/// Whether any is true. (PoCL takes any() apart, lane by lane.)
bool any_lane(LANES lanes) {
#if PACKET == 16
  const int8 eight = lanes.lo | lanes.hi;
  const int4 four = eight.lo | eight.hi;
#elif PACKET == 8
  const int4 four = lanes.lo | lanes.hi;
#else
  const int4 four = lanes;
#endif
  const int2 two = four.lo | four.hi;
  return (two.x | two.y) != 0;
}
#endif

// The hierarchy's buffers as parameters and arguments of a function; both end with a comma.
#define HIERARCHY_PARAMETERS global const uint4 *hierarchy_nodes, global const float4 *hierarchy_leaves,
#define HIERARCHY hierarchy_nodes, hierarchy_leaves,
#define NODE_WORDS(i) hierarchy_nodes[i]
#define LEAF_FOUR(i) hierarchy_leaves[i]
