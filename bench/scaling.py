#!/usr/bin/env python3
"""Strong and weak scaling of `interflect solve` over MPI ranks, and the model that is fitted to it (docs/scaling.md).

  bench/scaling.py measure PROGRAM [-o scaling.json] [--ranks 1,2,3,4] [--repetitions 3] [--patches 9680]
  bench/scaling.py report scaling.json      the tables of docs/scaling.md: what was measured, the fit, what the model predicts

Every rank computes on one thread. Runs of all sizes take turns; figures are medians. A run that fails, or whose products are
not those of one rank, ends the measurement with status 1."""

import argparse
import json
import math
import os
import platform
import statistics
import subprocess
import sys
import tempfile

import numpy

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
COLUMNS = 3
VECTOR_VALUES = 15  # reads and writes of a CG iteration per column and patch (host/solver/cg.cpp)
FORMATS = {"dense32": 4.0, "dense16": 2.0, "tiled16": 2.0 * 0.37, "sym16": 2.0 * 0.37 / 2}  # bytes per N²; tiles as in room-17128
# What the predictions take for granted: data sheets, and shares that other machines reached. None of it was measured here.
GPU = {"memory": 80e9, "usable": 0.9, "bandwidth": 3.35e12, "share": 0.85, "per_node": 8,
       "near_latency": 10e-6, "near_bandwidth": 25e9, "far_latency": 15e-6, "far_bandwidth": 40e9, "bus": 25e9}
KERNEL_LIMIT = 1 << 20  # patches (kernels/README.md)


def steps(ranks):
    """Rounds of messages of a product: the all-gather's and the broadcast's, in each of which a message reaches every rank."""
    return 2 * math.ceil(math.log2(ranks)) if ranks > 1 else 0


def gathered(patches, ranks):
    """Bytes that one rank receives for one product."""
    return 4 * COLUMNS * patches * (ranks - 1) / ranks


