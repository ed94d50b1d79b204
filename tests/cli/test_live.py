"""Commands on shared stores."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from tests.test_unreadable_members import Member, recording

import tfdb
from tfdb.cli.graph import Live
from tfdb.judging.doctor import examine
from tfdb.judging.follower import Follower, watch_arrivals
from tfdb.player.player import Player

if TYPE_CHECKING:
    from collections.abc import Iterator

    from conftest import Tool

TURN = (0.0, 0.6, 0.0, 0.8)


@pytest.fixture
def served(tool: Tool, bag: Path, name: str) -> str:
    """A shared store with the example recording."""
    done = tool("play", bag, "--into", name, "--speed", "inf", "--history", "1000")
    assert re.search(r"7,180 transforms in 750 messages, played in [\d.]+ m?s", done.out)
    assert f"into shm:{name}; Ctrl-C ends it" in done.out
    return f"shm:{name}"


def test_a_store_answers_as_its_recording(tool: Tool, bag: Path, served: str) -> None:
    tool.check_answers(served, bag)


def test_poses_of_a_store(tool: Tool, bag: Path, served: str, tmp_path: Path) -> None:
    arguments = ("map", "base_link", "--rate", "10")
    done = tool("poses", served, *arguments, "-o", tmp_path / "live.tum")
    assert "poses of base_link in map" in done.out


def test_options_of_files_are_refused(tool: Tool, bag: Path, served: str) -> None:
    assert "this command reads files only" in tool("convert", served, "x.bag", code=2).error
    assert "cannot be combined with other files" in tool("info", served, bag, code=2).error
    assert "--topic is valid for recordings" in tool("info", served, "--topic", "/tf", code=2).error
    assert "--salvage is valid for recordings" in tool("check", served, "--salvage", code=2).error
    assert "is valid for live stores" in tool("check", bag, "--for", "1", code=2).error
    assert (
        "frame 'maps' does not exist; did you mean 'map'"
        in tool("lookup", served, "maps", "x", code=2).error
    )


def test_no_such_store(tool: Tool, name: str) -> None:
    for command in (("info", f"shm:{name}"), ("shm", "info", name), ("shm", "rm", name)):
        failed = tool(*command, "--json", code=2)
        assert failed.json["command"] == " ".join(command[:-1])
        assert failed.json["error"]["type"] == "NoSuchStore"
        assert "tfdb shm ls" in failed.error
    assert "has a slash" in tool("tree", "shm:a/b", code=2).error


@contextmanager
def another_process_that_opens_twice(name: str) -> Iterator[None]:
    program = f"""
