"""The rows: one operation of tfdb and of its rivals, in turns, in C++ and in Python.

Answers are compared before a time counts. A rival that is not installed is left out, and said.
"""

from __future__ import annotations

import importlib.util
import json
import os
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from . import programs
from .workers import CONTENDERS, Worker, compare_poses, interleave, process_output

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from .results import Results
    from .workers import Rounds, Turn

ROOT = Path(__file__).resolve().parents[2]
SYSTEM_PYTHON = Path("/usr/bin/python3")
SAMPLES = 11_000  # of each edge: the 10 s of history are full
HOURS = 3_600.0

# pytransform3d moves along screws between two samples: another curve, equal to first order.
# schiebung's shares of the way are not computed from whole nanoseconds.
TOLERANCES = {"pytransform3d": 1e-5, "schiebung": 1e-7}
NEEDED = {
    "tfdb": "tfdb",
    "tfdb_tf2": "tfdb",
    "tf2": "tf2_ros",
    "transform_tree": "tf_tree",
    "pytransform3d": "pytransform3d",
    "schiebung": "schiebung",
    "rosbags_tf2": "rosbags, tf2_py",
    "transform_tree_shared": "tf_tree",
    "tf2_live": "tf2_ros, roslaunch",
    "tf2_listening": "tf2_ros",
    "tfdb_live": "tfdb",
    "tfdb_in_rospy": "tfdb, rospy",
}
FEW = (1, 4, 16, 64)  # stamps in one call
MANY_FRAMES = 2_000  # looked up in one call

# A robot that many processes look at: ten moving frames, 500 times a second each.
LIVE_CHAIN, MESSAGES = 10, 500.0
FLEETS = 20, 100
"""How many homes one process mirrors."""
MANY_HOMES = 1_000
READERS, LOOKUPS = 16, 100.0  # lookups of each per second
# What is published on /tf: edges of a message, messages per second.
STREAMS = ((10, 500.0), (100, 50.0))
MANY_NODES, SLOW_MESSAGES = 20, 50.0
NODES = {"tf2_ros": "tf2_listening", "tfdb": "tfdb_live", "tfdb in rospy": "tfdb_in_rospy"}
# Of each: the contender, and how it is called.
NODES_OF_ROS2 = {
    "tf2_ros": ("tf2_in_ros2", "stored"),
    "deserialised": ("tf2_in_ros2", "deserialised"),
    "tfdb": ("tfdb_in_ros2", "own thread"),
    "tfdb in the executor": ("tfdb_in_ros2", "executor"),
    "tfdb without rclpy": ("tfdb_dds", ""),
}
# As many as leave two cores idle now and then: more would be measured while they lag.
LISTENERS = {"tf2_ros listener, alone": 1, "tf2_ros listener, each of 2": 2}


@dataclass(frozen=True)
class Effort:
    """How much is measured: the rounds of each row, and the sizes of what takes longest."""

    rounds: int = 7
    messages: int = (
        100_000  # of ten transforms each, in a recording; ten times as many in the long one
    )
    samples: int = 1_000_000  # of one edge
    chains: tuple[int, ...] = (1, 4, 10)
    seconds: float = 2.0  # of a race for torn pairs
    env: Path = CONTENDERS / "env"


def label(row: str, chain: int) -> str:
    """Name a row on a chain of so many edges, if it has one."""
    return f"{row}, chain of {chain}" if chain else row


def _printed(results: Results, group: str, command: list[str]) -> None:
    for row in programs.lines_of(command, limit=2 * HOURS):
        _add(results, group, row["row"], row["chain"], row["unit"], row["rounds"])


def _add(
    results: Results, group: str, row: str, chain: int, unit: str, rounds: dict[str, list[float]]
) -> None:
    results.add_rounds(group, label(row, chain), unit, {k: v for k, v in rounds.items() if v})
    print(
        f"{group:>12} | {label(row, chain)}: {results.shown(group, label(row, chain))}", flush=True
    )


def cpp(results: Results, effort: Effort) -> None:
    """Rows of tfdb's core and tf2 in one program."""
    program = str(programs.find("tfdb_against_tf2"))
    _printed(results, "C++", [program, "--rounds", str(effort.rounds)])


def costs(results: Results, effort: Effort) -> None:
    """Rows of what is unusual or large, of tfdb alone."""
    program = str(programs.find("tfdb_costs"))
    rounds = str(min(effort.rounds, 3))
    _printed(results, "cost", [program, "--rounds", rounds, "--samples", str(effort.samples)])


def torn(results: Results, effort: Effort) -> None:
    """Count torn reads of a pair of static edges."""
    program = str(programs.find("tfdb_torn_pair"))
    shares: dict[str, list[float]] = {"tf2": [], "tfdb": []}
    writes: dict[str, list[float]] = {"tf2": [], "tfdb": []}
    for _ in range(min(effort.rounds, 5)):
        for store, of_store in shares.items():
            (found,) = programs.lines_of([program, store, str(effort.seconds)], limit=HOURS)
            of_store.append(100.0 * found["torn"] / found["reads"])
            writes[store].append(1e-3 * found["writes"] / effort.seconds)
    _add(results, "torn", "torn reads of a pair of static edges", 0, "%", shares)
    _add(results, "torn", "pairs written meanwhile", 0, "kops/s", writes)


def instructions(results: Results, effort: Effort) -> None:
    """Count instructions, which hardly depend on the machine."""
    for chain in effort.chains:
        for what in ("lookup mid", "lookup latest"):
            counts = {
                who: [programs.instructions(f"{who} {what}", chain)] for who in ("tf2", "tfdb")
            }
            _add(results, "instructions", what, chain, "instructions", counts)


