// Whether anything of a hierarchy (host/device/hierarchy.h) lies on a ray: kernels/README.md, "Shared code".
//
// REAL is a float of a ray and LANES one bool for it. Where an invocation traces PACKET > 1 rays together (OpenCL on
// processors), they are vectors: the rays go down the hierarchy as one, into each box that any of them meets. ANY says
// whether that is so of any ray that goes along: in GLSL on processors those of the subgroup, on GPUs the ray alone.
//
// Boxes are made larger by the host, so that rounding loses no triangle where a ray starts within four times the largest
// coordinate of the scene. The test of a triangle looks along the ray: it asks on which side of each edge the ray passes,
// and two triangles that share an edge get the same number with opposite signs, so that no ray slips between them (Woop,
// Benthin and Wald 2013).

#define LEAF_BIT 0x80000000u
#define STACK_SIZE 20u    // most_levels of host/device/hierarchy.h
#define NARROWEST 1e-18f  // of a direction's component, so that its reciprocal is finite

/// Rays as they are traced.
STRUCT(Rays) {
  REAL ox, oy, oz;     // origin
  REAL ix, iy, iz;     // reciprocals of the direction
  REAL sx, sy, sz;     // origin times them
  REAL ax, ay, az;     // two directions across the ray's
  REAL bx, by, bz;
  REAL tx, ty, tz;     // t of a point p is this times p - origin
  REAL near, far;      // far < near: the ray is done
};

/// The reciprocal of a direction's component.
FUNCTION REAL finite_reciprocal(REAL x) {
  const LANES narrow = absolute(x) < NARROWEST;
  return 1.0f / (narrow ? FILL_REAL(NARROWEST) : x);
}

FUNCTION Rays make_rays(REAL ox, REAL oy, REAL oz, REAL dx, REAL dy, REAL dz, REAL near, REAL far) {
  Rays r;
  r.ox = ox;
  r.oy = oy;
  r.oz = oz;
  r.ix = finite_reciprocal(dx);
  r.iy = finite_reciprocal(dy);
  r.iz = finite_reciprocal(dz);
  r.sx = ox * r.ix;
  r.sy = oy * r.iy;
  r.sz = oz * r.iz;
  // (z, 0, -x) and (0, z, -y) where z is the largest component, and so on round.
  const REAL zero = FILL_REAL(0.0f);
  const REAL x = absolute(dx);
  const REAL y = absolute(dy);
  const REAL z = absolute(dz);
  const LANES along_z = (z >= x) && (z >= y);
  const LANES along_y = (y >= x) && (y > z);
  r.ax = along_z ? dz : along_y ? dy : -dy;
  r.ay = along_z ? zero : along_y ? -dx : dx;
  r.az = along_z ? -dx : zero;
  r.bx = along_z ? zero : along_y ? zero : -dz;
  r.by = along_z ? dz : along_y ? -dz : zero;
  r.bz = along_z ? -dy : along_y ? dy : dx;
  const REAL shorter = 1.0f / (dx * dx + dy * dy + dz * dz);
  r.tx = dx * shorter;
  r.ty = dy * shorter;
  r.tz = dz * shorter;
  r.near = near;
  r.far = far;
  return r;
}

/// A point as a ray sees it: across, up, and how far along.
STRUCT(Seen) {
  REAL x, y, t;
};
FUNCTION Seen seen_from(Rays r, float px, float py, float pz) {
  const REAL x = px - r.ox;
  const REAL y = py - r.oy;
  const REAL z = pz - r.oz;
  Seen s;
  s.x = MULTIPLY_ADD(x, r.ax, MULTIPLY_ADD(y, r.ay, z * r.az));
  s.y = MULTIPLY_ADD(x, r.bx, MULTIPLY_ADD(y, r.by, z * r.bz));
  s.t = MULTIPLY_ADD(x, r.tx, MULTIPLY_ADD(y, r.ty, z * r.tz));
  return s;
}