def run(program, scene, patches, ranks, folder):
    report = os.path.join(folder, "report.json")
    environment = dict(os.environ, OMP_NUM_THREADS="1", OMPI_ALLOW_RUN_AS_ROOT="1", OMPI_ALLOW_RUN_AS_ROOT_CONFIRM="1")
    command = ["mpirun", "-n", str(ranks), "--oversubscribe", "--bind-to", "none", program, "solve", scene, "--patches", str(patches),
               "--device", "openmp", "--storage", "dense32", "--quiet", "--report", report, "-o", os.path.join(folder, "b.npy")]
    result = subprocess.run(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
    if result.returncode != 0:
        sys.exit(f"status {result.returncode}: {' '.join(command)}\n{result.stdout}")
    with open(report, encoding="utf-8") as file:
        data = json.load(file)
    products = data["products"]
    shared = data.get("ranks") or {}
    return {"patches": data["patches"], "products": products, "solve": data["seconds"]["solve"] / products,
            "assembly": data["seconds"]["form_factors"], "communicating": shared.get("seconds_communicating", 0.0) / products,
            "bytes": shared.get("bytes_gathered", 0) / products, "messages": shared.get("messages", 0) / products}


def measure(arguments):
    program, ranks = os.path.abspath(arguments.program), [int(p) for p in arguments.ranks.split(",")]
    scene = os.path.join(ROOT, "scenes", "room-1312.obj")
    plan = [("strong", arguments.patches, p) for p in ranks]
    plan += [("weak", round(arguments.patches * math.sqrt(p / max(ranks))), p) for p in ranks]
    runs = {key: [] for key in plan}
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(arguments.repetitions):
            for kind, patches, p in plan:
                runs[kind, patches, p].append(run(program, scene, patches, p, folder))
    rows = []
    for (kind, _, p), found in runs.items():
        row = {"kind": kind, "ranks": p, **{name: statistics.median(one[name] for one in found) for name in found[0]}}
        rows.append(row)
    strong = [row for row in rows if row["kind"] == "strong"]
    if len({row["products"] for row in strong}) != 1:
        sys.exit("the number of products depends on the number of ranks")
    commit = subprocess.run(["git", "-C", ROOT, "rev-parse", "--short", "HEAD"], stdout=subprocess.PIPE, text=True, check=False).stdout.strip()
    result = {"commit": commit, "machine": platform.machine(), "cores": len(os.sched_getaffinity(0)),
              "repetitions": arguments.repetitions, "columns": COLUMNS, "rows": rows}
    with open(arguments.output, "w", encoding="utf-8") as file:
        json.dump(result, file, indent=1)
    print(f"wrote {arguments.output}")


def fit(data):
    """seconds of a product = N² / (min(P, cores) rate) + vectors N; seconds of communication = latency steps + bytes / bandwidth.
    Least squares in relative errors; a negative coefficient is left out."""
    rows, cores = data["rows"], data["cores"]

    def solve(columns, values):
        columns, values = numpy.array(columns, float), numpy.array(values, float)
        kept = list(range(columns.shape[1]))
        while True:
            found = numpy.linalg.lstsq(columns[:, kept] / values[:, None], numpy.ones(len(values)), rcond=None)[0]
            if (found >= 0).all() or len(kept) == 1:
                break
            kept.pop(int(found.argmin()))
        out = numpy.zeros(columns.shape[1])
        out[kept] = found
        return out

    # More ranks than cores take turns: they are left out of the fit of the work, not of the communication's.
    own = [row for row in rows if row["ranks"] <= cores]
    work = solve([[row["patches"] ** 2 / row["ranks"], row["patches"]] for row in own], [row["solve"] - row["communicating"] for row in own])
    several = [row for row in rows if 1 < row["ranks"] <= cores and row["communicating"] > 0]
    several = several or [row for row in rows if row["ranks"] > 1 and row["communicating"] > 0]
    talk = solve([[steps(row["ranks"]), gathered(row["patches"], row["ranks"])] for row in several],
                 [row["communicating"] for row in several]) if several else numpy.zeros(2)
    return {"element": work[0], "vector": work[1], "latency": talk[0], "byte": talk[1]}


def modelled(model, patches, ranks, cores):
    work = model["element"] * patches ** 2 / min(ranks, cores) + model["vector"] * patches
    return work + model["latency"] * steps(ranks) + model["byte"] * gathered(patches, ranks)


def measured_tables(data):
    model = fit(data)
    one = {row["kind"]: row for row in data["rows"] if row["ranks"] == 1}
    print(f"commit {data['commit']}, {data['cores']} cores, medians of {data['repetitions']}, one thread a rank\n")
    print("| | ranks | patches | products | ms a product | of it communicating | model, ms | times one rank's speed | KiB received a product | messages a product | assembly, s |")
    print("| --- | --: | --: | --: | --: | --: | --: | --: | --: | --: | --: |")
    for row in data["rows"]:
        base = one[row["kind"]]
        speed = base["solve"] / row["solve"] * (row["patches"] / base["patches"]) ** 2
        print(f"| {row['kind']} | {row['ranks']} | {row['patches']:,} | {row['products']:.0f} | {1e3 * row['solve']:.2f} | {1e3 * row['communicating']:.3f} | "
              f"{1e3 * modelled(model, row['patches'], row['ranks'], data['cores']):.2f} | {speed:.2f} | {row['bytes'] / 1024:.1f} | {row['messages']:.1f} | {row['assembly']:.2f} |")
    rate = f"{4 / model['element'] / 1e9:.1f} GB/s of F" if model["element"] > 0 else "nothing that the fit sees"
    print(f"\nFitted: a rank reads {rate}; vectors {1e9 * model['vector']:.2f} ns a patch; a round of messages {1e6 * model['latency']:.1f} µs; "
          + (f"{1 / model['byte'] / 1e9:.2f} GB/s between ranks" if model["byte"] > 0 else "bytes between ranks cost nothing that the fit sees"))


def most_patches(gpus, size):
    return int(math.sqrt(gpus * GPU["memory"] * GPU["usable"] / size))


def seconds_of_product(patches, gpus, size):
    """The model with a data sheet's figures: (bytes of F, vectors, messages)."""
    rate = GPU["bandwidth"] * GPU["share"]
    near = steps(min(gpus, GPU["per_node"]))
    far = steps(gpus) - near
    width = GPU["near_bandwidth"] if gpus <= GPU["per_node"] else GPU["far_bandwidth"]
    # y goes down to the host and, when it is whole, up again.
    copies = 2 * 4 * COLUMNS * patches / GPU["bus"] if gpus > 1 else 0
    talk = near * GPU["near_latency"] + far * GPU["far_latency"] + gathered(patches, gpus) / width + copies
    return size * patches ** 2 / (gpus * rate), 4 * VECTOR_VALUES * COLUMNS * patches / rate, talk


def predicted_tables(products):
    print("| storage | bytes per pair | " + " | ".join(f"{g} GPU{'s' if g > 1 else ''}" for g in (1, 8, 64, 512)) + " |")
    print("| --- | --: | --: | --: | --: | --: |")
    for name, size in FORMATS.items():
        print(f"| {name} | {size:.2f} | " + " | ".join(f"{most_patches(g, size):,}{' *' if most_patches(g, size) > KERNEL_LIMIT else ''}"
                                                        for g in (1, 8, 64, 512)) + " |")
    print("\n| patches | storage | GPUs | F, ms | vectors, ms | messages, ms | a solve, s |")
    print("| --: | --- | --: | --: | --: | --: | --: |")
    for patches in (17128, 131072, 524288, 1048576):
        for name in ("dense32", "tiled16"):
            for gpus in (1, 8, 64, 512):
                if most_patches(gpus, FORMATS[name]) < patches:
                    continue
                f, vectors, talk = seconds_of_product(patches, gpus, FORMATS[name])
                print(f"| {patches:,} | {name} | {gpus} | {1e3 * f:.3f} | {1e3 * vectors:.3f} | {1e3 * talk:.3f} | {products * (f + vectors + talk):.4f} |")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    one = commands.add_parser("measure")
    one.add_argument("program")
    one.add_argument("-o", "--output", default="scaling.json")
    one.add_argument("--ranks", default="1,2,3,4")
    one.add_argument("--repetitions", type=int, default=3)
    one.add_argument("--patches", type=int, default=9680)
    two = commands.add_parser("report")
    two.add_argument("data")
    arguments = parser.parse_args()
    if arguments.command == "measure":
        measure(arguments)
        return
    with open(arguments.data, encoding="utf-8") as file:
        data = json.load(file)
    print("Measured\n")
    measured_tables(data)
    print("\nModel\n")
    predicted_tables(statistics.median(row["products"] for row in data["rows"]))


if __name__ == "__main__":
    main()
