#!/usr/bin/env python3
"""report_fields.py PROGRAM: the table of the report's fields in docs/file-formats.md against real reports, both ways."""

import json
import os
import re
import subprocess
import sys
import tempfile

from run_docs import ROOT, Runner

# Reports that have, together, every field: light groups, a file, a rounded format, streaming, no convergence, a checkpoint.
RUNS = [
    "--light-groups object --storage sym16",
    "--form-factors kept.iff --memory 4M",
    "--max-iterations 2 --checkpoint room.ckp",
]


def fields_of(value, path, out):
    """Every path of a report's leaves; names that depend on the scene are no fields."""
    if isinstance(value, dict) and path != "closure.set_aside.by_object":
        for key, inner in value.items():
            fields_of(inner, f"{path}.{key}" if path else key, out)
    elif isinstance(value, list) and value and isinstance(value[0], dict):
        for inner in value:
            fields_of(inner, path + "[]", out)
    else:
        out.add(path)


def fields_of_page(text):
    table = re.search(r"<!-- fields of the report -->\n(.*?)\n\n", text, re.S).group(1).split("\n")[2:]
    return {name for row in table for name in re.findall(r"`([^`]+)`", row.split("|")[1])}


def complaints(page, reports):
    for name in sorted(reports - page):
        yield f"file-formats.md does not have the report's field {name}"
    for name in sorted(page - reports):
        yield f"file-formats.md has {name}, and no report does"


def main():
    with open(os.path.join(ROOT, "docs", "file-formats.md"), encoding="utf-8") as file:
        page = fields_of_page(file.read())
    reports = set()
    with tempfile.TemporaryDirectory() as folder:
        runner = Runner(sys.argv[1], folder)
        for options in RUNS:
            scene = os.path.join(ROOT, "scenes", "room-1312.obj")
            result = subprocess.run(["interflect", "solve", scene, "--divide", "1", "--quiet", "--report", "report.json",
                                     *options.split()], cwd=folder, env=runner.environment, check=False)
            if result.returncode not in (0, 5):
                sys.exit(f"status {result.returncode}: {options}")
            with open(os.path.join(folder, "report.json"), encoding="utf-8") as file:
                fields_of(json.load(file), "", reports)
    wrong = list(complaints(page, reports))
    if wrong:
        sys.exit("\n".join(wrong))
    # A table with a field too many, and one too few, must be found.
    assert len(list(complaints(page | {"absent"}, reports))) == 1
    assert len(list(complaints(page - {"energy.emitted"}, reports))) == 1
    print(f"{len(page)} fields")


if __name__ == "__main__":
    main()
