"""A running `interflect serve`, and what it answers."""

import json
import os
import re
import signal
import struct
import subprocess


class Served:
    """Used in a `with`, or closed by hand. Solves the small room as room.Solver does."""

    def __init__(self, program, scene, *arguments, environment=None, divide="0.2"):
        command = [program, "serve", scene, "--port", "0", "--divide", divide, "--device", "openmp", "--closure", "off",
                   "--accuracy", "low", "--quiet", *arguments]
        # A shell that starts the tests in the background has them ignore SIGINT, which a child would inherit.
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True,
                                        env={**os.environ, **(environment or {})},
                                        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL))
        for line in self.process.stdout:
            found = re.search(r"http://127\.0\.0\.1:(\d+)/", line)
            if found:
                self.port = int(found[1])
                self.url = found[0]
                return
        self.close()
        raise RuntimeError(f"{command}: {self.process.returncode}")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        if self.process.poll() is None:
            self.process.terminate()
            try:
                self.process.wait(30)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
        self.process.stdout.close()


def read_solution(body):
    """(what it says, [lamp][patch] -> (r, g, b)) of an answer to POST /solve."""
    length = struct.unpack("<I", body[:4])[0]
    said = json.loads(body[4:4 + length])
    values = struct.unpack(f"<{(len(body) - 4 - length) // 4}f", body[4 + length:])
    count = 3 * said["patches"]
    if len(values) != count * said["lamps"]:
        raise ValueError(f"{len(values)} values for {said['lamps']} lamps and {said['patches']} patches")
    lit = [values[g * count:(g + 1) * count] for g in range(said["lamps"])]
    return said, [[rows[k:k + 3] for k in range(0, count, 3)] for rows in lit]
