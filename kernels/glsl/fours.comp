// Reading memory by fours of floats, as a storage buffer or, with TEXEL, as a texel buffer: llvmpipe loads the lanes of
// a storage buffer one by one, each with a branch of its own, those of a texel buffer by whole texels.
// (The backend knows which buffers these are: reads_fours() in host/device/vulkan/program.cpp.)
// INPUT_FOURS(binding, name) declares name, FOUR(name, i) is its i-th four.

#ifdef TEXEL
#define INPUT_FOURS(index, name) layout(set = 0, binding = index) uniform samplerBuffer name;
#define FOUR(name, i) texelFetch(name, int(i))
#else
#define INPUT_FOURS(index, name) \
  layout(set = 0, binding = index, std430) readonly restrict buffer Fours_##name { vec4 name[]; };
#define FOUR(name, i) name[i]
#endif
