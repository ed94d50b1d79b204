"""`tfdb play`, controlled by lines and by keys."""

from __future__ import annotations

import json
import os
import pty
import subprocess
import sys
from contextlib import suppress
from typing import TYPE_CHECKING

import pytest

import tfdb

if TYPE_CHECKING:
    from pathlib import Path

    from tests.cli.conftest import Tool

LONGEST = 60.0  # seconds: the longest wait of a test


def test_lines_control_a_player(bag: Path, name: str) -> None:
    command = [sys.executable, "-m", "tfdb.cli", "play", str(bag), "--into", name, "--json"]
    with subprocess.Popen(
        [*command, "--paused", "--control"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as player:
        assert player.stdin is not None
        player.stdin.write("jump\nseek 2\nstep\nspeed 4\nskip 1\nquit\n")
        out, said = player.communicate(timeout=LONGEST)
    assert player.returncode == 0, said
    assert "'jump': not a control; the controls are pause, step, back" in said
    body = json.loads(out)
    assert body["rounds"] == 0
    assert body["newest_ns"] > 0
    assert tfdb.Buffer.open(name, mode="r").clock.is_system


def test_keys_control_a_player(bag: Path, name: str) -> None:
    """The command runs in a pseudo-terminal. Each key causes a commit, or ends the player."""
    terminal, theirs = pty.openpty()
    command = [sys.executable, "-m", "tfdb.cli", "play", str(bag), "--into", name, "--paused"]
    with subprocess.Popen(command, stdin=theirs, stdout=theirs, stderr=theirs) as player:
        try:
            os.close(theirs)
            store = opened(name, player)
            store.wait_for_commit(0, LONGEST)
            while not store.clock.paused:
                assert player.poll() is None
            for key in ("]", "\x1b[C", "\x1b[D", "["):
                commit = store.commit
                os.write(terminal, key.encode())
                store.wait_for_commit(commit, LONGEST)
            os.write(terminal, b"5")
            while store.clock.speed != 5.0:
                assert player.poll() is None
            os.write(terminal, b"q")
            said = b""
            with suppress(OSError):  # the other end is closed
                while chunk := os.read(terminal, 4096):
                    said += chunk
            assert player.wait(LONGEST) == 0
        finally:
            player.kill()
            os.close(terminal)
    assert b"space: pause" in said
    assert b"transforms in" in said


def opened(name: str, player: subprocess.Popen[bytes]) -> tfdb.Buffer:
    while True:
        try:
            return tfdb.Buffer.open(name, create=False)
        except tfdb.errors.NoSuchStore:
            assert player.poll() is None


def test_the_clock_of_a_killed_player_is_shown_and_reset(tool: Tool, bag: Path, name: str) -> None:
    command = [sys.executable, "-m", "tfdb.cli", "play", str(bag), "--into", name, "--speed", "0.5"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as player:
        store = opened(name, player)
        while store.clock.speed != 0.5:
            assert player.poll() is None
        player.kill()
    clock = tool("shm", "info", name, "--json").json["clock"]
    assert (clock["speed"], clock["paused"]) == (0.5, False)
    assert 0 <= clock["set_s_ago"] < LONGEST
    assert clock["now_ns"] <= store.clock.now()
    said = tool("shm", "info", f"shm:{name}").out
    assert "clock     speed 0.5, at " in said
    assert f"'tfdb shm reset-clock {name}'" in " ".join(said.split())
    store.clock.pause()
    assert "clock     paused at " in tool("shm", "info", name).out
    assert tool("shm", "reset-clock", f"shm:{name}", "--json").json["before"]["paused"]
    assert store.clock.is_system
    assert "clock     the system's" in tool("shm", "info", name).out
    assert tool("shm", "info", name, "--json").json["clock"] is None


@pytest.mark.parametrize("speed", ["0", "-1", "nan", "fast"])
def test_bad_speeds_are_refused(tool: Tool, bag: Path, name: str, speed: str) -> None:
    said = tool("play", bag, "--into", name, "--speed", speed, code=2).error
    assert "--speed" in said
    with pytest.raises(tfdb.errors.NoSuchStore):
        tfdb.Buffer.open(name, create=False)


def test_playing_without_waiting_cannot_begin_paused(tool: Tool, bag: Path, name: str) -> None:
    said = tool("play", bag, "--into", name, "--speed", "inf", "--paused", code=2).error
    assert "--paused needs a finite --speed: inf plays without pauses" in said


def test_a_store_with_frames_of_another_source_is_refused(tool: Tool, bag: Path, name: str) -> None:
    other = tfdb.Buffer()
    other.set_transform("map", "base", 1, (1, 0, 0))
    store = tfdb.Buffer.open(name)
    store.apply(other.snapshot().state_bytes(), source="robot1", prefix="r1/")
    said = tool("play", bag, "--into", name, "--speed", "inf", code=2).error
    assert "frames of source 'robot1': play into another store" in said
    assert store.frames() == ["r1/base", "r1/map"]
