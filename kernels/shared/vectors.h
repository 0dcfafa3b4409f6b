// The words of kernels/shared/ for C++, which has no vectors of its own: of cuda/shared.cuh and omp/shared.h. These give
// FUNCTION, uint, and vec4 and uvec4 with components x, y, z, w.

#define STRUCT(name) struct name
#define TABLE(type, name, size) FUNCTION const type name[size] = {
#define END_TABLE };

struct vec2 {
  float x, y;
};
struct vec3 {
  float x, y, z;
};

#define VEC2(x, y) (vec2{x, y})
#define VEC3(x, y, z) (vec3{x, y, z})
#define VEC4(x, y, z, w) (vec4{x, y, z, w})
#define FILL4(x) fill4(x)
#define TO_FLOAT(x) (static_cast<float>(x))
#define TO_UINT(x) (static_cast<uint>(x))
#define TO_INT(x) (static_cast<int>(x))

#define MULTIPLY_ADD(a, b, c) ((a) * (b) + (c))
#define PACKET 1
#define REAL float
#define LANES bool
#define FILL_REAL(x) (x)
#define ANY(lanes) (lanes)

FUNCTION vec4 fill4(float x) { return {x, x, x, x}; }
FUNCTION vec4 bytes_of(uint word) {
  return {TO_FLOAT(word & 255U), TO_FLOAT((word >> 8) & 255U), TO_FLOAT((word >> 16) & 255U), TO_FLOAT(word >> 24)};
}
FUNCTION float smaller(float a, float b) { return b < a ? b : a; }
FUNCTION float larger(float a, float b) { return a < b ? b : a; }
FUNCTION uint smaller(uint a, uint b) { return b < a ? b : a; }
FUNCTION uint larger(uint a, uint b) { return a < b ? b : a; }
FUNCTION float absolute(float a) { return a < 0 ? -a : a; }

FUNCTION vec2 operator+(vec2 a, vec2 b) { return {a.x + b.x, a.y + b.y}; }
FUNCTION vec2 operator-(vec2 a, vec2 b) { return {a.x - b.x, a.y - b.y}; }
FUNCTION vec2 operator*(vec2 a, vec2 b) { return {a.x * b.x, a.y * b.y}; }
FUNCTION vec2 operator*(vec2 a, float b) { return {a.x * b, a.y * b}; }
FUNCTION vec2 operator*(float a, vec2 b) { return b * a; }
FUNCTION vec2 operator+(vec2 a, float b) { return {a.x + b, a.y + b}; }
FUNCTION vec2 operator-(vec2 a, float b) { return {a.x - b, a.y - b}; }
FUNCTION vec2 operator-(vec2 a) { return {-a.x, -a.y}; }
FUNCTION vec2 smaller(vec2 a, vec2 b) { return {smaller(a.x, b.x), smaller(a.y, b.y)}; }
FUNCTION vec2 larger(vec2 a, vec2 b) { return {larger(a.x, b.x), larger(a.y, b.y)}; }
FUNCTION vec2 absolute(vec2 a) { return {absolute(a.x), absolute(a.y)}; }
FUNCTION vec3 operator+(vec3 a, vec3 b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
FUNCTION vec3 operator-(vec3 a, vec3 b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
FUNCTION vec3 operator*(vec3 a, vec3 b) { return {a.x * b.x, a.y * b.y, a.z * b.z}; }
FUNCTION vec3 operator*(vec3 a, float b) { return {a.x * b, a.y * b, a.z * b}; }
FUNCTION vec3 operator*(float a, vec3 b) { return b * a; }
FUNCTION vec3 operator+(vec3 a, float b) { return {a.x + b, a.y + b, a.z + b}; }
FUNCTION vec3 operator-(vec3 a, float b) { return {a.x - b, a.y - b, a.z - b}; }
FUNCTION vec3 operator-(vec3 a) { return {-a.x, -a.y, -a.z}; }
FUNCTION vec3 smaller(vec3 a, vec3 b) { return {smaller(a.x, b.x), smaller(a.y, b.y), smaller(a.z, b.z)}; }
FUNCTION vec3 larger(vec3 a, vec3 b) { return {larger(a.x, b.x), larger(a.y, b.y), larger(a.z, b.z)}; }
FUNCTION vec3 absolute(vec3 a) { return {absolute(a.x), absolute(a.y), absolute(a.z)}; }
FUNCTION vec4 operator+(vec4 a, vec4 b) { return {a.x + b.x, a.y + b.y, a.z + b.z, a.w + b.w}; }
FUNCTION vec4 operator-(vec4 a, vec4 b) { return {a.x - b.x, a.y - b.y, a.z - b.z, a.w - b.w}; }
FUNCTION vec4 operator*(vec4 a, vec4 b) { return {a.x * b.x, a.y * b.y, a.z * b.z, a.w * b.w}; }
FUNCTION vec4 operator*(vec4 a, float b) { return {a.x * b, a.y * b, a.z * b, a.w * b}; }
FUNCTION vec4 operator*(float a, vec4 b) { return b * a; }
FUNCTION vec4 operator+(vec4 a, float b) { return {a.x + b, a.y + b, a.z + b, a.w + b}; }
FUNCTION vec4 operator-(vec4 a, float b) { return {a.x - b, a.y - b, a.z - b, a.w - b}; }
FUNCTION vec4 operator-(vec4 a) { return {-a.x, -a.y, -a.z, -a.w}; }
FUNCTION vec4 smaller(vec4 a, vec4 b) { return {smaller(a.x, b.x), smaller(a.y, b.y), smaller(a.z, b.z), smaller(a.w, b.w)}; }
FUNCTION vec4 larger(vec4 a, vec4 b) { return {larger(a.x, b.x), larger(a.y, b.y), larger(a.z, b.z), larger(a.w, b.w)}; }
FUNCTION vec4 absolute(vec4 a) { return {absolute(a.x), absolute(a.y), absolute(a.z), absolute(a.w)}; }