/// Which rays meet the triangle between near and far.
FUNCTION LANES meet_triangle(Rays r, float ax, float ay, float az, float bx, float by, float bz, float cx, float cy,
                             float cz) {
  const Seen a = seen_from(r, ax, ay, az);
  const Seen b = seen_from(r, bx, by, bz);
  const Seen c = seen_from(r, cx, cy, cz);
  const REAL u = product_difference(b.x, c.y, b.y, c.x);
  const REAL v = product_difference(c.x, a.y, c.y, a.x);
  const REAL w = product_difference(a.x, b.y, a.y, b.x);
  // All of one sign: inside, seen from the front or the back. Then t = along / area lies between near and far where both
  // differences have the area's sign.
  const REAL area = u + v + w;
  const REAL along = MULTIPLY_ADD(u, a.t, MULTIPLY_ADD(v, b.t, w * c.t));
  const REAL behind = along - area * r.near;
  const REAL before = area * r.far - along;
  const REAL least = smaller(smaller(u, v), w);
  const REAL most = larger(larger(u, v), w);
  return ((least >= 0.0f) && (behind > 0.0f) && (before > 0.0f)) ||
         ((most <= 0.0f) && (behind < 0.0f) && (before < 0.0f));
}

#if PACKET == 1

/// Which of a node's children the ray meets, a bit for each: the sides that it meets first and last, four boxes at once.
FUNCTION uint children_met(HIERARCHY_PARAMETERS uint node, Rays r) {
  const uvec4 corner = NODE_WORDS(node * 4u);
  const uvec4 low = NODE_WORDS(node * 4u + 1u);
  const uvec4 high = NODE_WORDS(node * 4u + 2u);
  const float x = float_of_bits(corner.x) - r.ox;
  const float y = float_of_bits(corner.y) - r.oy;
  const float z = float_of_bits(corner.z) - r.oz;
  const float step_x = float_of_bits((corner.w & 255u) << 23) * r.ix;
  const float step_y = float_of_bits(((corner.w >> 8) & 255u) << 23) * r.iy;
  const float step_z = float_of_bits(((corner.w >> 16) & 255u) << 23) * r.iz;
  const bool up_x = r.ix >= 0.0f;
  const bool up_y = r.iy >= 0.0f;
  const bool up_z = r.iz >= 0.0f;
  const vec4 x0 = bytes_of(up_x ? low.x : high.x) * step_x + x * r.ix;
  const vec4 x1 = bytes_of(up_x ? high.x : low.x) * step_x + x * r.ix;
  const vec4 y0 = bytes_of(up_y ? low.y : high.y) * step_y + y * r.iy;
  const vec4 y1 = bytes_of(up_y ? high.y : low.y) * step_y + y * r.iy;
  const vec4 z0 = bytes_of(up_z ? low.z : high.z) * step_z + z * r.iz;
  const vec4 z1 = bytes_of(up_z ? high.z : low.z) * step_z + z * r.iz;
  const vec4 enter = larger(larger(x0, y0), larger(z0, FILL4(r.near)));
  const vec4 leave = smaller(smaller(x1, y1), smaller(z1, FILL4(r.far)));
  return (enter.x <= leave.x ? 1u : 0u) | (enter.y <= leave.y ? 2u : 0u) | (enter.z <= leave.z ? 4u : 0u) |
         (enter.w <= leave.w ? 8u : 0u);
}

#else

/// Which rays meet a box, of centre c and half its sides h.
FUNCTION LANES meet_box(Rays r, float cx, float cy, float cz, float hx, float hy, float hz) {
  const REAL x = MULTIPLY_ADD(cx, r.ix, -r.sx);
  const REAL y = MULTIPLY_ADD(cy, r.iy, -r.sy);
  const REAL z = MULTIPLY_ADD(cz, r.iz, -r.sz);
  const REAL wx = hx * absolute(r.ix);
  const REAL wy = hy * absolute(r.iy);
  const REAL wz = hz * absolute(r.iz);
  return larger(larger(x - wx, y - wy), larger(z - wz, r.near)) <=
         smaller(smaller(x + wx, y + wy), smaller(z + wz, r.far));
}