import sys, tfdb
stores = [tfdb.Buffer.open({name!r}, mode=mode) for mode in ("r", "rw")]
print("ready", flush=True)
sys.stdin.read()
"""
    command = [sys.executable, "-c", program]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        yield
        process.communicate()


def test_shm(tool: Tool, served: str) -> None:
    name = served.removeprefix("shm:")
    (listed,) = [s for s in tool("shm", "ls", "--json").json["stores"] if s["name"] == name]
    told = tool("shm", "info", served, "--json").json
    keys = ("path", "permissions", "user", "group", "commit", "frames", "samples", "history_s")
    keys += ("size_bytes", "memory_bytes", "used_bytes", "processes", "repairs", "clock")
    assert set(listed) == {"name", "error", *keys}
    assert set(told) == {"tfdb", "command", "name", "start_ns", "end_ns", *keys}
    assert listed["frames"] == told["frames"] == 85
    assert told["commit"] == 751  # the last commit makes the frames writable
    assert told["permissions"] == "0600"
    assert told["history_s"] == 1000
    assert told["processes"] == 0
    assert told["memory_bytes"] < 10 << 20
    opened = tfdb.Buffer.open(name, mode="r")
    assert tool("shm", "info", name, "--json").json["processes"] == 0
    with another_process_that_opens_twice(name):
        assert tool("shm", "info", name, "--json").json["processes"] == 1
        assert "processes 1 beside this one" in tool("shm", "info", name).out
        assert opened.shared is not None
        assert opened.shared.processes == 2
    assert opened.shared.processes == 1
    assert f"/dev/shm/tfdb.{name}, 0600" in tool("shm", "info", name).out
    assert name in tool("shm", "ls").out
    compacted = tool("shm", "compact", served, "--json").json
    assert compacted["done"]
    assert 0 < compacted["after_bytes"] <= compacted["before_bytes"]
    assert "MiB now" in tool("shm", "compact", name).out
    with tfdb.Buffer.open(name) as buffer, buffer.snapshot():
        buffer.set_transform("a", "b", 10**18, (1, 2, 3), (0, 0, 0, 1))
        assert "holds an older state" in tool("shm", "compact", name).out
    assert tool("shm", "rm", served).out == f"removed {name}\n"
    assert name not in tool("shm", "ls").out


def test_a_store_of_another_version_is_listed_and_removed(tool: Tool, name: str) -> None:
    path = Path(tfdb.Buffer.open(name).shared.path)
    with path.open("r+b") as file:
        file.seek(8 * 12)
        file.write(b"\1" * 8)
    (listed,) = [s for s in tool("shm", "ls", "--json").json["stores"] if s["name"] == name]
    assert "another version of tfdb" in listed["error"]
    assert "another version" in tool("shm", "ls").out
    other = f"{name}-other"
    assert tool("shm", "rm", name, other, code=2).error
    assert path.exists()
    assert tool("shm", "rm", name, "--json").json["removed"] == [name]


def test_a_recording_that_is_played_again_replaces_itself(
    tool: Tool, bag: Path, served: str
) -> None:
    store = tfdb.Buffer.open(served.removeprefix("shm:"), mode="r")
    before = store.samples("base_footprint")
    done = tool("play", bag, "--into", served, "--speed", "inf", "--json").json
    assert (done["refused"], done["rounds"], done["shift_ns"]) == (0, 1, 0)
    after = store.samples("base_footprint")
    assert all((old == new).all() for old, new in zip(before[:2], after[:2], strict=True))


def test_left_out_messages_take_no_time(
    tool: Tool, tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Moving transforms are recorded each second for a minute, static ones each half minute."""
    path = tmp_path / "a.mcap"
    with tfdb.recordings.RecordingWriter(path) as writer:
        for second in range(60):
            static = second % 30 == 0
            child = "cam" if static else "base"
            one = tfdb.TransformStamped(
                "map", child, second * 10**9, (second, 2, 3), (0, 0.6, 0, 0.8)
            )
            data = tfdb.encode_tf_message([one], writer.encoding)
            writer.write(
                data, second * 10**9, topic="/tf_static" if static else "/tf", static=static
            )
    times: list[int] = []  # the last set time, and the due times since

    def is_due(player: Player) -> bool:
        times.append(player._due)
        return True

    monkeypatch.setattr(Player, "_is_due", is_due)
    monkeypatch.setattr(Player, "_set_clock", lambda _, time: (times.clear(), times.append(time)))
    for options, seconds in (
        ((), 59),
        (("--start", "51"), 8),
        (("--end", "4"), 30),
        (("--end", "4", "--exclude", "cam"), 3),
        (("--start", "21", "--end", "25"), 9),
    ):
        tool("play", path, "--into", name, *options)
        assert times[-1] - times[0] == seconds * 10**9


def test_a_selection_that_leaves_nothing_is_not_served(tool: Tool, bag: Path, name: str) -> None:
    said = tool("play", bag, "--into", name, "--speed", "inf", "--exclude", "*", code=2)
    assert said.error == tool("info", bag, "--exclude", "*", code=2).error


