#!/usr/bin/env python3
"""Files of form factors that several ranks write and read together. Exit status 77 without mpirun or without the MPI
module, unless INTERFLECT_TEST_REQUIRE names mpi."""

import os
import signal
import struct

from mpirun import SCENE, main, wait_for

PANELS = {"INTERFLECT_MAX_PANEL_BYTES": "262144"}  # many small ones


def the_bytes_are_those_of_one_process(job):
    make = ("formfactors", SCENE, "--patches", "500", "--quiet", "-o")
    assert job.run(0, *make, "one.iff", **PANELS).returncode == 0
    for count in (1, 2, 3):
        done = job.run(count, *make, f"by{count}.iff", **PANELS)
        assert done.returncode == 0, done
        assert job.content(f"by{count}.iff") == job.content("one.iff"), count
        assert not os.path.exists(job.file(f"by{count}.iff.partial"))
    again = job.run(2, "formfactors", SCENE, "--patches", "500", "-o", "by2.iff")
    assert again.returncode == 0 and "is there and fits" in again.stderr, again


def a_solve_takes_and_makes_the_file(job):
    solve = ("solve", SCENE, "--device", "openmp", "--quiet")
    for ranks, name, more in ((0, "one", ()), (3, "three", ())):
        done = job.run(ranks, *solve, "--form-factors", "one.iff", "-o", f"{name}.npy", *more)
        assert done.returncode == 0, done
    assert job.content("one.npy") == job.content("three.npy")
    for ranks, name in ((0, "open1"), (2, "open2")):  # the closure anew
        done = job.run(ranks, *solve, "--form-factors", "one.iff", "--closure", "on", "-o", f"{name}.npy")
        assert done.returncode == 0, done
    assert job.content("open1.npy") == job.content("open2.npy") != job.content("one.npy")
    done = job.run(2, *solve, "--patches", "500", "--form-factors", "new.iff", "-o", "new.npy", **PANELS)
    assert done.returncode == 0, done
    assert job.content("new.iff") == job.content("one.iff") and job.content("new.npy") == job.content("one.npy")


def finished_panels(job, name):
    """By the table of a file that is being made."""
    try:
        content = job.content(name)
    except FileNotFoundError:
        return 0
    if len(content) < 4096 + 64 * 16:
        return 0
    panels = struct.unpack_from("<I", content, 28)[0]
    return sum(struct.unpack_from("<I", content, 4096 + 64 * k)[0] == 1 for k in range(panels))


def another_number_of_ranks_goes_on_after_a_kill(job):
    make = ("formfactors", SCENE, "--patches", "2500", "--accuracy", "high", "--quiet", "-o")
    started = job.start(2, *make, "big.iff", **PANELS)
    wait_for(lambda: finished_panels(job, "big.iff.partial") > 0 or started.poll() is not None, "a finished panel")
    os.kill(job.ranks_of(started)[1], signal.SIGKILL)
    started.communicate(timeout=60)
    assert started.returncode != 0 and not os.path.exists(job.file("big.iff"))
    kept = finished_panels(job, "big.iff.partial")
    assert kept > 0
    done = job.run(3, "formfactors", SCENE, "--patches", "2500", "--accuracy", "high", "-o", "big.iff", **PANELS)
    assert done.returncode == 0 and f"going on after {kept} of" in done.stderr, done
    assert job.run(0, *make, "big1.iff", **PANELS).returncode == 0
    assert job.content("big.iff") == job.content("big1.iff")


def an_interrupt_keeps_what_is_finished(job):
    make = ("formfactors", SCENE, "--patches", "2500", "--accuracy", "high", "-o")
    started = job.start(2, *make, "stopped.iff", **PANELS)
    wait_for(lambda: finished_panels(job, "stopped.iff.partial") > 0 or started.poll() is not None, "a finished panel")
    os.kill(job.ranks_of(started)[0], signal.SIGINT)
    _, error = started.communicate(timeout=60)
    assert started.returncode == 130 and error.count("panels are kept in") == 1, error
    assert 0 < finished_panels(job, "stopped.iff.partial")


if __name__ == "__main__":
    main([the_bytes_are_those_of_one_process, a_solve_takes_and_makes_the_file,
          another_number_of_ranks_goes_on_after_a_kill, an_interrupt_keeps_what_is_finished])
