"""The scenes with a known answer: two plates, the furnace, the Cornell box."""

from .mesh import Material, Mesh, part
from .triangulate import distance2, inside, triangulate

MADE = "Made by scripts/make-scenes.py; what it shows and its known answer: scenes/README.md"


def two_plates(folder):
    mesh = Mesh(0)
    mesh.add(part("lower", "emitting"), (0, 0, 0), (0, 0, 1), (1, 0, 1), (1, 0, 0))
    mesh.add(part("upper", "grey"), (0, 1, 0), (1, 1, 0), (1, 1, 1), (0, 1, 1))
    mesh.write(folder, "two-plates",
               ["Two parallel unit squares at distance 1, facing each other; unit: metre; the lower one emits", MADE],
               ((0.5, 0.6, 4), (0.5, 0.5, 0), (0, 1, 0), 30),
               {"emitting": Material((0, 0, 0), (1, 1, 1)), "grey": Material((0.5, 0.5, 0.5), (0, 0, 0))})
    return mesh


def furnace(folder):
    mesh = Mesh(0)
    corners = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    for name, face in (("floor", (0, 1, 5, 4)), ("ceiling", (2, 6, 7, 3)), ("left", (0, 2, 3, 1)),
                       ("right", (4, 5, 7, 6)), ("back", (0, 4, 6, 2)), ("front", (1, 3, 7, 5))):
        mesh.add(part(name, "glowing"), *(corners[i] for i in face))
    mesh.write(folder, "furnace",
               ["A closed unit cube seen from inside, every side alike: b = Ke / (1 - Kd) = 1 2 3 everywhere", MADE],
               ((0.5, 0.5, 0.95), (0.5, 0.5, 0), (0, 1, 0), 60),
               {"glowing": Material((0.5, 0.25, 0.8), (0.5, 1.5, 0.6))})
    return mesh


def between(a, b, i, n):
    """The point i / n of the way from a to b; exact, or an error."""
    out = tuple(p + (q - p) * i // n for p, q in zip(a, b))
    if any((q - p) * i % n for p, q in zip(a, b)):
        raise ValueError("not exact: %s %s" % (a, b))
    return out


def cut(loop, n):
    """The loop with each edge cut into n."""
    return [between(a, b, i, n) for a, b in zip(loop, loop[1:] + loop[:1]) for i in range(n)]


def grid(mesh, owner, corners, n):
    """A quadrilateral, corners counter-clockwise from the front, as n x n smaller ones between its edges."""
    a, b, c, d = corners
    rows = [[between(between(a, b, i, n), between(d, c, i, n), j, n) for i in range(n + 1)] for j in range(n + 1)]
    for j in range(n):
        for i in range(n):
            mesh.add(owner, rows[j][i], rows[j][i + 1], rows[j + 1][i + 1], rows[j + 1][i])


def level(mesh, owner, loops, y, up, points=()):
    """A horizontal face at height y, of loops in x and z and further points inside, seen from above (up) or below."""
    for t in triangulate([[(x, -z) for x, z in loop] for loop in loops], [(x, -z) for x, z in points]):
        corners = [(x, y, -z) for x, z in t]
        mesh.add(owner, *(corners if up else corners[::-1]))


def inner(x, z, n, holes):
    """The inner points of an n x n grid over [0, x] x [0, z] that keep away from the holes."""
    near = (min(x, z) // n // 3)**2
    out = [(x * i // n, z * j // n) for i in range(1, n) for j in range(1, n)]
    edges = [e for h in holes for e in zip(h, h[1:] + h[:1])]
    return [p for p in out if not inside(holes, *p) and all(distance2(p, *e) > near for e in edges)]


def cornell_box(folder):
    """Cornell University Program of Computer Graphics, "Cornell Box Data". Lengths here in tenths of the published unit.

    The published quadrilaterals, their edges cut into four. The left wall is not quite plane as published; it is cut as
    the surface that its straight edges span."""
    mesh, n = Mesh(1), 4
    short = [(1300, 650), (820, 2250), (2400, 2720), (2900, 1140)]
    tall = [(4230, 2470), (2650, 2960), (3140, 4560), (4720, 4060)]
    light = [(3430, 2270), (3430, 3320), (2130, 3320), (2130, 2270)]
    # The floor is cut out under the blocks, whose walls stand in the cuts; the ceiling is cut out for the light.
    floor = cut([(5528, 0), (0, 0), (0, 5592), (5496, 5592)], n)
    level(mesh, part("floor", "white"), [floor, short, tall], 0, True, inner(5512, 5592, n, [short, tall]))
    level(mesh, part("light", "light"), [light], 5488, False)
    ceiling = cut([(5560, 0), (5560, 5592), (0, 5592), (0, 0)], n)
    level(mesh, part("ceiling", "white"), [ceiling, light], 5488, False, inner(5560, 5592, n, [light]))
    grid(mesh, part("back_wall", "white"), [(5496, 0, 5592), (0, 0, 5592), (0, 5488, 5592), (5560, 5488, 5592)], n)
    grid(mesh, part("right_wall", "green"), [(0, 0, 5592), (0, 0, 0), (0, 5488, 0), (0, 5488, 5592)], n)
    grid(mesh, part("left_wall", "red"), [(5528, 0, 0), (5496, 0, 5592), (5560, 5488, 5592), (5560, 5488, 0)], n)
    for name, foot, top in (("short_block", short, 1650), ("tall_block", tall, 3300)):
        owner = part(name, "white")
        mesh.add(owner, *((x, top, z) for x, z in foot))
        for (ax, az), (bx, bz) in zip(foot, foot[1:] + foot[:1]):
            mesh.add(owner, (bx, 0, bz), (bx, top, bz), (ax, top, az), (ax, 0, az))
    black = (0, 0, 0)
    mesh.write(folder, "cornell-box",
               ["The Cornell box; unit: millimetre; measurements: Cornell University Program of Computer Graphics,",
                "Cornell Box Data; open at the front, the light in a hole of the ceiling", MADE],
               ((278, 273, -800), (278, 273, 0), (0, 1, 0), 39.3076),
               {"white": Material((0.725, 0.71, 0.68), black), "green": Material((0.14, 0.45, 0.091), black),
                "red": Material((0.63, 0.065, 0.05), black), "light": Material((0.78, 0.78, 0.78), (17, 12, 4))})
    return mesh
