// The sum of a value over the work-group, always in the same order. Every invocation must call it.
// SUBGROUPS: how many subgroups a work-group has at most; 1 where it is a single one; not defined where subgroups
// cannot add.

#if defined(SUBGROUPS) && SUBGROUPS == 1

float group_sum(float value) { return subgroupAdd(value); }

#elif defined(SUBGROUPS)

shared float of_subgroup[SUBGROUPS];

float group_sum(float value) {
  const float sum = subgroupAdd(value);
  if (subgroupElect()) of_subgroup[gl_SubgroupID] = sum;
  barrier();
  float all = 0.0;
  for (uint s = 0u; s < gl_NumSubgroups; ++s) all += of_subgroup[s];
  barrier();  // before of_subgroup is written again
  return all;
}

#else

shared float of_invocation[WORKGROUP];

float group_sum(float value) {
  of_invocation[gl_LocalInvocationIndex] = value;
  barrier();
  for (uint width = WORKGROUP / 2u; width > 0u; width /= 2u) {
    if (gl_LocalInvocationIndex < width) {
      of_invocation[gl_LocalInvocationIndex] += of_invocation[gl_LocalInvocationIndex + width];
    }
    barrier();
  }
  const float sum = of_invocation[0];
  barrier();  // before of_invocation is written again
  return sum;
}

#endif
