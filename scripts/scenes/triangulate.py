"""Constrained Delaunay triangulation of a polygon with holes, in exact integer arithmetic.

Incremental insertion with Lawson's flips, missing constraint edges recovered by flipping what crosses them (Sloan 1993).
Deterministic: the same points in the same order give the same triangles on every machine.
"""


def orient(p, q, r):
    """Twice the signed area of p, q, r; positive if they run counter-clockwise."""
    return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])


def in_circle(p, q, r, s):
    """Positive if s lies inside the circle through p, q, r (counter-clockwise)."""
    ax, ay = p[0] - s[0], p[1] - s[1]
    bx, by = q[0] - s[0], q[1] - s[1]
    cx, cy = r[0] - s[0], r[1] - s[1]
    return ((ax * ax + ay * ay) * (bx * cy - cx * by) - (bx * bx + by * by) * (ax * cy - cx * ay)
            + (cx * cx + cy * cy) * (ax * by - bx * ay))


def sheared(p):
    """The point in a plane sheared a little, in which no four points of a grid lie on one circle: all diagonals of a
    grid run the same way."""
    return (1024 * p[0] + p[1], 1024 * p[1])


class Triangulation:
    """Triangles kept as edge[(a, b)] = c for each directed edge of the triangle a, b, c."""

    def __init__(self, points):
        self.points = list(points)
        span = 1 + max(max(abs(x), abs(y)) for x, y in points)
        far = 64 * span
        self.count = len(points)
        self.points += [(-far, -far), (3 * far, -far + 1), (-far + 3, 3 * far)]
        self.circle = [sheared(p) for p in self.points]
        self.edge = {}
        self.add(self.count, self.count + 1, self.count + 2)
        self.last = (self.count, self.count + 1)
        for i in range(self.count):
            self.insert(i)

    def add(self, a, b, c):
        self.edge[a, b] = c
        self.edge[b, c] = a
        self.edge[c, a] = b
        self.last = (a, b)

    def remove(self, a, b, c):
        del self.edge[a, b], self.edge[b, c], self.edge[c, a]

    def locate(self, i):
        p = self.points[i]
        a, b = self.last
        while True:
            c = self.edge[a, b]
            for u, v in ((a, b), (b, c), (c, a)):
                if orient(self.points[u], self.points[v], p) < 0:
                    a, b = v, u
                    break
            else:
                return a, b, c

    def insert(self, i):
        a, b, c = self.locate(i)
        p = self.points[i]
        for u, v, w in ((a, b, c), (b, c, a), (c, a, b)):
            if orient(self.points[u], self.points[v], p) == 0:
                d = self.edge[v, u]
                self.remove(u, v, w)
                self.remove(v, u, d)
                for s, t in ((v, w), (w, u), (u, d), (d, v)):
                    self.add(i, s, t)
                self.legalise([(v, w), (w, u), (u, d), (d, v)], i)
                return
        self.remove(a, b, c)
        for s, t in ((a, b), (b, c), (c, a)):
            self.add(i, s, t)
        self.legalise([(a, b), (b, c), (c, a)], i)

    def legalise(self, edges, i):
        while edges:
            a, b = edges.pop()
            d = self.edge.get((b, a))
            if d is not None and self.wants_flip(a, b, i, d):
                self.flip(a, b)
                edges += [(a, d), (d, b)]

    def wants_flip(self, a, b, c, d):
        q = self.circle
        return in_circle(q[a], q[b], q[c], q[d]) > 0

    def flip(self, a, b):
        c, d = self.edge[a, b], self.edge[b, a]
        self.remove(a, b, c)
        self.remove(b, a, d)
        self.add(c, a, d)
        self.add(c, d, b)

    def crosses(self, a, b, u, v):
        p = self.points
        if len({a, b, u, v}) < 4:
            return False
        return (orient(p[u], p[v], p[a]) > 0) != (orient(p[u], p[v], p[b]) > 0) and (
            orient(p[a], p[b], p[u]) > 0) != (orient(p[a], p[b], p[v]) > 0)

    def recover(self, u, v):
        """Flips until the edge u, v is there."""
        if (u, v) in self.edge or (v, u) in self.edge:
            return
        queue = [e for e in self.edge if e[0] < e[1] and self.crosses(*e, u, v)]
        for _ in range(100000):
            if not queue:
                break
            a, b = queue.pop(0)
            c, d = self.edge[a, b], self.edge[b, a]
            p = self.points
            if orient(p[c], p[a], p[d]) > 0 and orient(p[c], p[d], p[b]) > 0:
                self.flip(a, b)
                if self.crosses(c, d, u, v):
                    queue.append((c, d))
            else:
                queue.append((a, b))
        if (u, v) not in self.edge and (v, u) not in self.edge:
            raise ValueError("cannot recover the edge %s - %s" % (self.points[u], self.points[v]))

    def relax(self, fixed):
        """Lawson's flips on all edges but the fixed ones, until every one is Delaunay."""
        queue = [e for e in self.edge if e[0] < e[1]]
        while queue:
            a, b = queue.pop()
            if (a, b) in fixed or (b, a) in fixed or (a, b) not in self.edge or (b, a) not in self.edge:
                continue
            c, d = self.edge[a, b], self.edge[b, a]
            p = self.points
            if orient(p[c], p[a], p[d]) > 0 and orient(p[c], p[d], p[b]) > 0 and self.wants_flip(a, b, c, d):
                self.flip(a, b)
                queue += [(a, c), (a, d), (b, c), (b, d)]

    def triangles(self, fixed):
        """The triangles inside the fixed edges, each from its smallest vertex on: those to which one comes from outside
        over an odd number of fixed edges."""
        start = (self.count, self.count + 1) if (self.count, self.count + 1) in self.edge else (self.count + 1, self.count)
        todo, seen, out = [(start, False)], set(), []
        while todo:
            (a, b), odd = todo.pop()
            if (a, b) in seen:
                continue
            c = self.edge[a, b]
            seen.update(((a, b), (b, c), (c, a)))
            if odd:
                out.append((a, b, c) if a < b and a < c else (b, c, a) if b < c else (c, a, b))
            for u, v in ((a, b), (b, c), (c, a)):
                if (v, u) in self.edge and (v, u) not in seen:
                    todo.append(((v, u), odd != ((u, v) in fixed or (v, u) in fixed)))
        return sorted(out)


