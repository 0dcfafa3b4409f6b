"""Furniture and lamps. Lengths in millimetres; the mesh's unit is a tenth of that."""

from .bricks import Bricks
from .mesh import Mesh, part
from .teapot import Teapot
from .turned import ball, turn

QUARTERS = ((1, 0, 0, 1), (0, 1, -1, 0), (-1, 0, 0, -1), (0, -1, 1, 0))


class Room:
    """A closed room of the given width (x), height (y) and depth (z) in millimetres, with walls of matter around.
    spacing: of the vertices on floor, walls and ceiling. colours: materials of floor, ceiling, back, front, left, right."""

    def __init__(self, size, spacing, shapely, colours):
        self.size, self.mesh, self.bricks = size, Mesh(4), Bricks(shapely)
        w, h, d = size
        t = 300
        sides = (("floor", spacing[0], (-t, -t, -t), (w + t, 0, d + t)), ("ceiling", spacing[2], (-t, h, -t), (w + t, h + t, d + t)),
                 ("back_wall", spacing[1], (-t, 0, -t), (w + t, h, 0)), ("front_wall", spacing[1], (-t, 0, d), (w + t, h, d + t)),
                 ("left_wall", spacing[1], (-t, 0, 0), (0, h, d)), ("right_wall", spacing[1], (w, 0, 0), (w + t, h, d)))
        for (name, s, lo, hi), material in zip(sides, colours.split()):
            self.box(part(name, material), lo, hi, s)
        self.bricks.air((0, 0, 0), tuple(10 * c for c in size))

    def box(self, owner, lo, hi, spacing):
        self.bricks.matter(owner, [10 * c for c in lo], [10 * c for c in hi], 10 * spacing)

    def turned(self, x, z, sides, profile, on_floor=True, under=False):
        """A turned thing whose lowest ring stands on a face (or whose uppermost hangs from one)."""
        rings = turn(self.mesh, 10 * x, 10 * z, sides, [(o, round(10 * r), round(10 * y)) for o, r, y in profile])
        if on_floor:
            self.bricks.attach(1, 1, rings[0])
        if under:
            self.bricks.attach(1, -1, rings[-1])

    def frame(self, x, z, quarter=0, y=0):
        return Frame(self, x, y, z, quarter)

    def wall(self, name):
        """A frame on a wall: x along it to the right as seen from inside, z into the room."""
        w, _, d = self.size
        return {"back": Frame(self, 0, 0, 0, 0), "left": Frame(self, 0, 0, d, 1), "front": Frame(self, w, 0, d, 2),
                "right": Frame(self, w, 0, 0, 3)}[name]


class Frame:
    """A corner to build from, turned by quarters: 0: x and z as the room's; 1: z of the frame along the room's x."""

    def __init__(self, room, x, y, z, quarter):
        self.room, self.x, self.y, self.z, self.turn = room, x, y, z, QUARTERS[quarter]

    def at(self, x, z):
        a, b, c, d = self.turn
        return self.x + a * x + b * z, self.z + c * x + d * z

    def corners(self, lo, hi):
        (x0, z0), (x1, z1) = self.at(lo[0], lo[2]), self.at(hi[0], hi[2])
        return (x0, self.y + lo[1], z0), (x1, self.y + hi[1], z1)

    def box(self, owner, lo, hi, spacing):
        self.room.box(owner, *self.corners(lo, hi), spacing)

    def air(self, lo, hi):
        a, b = self.corners(lo, hi)
        self.room.bricks.air([10 * c for c in a], [10 * c for c in b])


def table(f, name, wood, w, d, h, s, leg=60, top=40):
    for x in (40, w - 40 - leg):
        for z in (40, d - 40 - leg):
            f.box(part(name, wood, name + "_legs"), (x, 0, z), (x + leg, h - top, z + leg), s)
    f.box(part(name, wood, name + "_top"), (0, h - top, 0), (w, h, d), s)


def chair(f, name, wood, cloth, s):
    """420 wide and deep; its back at z = 0, so that one sits looking along z."""
    for x in (0, 380):
        f.box(part(name, wood), (x, 0, 0), (x + 40, 900, 40), s)
        f.box(part(name, wood), (x, 0, 380), (x + 40, 430, 420), s)
    f.box(part(name, cloth, name + "_seat"), (0, 430, 0), (420, 470, 420), s)
    f.box(part(name, wood), (0, 430, 0), (40, 900, 40), s)
    f.box(part(name, wood), (380, 430, 0), (420, 900, 40), s)
    f.box(part(name, wood), (40, 660, 10), (380, 860, 30), s)


