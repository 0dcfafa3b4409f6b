"""The page of `view` in a real browser: what it shows must be what independent solves say.

page_test.py PROGRAM [TEST...]. Exit status 77 where there is no browser, unless INTERFLECT_TEST_REQUIRE names chromium."""

import http.server
import json
import math
import os
import struct
import sys
import tempfile
import threading
import time
import unittest

import room
from webdriver import Browser, Picture, differing, why_missing

WIDTH, HEIGHT = 700, 400
CAMERA = "#eye={},{},{}&to={},{},{}&camera=walk".format(*room.EYE, *room.TARGET)
PROGRAM = None


class Page(unittest.TestCase):
    """One browser and one page for all tests; each opens it anew."""

    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory(prefix="interflect-page-")
        cls.addClassCleanup(cls.folder.cleanup)
        cls.solver = room.Solver(PROGRAM, cls.folder.name)
        scene = room.write_scene(cls.folder.name, "room", list(room.LAMPS))
        cls.path = os.path.join(cls.folder.name, "room.html")
        cls.solver.solve(scene, "view", "-o", cls.path)
        cls.single = [cls.solver.table([lamp]) for lamp in room.LAMPS]
        cls.rows = cls.single[0]
        cls.lens = room.Lens(WIDTH, HEIGHT)
        cls.seen = room.visible(cls.rows, cls.lens)
        cls.browser = Browser(WIDTH, HEIGHT)
        cls.enterClassContext(cls.browser)
        for kind in ("browser", "performance"):  # what came with the browser's own first page
            cls.browser.logs(kind)

    def setUp(self):
        self.assertGreater(len(self.seen), 60, "too few patches in view to compare anything")
        self.walls = {row["group"] for i, row in enumerate(self.rows) if i in self.seen}
        self.assertGreaterEqual(self.walls, {"floor", "ceiling", "back", "left", "right"})

    def tearDown(self):
        """Nothing in the console, and nothing left the page."""
        said = [entry for entry in self.browser.logs("browser") if entry["level"] in ("SEVERE", "WARNING")]
        self.assertEqual(said, [])
        self.assertEqual(self.requests(), [])

    def requests(self):
        """Addresses that were asked for, the page itself and what it made apart."""
        out = []
        for entry in self.browser.logs("performance"):
            message = json.loads(entry["message"])["message"]
            if message["method"] != "Network.requestWillBeSent":
                continue
            url = message["params"]["request"]["url"]
            if not url.startswith(("file://" + self.folder.name, "data:", "blob:")):
                out.append(url)
        return out

    def open(self, fragment="", fold=True):
        self.browser.open(self.path, fragment)
        self.browser.run("localStorage.clear()")
        if fold:  # the room has the whole window, and the camera's middle is the window's
            self.browser.find("#fold").click()
            self.browser.settle()

    def reopen(self, fragment="", fold=True):
        """As another person would: not by a change of the address alone."""
        self.browser.post("url", url="about:blank")
        self.open(fragment, fold)

    def covered(self):
        """What lies over the room, with its shadow."""
        return self.browser.run("""
          return ["toolbar", "panel", "legend", "hint", "status"]
            .map((id) => document.getElementById(id).getBoundingClientRect())
            .map((r) => [r.left - 26, r.top - 26, r.right + 26, r.bottom + 26]);""")

    def wrong(self, expected, levels=1.0):
        """Patches whose pixel is more than so many levels from what it must be, of those that nothing covers."""
        picture, covered = self.browser.pixels(), self.covered()
        wrong, self.compared = [], 0
        for i, (x, y) in self.seen.items():
            if any(left <= x <= right and top <= y <= bottom for left, top, right, bottom in covered):
                continue
            self.compared += 1
            if any(abs(have - want) > levels for have, want in zip(picture.at(x, y), expected[i])):
                wrong.append((i, self.rows[i]["group"], picture.at(x, y), expected[i]))
        self.assertGreater(self.compared, 60)
        return wrong

    def photographed(self, weights, exposure, tone):
        return [room.photographed(b, exposure, tone) for b in room.mixed(self.single, weights)]

    def press(self, selector):
        """Also what the folded panel hides."""
        self.browser.run("document.querySelector(arguments[0]).click()", selector)

    def text(self, name):
        return self.browser.run("return document.getElementById(arguments[0]).textContent", name)

    def slider(self, lamp):
        return f".lamp:nth-child({lamp + 1}) input[type=range]"

    def hash_with(self, *parts):
        return self.browser.wait("""
          return arguments[0].every((part) => location.hash.includes(part)) && location.hash""", list(parts))

    # ---- the light

    def test_a_slider_dims_its_lamp(self):
        for tone in ("filmic", "linear"):
            self.reopen(CAMERA + f"&exposure=1.5&tone={tone}&shading=flat")
            both = [(1, 1, 1), (1, 1, 1)]
            self.assertEqual(self.wrong(self.photographed(both, 1.5, tone)), [])
            self.browser.set_slider(self.slider(0), 35)
            dimmed = [(0.35, 0.35, 0.35), (1, 1, 1)]
            self.assertEqual(self.wrong(self.photographed(dimmed, 1.5, tone)), [])
            # The twins: a weight that is off by a twentieth, and the two weights exchanged.
            for weights in ([(0.40, 0.40, 0.40), (1, 1, 1)], dimmed[::-1]):
                self.assertGreater(len(self.wrong(self.photographed(weights, 1.5, tone))), self.compared / 2)

    def test_switches_and_colours(self):
        self.reopen(CAMERA + "&exposure=2&tone=linear&shading=flat")
        self.press(".lamp:nth-child(1) input[role=switch]")
        self.browser.settle()
        self.assertEqual(self.wrong(self.photographed([(0, 0, 0), (1, 1, 1)], 2, "linear")), [])
        self.browser.set_slider(".lamp:nth-child(2) input[type=color]", "#ff8000")
        tint = tuple(room.srgb_linear(v / 255) for v in (255, 128, 0))
        self.assertEqual(self.wrong(self.photographed([(0, 0, 0), tint], 2, "linear")), [])
        self.press("#lamps-reset")
        self.browser.settle()
        self.assertEqual(self.wrong(self.photographed([(1, 1, 1)] * 2, 2, "linear")), [])
        self.assertGreater(len(self.wrong(self.photographed([(0, 0, 0), tint], 2, "linear"))), self.compared / 2)

    def test_false_colours(self):
        for kind, low, high in (("linear", 0, 0.8), ("log", 0.02, 1.5)):
            self.reopen(CAMERA + f"&tone=false&scale={kind},{low},{high}&shading=flat&levels=1,0.5")
            b = room.mixed(self.single, [(1, 1, 1), (0.5, 0.5, 0.5)])
            shown = [room.false_colour(v, low, high, kind == "log") for v in b]
            self.assertEqual(self.wrong(shown), [])
            twin = [room.false_colour(v, low, 1.1 * high, kind == "log") for v in b]
            self.assertGreater(len(self.wrong(twin)), self.compared / 2)
            ticks = self.browser.run("""
              return [...document.querySelectorAll("#legend-ticks span")].map((t) =>
                [Number(t.textContent), parseFloat(t.style.bottom) / 100]);""")
            self.assertGreaterEqual(len(ticks), 4)
            for value, place in ticks:
                t = math.log(value / low) / math.log(high / low) if kind == "log" else (value - low) / (high - low)
                self.assertAlmostEqual(place, t, delta=1e-3)

    def test_bounces(self):
        self.reopen(CAMERA + "&exposure=2&tone=linear&shading=flat")
        weights = [(0.5, 0.5, 0.5), (1, 1, 1)]
        self.browser.set_slider(self.slider(0), 50)
        by_count = {}
        for bounce in (0, 1, 3):
            self.browser.set_slider("#bounce", bounce)
            if bounce == 0:
                tables = [[dict(row, b=row["e"]) for row in rows] for rows in self.single]
            else:
                tables = [self.solver.table([lamp], "--method", "jacobi", "--iterations", str(bounce))
                          for lamp in room.LAMPS]
            by_count[bounce] = [room.photographed(b, 2, "linear") for b in room.mixed(tables, weights)]
            self.assertEqual(self.wrong(by_count[bounce]), [])
            self.assertIn(str(bounce), self.text("bounce-value"))
        self.assertGreater(len(self.wrong(by_count[1])), self.compared / 2)  # the twin: another bounce
        self.browser.set_slider("#bounce", 99)
        self.assertEqual(self.text("bounce-value"), "all bounces")
        self.assertEqual(self.wrong(self.photographed(weights, 2, "linear")), [])

    def test_smooth_shading_is_that_of_the_other_outputs(self):
        scene = os.path.join(self.folder.name, "room.obj")
        out = os.path.join(self.folder.name, "room.ply")
        self.solver.solve(scene, "solve", "-o", out)
        corners = read_ply(out)
        middle = [tuple(sum(c[k] for c in three) / 3 for k in range(3)) for three in corners]
        shown = [room.photographed(b, 1.5, "filmic") for b in middle]
        self.reopen(CAMERA + "&exposure=1.5")
        # The middle of a pixel is up to half a pixel from the middle of the patch, along which the light changes.
        near = self.wrong(shown, 4)
        self.assertEqual(near, [])
        flat = self.photographed([(1, 1, 1)] * 2, 1.5, "filmic")
        self.assertGreater(len(self.wrong(flat, 4)), 10)  # the twin

    def test_the_first_exposure_is_that_of_a_picture(self):
        self.reopen(CAMERA)
        found = self.hash_with("exposure=")
        exposure = float(found.split("exposure=")[1].split("&")[0])
        b = room.mixed(self.single, [(1, 1, 1)] * 2)
        expected = room.automatic_exposure(self.rows, b, self.lens)
        # Folding the panel comes after the first exposure: what it hid then is the right edge of the picture.
        self.assertLess(abs(exposure / expected - 1), 0.15)
        self.assertGreater(abs(exposure / room.automatic_exposure(self.rows, b, self.lens, "linear") - 1), 0.15)

    # ---- the page

    def test_the_inspector_says_what_was_solved(self):
        self.reopen(CAMERA + "&exposure=1.5&levels=0.5,1")
        b = room.mixed(self.single, [(0.5, 0.5, 0.5), (1, 1, 1)])
        lamp = next(i for i, row in enumerate(self.rows) if row["group"] == room.HOSTILE and i in self.seen)
        wall = next(i for i in self.seen if self.rows[i]["group"] == "back" and self.seen[i][1] > 150)
        for patch in (wall, lamp):
            row = self.rows[patch]
            self.browser.click_at(*self.seen[patch])
            text = lambda name: self.text(f"inspect-{name}")
            numbers = lambda name: [float(v) for v in text(name).split()]
            self.assertEqual(text("object"), row["group"])
            self.assertEqual(text("material"), "glow_1" if patch == lamp else "paint_back")
            self.assertEqual(text("patch").split()[0], str(patch))
            close = lambda have, want: [self.assertAlmostEqual(h, w, delta=2e-4 * abs(w) + 1e-9)
                                        for h, w in zip(have, want, strict=True)]
            close(numbers("area"), [row["area"]])
            close(numbers("reflectance"), row["rho"])
            close(numbers("emittance"), room.LAMPS[room.HOSTILE][0] if patch == lamp else (0, 0, 0))
            close(numbers("radiosity"), b[patch])
            close(numbers("row-sum"), [row["row_sum"]])
        # It follows the sliders.
        self.browser.set_slider(self.slider(1), 50)
        close(numbers("radiosity"), room.mixed(self.single, [(0.5,) * 3, (0.5,) * 3])[lamp])

    def test_an_address_brings_the_view_back(self):
        self.reopen(CAMERA + "&shading=flat")
        self.browser.set_slider(self.slider(0), 30)
        self.browser.set_slider(self.slider(1), 140)
        self.browser.set_slider(".lamp:nth-child(2) input[type=color]", "#20c0ff")
        self.browser.set_slider("#exposure", 0.5)
        self.browser.set_slider("#bounce", 2)
        self.browser.find("#room").type("wwd")
        self.browser.settle()
        self.press("#link")
        address = self.hash_with("levels=0.3,1.4", "colours=ffffff,20c0ff", "bounce=2", "exposure=1.41421")
        self.assertNotIn("eye={},{},{}&".format(*room.EYE), address)

        def picture():  # without the ring around what has the focus, and without what is said for a moment
            self.browser.run("""
              document.activeElement.blur();
              for (const id of ["hint", "status"]) document.getElementById(id).hidden = true;""")
            self.browser.settle()
            return self.browser.png()

        before = picture()
        self.reopen("")
        self.assertGreater(differing(before, picture()), 10000)
        self.reopen(address)
        self.assertEqual(differing(before, picture()), 0)
        state = self.browser.run("""
          const value = (s) => document.querySelector(s).value;
          return [value(arguments[0]), value(arguments[1]), value(".lamp:nth-child(2) input[type=color]"),
                  value("#bounce")];""", self.slider(0), self.slider(1))
        self.assertEqual(state, ["30", "140", "#20c0ff", "2"])

    def camera(self):
        """Eye and target, as the link says them."""
        self.browser.settle()
        self.press("#link")
        parts = dict(p.split("=") for p in self.hash_with("eye=")[1:].split("&"))
        return [tuple(float(v) for v in parts[name].split(",")) for name in ("eye", "to")]

    def test_mouse_touch_and_keys_move_the_camera(self):
        far = lambda a, b: math.dist(a, b) > 0.05
        close = lambda a, b: math.dist(a, b) < 1e-3
        mouse = lambda kind, x, y, **more: self.browser.devtools(
            "Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", **more)

        def drag():
            mouse("mousePressed", 350, 200, buttons=1, clickCount=1)
            mouse("mouseMoved", 420, 220, buttons=1)
            mouse("mouseReleased", 420, 220, buttons=0, clickCount=1)

        def fingers(*places):
            self.browser.devtools("Input.dispatchTouchEvent", touchPoints=[
                {"x": x, "y": y, "id": k} for k, (x, y) in enumerate(places[1:])], type=places[0])

        for mode, stays in (("walk", 0), ("orbit", 1)):
            self.reopen(CAMERA.replace("walk", mode))
            before = self.camera()
            drag()
            after = self.camera()
            self.assertTrue(close(before[stays], after[stays]), (mode, before, after))
            self.assertTrue(far(before[1 - stays], after[1 - stays]), (mode, before, after))
            fingers("touchStart", (350, 200))
            fingers("touchMove", (300, 230))
            fingers("touchEnd")
            touched = self.camera()
            self.assertTrue(close(after[stays], touched[stays]) and far(after[1 - stays], touched[1 - stays]), touched)
            fingers("touchStart", (300, 200), (400, 200))
            fingers("touchMove", (250, 200), (450, 200))
            fingers("touchEnd")
            pinched = self.camera()
            self.assertTrue(far(touched[0], pinched[0]), pinched)
            self.browser.devtools("Input.dispatchMouseEvent", type="mouseWheel", x=350, y=200, deltaX=0, deltaY=-100)
            wheeled = self.camera()
            self.assertTrue(far(pinched[0], wheeled[0]), wheeled)
            self.browser.find("#room").type("s")
            stepped = self.camera()
            self.assertGreater(math.dist(wheeled[0], stepped[0]), 1e-3)
            self.press("#home")
            home = self.camera()
            self.assertTrue(close(home[0], room.EYE) and close(home[1], room.TARGET), home)

    def test_a_name_that_means_harm_is_text(self):
        self.reopen()
        names = self.browser.run("return [...document.querySelectorAll('.lamp .name')].map((n) => n.textContent)")
        self.assertEqual(sorted(names), sorted(room.LAMPS))
        self.assertEqual(self.browser.run("return document.querySelectorAll('img').length"), 0)
        self.assertEqual(self.browser.run("return document.title"), "room · Interflect")

    def test_nothing_can_leave_the_page(self):
        with Listener() as listener:
            call = f"""
              fetch("{listener.url}").catch(() => 0);
              const picture = new Image();
              picture.src = "{listener.url}picture.png";
              const script = document.createElement("script");
              script.src = "{listener.url}script.js";
              document.head.append(script);"""
            self.reopen()
            self.browser.run(call)
            self.browser.settle()
            blocked = [e["message"] for e in self.browser.logs("browser")]
            self.assertGreaterEqual(sum("Content Security Policy" in m for m in blocked), 3, blocked)
            self.assertEqual(listener.asked, [])
            # The twin: the same page without its policy does reach the listener.
            with open(self.path, encoding="utf-8") as file:
                text = file.read()
            start = text.index("<meta http-equiv=")
            bare = os.path.join(self.folder.name, "bare.html")
            with open(bare, "w", encoding="utf-8") as file:
                file.write(text[:start] + text[text.index(">", start) + 1:])
            self.browser.open(bare)
            self.browser.run(call)
            listener.wait(3)
            self.assertGreater(len(self.requests()), 0)  # so the record of requests works, too
        self.browser.logs("browser")

    def test_a_picture_can_be_saved(self):
        downloads = os.path.join(self.folder.name, "downloads")
        os.mkdir(downloads)
        self.browser.devtools("Page.setDownloadBehavior", behavior="allow", downloadPath=downloads)
        expected = self.photographed([(1, 1, 1)] * 2, 2, "linear")
        try:
            # On a phone the room has half of the window, and the picture all of it: what was seen is still in it.
            for width, height, fold in ((WIDTH, HEIGHT, True), (390, 844, False)):
                self.browser.resize(width, height)
                self.reopen(CAMERA + "&tone=linear&exposure=2&shading=flat", fold)
                self.browser.find("#picture").click()
                path = os.path.join(downloads, "room.png")
                end = time.monotonic() + 60
                while os.listdir(downloads) != ["room.png"] and time.monotonic() < end:
                    time.sleep(0.05)
                with open(path, "rb") as file:
                    saved = Picture(file.read())
                os.remove(path)
                self.assertEqual((saved.width, saved.height), (width, height))
                seen = room.visible(self.rows, room.Lens(width, height))
                self.assertGreater(len(seen), 30)
                for i, (x, y) in seen.items():
                    self.assertTrue(all(abs(h - w) <= 1 for h, w in zip(saved.at(x, y), expected[i])), (i, width))
        finally:
            self.browser.resize(WIDTH, HEIGHT)

    def test_keys_reach_everything(self):
        self.reopen(fold=False)
        order = []
        for _ in range(60):
            self.browser.devtools("Input.dispatchKeyEvent", type="keyDown", key="Tab", code="Tab",
                                  windowsVirtualKeyCode=9)
            self.browser.devtools("Input.dispatchKeyEvent", type="keyUp", key="Tab", code="Tab",
                                  windowsVirtualKeyCode=9)
            focused = self.browser.run("""
              const e = document.activeElement;
              if (e === document.body) return null;
              const label = e.getAttribute("aria-label") || (e.labels && e.labels[0] && e.labels[0].textContent)
                || e.textContent;
              return [e.id || e.className || e.name || e.tagName, (label || "").trim()];""")
            if focused is None:
                break
            order.append(focused)
        ids = [name for name, _ in order]
        for wanted in ("room", "home", "picture", "link", "fold", "theme", "exposure", "smooth", "wire", "bounce"):
            self.assertIn(wanted, ids)
        self.assertEqual([name for name, label in order if not label], [])
        self.assertLess(ids.index("room"), ids.index("fold"))
        self.browser.find("#room").type("\ue007")  # Enter: the patch in the middle
        self.browser.settle()
        self.assertEqual(self.text("inspect-object"), "back")

    def test_what_is_not_solved_to_its_end_is_not_called_all_bounces(self):
        label = lambda: self.text("bounce-value")
        self.reopen()
        self.assertEqual(label(), "all bounces")
        cut = os.path.join(self.folder.name, "cut.html")
        self.solver.solve(os.path.join(self.folder.name, "room.obj"), "view", "-o", cut, "--method", "jacobi", "--iterations", "2")
        self.browser.open(cut)
        self.assertEqual(label(), "as far as solved")
        self.browser.set_slider("#bounce", 12)
        self.assertEqual(label(), "12 bounces")
        self.assertIn("not with all its bounces", self.browser.run("return document.querySelector('#help .note').textContent"))

    def test_light_and_dark(self):
        theme = lambda: self.browser.run("return document.documentElement.dataset.theme")
        ground = lambda: self.browser.run("return getComputedStyle(document.body).backgroundColor")
        self.reopen()
        self.assertEqual(theme(), "light")
        light = ground()
        self.browser.prefer(True)
        self.browser.wait("return document.documentElement.dataset.theme === 'dark'")
        self.assertNotEqual(ground(), light)
        self.browser.prefer(False)
        self.browser.find("#fold").click()
        for expected in ("light", "dark", "light"):  # always light, always dark, as the system
            self.browser.find("#theme").click()
            self.assertEqual(theme(), expected)

    def test_a_phone_has_it_all(self):
        try:
            self.browser.resize(390, 844, 2, True)
            self.reopen(fold=False)
            wide = self.browser.run("return [document.documentElement.scrollWidth, innerWidth]")
            self.assertEqual(wide, [390, 390])
            boxes = self.browser.run("""
              return ["toolbar", "panel"].map((id) => document.getElementById(id).getBoundingClientRect())
                .map((r) => [r.left, r.top, r.right, r.bottom]);""")
            for left, top, right, bottom in boxes:
                self.assertTrue(0 <= left < right <= 390 and 0 <= top < bottom <= 844, boxes)
            self.assertLess(boxes[0][3], boxes[1][1])
            self.assertGreater(boxes[1][1], 400)  # half of the window is the room's
        finally:
            self.browser.resize(WIDTH, HEIGHT)


