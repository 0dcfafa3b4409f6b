#!/usr/bin/env python3
"""How a job of several ranks ends when something is wrong: once said, the right status, no hang. Exit status 77 without
mpirun or without the MPI module, unless INTERFLECT_TEST_REQUIRE names mpi."""

import json
import os
import shutil
import signal
import subprocess

from mpirun import LIMIT, ROOT, SCENE, environment, errors_of, floats, main, wait_for

ENDLESS = ("solve", SCENE, "--patches", "500", "--device", "openmp", "--method", "jacobi", "--iterations",
           "9000000")


def fails_once(job, status, part, ranks, *arguments, **more):
    done = job.run(ranks, *arguments, **more)
    said = errors_of(done.stderr)
    assert done.returncode == status and len(said) == 1 and part in said[0], done


def what_all_ranks_meet_is_said_once(job):
    fails_once(job, 3, "nowhere.obj: cannot open", 3, "solve", "nowhere.obj")
    fails_once(job, 2, "--bogus", 3, "solve", SCENE, "--bogus")
    fails_once(job, 2, "no device 'cuda:77'", 2, "solve", SCENE, "--device", "cuda:77")
    with open(job.file("bad.obj"), "w", encoding="utf-8") as scene:
        scene.write("v 0 0 0\nv 1 0 0\nv 0 x 0\nf 1 2 3\n")
    fails_once(job, 3, "bad.obj:3", 3, "solve", "bad.obj")
    fails_once(job, 3, "nowhere/x.npy", 2, "solve", SCENE, "--patches", "200", "--device", "openmp", "-o", "nowhere/x.npy")


def what_ranks_cannot_do_is_said(job):
    for arguments in (("solve", SCENE, "--storage", "sym16"), ("solve", SCENE, "--memory", "1M"),
                      ("solve", SCENE, "--split", "1,1"), ("devices",),
                      ("serve", SCENE), ("formfactors", SCENE, "--patches", "200")):
        fails_once(job, 2, "start it without mpirun", 2, *arguments, *(() if arguments[0] in ("devices", "serve") else
                                                                     ("--device", "openmp")))


def without_the_module_no_rank_solves_alone(job):
    fails_once(job, 2, "3 ranks", 3, "solve", SCENE, "-o", "alone.npy", INTERFLECT_MPI_MODULE="/nowhere.so")
    assert not os.path.exists(job.file("alone.npy"))


def a_rank_without_its_device_ends_all(job):
    listed = job.run(0, "devices", "--json", CUDA_VISIBLE_DEVICES="", OCL_ICD_VENDORS="/nowhere").stdout
    missing = [device["id"] for device in json.loads(listed) if not device["available"] and ":" in device["id"]]
    if not missing:
        print("not run: every device is available")
        return
    fails_once(job, 4, "(rank 1)", 2, "solve", SCENE, "--device", f"openmp,{missing[0]}", CUDA_VISIBLE_DEVICES="",
               OCL_ICD_VENDORS="/nowhere")


def a_device_that_fails_on_one_rank_ends_all(job):
    """Also where that rank has others: it cannot begin again alone. Three devices for two ranks: rank 0 has two."""
    if "opencl:0" not in job.devices or "vulkan:0" not in job.devices:
        print("not run: it takes opencl:0 and vulkan:0")
        return
    kernels = os.path.join(ROOT, "kernels")
    for number, broken in enumerate(("cg.cl", "matvec.cl")):  # as the solve begins; as F is placed, which all agree on
        folder = job.file(f"kernels-{number}")
        shutil.copytree(kernels, folder)
        os.remove(os.path.join(folder, "cl", broken))
        solve = (job.program, "solve", SCENE, "--patches", "300", "--device", "opencl:0,openmp,vulkan:0", "-o", "broken.npy")
        command = ["mpirun", "--oversubscribe", "--bind-to", "none", "-n", "1", "env", f"INTERFLECT_KERNEL_DIR={folder}", *solve,
                   ":", "-n", "1", *solve]
        done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT, cwd=job.folder,
                              env=environment(INTERFLECT_CACHE="off"), check=False)
        assert done.returncode == 4 and broken in done.stderr, done
        assert not os.path.exists(job.file("broken.npy"))


def a_rank_without_rows_has_devices_too(job):
    if "opencl:0" not in job.devices or "vulkan:0" not in job.devices:
        print("not run: it takes opencl:0 and vulkan:0")
        return
    solve = ("solve", os.path.join(ROOT, "scenes", "furnace.obj"), "--patches", "10", "--quiet")
    assert job.run(0, *solve, "--device", "openmp", "-o", "one.npy").returncode == 0
    done = job.run(2, *solve, "--device", "openmp,opencl:0,vulkan:0", "-o", "two.npy")
    assert done.returncode == 0 and not errors_of(done.stderr), done
    one, two = floats(job.content("one.npy")), floats(job.content("two.npy"))
    assert max(abs(a - b) for a, b in zip(one, two)) < 1e-5 * max(one)


