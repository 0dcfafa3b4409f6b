// Reading memory by fours of floats, as a storage buffer or, with TEXEL, as a storage texel buffer. llvmpipe loads the
// lanes of a storage buffer one by one, each with a branch of its own, those of a texel buffer by whole texels. It puts the
// loads of a storage texel buffer where they stand, so that the processor's prefetcher can tell the rows of a matrix by
// their instructions; those of a uniform texel buffer are calls of one function, and a matrix of 1 GB takes 1.6 times as
// long to read.
// (The backend knows which buffers these are: reads_fours() in host/device/vulkan/program.cpp.)
// INPUT_FOURS(binding, name) declares name, FOUR(name, i) is its i-th four.

#ifdef TEXEL
#define INPUT_FOURS(index, name) layout(set = 0, binding = index, rgba32f) uniform readonly restrict imageBuffer name;
#define FOUR(name, i) imageLoad(name, int(i))
#else
#define INPUT_FOURS(index, name) \
  layout(set = 0, binding = index, std430) readonly restrict buffer Fours_##name { vec4 name[]; };
#define FOUR(name, i) name[i]
#endif
