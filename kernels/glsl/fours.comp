// Reading memory by fours of floats, as a storage buffer or, with TEXEL, as a storage texel buffer. llvmpipe loads the
// lanes of a storage buffer one by one, each with a branch of its own, those of a texel buffer by whole texels. It puts the
// loads of a storage texel buffer where they stand, so that the processor's prefetcher can tell the rows of a matrix by
// their instructions; those of a uniform texel buffer are calls of one function, and a matrix of 1 GB takes 1.6 times as
// long to read.
// (The backend knows which buffers these are: texels_of() in host/device/vulkan/program.cpp.)
// INPUT_FOURS(binding, name) declares name, FOUR(name, i) is its i-th four. The same with WORDS for fours of 32-bit words,
// and WORD(name, k) for a single one of those. SUM_FOURS is a buffer that is also written, with SET_FOUR(name, i, value).

#ifdef TEXEL
#define INPUT_FOURS(index, name) layout(set = 0, binding = index, rgba32f) uniform readonly restrict imageBuffer name;
#define FOUR(name, i) imageLoad(name, int(i))
#define INPUT_WORDS(index, name) layout(set = 0, binding = index, rgba32ui) uniform readonly restrict uimageBuffer name;
#define WORDS(name, i) imageLoad(name, int(i))
#define SUM_FOURS(index, name) layout(set = 0, binding = index, rgba32f) uniform coherent restrict imageBuffer name;
#define SET_FOUR(name, i, value) imageStore(name, int(i), value)
#else
#define INPUT_FOURS(index, name) \
  layout(set = 0, binding = index, std430) readonly restrict buffer Fours_##name { vec4 name[]; };
#define FOUR(name, i) name[i]
#define INPUT_WORDS(index, name) \
  layout(set = 0, binding = index, std430) readonly restrict buffer Words_##name { uvec4 name[]; };
#define WORDS(name, i) name[i]
#define SUM_FOURS(index, name) \
  layout(set = 0, binding = index, std430) coherent restrict buffer Fours_##name { vec4 name[]; };
#define SET_FOUR(name, i, value) name[i] = value
#endif
#define WORD(name, k) WORDS(name, (k) / 4u)[(k) % 4u]
