"""`expect`, `check --expect` and `watch`."""

from __future__ import annotations

import json
import threading
import time
from itertools import count
from typing import TYPE_CHECKING, Any

import tfdb
from tfdb.cli.graph import Live
from tfdb.cli.watch import watch_events
from tfdb.judging import Expectation

if TYPE_CHECKING:
    from pathlib import Path

    import pytest

    from conftest import Tool

S = 10**9


def recorded(folder: Path, times: list[tuple[float, float]]) -> Path:
    """Record one edge; each sample has an arrival time and a stamp."""
    path = folder / "drive.mcap"
    with tfdb.recordings.RecordingWriter(path) as writer:
        for arrival, stamp in times:
            one = tfdb.TransformStamped("map", "base", round(stamp * S), (0, 0, 0), (0, 0, 0, 1))
            data = tfdb.encode_tf_message([one], encoding=writer.encoding)
            writer.write(data, round(arrival * S), topic="/tf")
    return path


def findings(tool: Tool, *arguments: object, code: int) -> dict[tuple[str, str], Any]:
    body = tool("check", *arguments, "--json", code=code).json
    return {(each["kind"], "".join(each["frames"])): each for each in body["findings"]}


def test_a_recording_meets_its_proposal(tool: Tool, bag: Path, tmp_path: Path) -> None:
    out = tmp_path / "expectations.toml"
    assert "expectations of 84 edges and 3 authorities" in tool("expect", bag, "-o", out).out
    tool("check", bag, "--expect", out, code=0)
    assert "exists already" in tool("expect", bag, "-o", out, code=2).error
    told = tool("expect", bag, "--json").json
    assert (told["edges"], told["authorities"], told["events"]) == (84, 3, [])
    assert told["text"] == out.read_text()
    assert tool("expect", bag).out == out.read_text().rstrip() + "\n"


