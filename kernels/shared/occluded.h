// Whether anything of a hierarchy (host/device/hierarchy.h) lies on a ray: kernels/README.md, "Shared code". A ray takes one
// node or leaf at a time, four boxes or four triangles at once, and keeps what it has still to visit on a stack.
//
// A box is larger by the rounding of its own test, so that no triangle is missed. The test of a triangle asks on which side
// of each edge the ray passes (Pluecker coordinates relative to the ray's origin): two triangles that share an edge get the
// same number with opposite signs, so that no ray slips between them (as in Woop, Benthin and Wald 2013).

#define LEAF_BIT 0x80000000u
#define STACK_SIZE 64u    // three for each level and one: most_levels of host/device/hierarchy.h is 20
#define ROUNDINGS 9.6e-7f  // 16 * 2^-24: a box's t goes through at most 9
#define NARROWEST 1e-18f  // of a direction's component, so that its reciprocal is finite

/// The reciprocal of a direction's component.
FUNCTION float finite_reciprocal(float x) {
  return 1.0f / (absolute(x) < NARROWEST ? NARROWEST : x);
}

/// (b - a) x (b + a) . d for four edges at once: exactly the negative for the edge from b to a.
FUNCTION vec4 side_of_edge(vec4 ax, vec4 ay, vec4 az, vec4 bx, vec4 by, vec4 bz, vec3 d) {
  const vec4 ex = bx - ax;
  const vec4 ey = by - ay;
  const vec4 ez = bz - az;
  const vec4 sx = bx + ax;
  const vec4 sy = by + ay;
  const vec4 sz = bz + az;
  return (ey * sz - ez * sy) * d.x + (ez * sx - ex * sz) * d.y + (ex * sy - ey * sx) * d.z;
}

/// Whether one of a leaf's four triangles lies on the ray.
FUNCTION bool leaf_hides(HIERARCHY_PARAMETERS uint leaf, vec3 origin, vec3 d, float near, float far) {
  const uint at = (leaf & ~LEAF_BIT) * 9u;
  const vec4 ax = LEAF_FOUR(at) - origin.x;
  const vec4 ay = LEAF_FOUR(at + 1u) - origin.y;
  const vec4 az = LEAF_FOUR(at + 2u) - origin.z;
  const vec4 bx = LEAF_FOUR(at + 3u) - origin.x;
  const vec4 by = LEAF_FOUR(at + 4u) - origin.y;
  const vec4 bz = LEAF_FOUR(at + 5u) - origin.z;
  const vec4 cx = LEAF_FOUR(at + 6u) - origin.x;
  const vec4 cy = LEAF_FOUR(at + 7u) - origin.y;
  const vec4 cz = LEAF_FOUR(at + 8u) - origin.z;
  const vec4 u = side_of_edge(ax, ay, az, bx, by, bz, d);
  const vec4 v = side_of_edge(bx, by, bz, cx, cy, cz, d);
  const vec4 w = side_of_edge(cx, cy, cz, ax, ay, az, d);
  // All of one sign: inside, seen from the front or the back.
  const vec4 slack = absolute(u + v + w) * 2.4e-7f;
  const vec4 inside = larger(smaller(smaller(u, v), w) + slack, slack - larger(larger(u, v), w));
  // t = height / slope between near and far: the differences have the sign of the slope, both.
  const vec4 px = bx - ax;
  const vec4 py = by - ay;
  const vec4 pz = bz - az;
  const vec4 qx = cx - ax;
  const vec4 qy = cy - ay;
  const vec4 qz = cz - az;
  const vec4 nx = py * qz - pz * qy;
  const vec4 ny = pz * qx - px * qz;
  const vec4 nz = px * qy - py * qx;
  const vec4 slope = nx * d.x + ny * d.y + nz * d.z;
  const vec4 height = nx * ax + ny * ay + nz * az;
  const vec4 behind = height - slope * near;
  const vec4 before = slope * far - height;
  const vec4 hit = smaller(inside, larger(smaller(behind, before), -larger(behind, before)));
  return larger(larger(hit.x, hit.y), larger(hit.z, hit.w)) > 0.0f;
}

/// For each of a node's four children: below zero where the ray misses its box.
FUNCTION vec4 common_length(HIERARCHY_PARAMETERS uint node, vec3 origin, vec3 inverse, float near, float far) {
  const uvec4 corner = NODE_WORDS(node * 4u);
  const uvec4 low = NODE_WORDS(node * 4u + 1u);
  const uvec4 high = NODE_WORDS(node * 4u + 2u);
  const vec3 scale =
      VEC3(float_of_bits((corner.w & 255u) << 23), float_of_bits(((corner.w >> 8) & 255u) << 23),
           float_of_bits(((corner.w >> 16) & 255u) << 23)) * inverse;
  const vec3 start =
      (VEC3(float_of_bits(corner.x), float_of_bits(corner.y), float_of_bits(corner.z)) - origin) * inverse;
  const vec3 slack = (absolute(start) + absolute(scale) * 256.0f) * ROUNDINGS;
  const vec3 enter = start - slack;
  const vec3 leave = start + slack;
  const bool px = inverse.x >= 0.0f;
  const bool py = inverse.y >= 0.0f;
  const bool pz = inverse.z >= 0.0f;
  const vec4 x0 = bytes_of(px ? low.x : high.x) * scale.x + enter.x;
  const vec4 y0 = bytes_of(py ? low.y : high.y) * scale.y + enter.y;
  const vec4 z0 = bytes_of(pz ? low.z : high.z) * scale.z + enter.z;
  const vec4 x1 = bytes_of(px ? high.x : low.x) * scale.x + leave.x;
  const vec4 y1 = bytes_of(py ? high.y : low.y) * scale.y + leave.y;
  const vec4 z1 = bytes_of(pz ? high.z : low.z) * scale.z + leave.z;
  return smaller(smaller(x1, y1), smaller(z1, FILL4(far))) - larger(larger(x0, y0), larger(z0, FILL4(near)));
}

/// Whether a triangle lies at origin + t direction, near < t < far. Nothing does where far < near. Invocations of a
/// work-group may call it together or apart.
FUNCTION bool occluded(HIERARCHY_PARAMETERS vec3 origin, vec3 direction, float near, float far) {
  const vec3 inverse =
      VEC3(finite_reciprocal(direction.x), finite_reciprocal(direction.y), finite_reciprocal(direction.z));
  uint stack[STACK_SIZE];
  uint waiting = 0u;
  uint next = 0u;  // the root
  bool found = false;
  bool more = far > near;
  while (more) {
    if ((next & LEAF_BIT) != 0u) {
      found = leaf_hides(HIERARCHY next, origin, direction, near, far);
    } else {
      const vec4 common = common_length(HIERARCHY next, origin, inverse, near, far);
      const uvec4 child = NODE_WORDS(next * 4u + 3u);
      if (common.x >= 0.0f) stack[waiting++] = child.x;
      if (common.y >= 0.0f) stack[waiting++] = child.y;
      if (common.z >= 0.0f) stack[waiting++] = child.z;
      if (common.w >= 0.0f) stack[waiting++] = child.w;
    }
    more = !found && waiting > 0u;
    if (more) next = stack[--waiting];
  }
  return found;
}
