"""Four furnished rooms with the patch counts of the 2014 study."""

from .furniture import (Room, bowl, ceiling_lamp, chair, cup, cupboard, door, globe, pendant_lamp, picture, plant, rug,
                        shade_lamp, shelf, sofa, table, teapot, vase, window)
from .mesh import Material, part
from .plain import MADE

DARK = (0, 0, 0)
MATERIALS = {name: Material(kd, DARK) for name, kd in {
    "ceiling": (0.8, 0.79, 0.77), "plaster": (0.76, 0.74, 0.69), "terracotta": (0.58, 0.27, 0.16),
    "sage": (0.36, 0.46, 0.3), "dusk": (0.24, 0.34, 0.46), "ochre": (0.66, 0.47, 0.2), "rose": (0.62, 0.36, 0.33),
    "oak": (0.46, 0.31, 0.18), "wood": (0.36, 0.21, 0.11), "walnut": (0.22, 0.13, 0.08), "lacquer": (0.74, 0.73, 0.7),
    "metal": (0.45, 0.44, 0.42), "navy": (0.1, 0.15, 0.34), "petrol": (0.08, 0.3, 0.34), "mustard": (0.66, 0.43, 0.1),
    "wine": (0.4, 0.08, 0.1), "cream": (0.72, 0.65, 0.52), "leaf": (0.14, 0.33, 0.09), "clay": (0.52, 0.24, 0.14),
    "china": (0.82, 0.81, 0.78), "sea": (0.14, 0.32, 0.5), "ink": (0.06, 0.06, 0.08), "red": (0.6, 0.1, 0.07),
    "yellow": (0.75, 0.58, 0.1), "blue": (0.1, 0.18, 0.5)}.items()}
# The lamps, each with names of its own, so that they can be dimmed apart.
MATERIALS.update({
    "light_window": Material((0.3, 0.3, 0.3), (1.7, 2.1, 2.8)), "light_ceiling": Material((0.7, 0.7, 0.7), (14, 12.4, 10)),
    "light_pendant": Material((0.7, 0.7, 0.7), (90, 70, 45)), "light_floor": Material((0.7, 0.7, 0.7), (64, 42, 22)),
    "shade_floor": Material((0.6, 0.52, 0.4), (1.2, 0.79, 0.42)), "light_desk": Material((0.7, 0.7, 0.7), (80, 92, 100)),
    "shade_desk": Material((0.1, 0.32, 0.22), DARK), "shade_pendant": Material((0.5, 0.16, 0.1), DARK)})
BOOKS = ("wine", "navy", "petrol", "mustard", "cream", "ink", "sage", "terracotta")


def room_1312():
    r = Room((3600, 2500, 3200), (700, 800, 850), 1.9, "oak ceiling plaster plaster terracotta sage")
    window(r.wall("left"), "window", "light_window", "lacquer", 1250, 950, 1200, 1050, 600, 2, 1)
    picture(r.wall("back"), "picture", "walnut", 1450, 1300, 700, 500, 500,
            (("cream", 0, 0, 100, 100), ("red", 10, 15, 45, 85), ("blue", 55, 40, 90, 85)))
    table(r.frame(1150, 700), "table", "wood", 1300, 750, 740, 330)
    chair(r.frame(1600, 300), "chair", "wood", "navy", 330)
    ceiling_lamp(r, "ceiling_lamp", "light_ceiling", 1800, 1000, 300, 170, 8, 4)
    shade_lamp(r, "floor_lamp", "light_floor", "shade_floor", 3150, 450, 0, 200, 1450, 8, 3)
    bowl(r, "bowl", "china", 1650, 1080, 740, 8)
    return r, 1, (part("table", "wood", "table_top"), 38), ((2450, 1500, 3080), (1600, 1000, 700), 70)


