#!/usr/bin/env python3
"""Writes the scenes of scenes/ that are made by a program: make-scenes.py [FOLDER]; needs only Python 3.

The same on every machine, byte for byte; a test compares what it writes with what is committed.
"""

import os
import sys

sys.dont_write_bytecode = True
sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from scenes import plain, rooms  # noqa: E402


def main():
    here = os.path.dirname(os.path.abspath(__file__))
    folder = sys.argv[1] if len(sys.argv) > 1 else os.path.join(here, "..", "scenes")
    os.makedirs(folder, exist_ok=True)
    for make in (plain.two_plates, plain.furnace, plain.cornell_box):
        make(folder)
    for count in rooms.ROOMS:
        rooms.make(folder, count)


if __name__ == "__main__":
    main()
