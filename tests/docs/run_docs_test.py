#!/usr/bin/env python3
"""run_docs_test.py PROGRAM: that run_docs.py fails where a page does not hold what it promises."""

import os
import sys
import tempfile
import unittest
import unittest.mock

from run_docs import ROOT, Wrong, run_page, taken

PROGRAM = os.path.abspath(sys.argv[1])
SOLVE = "interflect solve scenes/furnace.obj --divide 0.1 --report furnace.json"


def sh(*lines, before=""):
    return before + "\n".join(("```sh", *lines, "```")) + "\n"


def output(*lines):
    return "\n".join(("```output", *lines, "```")) + "\n"


class Pages(unittest.TestCase):
    def page(self, text, check=run_page, program=PROGRAM):
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "page.md")
            with open(path, "w", encoding="utf-8") as file:
                file.write(text)
            return check(program, path)

    def fails(self, text, why, **more):
        with self.assertRaisesRegex(Wrong, why):
            self.page(text, **more)

    def test_a_page_that_holds(self):
        self.assertEqual(1, self.page(sh(SOLVE) + output("scene ... 192 patches ...", "...", "wrote          furnace.json")))

    def test_wrong_option(self):
        self.fails(sh(SOLVE + " --no-such-option"), "status 2 instead of 0")

    def test_wrong_scene(self):
        self.fails(sh(SOLVE.replace("furnace.obj", "oven.obj")), "status 3 instead of 0")

    def test_an_expected_status(self):
        self.assertEqual(1, self.page(sh(SOLVE.replace("furnace.obj", "oven.obj"), before="<!-- status: 3 -->\n")))
        self.fails(sh(SOLVE, before="<!-- status: 3 -->\n"), "status 0 instead of 3")

    def test_other_output(self):
        self.fails(sh(SOLVE) + output("scene ... 193 patches ..."), "not printed")
        self.fails(sh(SOLVE) + output("wrote          furnace.json", "scene ... 192 patches ..."), "not printed")

    def test_a_file_that_is_not_written(self):
        with tempfile.TemporaryDirectory() as folder:
            idle = os.path.join(folder, "interflect")
            with open(idle, "w", encoding="utf-8") as file:
                file.write("#!/bin/sh\nexit 0\n")
            os.chmod(idle, 0o755)
            self.fails(sh(SOLVE), "furnace.json was not written", program=idle)
            self.fails(sh("interflect render a.glb -o a-%04d.png"), "a-0000.png was not written", program=idle)
            self.fails(sh("interflect serve a.obj", before="<!-- until stopped -->\n"), "no address", program=idle)

    def test_a_block_that_is_not_run(self):
        self.fails("    " + SOLVE + "\n", "not run")
        self.fails("```text\n" + SOLVE + "\n```\n", "not run")
        self.fails(sh(SOLVE, before="<!-- not run -->\n"), "without a reason")
        self.assertEqual(0, self.page(sh(SOLVE, before="<!-- not run: needs a GPU -->\n")))

    def test_a_block_that_needs_a_program(self):
        self.assertEqual(1, self.page(sh("true", before="<!-- needs: bash -->\n")))
        with unittest.mock.patch.dict(os.environ, {"INTERFLECT_TEST_REQUIRE": "other"}):
            self.assertEqual(0, self.page(sh("false", before="<!-- needs: nobody-has-this -->\n")))
        with unittest.mock.patch.dict(os.environ, {"INTERFLECT_TEST_REQUIRE": "other,nobody-has-this"}):
            self.fails(sh("true", before="<!-- needs: nobody-has-this -->\n"), "required and not there")

    def test_marks_that_stand_nowhere(self):
        self.fails("<!-- file: room.obj -->\nText.\n", "before no block")
        self.fails("```sh\n" + SOLVE + "\n", "does not end")
        self.fails(output("something"), "output of no command")
        self.fails(sh("echo 'a"), "does not end")
        self.fails(sh("interflect devices " + chr(92)), "does not end")

    def test_a_copy_of_a_file(self):
        with open(os.path.join(ROOT, "examples/read-radiosities/CMakeLists.txt"), encoding="utf-8") as file:
            text = file.read()
        mark = "<!-- same as: examples/read-radiosities/CMakeLists.txt -->\n```cmake\n"
        self.assertEqual(0, self.page(mark + text + "```\n"))
        self.fails(mark + text.replace("REQUIRED", "") + "```\n", "not the same as examples")

    def test_readme(self):
        self.assertEqual(1, self.page("    " + SOLVE + "\n", check=taken))
        self.fails("    " + SOLVE + " --no-such-option\n", "status 2", check=taken)
        self.fails("Use `interflect solve room.obj --method\nmagic` for it.\n", "status 2", check=taken)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
