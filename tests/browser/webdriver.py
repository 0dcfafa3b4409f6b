"""A browser without a window, spoken to over WebDriver with nothing but Python's standard library."""

import base64
import json
import os
import re
import shutil
import struct
import subprocess
import tempfile
import time
import urllib.error
import urllib.request
import zlib


def why_missing():
    """Why no browser can be started here; None when one can."""
    for program in ("chromium", "chromedriver"):
        if shutil.which(program) is None:
            return f"{program} is not installed"
    return None


class Element:
    def __init__(self, browser, reference):
        self.browser, self.reference = browser, reference

    def post(self, what, **body):
        return self.browser.post(f"element/{self.reference}/{what}", **body)

    def click(self):
        self.post("click")

    def type(self, text):
        self.post("value", text=text)

    @property
    def text(self):
        return self.browser.get(f"element/{self.reference}/text")


class Browser:
    """Headless Chromium drawing WebGL on the processor. Used in a `with`."""

    KEY = "element-6066-11e4-a52e-4f735466cecf"

    def __init__(self, width=640, height=480, dark=False, arguments=()):
        self.folder = tempfile.mkdtemp(prefix="interflect-browser-")
        self.process = None
        self.session = None
        self.width, self.height, self.dark = width, height, dark
        self.arguments = list(arguments)

    def __enter__(self):
        try:
            self.start()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_):
        try:
            if self.session:
                self.request("DELETE", f"/session/{self.session}")
        except Exception:  # it may have died; what it left is removed below
            pass
        if self.process:
            self.process.terminate()
            try:
                self.process.wait(20)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
            self.process.stdout.close()
        shutil.rmtree(self.folder, ignore_errors=True)

    def start(self):
        environment = dict(os.environ, HOME=self.folder, XDG_CONFIG_HOME=self.folder, XDG_CACHE_HOME=self.folder,
                           TMPDIR=self.folder)
        self.process = subprocess.Popen(["chromedriver", "--port=0"], stdout=subprocess.PIPE,
                                        stderr=subprocess.STDOUT, text=True, env=environment)
        said = ""
        for line in self.process.stdout:
            said += line
            found = re.search(r"started successfully on port (\d+)", line)
            if found:
                self.root = f"http://127.0.0.1:{found[1]}"
                break
        else:
            raise RuntimeError(f"chromedriver did not start: {said}")
        arguments = ["--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--use-angle=swiftshader",
                     "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist", "--disable-background-networking",
                     "--disable-component-update", "--no-first-run", "--force-color-profile=srgb",
                     "--force-device-scale-factor=1", f"--user-data-dir={self.folder}/profile",
                     f"--window-size={self.width},{self.height}"] + self.arguments
        answer = self.request("POST", "/session", {"capabilities": {"alwaysMatch": {
            "browserName": "chrome",
            "goog:chromeOptions": {"args": arguments},
            "goog:loggingPrefs": {"browser": "ALL", "performance": "ALL"}}}})
        self.session = answer["sessionId"]
        self.post("timeouts", script=120000, pageLoad=120000)
        self.resize(self.width, self.height)
        self.prefer(self.dark)

    def request(self, verb, path, body=None):
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(self.root + path, data, {"Content-Type": "application/json"}, method=verb)
        try:
            with urllib.request.urlopen(request, timeout=180) as answer:
                return json.load(answer)["value"]
        except urllib.error.HTTPError as error:
            value = json.load(error)["value"]
            raise RuntimeError(f"{verb} {path}: {value['error']}: {value['message']}") from None

    def post(self, what, **body):
        return self.request("POST", f"/session/{self.session}/{what}", body)

    def get(self, what):
        return self.request("GET", f"/session/{self.session}/{what}")

    def devtools(self, command, **parameters):
        return self.post("goog/cdp/execute", cmd=command, params=parameters)

    def resize(self, width, height, scale=1, mobile=False):
        self.width, self.height = width, height
        self.devtools("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=scale,
                      mobile=mobile)

    def prefer(self, dark):
        self.devtools("Emulation.setEmulatedMedia",
                      features=[{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}])

    def open(self, path, fragment=""):
        """Opens a file and waits until the page says that it shows its room."""
        self.post("url", url="file://" + os.path.abspath(path) + fragment)
        state = self.wait("return document.documentElement.dataset.ready")
        if state != "1":
            raise RuntimeError("the page did not start: " + str(self.run("return document.body.innerText")))
        self.settle()

    def run(self, script, *arguments):
        return self.post("execute/sync", script=script, args=list(arguments))

    def wait(self, script, *arguments):
        """Until a script returns something true; its value. No test depends on how long that takes."""
        end = time.monotonic() + 120
        while time.monotonic() < end:
            value = self.run(script, *arguments)
            if value:
                return value
            time.sleep(0.05)
        raise RuntimeError(f"waited in vain for: {script}")

    def settle(self):
        """Until what has been asked for is drawn, two frames later, and with all its pixels."""
        frames = """
          const done = arguments[0];
          requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(done, 0)));"""
        self.post("execute/async", args=[], script=frames)
        if self.run("return document.documentElement.dataset.coarse"):
            self.wait("return !document.documentElement.dataset.coarse")
            self.post("execute/async", args=[], script=frames)

    def find(self, selector):
        found = self.post("element", using="css selector", value=selector)
        return Element(self, found[self.KEY])

    def click_at(self, x, y):
        """A press of the left button at a place in the window, in CSS pixels."""
        for kind in ("mousePressed", "mouseReleased"):
            self.devtools("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1,
                          buttons=1 if kind == "mousePressed" else 0)
        self.settle()

    def set_slider(self, selector, value):
        """As a person's drag ends: the value changes and the page is told."""
        self.run("""
          const slider = document.querySelector(arguments[0]);
          slider.value = arguments[1];
          slider.dispatchEvent(new Event("input", {bubbles: true}));
          slider.dispatchEvent(new Event("change", {bubbles: true}));""", selector, str(value))
        self.settle()

    def png(self):
        """The window as it looks, as a PNG file's bytes."""
        return base64.b64decode(self.devtools("Page.captureScreenshot", format="png", optimizeForSpeed=True)["data"])

    def pixels(self):
        return Picture(self.png())

    def logs(self, kind):
        return self.post("se/log", type=kind)