def shelf(f, name, wood, w, d, h, rows, s, books=(), seed=1, columns=1):
    """A bookcase: a block with compartments cut in; books stand in them."""
    owner, board = part(name, wood), 25
    f.box(owner, (0, 0, 0), (w, h, d), s)
    pitch, width = (h - 80 - board) // rows, (w - board) // columns
    for row in range(rows):
        for column in range(columns):
            y, x = 80 + row * pitch, board + column * width
            f.air((x, y, 20), (x + width - board, y + pitch - board, d))
            while books and x < board + column * width + (width - board) * (45 + seed % 53) // 100:
                seed = (seed * 1103515245 + 12345) % 2**31
                thick = min(28 + seed // 64 % 30, board + column * width + width - board - x)
                high, deep = (pitch - board) * (62 + seed // 4096 % 30) // 100, (d - 20) * (55 + seed // 65536 % 35) // 100
                f.box(part(name, books[seed // 2**20 % len(books)], name + "_books"), (x, y, 20),
                      (x + thick, y + high, 20 + deep), s)
                x += thick
            seed = (seed * 1103515245 + 12345) % 2**31


def cupboard(f, name, wood, front, w, d, h, doors, s, knob="metal"):
    f.box(part(name, wood), (20, 0, 0), (w - 20, 70, d - 40), s)
    f.box(part(name, wood), (0, 70, 0), (w, h, d), s)
    width = (w - 10) // doors
    for i in range(doors):
        x = 10 + i * width
        f.box(part(name, front, name + "_doors"), (x, 85, d), (x + width - 10, h - 15, d + 18), s)
        k = x + (width - 60 if i % 2 == 0 else 30)
        y = (85 + h - 15) // 2
        f.box(part(name, knob, name + "_doors"), (k, y - 40, d + 18), (k + 20, y + 40, d + 40), s)


def sofa(f, name, cloth, cushion, foot, w, s, seats=2):
    """900 deep, back at z = 0."""
    for x in (40, w - 100):
        for z in (40, 800):
            f.box(part(name, foot), (x, 0, z), (x + 60, 90, z + 60), s)
    f.box(part(name, cloth), (0, 90, 0), (w, 380, 900), s)
    f.box(part(name, cloth), (0, 380, 0), (w, 820, 200), s)
    for x in (0, w - 160):
        f.box(part(name, cloth), (x, 380, 200), (x + 160, 600, 900), s)
    width = (w - 320 - 20) // seats
    for i in range(seats):
        x = 170 + i * width
        f.box(part(name, cushion, name + "_cushions"), (x + 5, 380, 200), (x + width - 5, 470, 890), s)


def rug(f, name, border, middle, w, d, s, edge=150):
    f.box(part(name, border), (0, 0, 0), (w, 10, d), s)
    f.box(part(name, middle), (edge, 0, edge), (w - edge, 10, d - edge), s)


def picture(f, name, wood, x, y, w, h, s, fields):
    """fields: (material, left, bottom, right, top) in hundredths of the canvas; the first is the ground."""
    f.box(part(name, wood), (x - 40, y - 40, 0), (x + w + 40, y + h + 40, 30), s)
    f.air((x, y, 15), (x + w, y + h, 30))
    for material, x0, y0, x1, y1 in fields:
        f.box(part(name, material, name + "_canvas"), (x + w * x0 // 100, y + h * y0 // 100, 0),
              (x + w * x1 // 100, y + h * y1 // 100, 15), s)


def window(f, name, light, bar, x, y, w, h, s, columns=2, rows=2):
    """A luminous pane at the back of a niche, with glazing bars and a sill."""
    f.air((x, y, -150), (x + w, y + h, 0))
    f.box(part(name, light), (x, y, -200), (x + w, y + h, -150), s)
    for i in range(1, columns):
        f.box(part(name, bar, name + "_frame"), (x + w * i // columns - 20, y, -150), (x + w * i // columns + 20, y + h, -110), s)
    for j in range(1, rows):
        f.box(part(name, bar, name + "_frame"), (x, y + h * j // rows - 20, -150), (x + w, y + h * j // rows + 20, -110), s)
    f.box(part(name, bar, name + "_frame"), (x - 60, y - 40, 0), (x + w + 60, y, 150), s)


def door(f, name, leaf, jamb, x, w, h, s):
    f.box(part(name, jamb), (x - 80, 0, 0), (x + w + 80, h + 80, 25), s)
    f.box(part(name, leaf), (x, 0, 0), (x + w, h, 45), s)
    for y0, y1 in ((150, 850), (1050, h - 150)):
        f.air((x + 120, y0, 30), (x + w - 120, y1, 45))
    f.box(part(name, "metal"), (x + 40, 980, 45), (x + 70, 1010, 100), s)
    f.box(part(name, "metal"), (x + 40, 980, 80), (x + 160, 1010, 100), s)


def ceiling_lamp(room, name, light, x, z, drop, r, sides, steps):
    """A glowing ball on a rod."""
    owner, rod, top = part(name, light), part(name, "metal", name + "_rod"), room.size[1]
    profile = ball(owner, r, top - drop, steps, 0, 1 - 0.5 / steps)
    room.turned(x, z, sides, profile + [(rod, 12, profile[-1][2] + 10), (rod, 12, top - 30), (rod, 60, top - 25),
                                        (rod, 60, top)], False, True)


def shade_lamp(room, name, light, shade, x, z, y, size, height, sides, steps):
    """A lamp with a foot, a rod, a bulb and a shade that is open above and below: floor lamp or desk lamp."""
    rod, bulb = part(name, "metal", name + "_rod"), part(name, light, name + "_bulb")
    r = 0.3 * size
    profile = [(rod, 0.7 * size, y), (rod, 0.7 * size, y + 20), (rod, 0.07 * size, y + 30), (rod, 0.07 * size, y + height - r)]
    room.turned(x, z, sides, profile + ball(bulb, r, y + height, steps, 0.7 / steps, 1))
    cloth = part(name, shade, name + "_shade")
    low, high = y + height - 0.8 * size, y + height + 0.7 * size
    room.turned(x, z, sides, [(cloth, size, low), (cloth, 0.68 * size, high), (cloth, 0.68 * size - 8, high),
                              (cloth, size - 8, low), (cloth, size, low)], False)


def pendant_lamp(room, name, light, shade, x, z, y, size, sides, steps):
    """A bell-shaped shade on a cord, open below, a bulb in it."""
    cord, bulb, bell, lining = (part(name, m, name + g) for m, g in (
        ("metal", "_cord"), (light, "_bulb"), (shade, "_shade"), ("lacquer", "_shade")))
    top = room.size[1]
    inside = ball(bulb, 0.28 * size, y + 0.3 * size, steps, 0, 1 - 0.7 / steps)
    room.turned(x, z, sides, inside + [
        (cord, 0.16 * size, y + 0.78 * size), (lining, 0.62 * size, y + 0.55 * size), (lining, 0.96 * size, y),
        (bell, size, y), (bell, 0.66 * size, y + 0.6 * size), (bell, 0.2 * size, y + 0.84 * size), (cord, 6, y + size),
        (cord, 6, top - 25), (cord, 50, top - 20), (cord, 50, top)], False, True)


def plant(room, name, pot, leaf, x, z, sides, steps):
    clay, tree = part(name, pot, name + "_pot"), part(name, "wood", name + "_stem")
    profile = [(clay, 120, 0), (clay, 165, 300), (clay, 145, 300), (tree, 25, 280), (tree, 20, 640)]
    room.turned(x, z, sides, profile + ball(part(name, leaf, name + "_leaves"), 260, 880, steps, 0.5 / steps, 1))


def globe(room, name, material, x, z, y, r, sides, steps):
    foot = part(name, "wood", name + "_foot")
    profile = [(foot, 0.7 * r, y), (foot, 0.7 * r, y + 0.12 * r), (foot, 0.12 * r, y + 0.25 * r), (foot, 0.12 * r, y + 0.5 * r)]
    room.turned(x, z, sides, profile + ball(part(name, material), r, y + 1.45 * r, steps, 0.6 / steps, 1))


def cup(room, name, material, x, z, y, sides, scale=1.0):
    o = part(name, material)
    room.turned(x, z, sides, [(o, r * scale, y + h * scale) for r, h in (
        (25, 0), (38, 30), (44, 72), (40, 72), (33, 32), (0, 18))])


def bowl(room, name, material, x, z, y, sides, scale=1.0):
    o = part(name, material)
    room.turned(x, z, sides, [(o, r * scale, y + h * scale) for r, h in (
        (45, 0), (105, 35), (130, 80), (122, 80), (95, 40), (0, 18))])


def vase(room, name, material, x, z, y, sides, scale=1.0):
    o = part(name, material)
    room.turned(x, z, sides, [(o, r * scale, y + h * scale) for r, h in (
        (40, 0), (75, 70), (80, 120), (45, 210), (35, 260), (50, 300), (44, 300), (28, 255), (0, 200))])


def teapot(room, name, material, x, z, y, quarter, scale, steps, sides, around, along):
    """scale: millimetres for one unit of Newell's."""
    a, b, c, d = QUARTERS[quarter]

    def place(p):
        u, v = 10 * scale * p[0], -10 * scale * p[1]
        return (10 * x + round(a * u + b * v), 10 * y + round(10 * scale * (p[2] - 0.15)), 10 * z + round(c * u + d * v))

    pot = Teapot(room.mesh, part(name, material), place, steps, sides, around, along)
    room.bricks.attach(1, 1, pot.foot)
