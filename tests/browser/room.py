"""The small room of the page's tests, its light by independent solves, and what a picture of it must show."""

import csv
import math
import os
import subprocess

SIZE = (4.0, 2.6, 3.0)
EYE, TARGET, FOV = (2.0, 1.2, 2.9), (2.0, 1.15, 0.0), 62.0
HOSTILE = "</script><img src=x onerror=document.title='harm'>"
# name: (reflectance, lit, corners counter-clockwise from the front)
WALLS = {
    "floor": ((0.55, 0.4, 0.25), [(0, 0, 0), (0, 0, 3), (4, 0, 3), (4, 0, 0)]),
    "ceiling": ((0.8, 0.8, 0.78), [(0, 2.6, 0), (4, 2.6, 0), (4, 2.6, 3), (0, 2.6, 3)]),
    "back": ((0.7, 0.68, 0.6), [(0, 0, 0), (4, 0, 0), (4, 2.6, 0), (0, 2.6, 0)]),
    "front": ((0.5, 0.5, 0.5), [(4, 0, 3), (0, 0, 3), (0, 2.6, 3), (4, 2.6, 3)]),
    "left": ((0.6, 0.15, 0.1), [(0, 0, 3), (0, 0, 0), (0, 2.6, 0), (0, 2.6, 3)]),
    "right": ((0.15, 0.3, 0.6), [(4, 0, 0), (4, 0, 3), (4, 2.6, 3), (4, 2.6, 0)]),
}
LAMPS = {
    "warm lamp": ((24.0, 15.0, 7.0), (0.6, 0.6)),
    HOSTILE: ((6.0, 11.0, 22.0), (2.8, 0.5)),
}
LAMP_HEIGHT, LAMP_SIZE = 2.0, 0.6


def write_scene(folder, name, burning):
    """The room as OBJ with MTL; only the lamps of `burning` emit."""
    obj, mtl, count = [f"mtllib {name}.mtl"], [], 0
    obj.append("#camera eye {} {} {} target {} {} {} up 0 1 0 fov {}".format(*EYE, *TARGET, FOV))

    def quad(label, material, corners):
        nonlocal count
        obj.extend("v {} {} {}".format(*c) for c in corners)
        obj.extend([f"o {label}", f"usemtl {material}", "f {} {} {} {}".format(*range(count + 1, count + 5))])
        count += 4

    for label, (rho, corners) in WALLS.items():
        mtl.append("newmtl {}\nKd {} {} {}".format(f"paint_{label}", *rho))
        quad(label, f"paint_{label}", corners)
    for k, (label, (emittance, (x, z))) in enumerate(LAMPS.items()):
        mtl.append("newmtl glow_{}\nKd 0.5 0.5 0.5\nKe {} {} {}".format(
            k, *(emittance if label in burning else (0, 0, 0))))
        s, y = LAMP_SIZE, LAMP_HEIGHT
        quad(label, f"glow_{k}", [(x, y, z), (x + s, y, z), (x + s, y, z + s), (x, y, z + s)])  # looks down
    for suffix, lines in (("obj", obj), ("mtl", mtl)):
        with open(os.path.join(folder, f"{name}.{suffix}"), "w", encoding="utf-8") as file:
            file.write("\n".join(lines) + "\n")
    return os.path.join(folder, f"{name}.obj")