def inside(loops, x, y):
    """Whether (x, y) lies inside the loops, by the even-odd rule."""
    odd = False
    for loop in loops:
        px, py = loop[-1]
        for qx, qy in loop:
            if (py > y) != (qy > y):
                # Side of the edge, without a division.
                side = (qx - px) * (y - py) - (qy - py) * (x - px)
                if (side < 0) == (qy > py):
                    odd = not odd
            px, py = qx, qy
    return odd


def distance2(p, a, b):
    """Squared distance of p from the segment a, b (floating point; only used to leave out points)."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    t = ((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / (dx * dx + dy * dy)
    t = min(1.0, max(0.0, t))
    x, y = a[0] + t * dx - p[0], a[1] + t * dy - p[1]
    return x * x + y * y


def triangulate(loops, points=()):
    """Triangles (as triples of points, counter-clockwise) that fill the loops by the even-odd rule. The loops are lists of
    integer points, whose edges all become edges of triangles; `points` are further points inside."""
    index = {}
    for p in [p for loop in loops for p in loop] + list(points):
        index.setdefault(p, len(index))
    mesh = Triangulation(list(index))
    fixed = set()
    for loop in loops:
        for a, b in zip(loop, loop[1:] + loop[:1]):
            mesh.recover(index[a], index[b])
            fixed.add((index[a], index[b]))
    mesh.relax(fixed)
    return [tuple(mesh.points[i] for i in t) for t in mesh.triangles(fixed)]