def test_a_bad_member_costs_its_own(tool: Tool, name: str, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    good = tfdb.TransformStamped("map", "base", 5, (1, 2, 3), (0, 0.6, 0, 0.8))
    own = tfdb.TransformStamped("base", "base", 5, (1, 2, 3))
    names = tfdb.TransformStamped("map", "broken", 5, (1, 2, 3))
    data = tfdb.encode_tf_message([good, own, names]).replace(b"broken", b"br\xffken")
    with tfdb.recordings.RecordingWriter(path) as writer:
        writer.write(data, 1, topic="/tf")
        writer.write(tfdb.encode_tf_message([own]), 2, topic="/tf")
        writer.write(data[:40], 3, topic="/tf")
    done = tool("play", path, "--into", name, "--speed", "inf", "--json").json
    counts = {key: done[key] for key in ("messages", "transforms", "refused", "refused_transforms")}
    assert counts == {"messages": 3, "transforms": 1, "refused": 2, "refused_transforms": 3}
    with tfdb.Buffer.open(name, create=False) as store:
        assert (store.commit, store.frames()) == (2, ["base", "map"])
    said = tool("play", path, "--into", name, "--speed", "inf").out
    assert "3 transforms refused, nothing stored of 2 messages, the first: Inv" in said
    said = tool("info", path).out
    assert "3 transforms refused, nothing stored of 2 messages; 'tfdb check' lists" in said


def test_a_recording_is_served_without_unreadable_members(
    tool: Tool, tmp_path: Path, name: str
) -> None:
    bad = [Member(b"map", b"gear", 5, 10**9), Member(b"map", b"c\0am", 5)]
    path = recording(tmp_path / "a", "cdr", [[Member(b"map", b"base", 5), *bad], bad])
    done = tool("play", path, "--into", name, "--speed", "inf", "--json").json
    counts = {key: done[key] for key in ("messages", "transforms", "refused", "refused_transforms")}
    assert counts == {"messages": 2, "transforms": 1, "refused": 1, "refused_transforms": 4}
    with tfdb.Buffer.open(name, create=False) as store:
        assert (store.commit, store.frames()) == (2, ["base", "map"])


def test_broken_files_are_not_served(tool: Tool, bag: Path, name: str, tmp_path: Path) -> None:
    broken = tmp_path / "broken.bag"
    broken.write_bytes(bag.read_bytes()[:300_000])
    failed = tool("play", broken, "--into", name, "--speed", "inf", "--json", code=2)
    assert failed.json["error"]["type"] == "RecordingError"
    assert (
        "no topic '/odd'" in tool("play", bag, "--into", name, "--topic", "/odd:tf", code=2).error
    )
    assert "has a slash" in tool("play", bag, "--into", "a/b", code=2).error
    assert name not in tool("shm", "ls").out


def test_serve_and_watch(tool: Tool, bag: Path, name: str) -> None:
    """`play --loop` runs until Ctrl-C; the store stays."""
    command = [sys.executable, "-m", "tfdb.cli", "play", str(bag), "--into", name]
    with subprocess.Popen(
        [*command, "--loop", "--speed", "20", "--json"], stdout=subprocess.PIPE
    ) as server:
        try:
            while True:
                try:
                    store = tfdb.Buffer.open(name, create=False, mode="r")
                    break
                except tfdb.errors.NoSuchStore:
                    assert server.poll() is None
            while store.commit < 800:  # the second round
                assert server.poll() is None
            kinds = ("time-jump", "gap", "coverage", "late")  # a busy machine delays the server
            ignored = [word for kind in kinds for word in ("--ignore", kind)]
            watched = tool("check", f"shm:{name}", "--for", "0.3s", *ignored, "--json")
            assert watched.json["messages"] is None
            assert watched.json["transforms"] > 52
        finally:
            server.send_signal(signal.SIGINT)
            told, _ = server.communicate()
    assert server.returncode == 130
    assert b'"rounds": ' in told
    newest = store.tree()
    assert max(info.newest or 0 for info in newest) > 0
    assert tool("tree", f"shm:{name}").code == 0


def test_findings_of_a_watched_store(name: str) -> None:
    """Late samples are found from the commits, not from the state."""
    store = tfdb.Buffer.open(name, history=None)
    store.set_transform("map", "base", 5, (1, 2, 3), TURN)
    store.set_static_transform("base", "camera", (1, 2, 3), TURN)

    def write(_done: int, _total: int) -> None:
        newest = store.frame_info("base").newest or 0
        for stamp in (newest + 1, newest + 3, newest + 2):
            store.set_transform("map", "base", stamp, (stamp, 2, 3), TURN, authority="late")

    arrivals = watch_arrivals(Live(tfdb.Buffer.open(name, mode="r")), 0.1, write)
    assert arrivals.publishers_known
    assert arrivals.log.count == 1 + store.frame_info("base").samples - 1
    (found,) = examine(arrivals.log)
    assert (found.kind, found.frames, found.details) == ("late", ("base",), {"worst_ns": 1})
    assert found.count == (arrivals.log.count - 1) / 3


def test_a_late_follower_continues(name: str, tool: Tool, monkeypatch: pytest.MonkeyPatch) -> None:
    """If more commits occur than the feed holds, the number of missed ones is reported."""
    store = tfdb.Buffer.open(name)
    store.set_transform("map", "base", 1, (1, 2, 3), TURN)
    ahead = 20_000
    later = count(ahead + 2)

    def write(done: int, _total: int) -> None:
        stamps = range(2, ahead + 2) if done == 0 else [next(later)]
        for stamp in stamps:
            store.set_transform("map", "base", stamp, (1, 2, 3), TURN)

    reader = tfdb.Buffer.open(name, mode="r")
    arrivals = watch_arrivals(Live(reader), 2.0, write)
    assert arrivals.missed >= ahead
    assert 0 < arrivals.log.count == store.commit - arrivals.missed - 1

    monkeypatch.setattr("tfdb.judging.follower.watch_arrivals", lambda *_: arrivals)
    assert tool("check", f"shm:{name}", "--for", "1", "--json").json["missed_commits"] >= ahead
    assert "commits were missed" in tool("check", f"shm:{name}", "--for", "1").out


def test_a_follower_waits_again_after_it_was_lapped() -> None:
    store = tfdb.Buffer()
    follower = Follower(Live(store))
    for stamp in range(20_000):
        store.set_transform("map", "base", stamp, (1, 2, 3), TURN)
    assert follower.read(0.0) == []
    assert follower.missed == 20_000
    assert follower.read(0.0) == []
    store.set_transform("map", "base", 20_000, (1, 2, 3), TURN)
    (found,) = follower.read(0.0)
    assert found.rows.commits.tolist() == [20_001]


def test_findings_of_a_store(tool: Tool, name: str) -> None:
    store = tfdb.Buffer.open(name)
    for number in (0, 1, 2, 3, 4, 5, 6, 30, 31, 33, 32):
        store.set_transform("map", "base", 10**9 * number, (number, 1, 2), TURN)
    store.set_static_transform("other", "island", (1, 2, 3), TURN)
    found = tool("check", f"shm:{name}", "--json", code=1).json
    assert {f["kind"] for f in found["findings"]} == {"disconnected"}  # the history ends at 23 s
    store = tfdb.Buffer.open(f"{name}-all", history=None)
    try:
        for number in (0, 1, 2, 3, 4, 5, 6, 30, 31, 32):
            store.set_transform("map", "base", 10**9 * number, (number, 1, 2), TURN)
        found = tool("check", f"shm:{name}-all", "--json", code=1).json
        assert [f["kind"] for f in found["findings"]] == ["gap"]
    finally:
        tfdb.Buffer.unlink(f"{name}-all")


def test_frames_are_completed(served: str) -> None:
    from tfdb.cli.app import cli
    from tfdb.cli.common import complete_frames

    command = cli.get_command(None, "lookup")  # type: ignore[arg-type]
    with command.make_context("lookup", [served, "map", "base_link"]) as context:
        assert "base_link" in complete_frames(context, command.params[1], "base")
