// Copies memory: with `read`, a device's bandwidth. Contract: kernels/README.md.
//
// Memory traffic of a launch: 64 * lines bytes read and as many written.

typedef struct {
  uint lines;
} StreamArguments;

kernel __attribute__((reqd_work_group_size(WORKGROUP, 1, 1))) void interflect_copy(global const float* from, global float* to,
                                                                        const StreamArguments a) {
  // A group copies a contiguous part.
  const uint first = (uint)((ulong)a.lines * get_group_id(0) / get_num_groups(0));
  const uint last = (uint)((ulong)a.lines * (get_group_id(0) + 1) / get_num_groups(0));
#if WORKGROUP == 1
  for (uint i = first; i < last; ++i) {
    const float16 line = vload16(i, from);
#if defined(__clang__) && __has_builtin(__builtin_nontemporal_store)
    __builtin_nontemporal_store(line, (global float16*)to + i);  // past the cache, without reading the line first
#else
    vstore16(line, i, to);
#endif
  }
#else
  const size_t end = (size_t)last * 4;
  for (size_t i = (size_t)first * 4 + get_local_id(0); i < end; i += WORKGROUP) vstore4(vload4(i, from), i, to);
#endif
}