class Solver:
    """Runs the program on variants of the room."""

    def __init__(self, program, folder, divide="0.2"):
        self.program, self.folder, self.divide = program, folder, divide

    def solve(self, scene, *arguments):
        command = [self.program, arguments[0], scene, "--divide", self.divide, "--device", "openmp", "--closure", "off",
                   "--accuracy", "low", "--quiet", *arguments[1:]]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode != 0:
            raise RuntimeError(f"{command}: {done.returncode}: {done.stderr}")

    def table(self, burning, *arguments):
        """The CSV of a solve with only these lamps: a list of dictionaries by patch."""
        name = "only" + "".join(str(list(LAMPS).index(b)) for b in burning)
        scene = write_scene(self.folder, name, burning)
        out = os.path.join(self.folder, f"{name}.csv")
        self.solve(scene, "solve", "-o", out, *arguments)
        with open(out, newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        three = lambda row, names: tuple(float(row[n]) for n in names)
        return [{"group": row["group"], "area": float(row["area"]), "row_sum": float(row["row_sum"]),
                 "centre": three(row, ("cx", "cy", "cz")), "normal": three(row, ("nx", "ny", "nz")),
                 "rho": three(row, ("rho_r", "rho_g", "rho_b")), "e": three(row, ("e_r", "e_g", "e_b")),
                 "b": three(row, ("b_r", "b_g", "b_b"))} for row in rows]


def mixed(tables, weights):
    """B = sum of w_g B_g for tables of single lamps and weights per lamp and channel."""
    return [tuple(sum(w[c] * row["b"][c] for w, row in zip(weights, rows)) for c in range(3)) for rows in zip(*tables)]


# ---- What a screen shows, from the formulas (host/output/tone.h; the page's false colours), not from the page's program.

def curve(x, tone):
    if tone == "linear":
        return min(x, 1.0)
    return min(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 1.0)


def srgb(linear):
    return 12.92 * linear if linear <= 0.0031308 else 1.055 * linear ** (1 / 2.4) - 0.055


def srgb_linear(value):
    return value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4


def photographed(b, exposure, tone):
    exposed = [exposure * c for c in b]
    largest = max(exposed)
    if largest <= 0:
        return 0, 0, 0
    return tuple(255 * srgb(min(1, c * curve(largest, tone) / largest)) for c in exposed)


RAMP = ["14123a", "26348f", "1f6fc0", "1b9fb0", "35b779", "9bcb3c", "ecc52e", "f0852b", "d43a2c"]


def weighted(b):
    return 0.2126 * b[0] + 0.7152 * b[1] + 0.0722 * b[2]


def false_colour(b, low, high, log):
    y = weighted(b)
    if y > high:
        return 255, 255, 255
    t = math.log(max(y, 1e-30) / low) / math.log(high / low) if log else (y - low) / (high - low)
    t = 8 * min(max(t, 0), 1)
    k = min(int(t), 7)
    below, above = (tuple(int(RAMP[j][at:at + 2], 16) for at in (0, 2, 4)) for j in (k, k + 1))
    return tuple(p + (q - p) * (t - k) for p, q in zip(below, above))


# ---- Where a patch is in the window.

def minus(a, b):
    return tuple(x - y for x, y in zip(a, b))


def dot(a, b):
    return sum(x * y for x, y in zip(a, b))


def cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def unit(a):
    return tuple(x / math.sqrt(dot(a, a)) for x in a)


class Lens:
    """A camera with up = y over a window, with its angle across the shorter side."""

    def __init__(self, width, height, eye=EYE, target=TARGET):
        self.width, self.height, self.eye = width, height, eye
        self.forward = unit(minus(target, eye))
        self.right = unit(cross(self.forward, (0, 1, 0)))
        self.up = cross(self.right, self.forward)
        self.focal = min(width, height) / 2 / math.tan(math.radians(FOV) / 2)

    def place(self, point):
        """Pixels from the left and the top; None behind the camera."""
        to = minus(point, self.eye)
        depth = dot(to, self.forward)
        if depth < 0.1:
            return None
        return (self.width / 2 + self.focal * dot(to, self.right) / depth,
                self.height / 2 - self.focal * dot(to, self.up) / depth)

    def direction(self, x, y):
        across, down = (x - self.width / 2) / self.focal, (y - self.height / 2) / self.focal
        return tuple(f + across * r - down * u for f, r, u in zip(self.forward, self.right, self.up))


def wall_seen(eye, direction):
    """What a ray from inside meets: (name, place); the room is convex but for the lamps."""
    best = (math.inf, None)
    for axis in range(3):
        if direction[axis] == 0:
            continue
        bound = SIZE[axis] if direction[axis] > 0 else 0.0
        best = min(best, ((bound - eye[axis]) / direction[axis], (axis, bound > 0)))
    distance, side = best
    name = {(0, False): "left", (0, True): "right", (1, False): "floor", (1, True): "ceiling", (2, False): "back",
            (2, True): "front"}[side]
    if direction[1] > 0:
        t = (LAMP_HEIGHT - eye[1]) / direction[1]
        at = [e + t * d for e, d in zip(eye, direction)]
        for label, (_, (x, z)) in LAMPS.items():
            if t < distance and x <= at[0] <= x + LAMP_SIZE and z <= at[2] <= z + LAMP_SIZE:
                return label, tuple(at)
    return name, tuple(e + distance * d for e, d in zip(eye, direction))


def visible(rows, lens, margin=14):
    """Patches whose centre lies well inside the window and is not behind a lamp: {index: pixel}."""
    found = {}
    for i, row in enumerate(rows):
        at = lens.place(row["centre"])
        if at is None or not (margin < at[0] < lens.width - margin and margin < at[1] < lens.height - margin):
            continue
        to = minus(row["centre"], lens.eye)
        # Seen steeply enough, and large enough, for a pixel that is all its own.
        size = math.sqrt(row["area"]) * lens.focal / dot(to, lens.forward)
        if -dot(unit(to), row["normal"]) * size < 6:
            continue
        if wall_seen(lens.eye, to)[0] == row["group"]:
            found[i] = (int(at[0]), int(at[1]))
    return found


def automatic_exposure(rows, radiosity, lens, tone="filmic", across=60):
    """The rule of host/output/tone.h on a coarse picture of the surfaces that are not lamps."""
    by_wall = {}
    for i, row in enumerate(rows):
        by_wall.setdefault(row["group"], []).append(i)
    values = []
    for y in range(round(across * lens.height / lens.width)):
        for x in range(across):
            step = lens.width / across
            name, at = wall_seen(lens.eye, lens.direction((x + 0.5) * step, (y + 0.5) * step))
            if name in LAMPS:
                continue
            nearest = min(by_wall[name], key=lambda i: sum((p - q) ** 2 for p, q in zip(rows[i]["centre"], at)))
            values.append(max(radiosity[nearest]))
    values = sorted(v for v in values if v > 0)
    exposure = (0.8 if tone == "linear" else 1.0) / values[max(0, math.ceil(0.97 * len(values)) - 1)]
    mean = exposure * math.exp(sum(map(math.log, values)) / len(values))
    return exposure * min(max(0.06 / mean, 1), 4)
