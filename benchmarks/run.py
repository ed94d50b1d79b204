#!/usr/bin/env python3
"""tfdb against its rivals: everything in one run, contenders in turns, medians of seven rounds.

    benchmarks/rivals/install          # once
    benchmarks/run.py                  # everything; out/bench.json and the table of goals
    benchmarks/run.py --only python --rounds 5
    benchmarks/run.py --write-docs     # also into docs/benchmarks.md

Groups: cpp, torn, instructions, python, loading. Results are compared to 1e-12 before a time
counts.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
sys.path.insert(0, str(HERE / "python"))

import native  # noqa: E402 - the modules of this folder
import scenario  # noqa: E402
import table  # noqa: E402
from processes import Rounds, Worker, compare_poses, interleave  # noqa: E402
from results import Results, machine  # noqa: E402

SYSTEM_PYTHON = Path("/usr/bin/python3")
SAMPLES = 11_000  # of each edge: the 10 s of history are full
LONG_MESSAGES = 100_000
GROUPS = ["cpp", "torn", "instructions", "python", "loading"]
# pytransform3d moves along screws between two samples: another curve, equal to first order.
# schiebung's shares of the way are not computed from whole nanoseconds.
TOLERANCES = {"pytransform3d": 1e-5, "schiebung": 1e-7}


def parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--only", action="append", choices=GROUPS, help="a group; may be repeated")
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--env", type=Path, default=HERE / "rivals" / "env")
    parser.add_argument("--build", type=Path, default=ROOT / "build" / "against_tf2")
    parser.add_argument("--no-install", action="store_true", help="the tfdb of --env is up to date")
    parser.add_argument("--write-docs", action="store_true")
    parser.add_argument("--json", type=Path, default=ROOT / "out" / "bench.json")
    return parser.parse_args()


def cpp_rows(results: Results, programs: Path, rounds: int) -> None:
    for row in native.rows(programs, rounds, []):
        results.add("C++", row["row"], row["chain"], row["unit"], row["rounds"])


def torn_rows(results: Results, programs: Path, rounds: int) -> None:
    counts = native.torn_pairs(programs, rounds, seconds=2.0)
    share = {
        store: [100.0 * run["torn"] / run["reads"] for run in runs]
        for store, runs in counts.items()
    }
    writes = {store: [run["writes"] / 2000 for run in runs] for store, runs in counts.items()}
    results.add("C++", "torn reads of a pair of static edges", 2, "%", share)
    results.add("C++", "pairs written meanwhile", 2, "kops/s", writes)


def instruction_rows(results: Results, programs: Path) -> None:
    for chain in (1, 4, 10):
        for what in ("lookup mid", "lookup latest"):
            counts = {
                who: [native.instructions(programs, f"{who} {what}", chain)]
                for who in ("tf2", "tfdb")
            }
            results.add("C++", f"{what}, instructions", chain, "instructions", counts)


def same_answers(ours: Worker, others: list[Worker], samples: int) -> None:
    """All contenders at a few stamps near the newest sample."""
    stamps = scenario.mid_stamps(samples, 64)
    expected = ours.ask(do="values", stamps=stamps)["poses"]
    for other in others:
        poses = other.ask(do="values", stamps=stamps)["poses"]
        compare_poses(expected, poses, other.contender, TOLERANCES.get(other.contender, 1e-12))


def python_rows(results: Results, env: Path, rounds: int) -> None:
    python, newer = env / "bin" / "python", env / "newer" / "bin" / "python"
    for chain in (1, 4, 10):
        with (
            Worker("tfdb", python) as ours,
            Worker("tf2", SYSTEM_PYTHON) as tf2,
            Worker("transform_tree", python) as tree,
            Worker("pytransform3d", python) as pytransform3d,
        ):
            workers = [ours, tf2, tree, pytransform3d]
            if newer.exists():
                workers.append(Worker("schiebung", newer))
            for worker in workers:
                worker.ask(do="setup", chain=chain, samples=SAMPLES)
            same_answers(ours, workers[1:], SAMPLES)
            for row, turns in python_turns(workers).items():
                slow = [turn for turn in turns if turn[1].contender == "pytransform3d"]
                fast = [turn for turn in turns if turn not in slow]
                times: Rounds = interleave(fast, rounds)
                if slow:
                    times |= interleave(slow, min(rounds, 5))
                results.add("Python", row, chain, "ns", times)
            for extra in workers[4:]:
                extra.close()


def python_turns(workers: list[Worker]) -> dict[str, list[tuple[str, Worker, str]]]:
    """Which operation of which contender belongs to which row."""
    ours, tf2, tree, pytransform3d, *schiebung = workers
    rows = {
        "lookup mid": [
            ("tfdb", ours, "lookup mid"),
            ("tfdb, as a matrix", ours, "lookup mid, matrix"),
            ("tf2_ros", tf2, "lookup mid"),
            ("transform-tree plan.at", tree, "lookup mid"),
            ("transform-tree by name", tree, "lookup mid by name"),
            *(("schiebung", worker, "lookup mid") for worker in schiebung),
            ("pytransform3d", pytransform3d, "lookup mid"),
        ],
        "lookup latest": [
            ("tfdb", ours, "lookup latest"),
            ("tfdb, newest of each edge", ours, "newest of each edge"),
            ("tfdb, newest of each edge, as a matrix", ours, "newest of each edge, matrix"),
            ("tf2_ros", tf2, "lookup latest"),
            ("transform-tree plan.latest", tree, "lookup latest"),
            *(("schiebung", worker, "lookup latest") for worker in schiebung),
        ],
        "can_transform": [
            ("tfdb", ours, "can_transform"),
            ("tf2_ros", tf2, "can_transform"),
        ],
    }
    for batch in ("batch sorted", "batch unsorted"):
        for scan in ("", ", 0.1 s scan"):
            rows[batch + scan] = [
                ("tfdb", ours, batch + scan),
                ("transform-tree", tree, batch + scan),
            ]
    rows["batch sorted"].append(("pytransform3d, 1,000 stamps", pytransform3d, "batch sorted"))
    # Writes come last: they move the history on.
    rows["set_transform"] = [
        ("tfdb", ours, "set_transform"),
        ("tfdb, numpy arrays", ours, "set_transform, numpy"),
        ("tf2_ros", tf2, "set_transform"),
        ("transform-tree push", tree, "set_transform"),
    ]
    return rows


def loading_rows(results: Results, env: Path, rounds: int) -> None:
    python = env / "bin" / "python"
    with tempfile.TemporaryDirectory() as folder:
        maker: list[str | Path] = [
            python,
            HERE / "python" / "recording.py",
            folder,
            str(LONG_MESSAGES),
        ]
        subprocess.run(maker, check=True)
        files = {
            "mcap": "plain.mcap",
            "mcap, zstd": "zstd.mcap",
            "bag": "long.bag",
            "db3": "long_db3",
        }
        for title, name in files.items():
            path = str(Path(folder, name))
            times: Rounds = {"tfdb": [], "container alone (rosbags)": []}
            if title == "mcap":
                times["rosbags + tf2"] = []
            for _ in range(min(rounds, 5)):
                load_once(python, path, times)
            results.add("Python", f"load, {title}", 10, "s", times)


def load_once(python: Path, path: str, times: Rounds) -> None:
    """Each contender loads the recording once, in a process of its own."""
    names = ["base_footprint", "left_arm_10_joint_link"]
    stamps = [scenario.START + i * 7_654_321_098 % (990 * 10**9) for i in range(64)]
    with Worker("tfdb", python) as ours, Worker("rosbags_tf2", python) as rival:
        loaded = ours.call("load", path)
        times["tfdb"].append(loaded["seconds"])
        times["container alone (rosbags)"].append(rival.call("read", path)["seconds"])
        if "rosbags + tf2" in times:
            theirs = rival.call("load", path)
            times["rosbags + tf2"].append(theirs["seconds"])
            assert theirs["samples"] == loaded["samples"]
            here, there = (worker.call("poses_at", *names, stamps) for worker in (ours, rival))
            compare_poses(here, there, "loaded recordings")


def install(env: Path) -> None:
    """tfdb of this checkout into the rivals' environment."""
    if not (env / "bin" / "python").exists():
        sys.exit(f"no rivals in {env}: run benchmarks/rivals/install first")
    command: list[str | Path] = [
        env / "bin" / "python",
        "-m",
        "pip",
        "--disable-pip-version-check",
        "--quiet",
    ]
    command += ["install", f"--config-settings=build-dir={env / 'build'}", f"{ROOT}[recordings]"]
    subprocess.run(command, check=True)


def main() -> None:
    options = parse()
    groups = options.only or GROUPS
    results = Results(machine())
    if options.only and options.json.exists():  # a part replaces its rows of an earlier run
        earlier = Results.from_json(json.loads(options.json.read_text()))
        results = earlier if earlier.machine == results.machine else results
    if {"python", "loading"} & set(groups) and not options.no_install:
        install(options.env)
    if {"cpp", "torn", "instructions"} & set(groups):
        programs = native.build(options.build, os.cpu_count() or 1)
    if "cpp" in groups:
        cpp_rows(results, programs, options.rounds)
    if "torn" in groups:
        torn_rows(results, programs, min(options.rounds, 5))
    if "instructions" in groups:
        instruction_rows(results, programs)
    if "python" in groups:
        python_rows(results, options.env, options.rounds)
    if "loading" in groups:
        loading_rows(results, options.env, options.rounds)
    options.json.parent.mkdir(parents=True, exist_ok=True)
    options.json.write_text(json.dumps(results.to_json(), indent=1))
    print("\n".join(["", results.machine, *table.goals_table(results)]))
    if options.write_docs:
        table.write(results, ROOT / "docs" / "benchmarks.md")


if __name__ == "__main__":
    main()