def ranks_with_different_scenes_are_told_apart(job):
    with open(os.path.join(ROOT, "scenes", "furnace.obj"), encoding="utf-8") as stream:
        text = stream.read()
    with open(os.path.join(ROOT, "scenes", "furnace.mtl"), encoding="utf-8") as stream:
        materials = stream.read()
    command = ["mpirun", "--oversubscribe", "--bind-to", "none"]
    for rank, name in enumerate(("here", "there")):
        os.makedirs(job.file(name))
        with open(job.file(f"{name}/furnace.obj"), "w", encoding="utf-8") as stream:
            stream.write(text)
        with open(job.file(f"{name}/furnace.mtl"), "w", encoding="utf-8") as stream:
            stream.write(materials if rank == 0 else materials.replace("Kd 0.", "Kd 0.1", 1))
        command += [*([] if rank == 0 else [":"]), "-n", "1", "--wdir", job.file(name), job.program, "solve", "furnace.obj", "--device",
                    "openmp"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT, cwd=job.folder, env=environment(), check=False)
    said = errors_of(done.stderr)
    assert done.returncode == 3 and len(said) == 1 and "different scenes" in said[0], done


def a_file_that_one_rank_cannot_use_ends_all(job):
    make = ("formfactors", SCENE, "--patches", "300", "--quiet", "-o", "room.iff")
    assert job.run(0, *make, INTERFLECT_MAX_PANEL_BYTES="65536").returncode == 0
    content = bytearray(job.content("room.iff"))
    content[-40000] ^= 1  # of the last panels, which the last rank reads
    with open(job.file("room.iff"), "wb") as stream:
        stream.write(content)
    fails_once(job, 3, "checksum differs", 3, "solve", SCENE, "--device", "openmp", "--form-factors", "room.iff")


def iterating(job, name):
    """A job in the middle of its solve."""
    started = job.start(3, *ENDLESS, "-o", f"{name}.npy", "--report", f"{name}.json", "--json-progress")
    log = []
    for line in started.stderr:
        log.append(line)
        if '"iteration"' in line and '"iteration":0' not in line:
            return started
    raise AssertionError(f"it ended before: {log}")


def a_killed_rank_ends_the_job(job):
    started = iterating(job, "killed")
    os.kill(job.ranks_of(started)[1], signal.SIGKILL)
    _, error = started.communicate(timeout=60)
    assert started.returncode not in (0, 1, 2, 3, 4, 5, 6), started.returncode
    assert error.count("exited on signal 9") == 1, error
    assert not os.path.exists(job.file("killed.npy"))


def another_number_of_ranks_goes_on_from_a_checkpoint(job):
    # Enough to be killed on the way.
    solve = ("solve", SCENE, "--patches", "500", "--device", "openmp", "--method", "jacobi", "--iterations", "20000", "--quiet")
    keep = ("--checkpoint", "solve.ifc", "--every", "0.05s")
    assert job.run(0, *solve, "-o", "whole.npy").returncode == 0
    started = job.start(2, *solve, *keep, "-o", "parts.npy")
    wait_for(lambda: os.path.exists(job.file("solve.ifc")) or started.poll() is not None, "a checkpoint")
    os.kill(job.ranks_of(started)[1], signal.SIGKILL)
    started.communicate(timeout=60)
    assert started.returncode != 0 and not os.path.exists(job.file("parts.npy"))
    done = job.run(3, *solve, *keep, "-o", "parts.npy", "--report", "parts.json")
    assert done.returncode == 0, done
    report = json.loads(job.content("parts.json"))
    assert report["checkpoint"]["iterations_before"] > 0 and report["iterations"] == 20000, report["checkpoint"]
    assert not os.path.exists(job.file("solve.ifc"))
    whole, parts = floats(job.content("whole.npy")), floats(job.content("parts.npy"))
    assert max(abs(a - b) for a, b in zip(whole, parts)) < 1e-5 * max(whole)


def an_interrupt_leaves_the_best_so_far(job):
    started = iterating(job, "patient")
    os.kill(job.ranks_of(started)[0], signal.SIGINT)
    out, error = started.communicate(timeout=60)
    assert started.returncode == 130, (started.returncode, error)
    assert json.loads(job.content("patient.json"))["interrupted"], (out, error)
    assert os.path.exists(job.file("patient.npy"))


def an_interrupt_of_mpirun_ends_the_job(job):
    """mpirun itself gives its ranks a second and then kills them; its status is its own."""
    started = iterating(job, "ended")
    started.send_signal(signal.SIGINT)
    started.communicate(timeout=60)
    assert started.returncode != 0
    assert not [name for name in os.listdir(job.folder) if "ended" in name and not name.endswith((".npy", ".json"))]


if __name__ == "__main__":
    main([what_all_ranks_meet_is_said_once, what_ranks_cannot_do_is_said, without_the_module_no_rank_solves_alone,
          a_rank_without_its_device_ends_all, a_device_that_fails_on_one_rank_ends_all, a_rank_without_rows_has_devices_too,
          ranks_with_different_scenes_are_told_apart, a_file_that_one_rank_cannot_use_ends_all, a_killed_rank_ends_the_job,
          another_number_of_ranks_goes_on_from_a_checkpoint,
          an_interrupt_leaves_the_best_so_far, an_interrupt_of_mpirun_ends_the_job])
