"""The page of `serve` in a real browser: an edit's pixels must be those of an independent solve of the edited scene.

serve_page_test.py PROGRAM [TEST...]. Exit status 77 where there is no browser, unless INTERFLECT_TEST_REQUIRE names
chromium."""

import json
import os
import sys
import tempfile
import unittest

import room
from served import Served
from webdriver import Browser, why_missing

WIDTH, HEIGHT = 700, 400
CAMERA = "#eye={},{},{}&to={},{},{}&camera=walk&exposure=1.5&tone=linear&shading=flat".format(*room.EYE, *room.TARGET)
NO_DRIVERS = {"OCL_ICD_VENDORS": "/nonexistent", "VK_ICD_FILENAMES": "/nonexistent", "VK_DRIVER_FILES": "/nonexistent"}
PROGRAM = None


class LivePage(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory(prefix="interflect-live-")
        cls.addClassCleanup(cls.folder.cleanup)
        cls.solver = room.Solver(PROGRAM, cls.folder.name)
        scene = room.write_scene(cls.folder.name, "room", list(room.LAMPS))
        cls.before = cls.table(0.6)
        cls.lens = room.Lens(WIDTH, HEIGHT)
        cls.seen = room.visible(cls.before, cls.lens)
        cls.served = Served(PROGRAM, scene, environment=NO_DRIVERS)
        cls.addClassCleanup(cls.served.close)
        cls.browser = Browser(WIDTH, HEIGHT)
        cls.enterClassContext(cls.browser)

    @classmethod
    def table(cls, level):
        """An independent solve with the left wall's largest reflectance at `level`."""
        scale = level / 0.6
        walls = dict(room.WALLS)
        _, corners = walls["left"]
        room.WALLS["left"] = (tuple(scale * v for v in (0.6, 0.15, 0.1)), corners)
        try:
            return cls.solver.table(list(room.LAMPS))
        finally:
            room.WALLS.update(walls)

    def setUp(self):
        self.assertGreater(len(self.seen), 60)
        self.browser.post("url", url="about:blank")
        for kind in ("browser", "performance"):
            self.browser.logs(kind)
        self.browser.post("url", url=self.served.url + CAMERA)
        self.assertEqual(self.browser.wait("return document.documentElement.dataset.ready"), "1")
        self.browser.wait("return document.documentElement.dataset.live && document.getElementById('device').length")

    def tearDown(self):
        """Nothing in the console, and no request but to the page's own origin."""
        said = [entry for entry in self.browser.logs("browser") if entry["level"] in ("SEVERE", "WARNING")]
        self.assertEqual(said, [])
        asked = []
        for entry in self.browser.logs("performance"):
            message = json.loads(entry["message"])["message"]
            if message["method"] == "Network.requestWillBeSent":
                asked.append(message["params"]["request"]["url"])
        self.assertTrue(any(url.startswith(self.served.url) for url in asked))
        strangers = [url for url in asked if not url.startswith((self.served.url, "data:", "blob:", "about:"))]
        self.assertEqual(strangers, [])

    def fold(self):
        if not self.browser.run("return document.getElementById('panel').classList.contains('folded')"):
            self.browser.run("document.getElementById('fold').click()")
        self.browser.settle()

    def wrong(self, rows, levels=1.0):
        """Patches whose pixel is not what these radiosities make of it."""
        picture = self.browser.pixels()
        covered = self.browser.run("""
          return ["toolbar", "panel", "legend", "hint", "status"]
            .map((id) => document.getElementById(id).getBoundingClientRect())
            .map((r) => [r.left - 26, r.top - 26, r.right + 26, r.bottom + 26]);""")
        wrong, self.compared = [], 0
        for i, (x, y) in self.seen.items():
            if any(left <= x <= right and top <= y <= bottom for left, top, right, bottom in covered):
                continue
            self.compared += 1
            expected = room.photographed(rows[i]["b"], 1.5, "linear")
            if any(abs(have - want) > levels for have, want in zip(picture.at(x, y), expected)):
                wrong.append((i, rows[i]["group"], picture.at(x, y), expected))
        self.assertGreater(self.compared, 60)
        return wrong

    def row(self, name):
        return f".material[aria-label='{name}']"

    def solved(self):
        return int(self.browser.run("return document.documentElement.dataset.solved || 0"))

    def move(self, selector, value):
        """Moves a control and waits for the light of it."""
        before = self.solved()
        self.browser.set_slider(selector, value)
        self.browser.wait("""const app = document.documentElement.dataset;
          return Number(app.solved || 0) > arguments[0]""", before)
        self.browser.settle()

    def test_the_reflectance_slider_moves_the_light(self):
        self.browser.set_slider("#tolerance", "0.000001")
        self.fold()
        self.assertEqual(self.wrong(self.before), [])
        self.move(self.row("paint_left") + " input[type=range]", 95)
        after = self.table(0.95)
        self.assertEqual(self.wrong(after), [])
        # The twins: the room as it was, and a wall a little beside what was asked.
        self.assertGreater(len(self.wrong(self.before)), self.compared / 4)
        self.assertGreater(len(self.wrong(self.table(0.85))), self.compared / 20)
        before = self.solved()
        self.browser.run("document.getElementById('surfaces-reset').click()")
        self.browser.wait("return Number(document.documentElement.dataset.solved) > arguments[0]", before)
        self.browser.wait("return document.querySelector(arguments[0]).value === '60'",
                          self.row("paint_left") + " input[type=range]")
        self.browser.settle()
        self.assertEqual(self.wrong(self.before), [])

    def test_the_panel_says_what_is_going_on(self):
        self.move(self.row("paint_floor") + " input[type=range]", 40)
        text = lambda name: self.browser.run("return document.getElementById(arguments[0]).textContent", name)
        self.assertGreater(float(text("rate")), 0)
        self.assertGreaterEqual(int(text("products").split(",")[0]), 1)
        self.assertIn("live on openmp", text("subtitle"))
        self.assertTrue(self.browser.run("return document.getElementById('bounces').hidden"))
        self.assertEqual(self.browser.run("return document.getElementById('device').value"), "openmp")
        # The inspector knows the new reflectance.
        floor = next(i for i in self.seen if self.before[i]["group"] == "floor")
        self.fold()
        self.browser.click_at(*self.seen[floor])
        said = self.browser.run("return document.getElementById('inspect-reflectance').textContent")
        self.assertEqual([round(float(v), 4) for v in said.split()], [0.4, 0.2909, 0.1818])

    def test_a_busy_server_is_asked_again(self):
        """As where a hundred open the page at once."""
        script = """
          const real = window.fetch;
          let busy = 2;
          window.fetch = (...asked) => busy-- > 0 ?
            Promise.resolve(new Response('{"error": "too many"}', {status: 503, headers: {"Retry-After": "0.01"}})) : real(...asked);"""
        added = self.browser.devtools("Page.addScriptToEvaluateOnNewDocument", source=script)
        try:
            self.browser.post("url", url="about:blank")
            self.browser.post("url", url=self.served.url + CAMERA)
            self.browser.wait("return document.documentElement.dataset.live && document.getElementById('device').length")
        finally:
            self.browser.devtools("Page.removeScriptToEvaluateOnNewDocument", identifier=added["identifier"])
        self.assertNotIn("does not answer", self.browser.run("return document.getElementById('status').textContent"))
        self.move(self.row("paint_floor") + " input[type=range]", 35)

    def test_another_scene_at_the_same_address_is_said_so(self):
        self.browser.run("""
          const real = window.fetch;
          window.fetch = async (...asked) => {
            const answer = await real(...asked);
            if (asked[0] !== "/solve") return answer;
            const bytes = new Uint8Array(await answer.arrayBuffer());
            const length = new DataView(bytes.buffer).getUint32(0, true);
            const said = JSON.parse(new TextDecoder().decode(bytes.subarray(4, 4 + length)));
            said.patches = 10;
            const text = JSON.stringify(said), json = new TextEncoder().encode(text + " ".repeat(3 - (text.length + 3) % 4));
            const other = new Uint8Array(4 + json.length + 4 * 3 * 10 * said.lamps);
            new DataView(other.buffer).setUint32(0, json.length, true);
            other.set(json, 4);
            return new Response(other);
          };""")
        self.fold()
        self.browser.set_slider(self.row("paint_left") + " input[type=range]", 95)
        self.browser.wait("return document.querySelector('#solver .problem:not([hidden])')")
        self.assertIn("load the page again", self.browser.run("return document.querySelector('#solver .problem').textContent"))
        self.browser.settle()
        self.assertEqual(self.wrong(self.before), [])  # the light stays what it was

    def test_a_device_that_fails_is_said_so(self):
        self.browser.run("""const select = document.getElementById("device");
          select.add(new Option("none", "opencl:99"));
          select.value = "opencl:99";
          select.dispatchEvent(new Event("change"));""")
        self.browser.wait("return document.querySelector('#solver .problem:not([hidden])')")
        self.assertIn("opencl:99", self.browser.run("return document.querySelector('#solver .problem').textContent"))
        self.assertEqual(self.browser.run("return document.getElementById('device').value"), "openmp")
        logged = [e for e in self.browser.logs("browser") if e["level"] in ("SEVERE", "WARNING")]
        self.assertTrue(all("/device" in e["message"] and "400" in e["message"] for e in logged), logged)
        self.move(self.row("paint_floor") + " input[type=range]", 30)


if __name__ == "__main__":
    if why := why_missing():
        print(f"skipped: {why}")
        sys.exit(1 if "chromium" in os.environ.get("INTERFLECT_TEST_REQUIRE", "") else 77)
    PROGRAM = sys.argv.pop(1)
    unittest.main()
