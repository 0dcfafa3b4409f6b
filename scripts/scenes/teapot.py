"""Newell's teapot from his published Bezier patches, as one closed surface.

Body, rim and lid are turned: their patches are quarter turns of these profile curves. Handle and spout are cut off where
they meet the body, and the body is cut out there, so that no part of them is buried in it. The mouth of the spout is
closed. The pot has no bottom of its own: its lowest ring is the loop with which it stands on a table.
"""

import math

from .triangulate import distance2, inside, triangulate
from .turned import strip

# Profile curves as (radius, height), going up: body (two curves), rim, then lid (two curves).
BODY = [[(1.5, 0.15), (1.5, 0.225), (2.0, 0.45), (2.0, 0.9)], [(2.0, 0.9), (2.0, 1.35), (1.75, 1.875), (1.5, 2.4)]]
RIM = [[(1.5, 2.4), (1.4375, 2.53125), (1.3375, 2.53125), (1.4, 2.4)]]
LID = [[(1.3, 2.4), (1.3, 2.55), (0.4, 2.55), (0.2, 2.7)], [(0.2, 2.7), (0.0, 2.85), (0.8, 3.15), (0.0, 3.15)]]

# Half of each tube's patches (y <= 0; the other half is its mirror image): rows along the tube, four points around.
HANDLE = [
    [(-1.6, 0, 2.025), (-1.6, -0.3, 2.025), (-1.5, -0.3, 2.25), (-1.5, 0, 2.25)],
    [(-2.3, 0, 2.025), (-2.3, -0.3, 2.025), (-2.5, -0.3, 2.25), (-2.5, 0, 2.25)],
    [(-2.7, 0, 2.025), (-2.7, -0.3, 2.025), (-3.0, -0.3, 2.25), (-3.0, 0, 2.25)],
    [(-2.7, 0, 1.8), (-2.7, -0.3, 1.8), (-3.0, -0.3, 1.8), (-3.0, 0, 1.8)],
    [(-2.7, 0, 1.575), (-2.7, -0.3, 1.575), (-3.0, -0.3, 1.35), (-3.0, 0, 1.35)],
    [(-2.5, 0, 1.125), (-2.5, -0.3, 1.125), (-2.65, -0.3, 0.9375), (-2.65, 0, 0.9375)],
    [(-2.0, 0, 0.9), (-2.0, -0.3, 0.9), (-1.9, -0.3, 0.6), (-1.9, 0, 0.6)],
]
SPOUT = [
    [(1.7, 0, 1.425), (1.7, -0.66, 1.425), (1.7, -0.66, 0.6), (1.7, 0, 0.6)],
    [(2.6, 0, 1.425), (2.6, -0.66, 1.425), (3.1, -0.66, 0.825), (3.1, 0, 0.825)],
    [(2.3, 0, 2.1), (2.3, -0.25, 2.1), (2.4, -0.25, 2.025), (2.4, 0, 2.025)],
    [(2.7, 0, 2.4), (2.7, -0.25, 2.4), (3.3, -0.25, 2.4), (3.3, 0, 2.4)],
    [(2.8, 0, 2.475), (2.8, -0.25, 2.475), (3.525, -0.25, 2.49375), (3.525, 0, 2.49375)],
    [(2.9, 0, 2.475), (2.9, -0.15, 2.475), (3.45, -0.15, 2.5125), (3.45, 0, 2.5125)],
    [(2.8, 0, 2.4), (2.8, -0.15, 2.4), (3.2, -0.15, 2.4), (3.2, 0, 2.4)],
]


def bezier(points, t):
    b = ((1 - t)**3, 3 * (1 - t)**2 * t, 3 * (1 - t) * t * t, t**3)
    return tuple(sum(w * p[k] for w, p in zip(b, points)) for k in range(len(points[0])))


def tube_point(rows, t, s):
    """t in [0, 2] along the two patches (a little outside: straight on), s in [0, 2] once around."""
    if t < 0 or t > 2:
        end = 0.0 if t < 0 else 2.0
        a, b = tube_point(rows, end, s), tube_point(rows, abs(end - 0.001), s)
        return tuple(p + (p - q) * abs(t - end) / 0.001 for p, q in zip(a, b))
    first = 0 if t < 1 else 3
    half = s if s <= 1 else 2 - s
    x, y, z = bezier([bezier(row, half) for row in rows[first:first + 4]], t - (first == 3))
    return (x, y if s <= 1 else -y, z)