def read_ply(path):
    """The radiosities at each face's corners from a PLY of `solve`."""
    with open(path, "rb") as file:
        data = file.read()
    end = data.index(b"end_header\n") + len(b"end_header\n")
    header = data[:end].decode()
    count = lambda name: int(header.split(f"element {name} ")[1].split()[0])
    vertex = struct.Struct("<6f3B3f")
    values = [vertex.unpack_from(data, end + k * vertex.size)[9:] for k in range(count("vertex"))]
    face = struct.Struct("<B3I")
    start = end + count("vertex") * vertex.size
    return [[values[v] for v in face.unpack_from(data, start + k * face.size)[1:]] for k in range(count("face"))]


class Listener:
    """A server on this machine that writes down who asks for what."""

    def __enter__(self):
        asked = self.asked = []

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_GET(self):
                asked.append(self.path)
                self.send_response(404)
                self.end_headers()

            def log_message(self, *_):
                pass

        self.server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.server.server_address[1]}/"
        self.thread = threading.Thread(target=self.server.serve_forever)
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.server.shutdown()
        self.thread.join()
        self.server.server_close()

    def wait(self, count):
        end = time.monotonic() + 60
        while len(set(self.asked)) < count and time.monotonic() < end:
            time.sleep(0.05)
        if len(set(self.asked)) < count:
            raise AssertionError(f"only {self.asked} were asked for")


if __name__ == "__main__":
    PROGRAM = sys.argv.pop(1)
    missing = why_missing()
    if missing and "chromium" in os.environ.get("INTERFLECT_TEST_REQUIRE", "").split(","):
        sys.exit(f"required, but {missing}")
    if missing:
        print(f"SKIPPED: {missing}")
        sys.exit(77)
    unittest.main(verbosity=2)
