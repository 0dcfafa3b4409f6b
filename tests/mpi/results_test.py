#!/usr/bin/env python3
"""Several ranks have the results of one process. Exit status 77 without mpirun or without the MPI module, unless
INTERFLECT_TEST_REQUIRE names mpi."""

import json

from mpirun import SCENE, errors_of, floats, main

SOLVE = ("solve", SCENE, "--patches", "500", "--quiet")


def solved(job, ranks, name, *more, device="openmp"):
    done = job.run(ranks, *SOLVE, "--device", device, "-o", f"{name}.npy", "-o", f"{name}.csv", "--report", f"{name}.json", *more)
    assert done.returncode == 0, (ranks, done)
    return json.loads(job.content(f"{name}.json"))


def any_number_of_ranks_has_the_bits_of_one_process(job):
    one = solved(job, 0, "one")
    assert one["ranks"] is None
    for count in (1, 2, 3, 4, 7):
        report = solved(job, count, f"by{count}")
        for kind in ("npy", "csv"):
            assert job.content(f"by{count}.{kind}") == job.content(f"one.{kind}"), (count, kind)
        for same in ("iterations", "products", "relative_residual", "storage", "closure", "energy", "estimated_error"):
            assert report[same] == one[same], (count, same, report[same], one[same])
        if count == 1:
            continue
        ranks = report["ranks"]
        assert ranks["count"] == count and sum(ranks["rows"]) == one["patches"], ranks
        assert len(ranks["rows"]) == count and ranks["devices"] == ["openmp"] * count, ranks
        # Every product brings rank 0 the others' rows: three columns of floats.
        least = 12 * (one["patches"] - ranks["rows"][0]) * one["iterations"]
        assert least <= ranks["bytes_gathered"] <= 4 * least, (least, ranks)
        assert ranks["messages"] >= one["products"] and ranks["form_factors"]["bytes_exchanged"] > 0, ranks


def the_same_ranks_have_the_same_bits_again(job):
    for method in ("bicgstab", "jacobi"):
        for name in ("first", "second"):
            solved(job, 3, name, "--method", method, "--light-groups", "object")
        solved(job, 0, "alone", "--method", method, "--light-groups", "object")
        assert job.content("first.npy") == job.content("second.npy") == job.content("alone.npy"), method
        assert job.content("first.csv") == job.content("second.csv"), method


def sixteen_bits_have_the_bits_of_one_process(job):
    for storage in ("dense16", "tiled16"):
        one, three = (solved(job, ranks, f"{storage}{ranks}", "--storage", storage) for ranks in (0, 3))
        assert three["storage"]["format"] == storage and three["storage"]["refused"] is None, three["storage"]
        assert three["storage"]["rounding_error"] < 1e-4, three["storage"]
        if storage == "dense16":  # tiled16 has the patches in another order in one process
            assert job.content("dense160.npy") == job.content("dense163.npy")
            assert three["storage"]["rounding_error"] == one["storage"]["rounding_error"], (one, three)
        assert job.content(f"{storage}3.npy") != job.content("one.npy"), storage


def another_emission_is_seen_to_differ(job):
    """The comparison above can fail."""
    solved(job, 2, "changed", "--closure", "on")
    assert job.content("changed.npy") != job.content("one.npy")


def ranks_with_different_devices_never_part(job):
    if "opencl:0" not in job.devices or "opencl:0   not available" in job.devices:
        print("not run: there is no opencl:0")
        return
    for name in ("mixed", "again"):
        report = solved(job, 3, name, "--assembly", "host", device="openmp,opencl:0")
        assert report["ranks"]["devices"] == ["openmp", "opencl:0", "openmp"], report["ranks"]
    assert job.content("mixed.npy") == job.content("again.npy")
    one, mixed = floats(job.content("one.npy")), floats(job.content("mixed.npy"))
    largest = max(one)
    assert max(abs(a - b) for a, b in zip(one, mixed)) < 1e-5 * largest


def a_page_is_written_once(job):
    done = job.run(2, "view", SCENE, "--patches", "300", "--device", "openmp", "-o", "room.html")
    assert done.returncode == 0 and done.stdout.count("wrote") == 1, done
    assert b"</html>" in job.content("room.html")
    assert not errors_of(done.stderr)


if __name__ == "__main__":
    main([any_number_of_ranks_has_the_bits_of_one_process, the_same_ranks_have_the_same_bits_again,
          sixteen_bits_have_the_bits_of_one_process, another_emission_is_seen_to_differ, ranks_with_different_devices_never_part, a_page_is_written_once])
