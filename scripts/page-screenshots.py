#!/usr/bin/env python3
"""page-screenshots.py PROGRAM [FOLDER]: the pages of the rooms and of the Cornell box as a browser shows them, into
FOLDER (docs/pictures). Needs Debian's chromium and chromium-driver; a minute or three on two cores."""

import os
import struct
import subprocess
import sys
import tempfile
import zlib

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
sys.path.insert(0, os.path.join(ROOT, "tests", "browser"))
sys.dont_write_bytecode = True
from webdriver import Browser, Picture, why_missing  # noqa: E402

LIMIT = 400_000  # bytes of a picture
# name of the picture, scene, --divide, fragment of the address, (width, height, pixels per pixel, phone), dark
SHOTS = [
    ("page-room-17128", "room-17128", 1, "", (1200, 750, 1, False), True),
    ("page-room-9680", "room-9680", 1, "#levels=1.4,1,0.1,0", (1200, 750, 1, False), True),
    ("page-room-3360", "room-3360", 1, "#tone=false&scale=log,0.02,2", (1200, 750, 1, False), False),
    ("page-room-1312", "room-1312", 1, "", (1200, 750, 1, False), False),
    ("page-cornell-box", "cornell-box", 1000, "", (1200, 750, 1, False), False),
    ("page-phone", "room-9680", 1, "", (390, 844, 1, True), False),
]


def chunk(kind, body):
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


def packed(picture):
    """The picture as a PNG that is small: RGB, each row with the filter whose bytes are smallest."""
    rows, above = [], bytes(3 * picture.width)
    for row in picture.rows:
        row = bytes(row) if picture.channels == 3 else bytes(b for k, b in enumerate(row) if k % 4 < 3)
        left = bytes(3) + row[:-3]
        tries = [bytes((p - q) & 255 for p, q in zip(row, left)), bytes((p - q) & 255 for p, q in zip(row, above)),
                 bytes((p - (q + r) // 2) & 255 for p, q, r in zip(row, left, above))]
        sizes = [sum(min(b, 256 - b) for b in t) for t in tries]
        best = sizes.index(min(sizes))
        rows.append(bytes([best + 1]) + tries[best])
        above = row
    header = struct.pack(">IIBBBBB", picture.width, picture.height, 8, 2, 0, 0, 0)
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"sRGB", b"\0") +
            chunk(b"IDAT", zlib.compress(b"".join(rows), 9)) + chunk(b"IEND", b""))


def main():
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    if why_missing():
        sys.exit(f"page-screenshots: {why_missing()}")
    folder = sys.argv[2] if len(sys.argv) == 3 else os.path.join(ROOT, "docs", "pictures")
    with tempfile.TemporaryDirectory() as work, Browser(1200, 750) as browser:
        for name, scene, divide, fragment, (width, height, scale, phone), dark in SHOTS:
            page = os.path.join(work, f"{scene}.html")
            if not os.path.exists(page):
                subprocess.run([sys.argv[1], "view", os.path.join(ROOT, "scenes", f"{scene}.obj"), "--divide",
                                str(divide), "-o", page, "--quiet"], check=True)
            browser.resize(width, height, scale, phone)
            browser.prefer(dark)
            browser.post("url", url="about:blank")
            browser.open(page, fragment)
            browser.settle()
            data = packed(Picture(browser.png()))
            if len(data) > LIMIT:
                sys.exit(f"page-screenshots: {name}.png would have {len(data)} bytes, above {LIMIT}")
            with open(os.path.join(folder, f"{name}.png"), "wb") as file:
                file.write(data)
            print(f"{name}.png: {len(data) // 1024} KiB", flush=True)


main()