def _interpreters(env: Path, *contenders: str) -> dict[str, Path]:
    """Return the interpreter of each contender that can run here."""
    others = {
        "tf2": SYSTEM_PYTHON,
        "tf2_live": SYSTEM_PYTHON,
        "tf2_listening": SYSTEM_PYTHON,
        "schiebung": env / "newer" / "bin" / "python",
    }
    found = {}
    for contender in contenders:
        interpreter = others.get(contender, env / "bin" / "python")
        if interpreter.exists():
            imports = subprocess.run(
                [interpreter, CONTENDERS / "worker.py", contender],
                stdin=subprocess.DEVNULL,
                capture_output=True,
                check=False,
            )
            if imports.returncode == 0:
                found[contender] = interpreter
                continue
        print(f"{contender} is left out: {interpreter} cannot import {NEEDED[contender]}")
    return found


def python(results: Results, effort: Effort) -> None:
    """Rows of Python libraries, each in a process of its own."""
    interpreters = _interpreters(
        effort.env, "tfdb", "tfdb_tf2", "tf2", "transform_tree", "pytransform3d", "schiebung"
    )
    for chain in effort.chains:
        workers = {name: Worker(name, path) for name, path in interpreters.items()}
        try:
            for worker in workers.values():
                worker.ask(do="setup", chain=chain, samples=SAMPLES)
            _same_answers(workers)
            for row, turns in _python_turns(workers):
                slow = [turn for turn in turns if turn[1].contender == "pytransform3d"]
                fast = [turn for turn in turns if turn not in slow]
                times: Rounds = interleave(fast, effort.rounds)
                times |= interleave(slow, min(effort.rounds, 5))
                _add(results, "Python", row, chain, "ns", times)
        finally:
            for worker in workers.values():
                worker.close()
    _long_recording(results, effort, interpreters)
    _many_frames(results, effort, interpreters["tfdb"])


def _same_answers(workers: dict[str, Worker]) -> None:
    """Compare all contenders at a few stamps near the newest sample."""
    stamps = workers["tfdb"].call("near_the_newest", SAMPLES)
    expected = workers["tfdb"].ask(do="values", stamps=stamps)["poses"]
    for name, other in workers.items():
        poses = other.ask(do="values", stamps=stamps)["poses"]
        compare_poses(expected, poses, name, TOLERANCES.get(name, 1e-12))


def _whether() -> dict[str, list[tuple[str, str, str]]]:
    """Return the rows of can_transform: title, contender, operation."""
    yes, no = "can_transform", "can_transform, no answer"
    both = (("tfdb.tf2", "tfdb_tf2"), ("tf2_ros", "tf2"))
    return {
        yes: [("tfdb", "tfdb", yes), *((*who, yes) for who in both)],
        no: [(*who, no) for who in both],
    }


def _writes() -> dict[str, list[tuple[str, str, str]]]:
    """Return the rows of writes: title, contender, operation."""
    return {
        "set_transform": [
            ("tfdb", "tfdb", "set_transform"),
            ("tfdb, numpy arrays", "tfdb", "set_transform, numpy"),
            ("tfdb.tf2", "tfdb_tf2", "set_transform"),
            ("tf2_ros", "tf2", "set_transform"),
            ("transform-tree push", "transform_tree", "set_transform"),
        ],
        "message of all edges from bytes": [
            ("tfdb.tf2", "tfdb_tf2", "message of all edges from bytes"),
            ("tf2_ros", "tf2", "message of all edges from bytes"),
        ],
        "samples of one edge from arrays": [
            ("tfdb", "tfdb", "columns"),
            ("transform-tree push_many", "transform_tree", "columns"),
        ],
    }


def _python_turns(workers: dict[str, Worker]) -> Iterator[tuple[str, list[Turn]]]:
    """Return which operation of which contender belongs to which row."""
    batches = [
        f"batch {order}{span}" for order in ("sorted", "unsorted") for span in ("", ", 0.1 s scan")
    ]
    few = [f"{count} stamps in one call{span}" for count in FEW for span in ("", ", 0.1 s scan")]
    rows: dict[str, list[tuple[str, str, str]]] = {
        "lookup mid": [
            ("tfdb", "tfdb", "lookup mid"),
            ("tfdb, as a matrix", "tfdb", "lookup mid, matrix"),
            ("tfdb.tf2", "tfdb_tf2", "lookup mid"),
            ("tf2_ros", "tf2", "lookup mid"),
            ("transform-tree plan.at", "transform_tree", "lookup mid"),
            ("transform-tree by name", "transform_tree", "lookup mid by name"),
            ("schiebung", "schiebung", "lookup mid"),
            ("pytransform3d", "pytransform3d", "lookup mid"),
        ],
        "lookup latest": [
            ("tfdb", "tfdb", "lookup latest"),
            ("tfdb, newest of each edge", "tfdb", "newest of each edge"),
            ("tfdb, newest of each edge, as a matrix", "tfdb", "newest of each edge, matrix"),
            ("tfdb.tf2", "tfdb_tf2", "lookup latest"),
            ("tf2_ros", "tf2", "lookup latest"),
            ("transform-tree plan.latest", "transform_tree", "lookup latest"),
            ("schiebung", "schiebung", "lookup latest"),
        ],
        **_whether(),
        **{
            batch: [("tfdb", "tfdb", batch), ("transform-tree", "transform_tree", batch)]
            for batch in batches
        },
        **{
            row: [
                ("tfdb", "tfdb", row),
                ("tfdb, one by one", "tfdb", f"{row}, one by one"),
                ("transform-tree", "transform_tree", row),
            ]
            for row in few
        },
        "adaptive": [
            ("tfdb", "tfdb", "adaptive"),
            ("transform-tree", "transform_tree", "adaptive"),
        ],
        **_writes(),  # last: they move the history on
    }
    rows["batch sorted"].append(("pytransform3d, 1,000 stamps", "pytransform3d", "batch sorted"))
    for row, turns in rows.items():
        yield (
            row,
            [(title, workers[name], what) for title, name, what in turns if name in workers],
        )