/// Which of a node's children any ray meets, a bit for each.
FUNCTION uint children_met(HIERARCHY_PARAMETERS uint node, Rays r) {
  const uvec4 corner = NODE_WORDS(node * 4u);
  const uvec4 low = NODE_WORDS(node * 4u + 1u);
  const uvec4 high = NODE_WORDS(node * 4u + 2u);
  // Half of a step of the grid along each axis.
  const float x = float_of_bits((corner.w & 255u) << 23) * 0.5f;
  const float y = float_of_bits(((corner.w >> 8) & 255u) << 23) * 0.5f;
  const float z = float_of_bits(((corner.w >> 16) & 255u) << 23) * 0.5f;
  const vec4 x0 = bytes_of(low.x), y0 = bytes_of(low.y), z0 = bytes_of(low.z);
  const vec4 x1 = bytes_of(high.x), y1 = bytes_of(high.y), z1 = bytes_of(high.z);
  const vec4 cx = (x1 + x0) * x + float_of_bits(corner.x), hx = (x1 - x0) * x;
  const vec4 cy = (y1 + y0) * y + float_of_bits(corner.y), hy = (y1 - y0) * y;
  const vec4 cz = (z1 + z0) * z + float_of_bits(corner.z), hz = (z1 - z0) * z;
  return (ANY(meet_box(r, cx.x, cy.x, cz.x, hx.x, hy.x, hz.x)) ? 1u : 0u) |
         (ANY(meet_box(r, cx.y, cy.y, cz.y, hx.y, hy.y, hz.y)) ? 2u : 0u) |
         (ANY(meet_box(r, cx.z, cy.z, cz.z, hx.z, hy.z, hz.z)) ? 4u : 0u) |
         (ANY(meet_box(r, cx.w, cy.w, cz.w, hx.w, hy.w, hz.w)) ? 8u : 0u);
}

#endif

/// Which rays meet one of a leaf's triangles.
FUNCTION LANES meet_leaf(HIERARCHY_PARAMETERS uint leaf, Rays r) {
  const uint at = leaf * 9u;
  const vec4 ax = LEAF_FOUR(at), ay = LEAF_FOUR(at + 1u), az = LEAF_FOUR(at + 2u);
  const vec4 bx = LEAF_FOUR(at + 3u), by = LEAF_FOUR(at + 4u), bz = LEAF_FOUR(at + 5u);
  const vec4 cx = LEAF_FOUR(at + 6u), cy = LEAF_FOUR(at + 7u), cz = LEAF_FOUR(at + 8u);
  return meet_triangle(r, ax.x, ay.x, az.x, bx.x, by.x, bz.x, cx.x, cy.x, cz.x) ||
         meet_triangle(r, ax.y, ay.y, az.y, bx.y, by.y, bz.y, cx.y, cy.y, cz.y) ||
         meet_triangle(r, ax.z, ay.z, az.z, bx.z, by.z, bz.z, cx.z, cy.z, cz.z) ||
         meet_triangle(r, ax.w, ay.w, az.w, bx.w, by.w, bz.w, cx.w, cy.w, cz.w);
}