def test_a_recording_that_is_not_good_is_named(tool: Tool, tmp_path: Path) -> None:
    path = recorded(tmp_path, [(100 + i / 10, 100 - i // 20 * 50 + i / 10) for i in range(40)])
    assert "it has time-jump; 'tfdb check' lists them" in tool("expect", path).err


def test_a_broken_expectation_is_a_finding(tool: Tool, bag: Path, tmp_path: Path) -> None:
    file = tmp_path / "tight.toml"
    file.write_text(
        'version = 1\n[[edge]]\nparent = "odom"\nchild = "base_footprint"\nmax_step = "10 mm"\n'
        'deadline = 0.02\nauthority = "/other"\n[[edge]]\nparent = "a"\nchild = "b"\n'
        '[default]\nseverity = { step = "warning" }\n'
    )
    found = findings(tool, bag, "--expect", file, code=1)
    assert {kind for kind, _ in found} == {"missing", "foreign-authority", "deadline", "step"}
    step = found["step", "base_footprint"]
    assert step["severity"] == "warning"
    assert step["details"]["limit"] == 0.01
    assert step["message"].startswith("0.01")
    assert "of odom -> base_footprint by /odometry" in step["message"]
    deadline = found["deadline", "base_footprint"]
    assert deadline["count"] == len(deadline["details"]["times_ns"])
    assert found["missing", "b"]["message"] == "1 s (limit 1 s) of a -> b, once, until the end"
    left = findings(tool, bag, "--expect", file, "--ignore", "step", "--ignore", "missing", code=1)
    assert {kind for kind, _ in left} == {"foreign-authority", "deadline"}
    said = tool("check", bag, "--expect", file, code=1).out
    assert "2 errors, 2 warnings" in said


def test_a_deadline_takes_the_place_of_gaps(tool: Tool, tmp_path: Path) -> None:
    times = [(i / 10, i / 10 - (i == 45) / 2) for i in range(60) if not 20 < i < 30]
    path = recorded(tmp_path, times)
    kinds = {kind for kind, _ in findings(tool, path, code=1)}
    assert kinds == {"gap", "late"}
    file = tmp_path / "e.toml"
    file.write_text("version = 1\n[default]\ndeadline = 2\n")
    assert {kind for kind, _ in findings(tool, path, "--expect", file, code=1)} == {"late"}
    file.write_text("version = 1\n[default]\ndeadline = 2\nmax_late = 1\n")
    assert findings(tool, path, "--expect", file, code=0) == {}


def test_wrong_expectations_are_an_error(tool: Tool, bag: Path, tmp_path: Path) -> None:
    file = tmp_path / "wrong.toml"
    file.write_text("version = 1\n[default]\ndeadline = 0\n")
    failed = tool("check", bag, "--expect", file, "--json", code=2)
    assert failed.json["error"]["type"] == "ExpectationError"
    assert failed.json["error"]["fields"]["line"] == 3
    file.write_text("version = 1\n")
    assert "is not live" in tool("watch", bag, "--expect", file, code=2).error
    assert "Missing option '--expect'" in tool("watch", "shm:x", code=2).error
    assert "tfdb shm ls" in tool("watch", "shm:no-such-store", "--expect", file, code=2).error


def test_watch_prints_events_of_a_store(tool: Tool, name: str, tmp_path: Path) -> None:
    file = tmp_path / "e.toml"
    file.write_text(
        'version = 1\n[[edge]]\nparent = "map"\nchild = "base"\nlifespan = 5\nmax_step = 1\n'
    )
    with tfdb.Buffer.open(name) as buf:
        buf.set_transform("map", "base", time.time_ns(), (0, 0, 0), authority="ekf")
        tool("watch", f"shm:{name}", "--expect", file, "--for", "0.2", code=0)
        done = threading.Event()

        def write() -> None:
            for i in count():
                buf.set_transform("map", "base", time.time_ns(), (i % 2 * 3, 0, 0), authority="ekf")
                if done.wait(0.005):
                    return

        writer = threading.Thread(target=write)
        writer.start()
        try:
            done_watch = tool(
                "watch", f"shm:{name}", "--expect", file, "--for", "0.5", "--json", code=1
            )
        finally:
            done.set()
            writer.join()
    (event,) = map(json.loads, done_watch.out.splitlines())
    assert (event["kind"], event["severity"], event["value"]) == ("step", "error", 3.0)
    assert (event["parent"], event["child"], event["authority"]) == ("map", "base", "ekf")
    buf = tfdb.Buffer.open(name)
    buf.clear()
    buf.set_transform("map", "base", time.time_ns() - 60 * S, (0, 0, 0))
    said = tool("watch", f"shm:{name}", "--expect", file, "--for", "0.1", code=1)
    assert "stale: map -> base: lifespan 60 s (limit 5 s)" in said.out
    assert "0 errors, 0 warnings, 1 stale" in said.err


def test_check_judges_a_store_that_is_silent_while_watched(
    tool: Tool, name: str, tmp_path: Path
) -> None:
    file = tmp_path / "e.toml"
    edges = "".join(f'[[edge]]\nparent = "map"\nchild = "{child}"\n' for child in ("base", "arm"))
    file.write_text(f"version = 1\n{edges}")
    with tfdb.Buffer.open(name) as buf:
        buf.set_transform("map", "base", time.time_ns(), (0, 0, 0))  # only one sample
        found = findings(tool, f"shm:{name}", "--expect", file, "--for", "1.1", code=1)
    assert set(found) == {("missing", "base"), ("missing", "arm")}


def test_watch_and_monitor_go_by_the_clock_of_the_store(
    tool: Tool, name: str, tmp_path: Path
) -> None:
    file = tmp_path / "e.toml"
    file.write_text("version = 1\n[default]\nlifespan = 3\ndeadline = 3\n")
    store = tfdb.Buffer.open(name)
    store.clock.pause()
    store.clock.seek(1000 * S)
    store.set_transform("odom", "base", 999 * S, (1, 2, 3))
    tool("watch", f"shm:{name}", "--expect", file, "--for", "0.3", code=0)
    done = tool("echo", f"shm:{name}", "odom", "base", "--limit", "1", "--json")
    assert json.loads(done.out)["age_ns"] == S
    store.clock.seek(1003 * S)
    said = tool("watch", f"shm:{name}", "--expect", file, "--for", "0.3", code=1).out
    assert "stale: odom -> base: lifespan" in said
    assert "two-clocks" not in said


def test_watch_goes_on_after_commits_that_it_missed(capsys: pytest.CaptureFixture[str]) -> None:
    store = tfdb.Buffer()
    expected = tfdb.Expectations([Expectation("map", "base", deadline=0.5, max_step=1)])
    store.set_transform("map", "base", 10 * S, (0, 0, 0))
    now, steps = 10 * S, iter(range(4))

    def clock() -> int:
        nonlocal now
        now += S // 10
        if next(steps, None) == 3:  # the command has read the feed once
            for i in range(20_000):
                store.set_transform("map", "base", now + i, (i, 0, 0))
        return now

    said = ""
    for events in watch_events(Live(store, clock), expected, None):
        assert events == []
        said += capsys.readouterr().err
        if said:
            break
    assert "tfdb: warning: 20,000 commits were missed" in said