class Picture:
    """A decoded PNG: 8 bits per channel, RGB or RGBA, not interlaced, as browsers write them."""

    def __init__(self, data):
        if data[:8] != b"\x89PNG\r\n\x1a\n":
            raise ValueError("not a PNG")
        at, packed = 8, b""
        while at < len(data):
            length, kind = struct.unpack(">I4s", data[at:at + 8])
            body = data[at + 8:at + 8 + length]
            if kind == b"IHDR":
                self.width, self.height, depth, colour, _, _, interlaced = struct.unpack(">IIBBBBB", body)
                if depth != 8 or colour not in (2, 6) or interlaced:
                    raise ValueError("a PNG of another kind")
                self.channels = 3 if colour == 2 else 4
            elif kind == b"IDAT":
                packed += body
            at += 12 + length
        self.rows = self.unfilter(zlib.decompress(packed))

    def unfilter(self, raw):
        step, stride = self.channels, self.channels * self.width
        rows, above = [], bytearray(stride)
        for y in range(self.height):
            start = y * (stride + 1)
            kind, row = raw[start], bytearray(raw[start + 1:start + 1 + stride])
            if kind == 2:  # what the browser writes in a hurry
                row = bytearray((p + q) & 255 for p, q in zip(row, above))
            for x in range(stride if kind in (1, 3, 4) else 0):
                left = row[x - step] if x >= step else 0
                if kind == 1:
                    row[x] = (row[x] + left) & 255
                elif kind == 3:
                    row[x] = (row[x] + (left + above[x]) // 2) & 255
                elif kind == 4:
                    corner = above[x - step] if x >= step else 0
                    guess = left + above[x] - corner
                    near = [abs(guess - v) for v in (left, above[x], corner)]
                    row[x] = (row[x] + (left, above[x], corner)[near.index(min(near))]) & 255
            rows.append(row)
            above = row
        return rows

    def at(self, x, y):
        start = self.channels * x
        return tuple(self.rows[y][start:start + 3])


def differing(first, second):
    """How many pixels of two pictures differ."""
    a, b = Picture(first), Picture(second)
    return sum(a.at(x, y) != b.at(x, y) for y in range(a.height) for x in range(a.width))
