// Reads memory as fast as the device can: what every other kernel's rate is compared with. Contract: kernels/README.md.
//
// Memory traffic of a launch: 64 * lines bytes read, 4 * groups written.

typedef struct {
  uint lines;
} StreamArguments;

float sum4(float4 v) {
  return (v.x + v.z) + (v.y + v.w);
}

#if WORKGROUP == 1

#define AT_ONCE (16 / STREAMS)  // lines of each stream in an iteration: sixteen loads under way

kernel __attribute__((reqd_work_group_size(1, 1, 1))) void interflect_read(global const float* data, global float* sums,
                                                                const StreamArguments a) {
  const uint first = (uint)((ulong)a.lines * get_group_id(0) / get_num_groups(0));
  const uint lines = (uint)((ulong)a.lines * (get_group_id(0) + 1) / get_num_groups(0)) - first;
  global const float* part = data + (size_t)first * 16;
  const uint length = lines / STREAMS / AT_ONCE * AT_ONCE;  // lines of a stream
  float16 sum[STREAMS * AT_ONCE];
#pragma unroll
  for (uint k = 0; k < STREAMS * AT_ONCE; ++k) sum[k] = 0;
  for (uint i = 0; i < length; i += AT_ONCE) {
#pragma unroll
    for (uint k = 0; k < STREAMS * AT_ONCE; ++k) {
      sum[k] += vload16((size_t)(k / AT_ONCE) * length + i + k % AT_ONCE, part);
    }
  }
  float16 all = sum[0];
#pragma unroll
  for (uint k = 1; k < STREAMS * AT_ONCE; ++k) all += sum[k];
  for (uint i = STREAMS * length; i < lines; ++i) all += vload16(i, part);
  const float8 half_of_it = all.lo + all.hi;
  sums[get_group_id(0)] = sum4(half_of_it.lo + half_of_it.hi);
}

#else

kernel __attribute__((reqd_work_group_size(WORKGROUP, 1, 1))) void interflect_read(global const float* data, global float* sums,
                                                                        const StreamArguments a) {
  local float scratch[WORKGROUP];
  const uint l = get_local_id(0);
  const uint first = (uint)((ulong)a.lines * get_group_id(0) / get_num_groups(0));
  const uint last = (uint)((ulong)a.lines * (get_group_id(0) + 1) / get_num_groups(0));
  global const float* part = data + (size_t)first * 16;
  const uint quads = (last - first) * 4;  // a work-item reads four floats at once, neighbours side by side
  const uint length = quads / STREAMS / WORKGROUP * WORKGROUP;
  float4 sum[STREAMS];
#pragma unroll
  for (uint s = 0; s < STREAMS; ++s) sum[s] = 0;
  for (uint i = l; i < length; i += WORKGROUP) {
#pragma unroll
    for (uint s = 0; s < STREAMS; ++s) sum[s] += vload4(s * length + i, part);
  }
  float4 all = sum[0];
#pragma unroll
  for (uint s = 1; s < STREAMS; ++s) all += sum[s];
  for (uint i = STREAMS * length + l; i < quads; i += WORKGROUP) all += vload4(i, part);

  scratch[l] = sum4(all);
  for (uint width = WORKGROUP / 2; width > 0; width /= 2) {
    barrier(CLK_LOCAL_MEM_FENCE);
    if (l < width) scratch[l] += scratch[l + width];
  }
  if (l == 0) sums[get_group_id(0)] = scratch[0];
}

#endif