def _long_recording(results: Results, effort: Effort, interpreters: dict[str, Path]) -> None:
    """Measure a batch over one edge of many samples, and what it needs while it runs."""
    times: Rounds = {"tfdb": [], "tfdb, 10 s": []}
    memory: Rounds = {"100,000 stamps": [], "as many stamps as samples": []}
    for _ in range(min(effort.rounds, 3)):
        with Worker("tfdb", interpreters["tfdb"]) as ours:
            found = ours.call("long_recording", effort.samples)
        times["tfdb"].append(found["ns"])
        times["tfdb, 10 s"].append(found["ns_of_10_s"])
        memory["100,000 stamps"].append(found["working_bytes"])
        memory["as many stamps as samples"].append(found["working_bytes_of_many"])
    _add(results, "Python", "batch sorted over n samples", 0, "ns", times)
    _add(results, "Python", "working memory of a batch over n samples", 0, "bytes", memory)


def _many_frames(results: Results, effort: Effort, interpreter: Path) -> None:
    """Measure the edges of many frames at one stamp, and the facts of all frames, per frame."""
    rows = {
        "edges of 2,000 frames at one stamp": (
            ("tfdb", "lookup_edges"),
            ("tfdb, each one's newest", "lookup_edges, each one's newest"),
            ("tfdb, one by one", "lookup_transform"),
        ),
        "facts of 2,000 frames": (("tfdb, columns", "tree_columns"), ("tfdb, objects", "tree")),
    }
    times: dict[str, Rounds] = {row: {} for row in rows}
    for _ in range(effort.rounds):
        with Worker("tfdb", interpreter) as ours:
            found = ours.call("many_frames", MANY_FRAMES)
        for row, titles in rows.items():
            for title, name in titles:
                times[row].setdefault(title, []).append(found[name])
    for row, of_row in times.items():
        _add(results, "Python", row, 0, "ns", of_row)


def loading(results: Results, effort: Effort) -> None:
    """Load recordings: CPU time of the whole call, a fresh process each time."""
    interpreters = _interpreters(effort.env, "tfdb", "rosbags_tf2", "transform_tree")
    with tempfile.TemporaryDirectory() as folder:
        maker = [str(effort.env / "bin" / "python"), str(CONTENDERS / "recording.py"), folder]
        subprocess.run([*maker, str(effort.messages)], check=True)
        files = {
            "mcap": "plain.mcap",
            "mcap, zstd": "zstd.mcap",
            "bag": "long.bag",
            "db3": "long_db3",
        }
        for title, name in files.items():
            times: Rounds = {"tfdb": [], "container alone (rosbags)": []}
            for _ in range(min(effort.rounds, 5)):
                _load_once(interpreters, Path(folder, name), times, answers=title == "mcap")
            _add(results, "loading", f"load, {title}", 10, "s", times)
        _load_ten_times_more(results, effort, interpreters, Path(folder, "ten.mcap"))


def _load_once(interpreters: dict[str, Path], path: Path, times: Rounds, *, answers: bool) -> None:
    with Worker("tfdb", interpreters["tfdb"]) as ours:
        loaded = ours.call("load", str(path))
        times["tfdb"].append(loaded["seconds"])
        if "rosbags_tf2" not in interpreters:
            return
        with Worker("rosbags_tf2", interpreters["rosbags_tf2"]) as rival:
            container = rival.call("read", str(path))["seconds"]
            times["container alone (rosbags)"].append(container)
            if not answers:
                return
            theirs = rival.call("load", str(path))
            times.setdefault("rosbags + tf2", []).append(theirs["seconds"])
            if theirs["samples"] != loaded["samples"]:
                sys.exit("the loaded recordings differ")
            stamps = ours.call("all_over", loaded["oldest"], loaded["newest"])
            ends = ["base_footprint", "left_arm_10_joint_link"]
            here, there = (worker.call("poses_at", *ends, stamps) for worker in (ours, rival))
            compare_poses(here, there, "loaded recordings")


def _load_ten_times_more(
    results: Results, effort: Effort, interpreters: dict[str, Path], path: Path
) -> None:
    maker = [
        str(effort.env / "bin" / "python"),
        str(CONTENDERS / "recording.py"),
        "--mcap",
        str(path),
    ]
    subprocess.run([*maker, str(10 * effort.messages)], check=True)
    times: Rounds = {"tfdb": []}
    memory: Rounds = {"tfdb": [], "transform-tree": []}
    for _ in range(min(effort.rounds, 3)):
        with Worker("tfdb", interpreters["tfdb"]) as ours:
            loaded = ours.call("load", str(path))
        times["tfdb"].append(loaded["seconds"])
        memory["tfdb"].append(loaded["resident"] / loaded["samples"])
        if "transform_tree" in interpreters:
            with Worker("transform_tree", interpreters["transform_tree"]) as rival:
                memory["transform-tree"].append(rival.call("resident", loaded["samples"]))
    _add(results, "loading", "load, mcap of ten times as many", 10, "s", times)
    _add(results, "loading", "memory per sample after that load", 10, "bytes", memory)


def _percentiles(values: list[float]) -> Rounds:
    """Return the median and the 99th percentile, as what two contenders were measured for."""
    cuts = statistics.quantiles(values, n=100, method="inclusive")
    return {"p50": [cuts[49]], "p99": [cuts[98]]}


