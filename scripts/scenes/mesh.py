"""A triangle mesh with named parts, and its writing as Wavefront OBJ with MTL."""

import collections
import math
import os

# Object and group name as written with `o` and `g`, and the name of the material.
Part = collections.namedtuple("Part", "object group material")
# Linear RGB.
Material = collections.namedtuple("Material", "reflectance emittance")


def part(name, material, group=None):
    return Part(name, group or name, material)


class Mesh:
    """Vertices are integers (in 10**-decimals of the scene's unit), so that what touches shares its vertices exactly."""

    def __init__(self, decimals=4):
        self.decimals = decimals
        self.vertex = {}
        self.faces = {}  # part -> list of vertex triples

    def add(self, owner, *corners):
        """A flat convex polygon, corners counter-clockwise from the front, as a fan of triangles."""
        ids = [self.vertex.setdefault(tuple(p), len(self.vertex)) for p in corners]
        faces = self.faces.setdefault(owner, [])
        for i in range(1, len(ids) - 1):
            t = (ids[0], ids[i], ids[i + 1])
            if len(set(t)) < 3:
                raise ValueError("degenerate triangle in %s at %s" % (owner, corners))
            faces.append(t)

    def triangles(self):
        points = list(self.vertex)
        for owner, faces in self.faces.items():
            for t in faces:
                yield owner, tuple(points[i] for i in t)

    def area(self, t):
        unit = 10.0 ** -self.decimals
        u = [(t[1][k] - t[0][k]) * unit for k in range(3)]
        v = [(t[2][k] - t[0][k]) * unit for k in range(3)]
        c = (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])
        return 0.5 * math.sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2])

    def patches(self, divide):
        """The number of patches at this --divide: each triangle into four until its area is at most divide. An area too
        near to a threshold to be counted alike by everyone is refused."""
        total = 0
        for owner, t in self.triangles():
            area, n = self.area(t), 1
            while area > divide * (1 + 1e-9):
                if area < divide * (1 + 1e-6):
                    raise ValueError("%s: a triangle at the threshold: %r" % (owner, t))
                area, n = area / 4, n * 4
            total += n
        return total

    def open_edges(self):
        """Edges that are not shared by exactly two triangles running through them in opposite directions."""
        count = collections.Counter()
        for faces in self.faces.values():
            for a, b, c in faces:
                count.update(((a, b), (b, c), (c, a)))
        points = list(self.vertex)
        return [(points[a], points[b]) for (a, b), n in count.items() if n != 1 or count.get((b, a), 0) != 1]

    def number(self, value):
        text = "%d" % abs(value)
        text = text.rjust(self.decimals + 1, "0")
        whole, fraction = text[:len(text) - self.decimals], text[len(text) - self.decimals:].rstrip("0")
        return ("-" if value < 0 else "") + whole + ("." + fraction if fraction else "")

    def write(self, folder, name, comments, camera, materials):
        """NAME.obj and NAME.mtl. camera: (eye, target, up, vertical field of view in degrees)."""
        lines = ["# " + c for c in comments]
        eye, target, up, fov = camera
        lines.append("#camera eye %g %g %g target %g %g %g up %g %g %g fov %.6g" % (*eye, *target, *up, fov))
        lines.append("mtllib %s.mtl" % name)
        lines += ["v " + " ".join(self.number(c) for c in p) for p in self.vertex]
        last = Part(None, None, None)
        for owner in sorted(self.faces, key=self.order()):
            if owner.object != last.object:
                lines.append("o " + owner.object)
            if (owner.object, owner.group) != (last.object, last.group):
                lines.append("g " + owner.group)
            lines.append("usemtl " + owner.material)
            lines += ["f %d %d %d" % (a + 1, b + 1, c + 1) for a, b, c in self.faces[owner]]
            last = owner
        save(folder, name + ".obj", lines)
        used = {p.material for p in self.faces}
        lines = ["# Materials of %s.obj" % name, "# Kd: reflectance, Ke: emittance; linear RGB"]
        for m in materials:
            if m in used:
                lines += ["newmtl " + m, "Kd %g %g %g" % materials[m].reflectance, "Ke %g %g %g" % materials[m].emittance]
        save(folder, name + ".mtl", lines)

    def order(self):
        """Parts by first appearance of their object, then group, then material."""
        objects, groups, parts = {}, {}, {}
        for p in self.faces:
            objects.setdefault(p.object, len(objects))
            groups.setdefault((p.object, p.group), len(groups))
            parts.setdefault(p, len(parts))
        return lambda p: (objects[p.object], groups[p.object, p.group], parts[p])


def save(folder, name, lines):
    with open(os.path.join(folder, name), "w", encoding="ascii", newline="\n") as f:
        f.write("\n".join(lines) + "\n")
