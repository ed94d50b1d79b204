"""`echo`, `monitor` and `view-frames` on recordings and shared stores."""

from __future__ import annotations

import fcntl
import json
import math
import os
import pty
import re
import struct
import subprocess
import sys
import termios
import threading
import time
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

import tfdb
from tfdb.cli.echo import Printer, Question, echo
from tfdb.cli.graph import Live
from tfdb.cli.monitor import Watch
from tfdb.cli.times import LATEST
from tfdb.judging.live import LiveJudge
from tfdb.streams.rows import stretches_of_changes

if TYPE_CHECKING:
    from conftest import Tool

S = 1_000_000_000
TURN = (0.0, 0.6, 0.0, 0.8)


def lines(text: str) -> list[dict[str, Any]]:
    """Parse the JSON objects of a command, one per line."""
    return [json.loads(line) for line in text.splitlines()]


def test_echo_walks_through_a_recording(tool: Tool, bag: Path) -> None:
    told = lines(tool("echo", bag, "map", "/base_link", "-r", "2", "--json").out)
    stamps = [each["stamp_ns"] for each in told]
    assert len(stamps) == 18
    assert {after - before for before, after in pairwise(stamps)} == {S // 2}
    asked = tool("lookup", bag, "map", "base_link", f"{stamps[5]}ns", "--json").json
    for key in ("translation", "rotation_xyzw", "rpy_deg", "matrix", "limiting", "stamp_ns"):
        assert told[5][key] == asked[key]
    assert told[5]["gap_ns"] == max(edge["gap_ns"] for edge in asked["edges"])
    assert told[5]["age_ns"] == 0
    limited = lines(tool("echo", bag, "map", "base_link", "-r", "2", "-l", "3", "--json").out)
    assert limited == told[:3]


def test_echo_prints_as_tf2_echo(tool: Tool, name: str) -> None:
    store = tfdb.Buffer.open(name)
    store.set_transform("map", "base", 5 * S + 7, (1, -2.5, 3), TURN)
    store.set_transform("map", "base", 6 * S + 7, (1, -2.5, 3), TURN)
    said = tool("echo", f"shm:{name}", "map", "base", "-t", "5.000000007", "-l", "1").out
    first, *rest = said.splitlines()
    assert first.startswith("At time 5.000000007, (current time ")
    assert rest[:5] == [
        "- Translation: [1.000, -2.500, 3.000]",
        "- Rotation: in Quaternion [0.000, 0.600, 0.000, 0.800]",
        f"            in RPY (radian) [0.000, {math.asin(0.96):.3f}, 0.000]",
        f"            in RPY (degree) [0.000, {math.degrees(math.asin(0.96)):.3f}, 0.000]",
        "- Matrix:",
    ]
    assert [float(text) for text in rest[5].split()] == [0.28, 0, 0.96, 1]
    assert rest[9].startswith("- Age: ")
    said = tool("echo", f"shm:{name}", "map", "base", "-t", "5.5", "-l", "1", "-p", "1").out
    assert "[1.0, -2.5, 3.0]" in said
    assert "interpolated over 1 s in base" in said
    store.set_static_transform("base", "camera", (1, 2, 3), TURN)
    said = tool("echo", f"shm:{name}", "base", "camera", "-l", "1").out
    assert "no edge of the path moves" in said


@pytest.mark.parametrize("period", [None, 0.001, 3600.0])
def test_echo_of_later_transforms(name: str, period: float | None) -> None:
    """The first transform is printed when it arrives, then each new one."""
    store = tfdb.Buffer.open(name)
    to_come = [
        [("odom", "base", 7), ("map", "odom", 8)],
        [("map", "odom", 8), ("map", "odom", 9)],
    ]
    shown: list[object] = []

    class Writes(Printer):
        """Writes the next transform when a line is printed."""

        def show(self, found: tfdb.Transform | tfdb.TfdbError, now: int) -> None:
            shown.append(found if isinstance(found, tfdb.TfdbError) else found.stamp)
            for parent, child, stamp in to_come.pop(0) if to_come else ():
                store.set_transform(parent, child, stamp * S, (1, 2, 3), TURN)

    live = Live(tfdb.Buffer.open(name, mode="r"))
    question = Question("map", "odom", LATEST, None, None)
    echo(live, question, period, Writes("", 3, as_json=True), 1 if period == 3600 else 2)
    error, *stamps = shown
    assert isinstance(error, tfdb.UnknownFrame)
    assert stamps == [8 * S, 9 * S][: 1 if period == 3600 else 2]


def test_echo_at_a_rate_repeats_itself(tool: Tool, name: str) -> None:
    tfdb.Buffer.open(name).set_transform("map", "base", 3 * S, (1, 2, 3), TURN)
    told = lines(tool("echo", f"shm:{name}", "map", "base", "-l", "2", "-r", "500", "--json").out)
    assert [each["stamp_ns"] for each in told] == [3 * S, 3 * S]
    assert told[0]["age_ns"] == told[0]["now_ns"] - 3 * S


def test_echo_by_an_offset(tool: Tool, bag: Path, name: str) -> None:
    told = lines(tool("echo", bag, "map", "base_link", "-o", "-0.5", "-l", "2", "--json").out)
    assert [each["age_ns"] for each in told] == [S // 2, S // 2]
    store = tfdb.Buffer.open(name, history=None)
    now = time.time_ns()
    for seconds in (-100, 100):
        store.set_transform("map", "base", now + seconds * S, (seconds, 2, 3), TURN)
    arguments = ("map", "base", "-o", "-2.5", "-l", "1", "--json")
    (one,) = lines(tool("echo", f"shm:{name}", *arguments).out)
    assert 0 <= one["age_ns"] - 2.5 * S < 20 * S


def test_echo_refuses_wrong_arguments(tool: Tool, bag: Path, name: str) -> None:
    tfdb.Buffer.open(name)
    assert "did you mean 'map'" in tool("echo", bag, "maps", "base_link", code=2).error
    store = (f"shm:{name}", "a", "b")
    assert "exclude" in tool("echo", *store, "-t", "1", "-o", "1", code=2).error
    assert "absolute" in tool("echo", *store, "-t", "+1", code=2).error
    assert "valid for live stores" in tool("echo", bag, "a", "b", "--each", code=2).error
    assert "--topic is valid for recordings" in tool("echo", *store, "--topic", "/tf", code=2).error
    assert "tfdb shm ls" in tool("echo", "shm:none-such", "a", "b", code=2).error


def test_monitor_reports_the_whole_recording(tool: Tool, bag: Path) -> None:
    (told,) = lines(tool("monitor", bag, "map", "base_link", "--json").out)
    summary = {each["frame"]: each for each in tool("info", bag, "--json").json["edges"]}
    assert [each["frame"] for each in told["frames"]] == ["base_footprint", "base_link", "odom"]
    for each in told["frames"]:
        known = summary[each["frame"]]
        assert each["authorities"] == [known["authority"]]
        assert each["parent"] == known["parent"]
        assert each["static"] == known["static"]
        assert each["messages"] == known["samples"]
        if not each["static"]:
            assert each["longest_gap_ns"] == known["longest_gap_ns"]
            assert each["rate_hz"] == pytest.approx(known["rate_hz"], rel=0.02)
            assert 0 < each["delay_ns"] < each["longest_delay_ns"] < S // 100
    chain = told["chain"]
    assert chain["frames"] == ["map", "odom", "base_footprint", "base_link"]
    assert 0 < chain["delay_ns"] < chain["longest_delay_ns"] < S
    assert {each["authority"] for each in told["authorities"]} >= {"/odometry", "/localization"}
    said = tool("monitor", bag, "map", "base_link").out
    assert "map <- odom <- base_footprint <- base_link: net delay" in said
    assert "/odometry" in said


def test_monitor_looks_at_the_chain_over_the_whole_recording(tool: Tool, tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    # Edge a ends at 1 s, edge b continues: (arrival, stamp) in nanoseconds.
    arrivals = [("a", S // 100, 0), ("b", S // 50, 0), ("a", S + S // 100, S)]
    arrivals += [("b", number * S + S // 50, number * S) for number in range(1, 16)]
    with tfdb.recordings.RecordingWriter(path) as writer:
        for child, arrival, stamp in arrivals:
            edge = ("map", "a") if child == "a" else ("a", "b")
            one = tfdb.TransformStamped(*edge, 100 * S + stamp, (1, 2, 3), TURN)
            writer.write(tfdb.encode_tf_message([one]), 100 * S + arrival, topic="/tf")
    newest: dict[str, int] = {}
    ages = []
    for child, arrival, stamp in arrivals:
        newest[child] = stamp
        if len(newest) == 2:
            ages.append(arrival - min(newest.values()))
    (told,) = lines(tool("monitor", path, "map", "b", "--json").out)
    assert told["chain"]["broken"] is None
    assert told["chain"]["longest_delay_ns"] == max(ages) > 14 * S
    assert told["chain"]["delay_ns"] == sum(ages) // len(ages)


def test_monitor_of_a_chain_names_refused_transforms_and_the_options(tool: Tool) -> None:
    case = Path(__file__).resolve().parents[1] / "cases" / "static_and_dyn.mcap"
    warned = tool("monitor", case, "odom", "base_link", "--json").err
    assert "50 transforms of frame 'base_link' were refused with StaticConflict" in warned
    assert "--exclude '/tf_static:base_link'" in warned


def test_monitor_follows_a_store(tool: Tool, name: str) -> None:
    store = tfdb.Buffer.open(name)
    store.set_static_transform("base", "camera", (1, 2, 3), TURN, authority="urdf")
    over = threading.Event()

    def write() -> None:
        while not over.is_set():
            now = time.time_ns()
            store.set_transform("map", "base", now - S, (1, 2, 3), TURN, authority="slow")
            over.wait(0.001)

    writer = threading.Thread(target=write)
    writer.start()
    try:
        arguments = ("--every", "0.2", "--for", "0.5", "--json")
        told = lines(tool("monitor", f"shm:{name}", "map", "camera", *arguments).out)
        assert "net delay 1" in tool("monitor", f"shm:{name}", "map", "base", "--for", "1").out
    finally:
        over.set()
        writer.join()
    assert len(told) == 3
    base, camera = told[-1]["frames"]
    assert (base["frame"], base["parent"], base["authorities"]) == ("base", "map", ["slow"])
    assert camera["static"]
    assert camera["authorities"] == ["urdf"]
    assert S <= base["delay_ns"] <= base["longest_delay_ns"]
    assert max(report["frames"][0]["messages"] for report in told) > 3
    assert told[-1]["chain"]["frames"] == ["map", "base", "camera"]
    assert told[-1]["chain"]["delay_ns"] >= S


AGO = 103 * 3600 * S


def written_at(name: str, ago: int, store: tfdb.Buffer, over: threading.Event) -> threading.Thread:
    """Start a thread that writes a frame with stamps `ago` before the clock, until `over`."""

    def write() -> None:
        while not over.is_set():
            store.set_transform("map", name, time.time_ns() - ago, (1, 2, 3), TURN, authority=name)
            over.wait(0.001)

    writer = threading.Thread(target=write)
    writer.start()
    return writer


@pytest.mark.parametrize("ago", [AGO, -AGO, 20 * 60 * S])
def test_monitor_shows_no_delay_of_a_replayed_store(tool: Tool, name: str, ago: int) -> None:
    store, over = tfdb.Buffer.open(name, history=None), threading.Event()
    writer = written_at("base", ago, store, over)
    try:
        arguments = ("monitor", f"shm:{name}", "map", "base", "--for", "0.3")
        said = tool(*arguments).out
        told = lines(tool(*arguments, "--json").out)[-1]
    finally:
        over.set()
        writer.join()
    away = {AGO: "103 h behind", -AGO: "102 h 59 min ahead of"}.get(ago, "20 min behind")
    assert f"no delay: the stamps of base are {away} their arrival" in said
    assert "replayed, or of another clock" in said
    assert "net delay none, longest none" in said
    assert said.count(" h ") + said.count(" min ") <= 2  # only in the line about the offset
    for body in (told["frames"][0], told["authorities"][0], told["chain"]):
        assert body["delay_ns"] is body["longest_delay_ns"] is None
        assert abs(body["clock_offset_ns"] - ago) < 10 * S


def test_monitor_shows_a_long_delay_beside_a_timely_frame() -> None:
    store = tfdb.Buffer(history=None)
    watch = Watch(store, None, began=0)
    now = 10**6 * S
    for child, ago in (("fast", S), ("slow", 100 * S), ("replayed", AGO)):
        store.set_transform("map", child, now - ago, (1, 2, 3), TURN)
    follower = LiveJudge(Live(store, lambda: now), watch.judge, rates=watch.rates, judges=False)
    follower.take(stretches_of_changes(store.changes(0)))
    found = {name: delays for name, _, delays in watch.rates.of_frames()}
    assert (found["fast"].mean, found["slow"].mean) == (S, 100 * S)
    assert (found["replayed"].mean, found["replayed"].nearest) == (None, AGO)


def test_echo_of_a_replayed_store_has_no_age(tool: Tool, name: str) -> None:
    store = tfdb.Buffer.open(name, history=None)
    store.set_transform("map", "base", time.time_ns() - AGO, (1, 2, 3), TURN)
    asked = ("echo", f"shm:{name}", "map", "base", "--limit", "1")
    said = tool(*asked).out
    assert "- Age: none, because the stamp is 103 h behind the clock (replayed, of " in said
    (told,) = lines(tool(*asked, "--json").out)
    assert told["age_ns"] >= AGO
    store.set_transform("map", "base", time.time_ns() - S, (1, 2, 3), TURN)
    assert "- Age: 1" in tool(*asked).out


def on_a_terminal(*arguments: str, columns: int = 80) -> bytes:
    """Run a command in a terminal of `columns`, check its exit code, and return its output."""
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
    process = subprocess.Popen([sys.executable, "-m", "tfdb.cli", *arguments], stdout=theirs)
    os.close(theirs)
    said = b""
    with suppress(OSError):  # the terminal was closed
        while part := os.read(ours, 65536):
            said += part
    os.close(ours)
    assert process.wait() == 0
    return said


def test_monitor_stays_in_place_on_a_terminal(name: str) -> None:
    tfdb.Buffer.open(name).set_static_transform("map", "base", (1, 2, 3), TURN)
    said = on_a_terminal("monitor", f"shm:{name}", "--every", "0.1", "--for", "0.3")
    upwards, hidden, shown = b"\x1b[1A", b"\x1b[?25l", b"\x1b[?25h"
    assert upwards in said
    assert said.count(b"map") >= 3
    assert said.rindex(shown) > said.rindex(hidden)


def test_monitor_breaks_no_name_on_a_terminal(name: str) -> None:
    """Twenty columns are too few for the table: it continues below, as in a pipe."""
    long = "warehouse_7/robot_042/base_footprint"
    tfdb.Buffer.open(name).set_static_transform("map", long, (1, 2, 3), TURN)
    arguments = ("monitor", f"shm:{name}", "--every", "0.1", "--for", "0.3")
    said = on_a_terminal(*arguments, columns=20)
    assert said.count(long.encode()) >= 3


def test_monitor_shows_the_worst_frames_first_and_no_more_than_fit(
    tool: Tool, name: str, tmp_path: Path
) -> None:
    store = tfdb.Buffer.open(name)
    old, new = time.time_ns() - 60 * S, time.time_ns()
    for number in range(40):
        stamp = old if number == 39 else new
        store.set_transform("map", f"frame_{number:02}", stamp, (0, 0, 0), TURN)
    file = tmp_path / "e.toml"
    file.write_text(
        'version = 1\n[default]\nlifespan = 30\n[[edge]]\nparent = "map"\nchild = "none"\n'
        '[[edge]]\nparent = "map"\nchild = "frame_0*"\nauthority = "it"\n'
    )
    asked = ("monitor", f"shm:{name}", "--expect", str(file), "--for", "1.2", "--every", "1.2")
    over = threading.Event()

    def write() -> None:
        while not over.wait(0.05):
            store.set_transforms(
                [
                    tfdb.TransformStamped("map", f"frame_{i:02}", time.time_ns(), (0, 0, 0), TURN)
                    for i in range(39)
                ],
                authority="other",
            )
            again = tfdb.TransformStamped("map", "frame_39", old, (0, 0, 0), TURN)
            store.set_transforms([again])

    writer = threading.Thread(target=write)
    writer.start()
    try:
        body = lines(tool(*asked, "--json").out)[-1]
        shown = tool(*asked).out.splitlines()
        said = on_a_terminal(*asked).decode()
    finally:
        over.set()
        writer.join()
    kinds = [event["kind"] for event in body["events"]]
    assert kinds == ["lifespan", "missing", *["foreign-authority"] * 10]
    assert shown[1] == "map -> none: error: missing 1 s (limit 1 s)"
    assert re.search(r"frame_39 +stale: lifespan", shown[4])
    assert re.search(r"frame_00 +error: foreign-authority", shown[5])
    assert sum("frame_" in line for line in shown) == 40
    assert "frame_39" in said
    assert "28 more frames" in said
    assert "frame_38" not in said


def test_monitor_begins_anew_where_time_jumps_back() -> None:
    store, stamp = tfdb.Buffer(history=None), 0
    watch = Watch(store, None, began=0)
    live = Live(store, lambda: stamp * S + 10)
    follower = LiveJudge(live, watch.judge, rates=watch.rates, judges=False)
    for stamp in (100, 101, 5, 7):
        if stamp == 5:
            store.clear()
        since = store.commit - (stamp == 5)
        store.set_transform("map", "base", stamp * S, (1, 2, 3), TURN)
        follower.take(stretches_of_changes(store.changes(since)))
    ((_, _, delays),) = watch.rates.of_frames()
    assert (delays.count, delays.gap, delays.longest) == (4, 2 * S, 10)


def test_an_error_is_printed_once(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    store = tfdb.Buffer.open(name)
    printer = Printer("", 3, as_json=False)
    for commit in range(3):
        store.set_transform("map", "base", commit * S, (1, 2, 3), TURN)
        printer.show(Question("map", "arm", LATEST, None, None).ask(store, 0), commit)
    printer.show(Question("map", "base", LATEST, 9 * S, None).ask(store, 0), 3)
    assert len(capsys.readouterr().err.splitlines()) == 2


def test_monitor_refuses_wrong_arguments(tool: Tool, bag: Path, tmp_path: Path) -> None:
    assert "give both" in tool("monitor", bag, "map", code=2).error
    assert "--every" in tool("monitor", bag, "--every", "0", code=2).error
    frozen = tmp_path / "x.tfdb"
    tool("freeze", bag, "-o", frozen)
    assert "which has no arrival times" in tool("monitor", frozen, code=2).error
    assert "frame 'nowhere' does not exist" in tool("monitor", bag, "map", "nowhere", code=2).error


NAMES = ('odd "name"', "back\\slash", "a->b; x", "<b>html</b>", "\u00e9t\u00e9")


def test_frames_are_drawn(tool: Tool, name: str, tmp_path: Path) -> None:
    store = tfdb.Buffer.open(name)
    for number, child in enumerate(NAMES):
        store.set_transform("map", child, time.time_ns() + number, (1, 2, 3), TURN, authority="a:1")
    store.set_static_transform(NAMES[0], "camera", (1, 2, 3), TURN)
    dot = tool("view-frames", f"shm:{name}", "-o", "-").out
    assert r'"map" -> "odd \"name\""' in dot
    assert r'"back\\slash"' in dot
    assert " old" in dot
    for suffix, begins in (("svg", b"<?xml"), ("pdf", b"%PDF"), ("dot", b"digraph")):
        path = tmp_path / f"frames.{suffix}"
        told = tool("view-frames", f"shm:{name}", "-o", path, "--json").json
        assert told["outputs"] == [str(path)]
        assert path.read_bytes().startswith(begins)
    drawn = (tmp_path / "frames.svg").read_text(encoding="utf-8")
    for text in ("odd &quot;name&quot;", "&lt;b&gt;html", "\u00e9t\u00e9"):
        assert text in drawn
    assert "exists already" in tool("view-frames", f"shm:{name}", "-o", path, code=2).error


def test_pictures_without_graphviz(
    tool: Tool, bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("matplotlib")
    monkeypatch.setenv("PATH", str(tmp_path))
    assert "85 frames" in tool("view-frames", bag, "-o", tmp_path / "frames").out
    assert (tmp_path / "frames.pdf").read_bytes().startswith(b"%PDF")
    assert "label=" in (tmp_path / "frames.gv").read_text(encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    tool("view-frames", bag)
    assert len(list(tmp_path.glob("frames_*_*.pdf"))) == 1