def sharing(results: Results, effort: Effort) -> None:
    """Measure stores that processes share, and waits."""
    names = ("tfdb", "transform_tree_shared", "tf2_live")
    interpreters = _interpreters(effort.env, *names)
    _shared_alone(results, effort, interpreters["tfdb"])
    _shared_against_tree(results, effort, interpreters)
    _many_readers(results, effort, interpreters)
    _mirrored(results, effort, interpreters["tfdb"])
    _mirrored_fleet(results, effort, interpreters["tfdb"])
    _flooded(results, effort, interpreters["tfdb"])
    _late(results, effort, interpreters["tfdb"])
    _sent(results, effort, interpreters["tfdb"])


def _mirrored_fleet(results: Results, effort: Effort, interpreter: Path) -> None:
    """Measure a process that mirrors many homes into one store."""
    seconds = 5.0 if effort.samples >= Effort.samples else 0.5
    used: Rounds = {}
    applied: Rounds = {}
    threads: Rounds = {}
    for count in FLEETS:
        title = f"{count} homes"
        with ExitStack() as stack:
            homes, mirrors = _workers(stack, "tfdb_net", interpreter, 2)
            endpoint = _free_endpoint()
            homes.call("publish", endpoint, count, 10)
            before = mirrors.call("threads")
            mirrors.call("mirror", endpoint, count)
            threads[title] = [mirrors.call("threads") - before]
            homes.begin("commit", 10)
            for _ in range(min(effort.rounds, 5)):
                percent, commits = mirrors.call("used_by_mirrors", seconds)
                used.setdefault(title, []).append(percent)
                applied.setdefault(title, []).append(commits)
            homes.end()
    row = "that mirrors homes of 10 commits/s, of ten transforms each, into one store"
    _add(results, "sharing", f"CPU of a process {row}", 0, "%", used)
    _add(results, "sharing", f"commits per second of a process {row}", 0, "1/s", applied)
    _add(results, "sharing", f"threads of a process {row}", 0, "", threads)