def room_3360():
    r = Room((4400, 2600, 3800), (800, 850, 900), 1.7, "oak ceiling plaster plaster sage ochre")
    window(r.wall("left"), "window", "light_window", "lacquer", 1100, 950, 1500, 1150, 600)
    table(r.frame(1500, 1400), "table", "walnut", 1500, 850, 740, 260)
    chair(r.frame(1150, 2035, 1), "chair_left", "walnut", "wine", 300)
    chair(r.frame(2040, 1080, 0), "chair_back", "walnut", "wine", 300)
    chair(r.frame(3350, 1615, 3), "chair_right", "walnut", "wine", 300)
    cupboard(r.frame(350, 0), "cupboard", "oak", "lacquer", 1300, 420, 900, 2, 420)
    picture(r.wall("back"), "picture", "ink", 600, 1350, 800, 560, 450,
            (("cream", 0, 0, 100, 100), ("dusk", 0, 45, 100, 100), ("yellow", 62, 60, 78, 82), ("leaf", 0, 0, 100, 22)))
    vase(r, "vase", "sea", 560, 220, 900, 8)
    globe(r, "globe", "blue", 1380, 220, 900, 120, 10, 5)
    teapot(r, "teapot", "china", 2300, 1790, 740, 0, 46, 2, 12, 6, 5)
    cup(r, "cup", "china", 1850, 1900, 740, 8)
    pendant_lamp(r, "pendant_lamp", "light_pendant", "shade_pendant", 2250, 1825, 1560, 230, 10, 4)
    shade_lamp(r, "floor_lamp", "light_floor", "shade_floor", 3300, 420, 0, 210, 1450, 10, 3)
    plant(r, "plant", "clay", "leaf", 3950, 480, 8, 5)
    return r, 1, (part("table", "walnut", "table_top"), 53), ((4050, 1600, 3500), (1750, 850, 800), 62)


def room_9680():
    r = Room((5400, 2700, 4800), (200, 260, 360), 1.5, "oak ceiling plaster plaster dusk terracotta")
    window(r.wall("left"), "window", "light_window", "lacquer", 2500, 850, 1700, 1350, 400)
    door(r.wall("front"), "door", "lacquer", "lacquer", 3600, 850, 2050, 500)
    rug(r.frame(1250, 1300), "rug", "wine", "cream", 2500, 1900, 300)
    sofa(r.frame(1450, 120), "sofa", "petrol", "petrol", "walnut", 2100, 260)
    table(r.frame(1900, 1700), "coffee_table", "walnut", 1200, 650, 430, 130, 50, 35)
    teapot(r, "teapot", "china", 2400, 2010, 430, 0, 50, 3, 16, 8, 7)
    cup(r, "cup_1", "china", 2130, 2180, 430, 10)
    cup(r, "cup_2", "china", 2720, 2200, 430, 10)
    bowl(r, "bowl", "mustard", 2850, 1900, 430, 12)
    chair(r.frame(620, 2150, 1), "chair", "oak", "mustard", 220)
    shelf(r.frame(0, 3900, 1), "shelf", "walnut", 1150, 320, 2050, 5, 260, BOOKS, 7)
    cupboard(r.frame(3800, 0), "sideboard", "walnut", "oak", 1500, 430, 750, 2, 300)
    shade_lamp(r, "desk_lamp", "light_desk", "shade_desk", 4050, 220, 750, 120, 380, 12, 4)
    globe(r, "globe", "sea", 4620, 220, 750, 140, 14, 8)
    vase(r, "vase", "rose", 5050, 200, 750, 10)
    picture(r.wall("back"), "picture", "ink", 1800, 1250, 1300, 800, 320,
            (("cream", 0, 0, 100, 100), ("red", 0, 52, 38, 100), ("blue", 62, 0, 100, 30), ("yellow", 80, 60, 100, 100),
             ("ink", 38, 0, 41, 100), ("ink", 0, 49, 38, 52), ("ink", 41, 30, 100, 33)))
    picture(r.wall("back"), "small_picture", "walnut", 4350, 1400, 550, 700, 320,
            (("sage", 0, 0, 100, 100), ("cream", 25, 20, 75, 80)))
    shade_lamp(r, "floor_lamp", "light_floor", "shade_floor", 1100, 480, 0, 220, 1480, 14, 5)
    ceiling_lamp(r, "ceiling_lamp", "light_ceiling", 2700, 2500, 450, 170, 14, 8)
    plant(r, "plant", "clay", "leaf", 480, 520, 10, 7)
    return r, 1, (part("rug", "cream"), 149), ((4950, 1600, 4450), (2350, 850, 1050), 62)


