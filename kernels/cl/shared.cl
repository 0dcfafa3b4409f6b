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

// The hierarchy's buffers as parameters and arguments of a function; both end with a comma.
#define HIERARCHY_PARAMETERS global const uint4 *hierarchy_nodes, global const float4 *hierarchy_leaves,
#define HIERARCHY hierarchy_nodes, hierarchy_leaves,
#define NODE_WORDS(i) hierarchy_nodes[i]
#define LEAF_FOUR(i) hierarchy_leaves[i]