def _flooded(results: Results, effort: Effort, interpreter: Path) -> None:
    """Measure mirrors that get messages as fast as they take them."""
    many = effort.samples >= Effort.samples
    commits = 100_000 if many else 2_000
    found: Rounds = {}
    for title, group in (("one a message", 1), ("20 a message", 20)):
        found[title] = _flood(effort, interpreter, 1, 10, commits // group, group)
    row = "commits of ten per second of a mirror that gets them as fast as it can"
    _add(results, "sharing", row, 0, "1/s", found)
    homes, edges = (MANY_HOMES, 20) if many else (5, 20)
    found = {}
    for title, messages, group in (
        ("one commit a message", 40, 1),
        ("ten commits a message", 8, 10),
    ):
        rates = _flood(effort, interpreter, homes, edges, messages, group)
        found[title] = [edges * rate for rate in rates]
    row = "transforms per second into one store from 1,000 homes of 20 edges"
    _add(results, "sharing", row, 0, "1/s", found)


def _flood(
    effort: Effort, interpreter: Path, homes: int, edges: int, messages: int, group: int
) -> list[float]:
    """Return how many commits per second one process applied, in each round."""
    rates: list[float] = []
    with ExitStack() as stack:
        sender, mirrors = _workers(stack, "tfdb_net", interpreter, 2)
        endpoint = _free_endpoint()
        sender.call("publish", endpoint, homes, edges)
        mirrors.call("mirror", endpoint, homes)
        sender.call("fall_silent")
        last = 1
        # First until the histories are full.
        warm = [(16, 10)] if effort.samples >= Effort.samples else []
        for count, size in [*warm, *[(messages, group)] * min(effort.rounds, 5)]:
            sender.call("prepare", count, size)
            sender.call("flood")
            last += count * size
            rates.append(mirrors.call("catch", last))
            sender.call("flooded")
        mirrors.call("leave")
        sender.call("leave")
    return rates[len(warm) :]


def _late(results: Results, effort: Effort, interpreter: Path) -> None:
    """Measure a mirror of a large store, and a session among many homes, that come late."""
    many = effort.samples >= Effort.samples
    frames, homes = (10_000, MANY_HOMES) if many else (100, 5)
    joined: Rounds = {"tfdb": []}
    found: Rounds = {"tfdb": []}
    for times, function, *numbers in (
        (joined, "publish_large", frames, 10),
        (found, "publish", homes, 1),
    ):
        with ExitStack() as stack:
            home, late = _workers(stack, "tfdb_net", interpreter, 2)
            endpoint = _free_endpoint()
            home.call(function, endpoint, *numbers)
            for _ in range(min(effort.rounds, 5)):
                call = ("join", endpoint) if times is joined else ("find", endpoint, homes)
                times["tfdb"].append(late.call(*call))
            home.call("leave")
    row = "a new mirror of 10,000 frames of ten samples, until it is live"
    _add(results, "sharing", row, 0, "s", joined)
    _add(results, "sharing", "a new session, until it knows 1,000 homes", 0, "s", found)


def _sent(results: Results, effort: Effort, interpreter: Path) -> None:
    """Measure a home beside a writer of another process that writes at full speed."""
    seconds = 3.0 if effort.samples >= Effort.samples else 0.3
    rates: Rounds = {"written": [], "sent": []}
    name = f"measure-home-{os.getpid()}"
    with ExitStack() as stack:
        home, writer = _workers(stack, "tfdb_net", interpreter, 2)
        home.call("publish_shared", _free_endpoint(), name)
        stack.callback(home.call, "unlink", name)
        for _ in range(min(effort.rounds, 5)):
            before, begin = home.call("sent"), time.perf_counter()
            rates["written"].append(writer.call("write", name, seconds))
            sent = home.call("sent") - before
            rates["sent"].append(sent / (time.perf_counter() - begin))
        home.call("leave")
    row = "commits of ten per second of a home, beside a writer of another process"
    _add(results, "sharing", row, 0, "1/s", rates)


def _free_endpoint() -> str:
    """Return an endpoint of this machine that is free now."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{free.getsockname()[1]}"


def _mirrored(results: Results, effort: Effort, interpreter: Path) -> None:
    """Measure mirrors on this machine, against callbacks of Zenoh that do nothing."""
    seconds = 5.0 if effort.samples >= Effort.samples else 0.5
    for per_s in (1_000, 5_000):
        used: Rounds = {"mirror": [], "empty callback": []}
        with _home_and_two(interpreter, max_delay=0.002) as (home, mirror, rival, endpoint):
            mirror.call("mirror", endpoint, 1)
            rival.call("hear", endpoint, "tfdb/1/robot0/log")
            home.begin("commit", per_s)
            for _ in range(effort.rounds):
                for worker, values in zip((mirror, rival), used.values(), strict=True):
                    values.append(worker.call("used", seconds / 2))
            home.end()
        row = f"CPU of a process that mirrors {per_s:,} commits/s of ten"
        _add(results, "sharing", row, 0, "%", used)
    with _home_and_two(interpreter, max_delay=0.0) as (home, mirror, rival, endpoint):
        mirror.call("mirror_and_note", endpoint)
        rival.call("hear", endpoint, "tfdb_measure/raw")
        home.begin("commit_and_put", 1000)
        time.sleep(seconds)
        for title, worker in (("mirror", mirror), ("Zenoh alone", rival)):
            row = f"from a commit to another process, {title}"
            _add(results, "sharing", row, 0, "ms", _percentiles(worker.call("delays_ms")))
        home.end()


@contextmanager
def _home_and_two(
    interpreter: Path, max_delay: float
) -> Iterator[tuple[Worker, Worker, Worker, str]]:
    """Start a home, and two workers that know its endpoint."""
    with ExitStack() as stack:
        home, *others = _workers(stack, "tfdb_net", interpreter, 3)
        for worker in (home, *others):
            stack.callback(worker.call, "leave")
        endpoint = _free_endpoint()
        home.call("publish", endpoint, 1, 10, max_delay)
        yield home, others[0], others[1], endpoint


def _shared_alone(results: Results, effort: Effort, interpreter: Path) -> None:
    name = f"measure-{os.getpid()}"
    chain, many = 4, effort.samples >= Effort.samples
    with (
        Worker("tfdb", interpreter) as private,
        Worker("tfdb_shared", interpreter) as owner,
        Worker("tfdb_shared", interpreter) as other,
    ):
        private.ask(do="setup", chain=chain, samples=SAMPLES)
        owner.call("make", name, chain, SAMPLES, 20_000)
        try:
            other.call("join", name, chain, SAMPLES)
            turns = [("private", private), ("shared", owner), ("another process", other)]
            times = interleave([(t, worker, "lookup mid") for t, worker in turns], effort.rounds)
            _add(results, "sharing", "lookup mid", chain, "ns", times)
            _shared_costs(results, owner, many=many)
            _recorder(results, owner, many=many)
        finally:
            owner.call("remove")


def _shared_costs(results: Results, owner: Worker, *, many: bool) -> None:
    count = 500 if many else 20
    rounds = 5 if many else 1
    both: Rounds = {"1 process": [], "2 processes": []}
    followed: Rounds = {"none": [], "16 processes": []}
    waits: Rounds = {"none": [], "10,000 waits": []}
    streams: Rounds = {"batches": [], "samples": []}
    rules: Rounds = {"none": [], "1,000 rules": []}
    pages: Rounds = {"1 viewer": [], "10 viewers": []}
    for _ in range(rounds):
        for title, readers in zip(both, (1, 2), strict=True):
            both[title].append(1e-3 * owner.call("readers", readers, 0.5))
        for title, followers in zip(followed, (0, 16), strict=True):
            took = owner.call("commits_beside_followers", followers, 100 * count)
            followed[title].append(took)
        for title, begun in zip(waits, (0, 10_000), strict=True):
            waits[title].append(owner.call("commits_beside_waits", begun, 100 * count))
        for how, shares in streams.items():
            shares.append(owner.call("follow_share", how, 2.0 if many else 0.5))
        for title, installed in zip(rules, (0, 1_000), strict=True):
            rules[title].append(owner.call("commits_beside_rules", installed, 20 * count))
        for title, viewers in zip(pages, (1, 10), strict=True):
            pages[title].append(owner.call("view_share", viewers, 5.0 if many else 0.5))
    _add(results, "sharing", "lookups of reader processes together", 0, "kops/s", both)
    _add(
        results,
        "sharing",
        "CPU of a commit beside processes that read every change",
        0,
        "ns",
        followed,
    )
    _add(
        results,
        "sharing",
        "CPU of a commit beside coroutines that wait for other frames",
        0,
        "ns",
        waits,
    )
    row = "CPU of a process that follows 100,000 transforms/s of another"
    _add(results, "sharing", row, 0, "%", streams)
    _add(results, "sharing", "a commit of ten beside rules on other frames", 0, "ns", rules)
    row = "CPU of the page's server, 2,000 moving frames at 30 Hz"
    _add(results, "sharing", row, 0, "%", pages)
    for row, function in (
        ("from a commit to a rule's action", "fires"),
        ("from a commit to a rule's action in another process", "fires_of_another_process"),
        ("from the time of a played message to its commit, 1,000 messages/s", "late_releases"),
        ("a jump in a recording of 1,000 transforms/s, history of 10 s", "jumps"),
        ("opening a shared store and first answer", "attach"),
        ("from a commit to a waiting thread of another process", "wakes"),
        ("from a commit to a waiting coroutine of another process", "wakes_of_coroutine"),
    ):
        _add(results, "sharing", row, 0, "ms", _percentiles(owner.call(function, count)))
    for row, values in owner.call("deaths", count // 2, 10_000).items():
        if len(values) > 1:
            _add(results, "sharing", f"from {row} to the next commit, 10,000 frames", 0, "ms",
                 _percentiles(values))  # fmt: skip


def _recorder(results: Results, owner: Worker, *, many: bool) -> None:
    shares: Rounds = {"tfdb": []}
    files: Rounds = {"tfdb": [], "mcap's own writer": []}
    for _ in range(5 if many else 1):
        share, *sizes = owner.call("record_share", 5.0 if many else 0.5)
        shares["tfdb"].append(share)
        for size, found in zip(sizes, files.values(), strict=True):
            found.append(1e-6 * size)
    row = "CPU of a recorder of 100,000 transforms/s of another process"
    _add(results, "sharing", row, 0, "%", shares)
    _add(results, "sharing", "the file of a recorder, the same messages", 0, "MB", files)
    row = "a jump in ten minutes of 1,000 transforms/s as `tfdb record` writes them"
    jumps = owner.call("jumps_in_commits", 200 if many else 10)
    _add(results, "sharing", row, 0, "ms", _percentiles(jumps))


def _shared_against_tree(results: Results, effort: Effort, interpreters: dict[str, Path]) -> None:
    """Compare with transform-tree's shared memory: of each one process writes, three read."""
    contenders = {"tfdb": ("tfdb_shared", "tfdb")}
    if "transform_tree_shared" in interpreters:
        contenders["transform-tree"] = ("transform_tree_shared", "transform_tree_shared")
    name = f"measure-{os.getpid()}"
    with ExitStack() as stack:
        processes = {
            title: _workers(stack, who, interpreters[python], 4)
            for title, (who, python) in contenders.items()
        }
        for title, (writer, *readers) in processes.items():
            writer.call("make", name, LIVE_CHAIN, SAMPLES)
            if title == "tfdb":
                stack.callback(writer.call, "remove")
            for reader in readers:
                reader.call("join", name, LIVE_CHAIN, SAMPLES)
        _same_answers({title: readers[0] for title, (_, *readers) in processes.items()})
        _shared_turns(results, effort, processes)


def _shared_turns(results: Results, effort: Effort, processes: dict[str, list[Worker]]) -> None:
    writers = {title: workers[0] for title, workers in processes.items()}
    readers = {title: workers[1] for title, workers in processes.items()}
    others = [worker for workers in processes.values() for worker in workers[2:]]
    for worker in others:
        worker.begin("look_up", LOOKUPS)
    for worker in writers.values():
        worker.begin("write_each", MESSAGES)
    turns = [(title, worker, "lookup mid") for title, worker in readers.items()]
    if "transform-tree" in readers:
        turns.append(("transform-tree by name", readers["transform-tree"], "lookup mid by name"))
    times = interleave(turns, effort.rounds)
    for worker in writers.values():
        worker.end()
    _add(results, "sharing", "lookup mid beside a writer's process", LIVE_CHAIN, "ns", times)
    opened: Rounds = {title: [] for title in readers}
    for worker in readers.values():
        worker.call("attach", 1)  # the first one imports what it needs
    for _ in range(effort.rounds):
        for title, worker in readers.items():
            opened[title].append(statistics.median(worker.call("attach", 50)))
    _add(results, "sharing", "opening and first answer, beside readers", LIVE_CHAIN, "ms", opened)
    what = "set_transform, each edge in turn"
    times = interleave([(t, worker, what) for t, worker in writers.items()], effort.rounds)
    _add(results, "sharing", "set_transform beside readers' processes", LIVE_CHAIN, "ns", times)
    for worker in others:
        worker.end()


def _many_readers(results: Results, effort: Effort, interpreters: dict[str, Path]) -> None:
    """Measure what a process costs that looks up now and then: in a store, and with tf2_ros."""
    name = f"measure-{os.getpid()}"
    seconds = 5.0 if effort.samples >= Effort.samples else 0.5
    each, idle = f"tfdb, each of {READERS}", f"only woken so often, each of {READERS}"
    used: Rounds = {each: [], idle: []}
    heard: Rounds = {"tfdb, written": []}
    with ExitStack() as stack:
        writer, *readers = _workers(stack, "tfdb_shared", interpreters["tfdb"], 1 + READERS)
        writer.call("make", name, LIVE_CHAIN, SAMPLES)
        stack.callback(writer.call, "remove")
        for reader in readers:
            reader.call("join", name, LIVE_CHAIN, SAMPLES)
        _memory(results, writer, readers)
        publisher, listeners = None, []
        if "tf2_live" in interpreters:
            publisher, *listeners = _workers(stack, "tf2_live", interpreters["tf2_live"], 3)
            uri = publisher.call("make", LIVE_CHAIN)
            for listener in listeners:
                listener.call("join", uri, LIVE_CHAIN)
        for _ in range(min(effort.rounds, 5)):
            writer.begin("write_each", MESSAGES)
            used[each].append(_cpu_of_each(readers, "look_up", seconds))
            used[idle].append(_cpu_of_each(readers, "wake", seconds))
            heard["tfdb, written"].append(LIVE_CHAIN * writer.end()["per_s"])
            for title, count in LISTENERS.items():
                if publisher is not None:
                    cpu, received = _listening(publisher, listeners[:count], seconds)
                    used.setdefault(title, []).append(cpu)
                    heard.setdefault(f"{title}, received", []).append(LIVE_CHAIN * received)
    _add(results, "sharing", "CPU of a process with 100 lookups/s", LIVE_CHAIN, "%", used)
    _add(results, "sharing", "transforms per second meanwhile", LIVE_CHAIN, "1/s", heard)


def _workers(stack: ExitStack, contender: str, python: Path, count: int) -> list[Worker]:
    """Start processes that end with the stack."""
    return [stack.enter_context(Worker(contender, python)) for _ in range(count)]


def _memory(results: Results, writer: Worker, readers: list[Worker]) -> None:
    """Weigh the store in all its processes together, and a reader."""
    of_store: Rounds = {}
    of_reader: Rounds = {}
    for count in (1, READERS):
        for reader in readers[:count]:
            reader.call("read_all")
        shares = [worker.call("memory") for worker in (writer, *readers[:count])]
        title = f"{count} reader{'s' if count > 1 else ''}"
        of_store[title] = [sum(share["store"] for share in shares) / 2**20]
        of_reader[title] = [statistics.mean(share["process"] for share in shares[1:]) / 2**20]
    row = "memory of a store, the shares of its writer and readers together"
    _add(results, "sharing", row, LIVE_CHAIN, "MiB", of_store)
    row = "memory of a reader's process, its share of the store included"
    _add(results, "sharing", row, LIVE_CHAIN, "MiB", of_reader)


def _cpu_of_each(workers: list[Worker], function: str, seconds: float) -> float:
    """Return the CPU of a process, in percent of a core, while all call that at a steady rate."""
    for worker in workers:
        worker.begin(function, LOOKUPS)
    time.sleep(seconds)
    return statistics.mean([worker.end()["cpu"] for worker in workers])


def _listening(publisher: Worker, listeners: list[Worker], seconds: float) -> tuple[float, float]:
    """Return the same of nodes that listen, and how many messages reached each per second."""
    publisher.begin("write_each", MESSAGES)
    for listener in listeners:
        listener.call("listen")
    begin, before = time.monotonic(), [listener.call("received") for listener in listeners]
    cpu = _cpu_of_each(listeners, "look_up", seconds)
    after, end = [listener.call("received") for listener in listeners], time.monotonic()
    publisher.end()
    for listener in listeners:
        listener.call("leave")
    return cpu, (sum(after) - sum(before)) / len(listeners) / (end - begin)


def live(results: Results, effort: Effort) -> None:
    """Measure nodes that listen in a graph of ROS 1, one at a time, in turns."""
    interpreters = _interpreters(effort.env, "tf2_live", *NODES.values())
    if "tf2_live" not in interpreters:
        return
    seconds = 4.0 if effort.samples >= Effort.samples else 0.5
    for edges, per_s in STREAMS:
        used: Rounds = {}
        heard: Rounds = {}
        with ExitStack() as stack:
            (publisher,) = _workers(stack, "tf2_live", interpreters["tf2_live"], 1)
            uri = publisher.call("make", edges)
            nodes = {
                title: _workers(stack, who, interpreters[who], 1)[0]
                for title, who in NODES.items()
                if who in interpreters
            }
            for node in nodes.values():
                node.call("join", uri)
            publisher.begin("write_each", per_s)
            for _ in range(effort.rounds):
                for title, node in nodes.items():
                    node.call("listen", "frame_0", f"frame_{edges}")
                    found = node.call("cost", seconds)
                    node.call("leave")
                    used.setdefault(title, []).append(found["cpu"])
                    heard.setdefault(title, []).append(found["per_s"])
            publisher.end()
        row = f"{per_s:.0f} messages/s of {edges} transforms"
        _add(results, "live", f"CPU of a node of ROS 1 that listens to {row}", 0, "%", used)
        _add(results, "live", f"messages per second that it received of {row}", 0, "1/s", heard)
    _delays(results, effort, interpreters)
    _many_nodes(results, effort, interpreters)


def live_in_ros2(results: Results, effort: Effort) -> None:
    """Measure nodes that listen in a graph of ROS 2, one at a time, in turns."""
    environment = _environment_of_ros2()
    if environment is None:
        print("nodes of ROS 2 are left out: python tools/make_ros2_env.py")
        return
    seconds = 4.0 if effort.samples >= Effort.samples else 0.5
    interpreter = effort.env / "bin" / "python"
    for edges, per_s in STREAMS:
        used: Rounds = {}
        late: dict[str, Rounds] = {}
        with ExitStack() as stack:

            def worker(contender: str, stack: ExitStack = stack) -> Worker:
                return stack.enter_context(Worker(contender, interpreter, environment))

            publisher = worker("ros2_publishing")
            publisher.call("make", edges)
            nodes = {title: worker(who) for title, (who, _) in NODES_OF_ROS2.items()}
            for title, node in nodes.items():
                node.call("join", NODES_OF_ROS2[title][1])
            publisher.begin("write_each", per_s)
            for _ in range(effort.rounds):
                for title, node in nodes.items():
                    node.call("listen", "frame_0", f"frame_{edges}")
                    found = node.call("cost", seconds)
                    node.call("leave")
                    used.setdefault(title, []).append(found["cpu"])
                    for share in ("p50", "p99"):
                        late.setdefault(share, {}).setdefault(title, []).append(found[share])
            publisher.end()
        row = f"{per_s:.0f} messages/s of {edges} transforms"
        _add(results, "live", f"CPU of a node of ROS 2 that listens to {row}", 0, "%", used)
        for share, delays in late.items():
            _add(results, "live", f"ROS 2, publish to stored, {row}, {share}", 0, "ms", delays)


def _environment_of_ros2() -> dict[str, str] | None:
    """Return the variables of a process that has ROS 2, in a graph of its own."""
    tool = ROOT / "tools" / "make_ros2_env.py"
    spec = importlib.util.spec_from_file_location("make_ros2_env", tool)
    if spec is None or spec.loader is None:
        return None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    if not module.is_made():
        return None
    found: dict[str, str] = module.environment()
    return found | {"ROS_DOMAIN_ID": str(1 + os.getpid() % 100)}


def _delays(results: Results, effort: Effort, interpreters: dict[str, Path]) -> None:
    """Measure how soon a waiting lookup returns; what 10,000 futures cost."""
    with ExitStack() as stack:
        (publisher,) = _workers(stack, "tf2_live", interpreters["tf2_live"], 1)
        uri = publisher.call("make", 1)
        publisher.begin("write_now", 50.0)
        for title, who in NODES.items():
            if who not in interpreters:
                continue
            (node,) = _workers(stack, who, interpreters[who], 1)
            node.call("join", uri)
            node.call("listen", "frame_0", "frame_1")
            found = node.call("delays", 50 * effort.rounds)
            row = f"publish to return of a waiting lookup: {title}"
            _add(results, "live", row, 0, "ms", _percentiles(found))
            if title == "tfdb":
                waits = node.call("futures", 10_000)
                row = "a write of other frames beside 10,000 futures"
                _add(results, "live", row, 0, "us", {"tfdb": waits["unrelated"]})
                row = "a write that ends 10,000 futures, until all have their results"
                _add(results, "live", row, 0, "ms", {"tfdb": waits["ended"]})
            node.call("leave")
        publisher.end()


def _many_nodes(results: Results, effort: Effort, interpreters: dict[str, Path]) -> None:
    """Measure what many nodes cost: one that listens for all, against one listener each."""
    if "tf2_listening" not in interpreters:
        return
    seconds = 5.0 if effort.samples >= Effort.samples else 0.5
    name, ends = f"measure-nodes-{os.getpid()}", ("frame_0", f"frame_{LIVE_CHAIN}")
    used: Rounds = {"tfdb": [], "tf2_ros": []}
    memory: Rounds = {"tfdb": [], "tf2_ros": []}
    with ExitStack() as stack:
        (publisher,) = _workers(stack, "tf2_live", interpreters["tf2_live"], 1)
        uri = publisher.call("make", LIVE_CHAIN)
        publisher.begin("write_each", SLOW_MESSAGES)
        ours = _workers(stack, "tfdb_live", interpreters["tfdb_live"], 1 + MANY_NODES)
        theirs = _workers(stack, "tf2_listening", interpreters["tf2_listening"], MANY_NODES)
        for node in (*ours, *theirs):
            node.call("join", uri)
        for _ in range(min(effort.rounds, 5)):
            listener, *readers = ours
            listener.call("listen_into", name, *ends)
            for reader in readers:
                reader.call("attach", name, *ends)
            used["tfdb"].append(len(ours) * _cpu_of_each(ours, "look_up", seconds))
            memory["tfdb"].append(sum(node.call("memory") for node in ours))
            listener.call("leave")
            listener.call("detach", name)
            for node in theirs:
                node.call("listen", *ends)
            used["tf2_ros"].append(len(theirs) * _cpu_of_each(theirs, "look_up", seconds))
            memory["tf2_ros"].append(sum(node.call("memory") for node in theirs))
            for node in theirs:
                node.call("leave")
        publisher.end()
    what = f"{MANY_NODES} nodes with 100 lookups/s each, 50 messages/s of 10 transforms"
    _add(results, "live", f"CPU of {what}", 0, "%", used)
    _add(results, "live", f"memory of {what}", 0, "MiB", memory)


def start(results: Results, effort: Effort) -> None:
    """Time `import tfdb` and `import numpy`, in processes that have just begun."""
    code = "import time; a = time.process_time_ns(); import {}; print(time.process_time_ns() - a)"
    times: Rounds = {"tfdb": [], "numpy": []}
    interpreter = effort.env / "bin" / "python"
    for turn in range(effort.rounds + 1):
        for module, values in times.items():
            took = json.loads(process_output([str(interpreter), "-c", code.format(module)]))
            if turn:  # the first one compiles
                values.append(1e-6 * took)
    _add(results, "start", "import", 0, "ms", times)


GROUPS: dict[str, Callable[[Results, Effort], None]] = {
    "C++": cpp,
    "cost": costs,
    "torn": torn,
    "instructions": instructions,
    "Python": python,
    "loading": loading,
    "sharing": sharing,
    "live": live,
    "live in ROS 2": live_in_ros2,
    "start": start,
}
"""What may be measured by itself, by the name that its rows have in the results."""

NEED_PYTHON = ("Python", "loading", "sharing", "live", "live in ROS 2", "start")
"""The groups that need the rivals' environment."""


def install(env: Path) -> None:
    """Install tfdb of this checkout into the rivals' environment, as a user would."""
    python_ = env / "bin" / "python"
    if not python_.exists():
        sys.exit(f"no rivals in {env}: run measure/contenders/install first")
    settings = f"--config-settings=build-dir={env / 'build'}"
    pip = [str(python_), "-m", "pip", "--disable-pip-version-check", "--quiet", "install"]
    subprocess.run([*pip, settings, f"{ROOT}[recordings,view,net,dds]"], check=True)