def room_17128():
    r = Room((7200, 2800, 6000), (210, 280, 380), 1.5, "oak ceiling plaster plaster sage ochre")
    for i, x in enumerate((1500, 3500)):
        window(r.wall("left"), "window_%d" % (i + 1), "light_window", "lacquer", x, 800, 1500, 1450, 350)
    door(r.wall("front"), "door", "lacquer", "lacquer", 3000, 850, 2050, 400)
    rug(r.frame(750, 1350), "rug", "navy", "cream", 2650, 1850, 260)
    sofa(r.frame(950, 150), "sofa", "wine", "wine", "walnut", 2300, 240, 3)
    sofa(r.frame(230, 3400, 1), "armchair", "mustard", "mustard", "walnut", 1000, 240, 1)
    table(r.frame(1500, 1850), "coffee_table", "oak", 1150, 620, 420, 130, 50, 35)
    bowl(r, "fruit_bowl", "petrol", 1850, 2150, 420, 12)
    vase(r, "vase", "sea", 2350, 2100, 420, 12)
    table(r.frame(3700, 3000), "dining_table", "walnut", 1950, 950, 740, 130)
    for i, (x, z, q) in enumerate(((4000, 2650, 0), (4930, 2650, 0), (4420, 4300, 2), (5350, 4300, 2))):
        chair(r.frame(x, z, q), "chair_%d" % (i + 1), "walnut", "petrol", 200)
    teapot(r, "teapot", "china", 4600, 3460, 740, 0, 52, 4, 20, 10, 9)
    for i, (x, z) in enumerate(((4150, 3250), (5150, 3230), (4250, 3700), (5200, 3720))):
        cup(r, "cup_%d" % (i + 1), "china", x, z, 740, 10)
    bowl(r, "bowl", "china", 5350, 3480, 740, 14)
    pendant_lamp(r, "pendant_lamp", "light_pendant", "shade_pendant", 4675, 3475, 1620, 260, 16, 6)
    shelf(r.frame(3980, 0), "bookcase", "walnut", 1650, 330, 2250, 6, 240, BOOKS, 11, 2)
    table(r.frame(5750, 0), "desk", "oak", 1350, 640, 740, 150)
    chair(r.frame(6640, 1060, 2), "desk_chair", "oak", "wine", 200)
    shade_lamp(r, "desk_lamp", "light_desk", "shade_desk", 5980, 250, 740, 130, 400, 14, 5)
    globe(r, "globe", "sea", 6620, 260, 740, 150, 18, 10)
    cupboard(r.frame(0, 5850, 1), "sideboard", "oak", "lacquer", 1500, 430, 800, 2, 260)
    vase(r, "tall_vase", "clay", 200, 4650, 800, 12, 1.3)
    picture(r.wall("back"), "picture", "ink", 1450, 1300, 1400, 850, 280,
            (("cream", 0, 0, 100, 100), ("red", 0, 52, 38, 100), ("blue", 62, 0, 100, 30), ("yellow", 80, 60, 100, 100),
             ("ink", 38, 0, 41, 100), ("ink", 0, 49, 38, 52), ("ink", 41, 30, 100, 33)))
    picture(r.wall("back"), "small_picture", "walnut", 6050, 1400, 700, 800, 280,
            (("dusk", 0, 0, 100, 100), ("cream", 25, 20, 75, 80)))
    shade_lamp(r, "floor_lamp", "light_floor", "shade_floor", 3600, 560, 0, 230, 1500, 16, 6)
    ceiling_lamp(r, "ceiling_lamp", "light_ceiling", 2100, 2500, 450, 180, 16, 10)
    plant(r, "plant", "clay", "leaf", 560, 560, 12, 8)
    return r, 1, (part("dining_table", "walnut", "dining_table_top"), 164), ((6900, 1650, 5750), (3600, 800, 1700), 62)


ROOMS = {1312: room_1312, 3360: room_3360, 9680: room_9680, 17128: room_17128}


def make(folder, count):
    room, divide, (tuned, extra), (eye, target, fov) = ROOMS[count]()
    room.bricks.extra[tuned] = extra
    room.bricks.build(room.mesh)
    name, patches = "room-%d" % count, room.mesh.patches(divide)
    if patches != count:
        raise ValueError("%s has %d patches; give its table top %d points, not %d" %
                         (name, patches, extra + (count - patches) // 2, extra))
    if room.mesh.open_edges():
        raise ValueError("%s is open at %s" % (name, room.mesh.open_edges()[:4]))
    room.mesh.write(folder, name, ["A furnished room; unit: metre; --divide %g gives %d patches" % (divide, count), MADE],
                    ([c / 1000 for c in eye], [c / 1000 for c in target], (0, 1, 0), fov), MATERIALS)
    return room.mesh