/// Traces the rays. `far` of those that meet something is then below `near`.
///
/// What has still to be visited is a node and bits of its children: (node << 4) | bits, on the stack one for each level.
/// The inner loop goes down to a leaf, so that invocations that run in step reach their leaves together.
FUNCTION Rays trace(HIERARCHY_PARAMETERS Rays r) {
  uint stack[STACK_SIZE];
  uint waiting = 0u;
  uint node = 0u;  // the root
  uint bits = children_met(HIERARCHY node, r);
  bool more = ANY(r.far > r.near);
  while (more) {
    uint child = 0u;
    while (more && (child & LEAF_BIT) == 0u) {
      if (bits == 0u) {
        more = waiting > 0u;
        if (more) {
          bits = stack[--waiting];
          node = bits >> 4;
          bits &= 15u;
        }
      }
      if (more) {
        const uvec4 all = NODE_WORDS(node * 4u + 3u);
        child = (bits & 8u) != 0u ? all.w : (bits & 4u) != 0u ? all.z : (bits & 2u) != 0u ? all.y : all.x;
        bits &= (bits & 8u) != 0u ? 7u : (bits & 4u) != 0u ? 3u : (bits & 2u) != 0u ? 1u : 0u;
        if ((child & LEAF_BIT) == 0u) {
          if (bits != 0u) stack[waiting++] = (node << 4) | bits;
          node = child;
          bits = children_met(HIERARCHY node, r);
        }
      }
    }
    if (more) {
      r.far = meet_leaf(HIERARCHY child & ~LEAF_BIT, r) ? FILL_REAL(-1.0f) : r.far;
      more = ANY(r.far > r.near);
    }
  }
  return r;
}

#if PACKET == 1

/// Whether a triangle lies at origin + t direction, near < t < far, with 0 <= near; nothing does where far <= near.
FUNCTION bool occluded(HIERARCHY_PARAMETERS vec3 origin, vec3 direction, float near, float far) {
  const Rays r =
      trace(HIERARCHY make_rays(origin.x, origin.y, origin.z, direction.x, direction.y, direction.z, near, far));
  return r.far < near && near < far;
}

#endif

/// Up to PACKET rays that an invocation traces at once: PUT_RAY for each k below PACKET, PUT_NO_RAY where there is none.
STRUCT(RayBatch) {
  float origin_x[PACKET], origin_y[PACKET], origin_z[PACKET], near[PACKET];
  float direction_x[PACKET], direction_y[PACKET], direction_z[PACKET], far[PACKET];
};
#define PUT_RAY(batch, k, from, nearest, along, farthest) \
  {                                                       \
    batch.origin_x[k] = (from).x;                         \
    batch.origin_y[k] = (from).y;                         \
    batch.origin_z[k] = (from).z;                         \
    batch.near[k] = nearest;                              \
    batch.direction_x[k] = (along).x;                     \
    batch.direction_y[k] = (along).y;                     \
    batch.direction_z[k] = (along).z;                     \
    batch.far[k] = farthest;                              \
  }
#define PUT_NO_RAY(batch, k) PUT_RAY(batch, k, VEC3(0.0f, 0.0f, 0.0f), 0.0f, VEC3(1.0f, 1.0f, 1.0f), -1.0f)

/// Bit k: whether a triangle lies on ray k of the batch, as occluded() says it.
FUNCTION uint occluded_batch(HIERARCHY_PARAMETERS RayBatch batch) {
#if PACKET == 1
  return occluded(HIERARCHY VEC3(batch.origin_x[0], batch.origin_y[0], batch.origin_z[0]),
                  VEC3(batch.direction_x[0], batch.direction_y[0], batch.direction_z[0]), batch.near[0], batch.far[0])
             ? 1u
             : 0u;
#else
  const Rays r = trace(HIERARCHY make_rays(LOAD_REAL(batch.origin_x), LOAD_REAL(batch.origin_y), LOAD_REAL(batch.origin_z),
                                           LOAD_REAL(batch.direction_x), LOAD_REAL(batch.direction_y),
                                           LOAD_REAL(batch.direction_z), LOAD_REAL(batch.near), LOAD_REAL(batch.far)));
  float far[PACKET];
  STORE_REAL(r.far, far);
  uint found = 0u;
  for (uint k = 0u; k < PACKET; ++k) {
    if (far[k] < batch.near[k] && batch.near[k] < batch.far[k]) found |= 1u << k;
  }
  return found;
#endif
}