def sample(curves, steps):
    out = [curves[0][0]]
    for c in curves:
        out += [bezier(c, (k + 1) / steps) for k in range(steps)]
    return out


def radius_at(profile, height):
    for (r, h), (s, g) in zip(profile, profile[1:]):
        if h <= height <= g:
            return r + (s - r) * (height - h) / (g - h)
    return 0.0


def meets_body(rows, s, profile, start, end):
    """The t between start (inside the body) and end (outside) at which the tube's line s passes through the body."""
    def outside(t):
        x, y, z = tube_point(rows, t, s)
        return math.hypot(x, y) > radius_at(profile, z)
    for _ in range(50):
        middle = (start + end) / 2
        start, end = (start, middle) if outside(middle) else (middle, end)
    return (start + end) / 2


class Teapot:
    """steps: rows per Bezier curve; sides: corners of the body's rings (a multiple of 4); around, along: of the tubes."""

    def __init__(self, mesh, owner, place, steps, sides, around, along):
        self.mesh, self.owner, self.place = mesh, owner, place
        self.steps, self.sides, self.around, self.along = steps, sides, around, along
        self.profile = sample(BODY, steps)
        self.columns = [2 * math.pi * i / sides for i in range(sides)]
        self.foot = self.ring(*self.profile[0])
        spout = self.tube(SPOUT, None)
        handle = self.tube(HANDLE, 2.0)
        self.side(-sides // 4, [spout[0]])
        self.side(sides // 4, [handle[0], handle[-1]])
        rings = [self.ring(*p) for p in sample(RIM, steps)] + [self.ring(*p) for p in sample(LID, steps)]
        for low, high in zip(rings, rings[1:]):
            strip(mesh, owner, low, high)

    def ring(self, r, h):
        if r < 1e-9:
            return [self.place((0, 0, h))]
        return [self.place((r * math.cos(a), r * math.sin(a), h)) for a in self.columns]

    def tube(self, rows, far_end):
        """Its rings, as (point of the pot, placed point), from where it leaves the body to its other end."""
        lines = []
        for j in range(self.around):
            s = 2 * j / self.around
            t0 = meets_body(rows, s, self.profile, -0.1, 0.4)
            t1 = 2.0 if far_end is None else meets_body(rows, s, self.profile, 2.1, 1.6)
            lines.append([tube_point(rows, t0 + (t1 - t0) * k / self.along, s) for k in range(self.along + 1)])
        rings = [[line[k] for line in lines] for k in range(self.along + 1)]
        placed = [[self.place(p) for p in r] for r in rings]
        for low, high in zip(placed, placed[1:]):
            strip(self.mesh, self.owner, low, high)
        if far_end is None:
            middle = tuple(sum(p[k] for p in rings[-1]) / len(rings[-1]) for k in range(3))
            strip(self.mesh, self.owner, placed[-1], [self.place(middle)])
        return rings

    def side(self, first, holes):
        """Half of the body, from column `first` on, with the holes of tubes, triangulated in the plane of angle and
        height."""
        half, turn = self.sides // 2, 2 * math.pi / self.sides
        where = {}

        def flat(angle, h, r):
            p = (round(1.8e5 * angle), round(1e5 * h))
            where[p] = self.place((r * math.cos(angle), r * math.sin(angle), h))
            return p

        grid = [[flat((first + i) * turn, h, r) for r, h in self.profile] for i in range(half + 1)]
        border = ([g[0] for g in grid] + grid[-1][1:] + [g[-1] for g in grid[-2::-1]] + grid[0][-2:0:-1])
        loops = []
        for hole in holes:
            loop = []
            for x, y, z in hole:
                angle = math.atan2(y, x)
                loop.append(flat(angle + 2 * math.pi * (angle < first * turn), z, math.hypot(x, y)))
            loops.append(loop)
        edges = [e for l in loops for e in zip(l, l[1:] + l[:1])]
        near = (0.3 * 1.8e5 * turn)**2
        points = [p for g in grid[1:-1] for p in g[1:-1]
                  if not inside(loops, *p) and all(distance2(p, *e) > near for e in edges)]
        for t in triangulate([border] + loops, points):
            self.mesh.add(self.owner, *(where[p] for p in t))
