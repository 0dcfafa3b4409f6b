"""What the tests with mpirun share: the program as so many ranks, in a folder of the test's own."""

import os
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
SCENE = os.path.join(ROOT, "scenes", "cornell-box.obj")
LIMIT = 120  # seconds for one job: a job that hangs fails


def skip(reason):
    if "mpi" in os.environ.get("INTERFLECT_TEST_REQUIRE", "").split(","):
        print(f"FAILED: {reason}, and INTERFLECT_TEST_REQUIRE names mpi")
        sys.exit(1)
    print(f"SKIPPED: {reason}")
    sys.exit(77)


def environment(**more):
    out = dict(os.environ, OMP_NUM_THREADS="1", OMP_WAIT_POLICY="passive", OMPI_ALLOW_RUN_AS_ROOT="1",
               OMPI_ALLOW_RUN_AS_ROOT_CONFIRM="1", INTERFLECT_TUNING="off")
    out.update(more)
    return out


class Job:
    """A program that may run as ranks; `program` is its path."""

    def __init__(self, program):
        self.program = os.path.abspath(program)
        self.folder = tempfile.mkdtemp(prefix="interflect-mpi-")
        if shutil.which("mpirun") is None:
            skip("mpirun is not installed")
        listed = subprocess.run([self.program, "devices"], capture_output=True, text=True, timeout=LIMIT, check=True).stdout
        if "ranks (MPI)  built in" not in listed:
            skip("the program is built without MPI")
        self.devices = listed

    def __enter__(self):
        return self

    def __exit__(self, *_):
        shutil.rmtree(self.folder, ignore_errors=True)

    def file(self, name):
        return os.path.join(self.folder, name)

    def content(self, name):
        with open(self.file(name), "rb") as stream:
            return stream.read()

    def command(self, ranks, arguments, mca=()):
        start = [] if ranks == 0 else ["mpirun", "--oversubscribe", "--bind-to", "none", "-n", str(ranks), *mca]
        return [*start, self.program, *arguments]

    def run(self, ranks, *arguments, mca=(), **more):
        """As so many ranks, 0: without mpirun. Gives what subprocess.run() gives."""
        return subprocess.run(self.command(ranks, arguments, mca), capture_output=True, text=True, timeout=LIMIT,
                              cwd=self.folder, env=environment(**more))

    def start(self, ranks, *arguments, mca=(), **more):
        return subprocess.Popen(self.command(ranks, arguments, mca), stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                text=True, cwd=self.folder, env=environment(**more))

    def ranks_of(self, job):
        """The processes of a started job, by rank."""
        found = {}
        for name in filter(str.isdigit, os.listdir("/proc")):
            try:
                with open(f"/proc/{name}/stat", encoding="utf-8", errors="replace") as stream:
                    parent = int(stream.read().rpartition(")")[2].split()[1])
                with open(f"/proc/{name}/environ", "rb") as stream:
                    variables = stream.read().split(b"\0")
            except (OSError, ValueError):
                continue
            for variable in variables:
                if parent == job.pid and variable.startswith(b"OMPI_COMM_WORLD_RANK="):
                    found[int(variable.partition(b"=")[2])] = int(name)
        return found


def wait_for(condition, what):
    """Until the condition holds."""
    end = time.monotonic() + LIMIT
    while not condition():
        if time.monotonic() > end:
            raise AssertionError(f"waited in vain for {what}")
        time.sleep(0.02)


def floats(npy):
    """The values of a float32 .npy file."""
    length = struct.unpack("<H", npy[8:10])[0]
    body = npy[10 + length:]
    return struct.unpack(f"<{len(body) // 4}f", body)


def errors_of(text):
    return [line for line in text.splitlines() if line.startswith("interflect: error:")]


def main(tests):
    """TEST.py PROGRAM [TEST...]: all, or those that are named."""
    wanted = sys.argv[2:] or [test.__name__ for test in tests]
    with Job(sys.argv[1]) as job:
        for test in tests:
            if test.__name__ in wanted:
                test(job)
                print(f"ok: {test.__name__}", flush=True)
