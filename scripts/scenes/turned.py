"""Turned things: surfaces of revolution about an upright axis, in integer coordinates."""

import math


def ring(x, z, r, y, n):
    """n points of the circle of radius r about (x, z) at height y, counter-clockwise seen from above; one if r is 0."""
    if r == 0:
        return [(x, y, z)]
    return [(x + round(r * math.cos(2 * math.pi * i / n)), y, z - round(r * math.sin(2 * math.pi * i / n)))
            for i in range(n)]


def strip(mesh, owner, low, high, flip=False):
    """Joins two rings of equal length, or a ring and a point; low before high on the way up the outside."""
    n = max(len(low), len(high))
    for i in range(n):
        a, b = low[i % len(low)], low[(i + 1) % len(low)]
        d, c = high[i % len(high)], high[(i + 1) % len(high)]
        if len(low) == 1:
            mesh.add(owner, a, c, d)
        elif len(high) == 1:
            mesh.add(owner, a, b, c)
        elif (i % 2 == 0) != flip:
            mesh.add(owner, a, b, c)
            mesh.add(owner, a, c, d)
        else:
            mesh.add(owner, a, b, d)
            mesh.add(owner, b, c, d)


def turn(mesh, x, z, n, profile):
    """profile: (owner, radius, height) from bottom to top along the outside; each owner holds for the strip that ends
    there. A profile that comes back to its start is a hollow ring (a lamp shade). Returns the rings."""
    rings = [ring(x, z, r, y, n) for _, r, y in profile]
    for k in range(1, len(rings)):
        strip(mesh, profile[k][0], rings[k - 1], rings[k], k % 2 == 0)
    return rings


def ball(owner, r, y, steps, start=0.0, end=1.0):
    """Profile of a sphere of radius r with centre height y, from polar angle start * 180 degrees (0: bottom) to end."""
    out = []
    for k in range(steps + 1):
        a = math.pi * (start + (end - start) * k / steps)
        s = math.sin(a)
        out.append((owner, 0 if s < 1e-9 else round(r * s), y - round(r * math.cos(a))))
    return out
