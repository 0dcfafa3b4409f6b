"""Solids made of boxes: everything that is right-angled in a room, walls included, as one closed surface.

Boxes of matter or air are laid over each other, the later one counts. What comes out is the surface between matter and air:
where a table leg stands on the floor, the floor is cut out and the two share their vertices; nothing lies double, nothing
is buried, no light leaks. Round things are attached by the loop with which they touch a face (see attach).
"""

from .triangulate import distance2, inside, triangulate

AIR = 0


class Bricks:
    """Lengths are integers in the mesh's unit. shapely: circumradius over shortest edge above which a triangle is
    improved (see graded)."""

    def __init__(self, shapely):
        self.shapely = shapely
        self.boxes = []
        self.owners = [None]  # index 0: air
        self.spacing = [0]
        self.index = {}
        self.loops = {}  # (axis, plane, sign) -> loops of round things that stand there
        self.extra = {}  # owner -> number of points to add to its largest upward face

    def matter(self, owner, lo, hi, spacing):
        """A box of matter from corner lo to corner hi; spacing: about how far apart the vertices on it are to lie."""
        lo, hi = tuple(map(min, lo, hi)), tuple(map(max, lo, hi))
        key = (owner, spacing)
        if key not in self.index:
            self.index[key] = len(self.owners)
            self.owners.append(owner)
            self.spacing.append(spacing)
        self.boxes.append((lo, hi, self.index[key]))

    def air(self, lo, hi):
        self.boxes.append((tuple(map(min, lo, hi)), tuple(map(max, lo, hi)), AIR))

    def attach(self, axis, sign, loop):
        """Cuts the loop (points in one plane) out of the face that looks along sign * axis there."""
        self.loops.setdefault((axis, loop[0][axis], sign), []).append(list(loop))

    def build(self, mesh):
        faces = self.faces()
        outlines = {key: outline(cells) for key, cells in faces.items()}
        corners = {place(key, p) for key, edges in outlines.items() for p in turns(edges)}
        chains = {key: chain(edges, key, corners) for key, edges in outlines.items()}
        spacing = {}
        for key, loops in chains.items():
            for loop in loops:
                for a, b in zip(loop, loop[1:] + loop[:1]):
                    s = tuple(sorted((place(key, a), place(key, b))))
                    spacing[s] = min(spacing.get(s, 10**9), self.spacing[key[3]])
        for key in sorted(chains):
            self.face(mesh, key, chains[key], spacing)
        if any(self.loops.values()):
            raise ValueError("loops that stand on no face: %s" % [(k, v) for k, v in self.loops.items() if v])

    def faces(self):
        """(axis, plane index, sign, owner index) -> cells (u, v) of the surface between matter and air."""
        self.axis = [sorted({c for lo, hi, _ in self.boxes for c in (lo[k], hi[k])}) for k in range(3)]
        where = [{c: i for i, c in enumerate(a)} for a in self.axis]
        nx, ny, nz = (len(a) - 1 for a in self.axis)
        rows = [[bytearray(b"\xff" * nx) for _ in range(ny)] for _ in range(nz)]
        for lo, hi, owner in self.boxes:
            x0, x1 = where[0][lo[0]], where[0][hi[0]]
            fill = bytes([owner]) * (x1 - x0)
            for z in range(where[2][lo[2]], where[2][hi[2]]):
                for y in range(where[1][lo[1]], where[1][hi[1]]):
                    rows[z][y][x0:x1] = fill
        rows = [[bytes(r) for r in plane] for plane in rows]
        faces = {}

        def between(a, b, axis, plane, cell):
            if (a == AIR) != (b == AIR):
                sign, owner = (1, a) if b == AIR else (-1, b)
                faces.setdefault((axis, plane, sign, owner), set()).add(cell)

        def different(p, q):
            return [x for x, (a, b) in enumerate(zip(p, q)) if a != b]

        steps = {}
        for z in range(nz):
            for y in range(ny):
                row = rows[z][y]
                if row not in steps:
                    steps[row] = [x for x in range(1, nx) if row[x - 1] != row[x]]
                for x in steps[row]:
                    between(row[x - 1], row[x], 0, x, (y, z))
                if y and rows[z][y - 1] != row:
                    for x in different(rows[z][y - 1], row):
                        between(rows[z][y - 1][x], row[x], 1, y, (z, x))
                if z and rows[z - 1][y] != row:
                    for x in different(rows[z - 1][y], row):
                        between(rows[z - 1][y][x], row[x], 2, z, (x, y))
        if any(key[3] == 255 for key in faces):
            raise ValueError("air reaches the end of the world")
        return faces

    def face(self, mesh, key, chains, spacing):
        axis, plane, sign, owner = key
        u, v = (axis + 1) % 3, (axis + 2) % 3
        loops = []
        for loop in chains:
            points = []
            for a, b in zip(loop, loop[1:] + loop[:1]):
                points += self.cut(key, a, b, spacing)
            loops.append(points)
        at = self.axis[axis][plane]
        standing = self.loops.get((axis, at, sign), [])
        mine = [l for l in standing if inside(loops, l[0][u], l[0][v])]
        standing[:] = [l for l in standing if l not in mine]
        outer = list(loops)
        for l in mine:
            if not all(inside(outer, p[u], p[v]) for p in l):
                raise ValueError("a loop leaves its face: %s" % l)
            loops.append([(p[u], p[v]) for p in l])
        points = grid_points(loops, self.spacing[owner])
        points = graded(loops, points, self.shapely)
        extra = self.extra.get(self.owners[owner], 0) if (axis, sign) == (1, 1) else 0
        triangles = refine(loops, points, extra)
        for t in triangles:
            corners = []
            for p in t:
                c = [0, 0, 0]
                c[axis], c[u], c[v] = at, p[0], p[1]
                corners.append(tuple(c))
            mesh.add(self.owners[owner], *(corners if sign > 0 else corners[::-1]))

    def cut(self, key, a, b, spacing):
        """The points from a up to b (without b), in the plane's coordinates; the same for both faces at this edge."""
        p, q = sorted((place(key, a), place(key, b)))
        u, v = (key[0] + 1) % 3, (key[0] + 2) % 3
        start = [self.axis[k][p[k]] for k in range(3)]
        end = [self.axis[k][q[k]] for k in range(3)]
        n = max(1, round(sum(e - s for s, e in zip(start, end)) / spacing[p, q]))
        points = [tuple(s + (e - s) * i // n for s, e in zip(start, end)) for i in range(n + 1)]
        if place(key, a) != p:
            points.reverse()
        return [(c[u], c[v]) for c in points[:-1]]


def place(key, p):
    """The vertex p = (u, v) of a face as three indices."""
    c = [0, 0, 0]
    c[key[0]], c[(key[0] + 1) % 3], c[(key[0] + 2) % 3] = key[1], p[0], p[1]
    return tuple(c)


def outline(cells):
    """Directed edges around cells, which lie on the left: vertex -> the vertices that follow it."""
    edges = []
    for i, j in cells:
        if (i, j - 1) not in cells:
            edges.append(((i, j), (i + 1, j)))
        if (i + 1, j) not in cells:
            edges.append(((i + 1, j), (i + 1, j + 1)))
        if (i, j + 1) not in cells:
            edges.append(((i + 1, j + 1), (i, j + 1)))
        if (i - 1, j) not in cells:
            edges.append(((i, j + 1), (i, j)))
    out = {}
    for a, b in sorted(edges):
        out.setdefault(a, []).append(b)
    return out


def turns(edges):
    """The vertices at which an outline does not run straight on."""
    before = {}
    for a, following in edges.items():
        for b in following:
            before.setdefault(b, []).append(a)
    return [p for p, following in edges.items() if len(following) > 1
            or (following[0][0] - p[0], following[0][1] - p[1]) != (p[0] - before[p][0][0], p[1] - before[p][0][1])]


def chain(edges, key, corners):
    """The outline as closed loops of those vertices that are a corner of any face."""
    edges = {a: list(b) for a, b in edges.items()}
    loops = []
    for start in sorted(edges):
        while edges[start]:
            loop, p = [], start
            while edges[p]:
                loop.append(p)
                # Where two outlines touch in a vertex, turn left: stay with the same cell.
                last = loop[-2] if len(loop) > 1 else p
                edges[p].sort(key=lambda q: (p[0] - last[0]) * (q[1] - p[1]) - (p[1] - last[1]) * (q[0] - p[0]))
                p = edges[p].pop()
            kept = [q for q in loop if place(key, q) in corners]
            loops.append(kept)
    return loops


def grid_points(loops, spacing):
    """Points about `spacing` apart inside the loops, not near to their edges."""
    xs, ys = [p[0] for l in loops for p in l], [p[1] for l in loops for p in l]
    nx = max(1, round((max(xs) - min(xs)) / spacing))
    ny = max(1, round((max(ys) - min(ys)) / spacing))
    edges = [e for l in loops for e in zip(l, l[1:] + l[:1])]
    near = (0.42 * spacing)**2
    out = []
    for i in range(1, nx):
        for j in range(1, ny):
            p = (min(xs) + (max(xs) - min(xs)) * i // nx, min(ys) + (max(ys) - min(ys)) * j // ny)
            if inside(loops, *p) and all(distance2(p, *e) > near for e in edges):
                out.append(p)
    return out


def graded(loops, points, shapely):
    """Further points until no triangle is slimmer than `shapely`, where that can be had: the circumcentres of slim
    triangles (Chew's refinement), so that triangles grow evenly from a table leg's foot to the floor's grid."""
    points = list(points)
    edges = [e for l in loops for e in zip(l, l[1:] + l[:1])]
    for _ in range(12):
        found = []
        for a, b, c in triangulate(loops, points):
            d = 2.0 * ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
            bb = (b[0] - a[0])**2 + (b[1] - a[1])**2
            cc = (c[0] - a[0])**2 + (c[1] - a[1])**2
            x = ((c[1] - a[1]) * bb - (b[1] - a[1]) * cc) / d
            y = ((b[0] - a[0]) * cc - (c[0] - a[0]) * bb) / d
            short2 = min(bb, cc, (c[0] - b[0])**2 + (c[1] - b[1])**2)
            if x * x + y * y > shapely * shapely * short2:
                found.append(((x * x + y * y) / short2, round(a[0] + x), round(a[1] + y), short2))
        added = []
        for _, x, y, short2 in sorted(found, reverse=True):
            p = (x, y)
            if (inside(loops, x, y) and all(distance2(p, *e) > 0.5 * short2 for e in edges)
                    and all((x - q[0])**2 + (y - q[1])**2 > 1.2 * short2 for q in added + points)):
                added.append(p)
        if not added:
            break
        points += added
    return points


def refine(loops, points, extra):
    """The triangulation, with `extra` further points in the middle of the largest triangles: each gives two more."""
    points = list(points)
    triangles = triangulate(loops, points)
    while extra > 0:
        def size(t):
            return ((t[1][0] - t[0][0]) * (t[2][1] - t[0][1]) - (t[1][1] - t[0][1]) * (t[2][0] - t[0][0]))
        triangles.sort(key=lambda t: (-size(t), t))
        n = min(extra, 1 + len(triangles) // 6)
        points += [(sum(p[0] for p in t) // 3, sum(p[1] for p in t) // 3) for t in triangles[:n]]
        extra -= n
        triangles = triangulate(loops, points)
    return triangles
