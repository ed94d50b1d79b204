"""`tfdb publish` and `tfdb mirror` as processes, over loopback."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading
from typing import TYPE_CHECKING, Any

import pytest
from tests.net.conftest import LONGEST, free_endpoint, needs_zenoh
from tests.recorder.reading import state_of

import tfdb

if TYPE_CHECKING:
    from pathlib import Path

    from tests.cli.conftest import Tool

pytestmark = needs_zenoh


class Running:
    """A command that runs until it is stopped."""

    def __init__(self, *arguments: object) -> None:
        command = [sys.executable, "-m", "tfdb.cli", *map(str, arguments), "--json"]
        pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        self.process = subprocess.Popen(command, text=True, **pipes)

    def wait_for(self, event: str) -> None:
        """Read lines up to an event."""
        assert self.process.stdout is not None
        patience = threading.Timer(LONGEST, self.process.kill)
        patience.start()
        try:
            for line in self.process.stdout:
                if json.loads(line).get("event") == event:
                    return
        finally:
            patience.cancel()
        raise AssertionError(f"no {event!r}: {self.process.communicate()}")

    def stop(self, number: int = signal.SIGINT) -> tuple[int, dict[str, Any]]:
        """Stop the command; return its exit code and its last line."""
        self.process.send_signal(number)
        out, said = self.process.communicate(timeout=LONGEST)
        assert "Traceback" not in said
        lines = out.splitlines()
        return self.process.returncode, json.loads(lines[-1]) if lines else {"said": said}


def test_a_mirror_follows_a_published_store(names: tuple[str, str]) -> None:
    here, there = names
    endpoint = free_endpoint()
    with tfdb.Buffer.open(here, size=1 << 25) as store:
        store.set_transform("map", "base", 1, (1, 2, 3), (0, 0, 0, 1))
        home = Running("publish", f"shm:{here}", "--as", "robot1", "--listen", endpoint)
        mirror = Running(
            "mirror", "robot1", "--into", there, "--prefix", "r/", "--shared", "map",
            "--connect", endpoint,
        )  # fmt: skip
        mirror.wait_for("live")
        store.set_transform("map", "base", 2, (2, 2, 3), (0, 0, 0, 1))
        with tfdb.Buffer.open(there, create=False) as copy:
            copy.wait_for_transform("map", "r/base", 2, LONGEST)
            code, end = mirror.stop()
            assert (code, end["state"], end["commit"], end["commits"]) == (0, "live", 2, 1)
            assert copy.frames() == ["map", "r/base"]
        code, end = home.stop()
        assert (code, end["state"], end["commits"]) == (0, "publishing", 1)
        assert (end["command"], end["name"], end["source"]) == ("publish", "robot1", f"shm:{here}")


def test_a_file_is_published_and_its_mirror_loses_it(bag: Path, names: tuple[str, str]) -> None:
    _, there = names
    endpoint = free_endpoint()
    with tfdb.net.Session(listen=endpoint):
        home = Running("publish", bag, "--as", "robot1", "--connect", endpoint)
        mirror = Running(
            "mirror", "robot1", "--into", there, "--history", "1000", "--connect", endpoint
        )
        mirror.wait_for("live")
        with tfdb.Buffer.open(there, create=False) as copy:
            assert state_of(copy) == state_of(tfdb.load(bag))
        assert home.stop()[0] == 0
        mirror.wait_for("stale")
        assert mirror.stop(signal.SIGTERM)[0] == 1


def test_a_mirror_waits_for_a_router(names: tuple[str, str]) -> None:
    endpoint = free_endpoint()
    arguments = "mirror", "robot1", "--into", names[1], "--connect", endpoint
    mirror = Running(*arguments)
    mirror.wait_for("absent")
    with (
        tfdb.net.Session(listen=endpoint) as session,
        tfdb.net.publish(tfdb.Buffer(), "robot1", session=session),
    ):
        mirror.wait_for("live")
        assert mirror.stop()[0] == 0
    waiting = Running(*arguments)
    waiting.wait_for("absent")
    assert waiting.stop()[0] == 130


def test_the_end_of_a_home_is_printed_once(names: tuple[str, str]) -> None:
    endpoint = free_endpoint()
    with (
        tfdb.Buffer.open(names[0], size=1 << 25),
        tfdb.net.Session(listen=endpoint) as session,
    ):
        home = Running("publish", f"shm:{names[0]}", "--as", "robot1", "--connect", endpoint)
        with tfdb.net.mirror("robot1", into=tfdb.Buffer(), session=session) as mirror:
            mirror.wait_until_live(LONGEST)
        with tfdb.net.publish(tfdb.Buffer(), "robot1", session=session, take_over=True):
            home.wait_for("fenced")
            out, said = home.process.communicate(timeout=LONGEST)
    assert home.process.returncode == 1
    assert (len(out.splitlines()), said) == (1, "")


def test_stores_change_roles_by_commands(names: tuple[str, str], tmp_path: Path) -> None:
    here, there = names
    endpoint = free_endpoint()
    to = "--connect", endpoint
    with (
        tfdb.net.Session(listen=endpoint),
        tfdb.Buffer.open(here, size=1 << 25) as store,
        tfdb.Buffer.open(there, size=1 << 25) as spare,
    ):
        store.set_transform("map", "base", 1, (1, 2, 3), (0, 0, 0, 1))
        home = Running("publish", f"shm:{here}", "--as", "robot1", *to)
        mirror = Running("mirror", "robot1", "--into", there, *to)
        mirror.wait_for("live")
        assert mirror.stop()[0] == 0
        later = Running("publish", f"shm:{there}", "--as", "robot1", "--take-over", *to)
        home.wait_for("fenced")
        home.process.communicate(timeout=LONGEST)
        assert home.process.returncode == 1
        with pytest.raises(tfdb.errors.ReadOnly, match="comes from source 'robot1'"):
            store.set_transform("map", "base", 2, (1, 2, 3), (0, 0, 0, 1))
        spare.set_transform("map", "base", 2, (2, 2, 3), (0, 0, 0, 1))
        back = Running("mirror", "robot1", "--into", here, *to)
        store.wait_for_transform("map", "base", 2, LONGEST)
        assert state_of(store) == state_of(spare)
        assert back.stop()[0] == 0
        assert later.stop()[0] == 0


@pytest.mark.parametrize("command", ["publish", "net"])
def test_commands_wait_for_a_router_and_warn_once(bag: Path, command: str) -> None:
    endpoint = free_endpoint()
    arguments = {"publish": ("publish", bag, "--as", "robot1"), "net": ("net", "top")}[command]
    waiting = Running(*arguments, "--connect", endpoint)
    assert waiting.process.stderr is not None
    warning = f"tfdb: warning: no Zenoh router at {endpoint}: retrying every second\n"
    assert waiting.process.stderr.readline() == warning
    with (
        tfdb.net.Session(listen=endpoint) as session,
        tfdb.net.mirror("robot1", into=tfdb.Buffer(), session=session) as mirror,
    ):
        if command == "publish":
            mirror.wait_until_live(LONGEST)
        else:
            assert waiting.process.stdout is not None
            assert json.loads(waiting.process.stdout.readline())["command"] == "net top"
        waiting.process.send_signal(signal.SIGINT)
        _, said = waiting.process.communicate(timeout=LONGEST)
        assert (waiting.process.returncode, said) == (0, "")
    waiting = Running(*arguments, "--connect", endpoint)
    assert waiting.process.stderr is not None
    assert waiting.process.stderr.readline() == warning
    waiting.process.send_signal(signal.SIGINT)
    _, said = waiting.process.communicate(timeout=LONGEST)
    assert (waiting.process.returncode, said.strip()) == (130, "tfdb: stopped")


def test_net_top_shows_homes_and_mirrors(tool: Tool, names: tuple[str, str]) -> None:
    endpoint = free_endpoint()
    source = tfdb.Buffer()
    with (
        tfdb.net.Session(listen=endpoint) as session,
        tfdb.net.publish(source, "robot1", session=session) as home,
        tfdb.net.mirror("robot1", into=tfdb.Buffer(), session=session) as mirror,
    ):
        source.set_transform("map", "base", 1, (1, 2, 3), (0, 0, 0, 1))
        mirror.wait_until_live(LONGEST)
        top = Running("net", "top", "--connect", endpoint, "--period", "0.1")
        assert top.process.stdout is not None
        for line in top.process.stdout:
            look = json.loads(line)
            if [each["state"] for each in look["found"]] == ["publishing", "live"]:
                break
            assert top.process.poll() is None
        for line in top.process.stdout:
            first, second = json.loads(line)["found"]
            source.set_transform("map", "base", source.commit + 1, (1, 2, 3), (0, 0, 0, 1))
            if first["bytes_per_second"] and second["bytes_per_second"]:
                break
        assert (first["name"], first["role"], second["role"]) == ("robot1", "home", "mirror")
        assert first["epoch"] == {"number": home.epoch.number, "id": home.epoch.id.hex()}
        assert second["stats"]["gaps"] == mirror.stats.gaps
        code, _ = top.stop()
        assert code == 0
        text = tool("net", "top", "robot1", "--connect", endpoint, "--once").out
        assert "1 home, 1 mirror" in text
        assert "publishing" in text
        assert home.epoch.id.hex()[:8] in text
        text = tool("net", "top", "other", "--connect", endpoint, "--once").out
        assert "no home and no mirror answers" in text
    text = tool("net", "top", "a*", "--once", "--connect", endpoint, code=2).err
    assert "'a*' is not a valid namespace" in text
    assert "--period must be positive" in tool("net", "top", "--period", "0", code=2).err


def test_errors(tool: Tool, bag: Path, names: tuple[str, str]) -> None:
    endpoint = free_endpoint()
    text = tool("net", "top", "--once", "--connect", endpoint, code=2).err
    assert f"no Zenoh router at {endpoint}" in text
    for command in (
        ("publish", bag, "--as", "r"), ("mirror", "r", "--into", names[1]), ("net", "top"),
    ):  # fmt: skip
        text = tool(*command, "--connect", "tcp/127.0.0.1", code=2).err
        assert "got 'tcp/127.0.0.1': tcp/HOST:PORT is valid" in text
        text = tool(*command, "--connect", "tpc/127.0.0.1:7447", code=2).err
        assert "did you mean 'tcp'?" in text
    with pytest.raises(tfdb.errors.NoSuchStore):  # the mirror made no store
        tfdb.Buffer.open(names[1], create=False)
    text = tool("mirror", "r*", "--into", names[1], "--connect", endpoint, code=2).err
    assert "'r*' is not a valid namespace" in text
    text = tool("publish", bag, "--as", "r*", "--connect", endpoint, code=2).err
    assert "'r*' is not a valid namespace" in text
    text = tool("publish", "shm:nowhere", "--as", "r", "--listen", endpoint, code=2).err
    assert "no shared store 'nowhere'; `tfdb shm ls` lists the existing ones" in text
    text = tool("publish", "ros1:", "--as", "r", "--listen", endpoint, code=2).err
    assert "ros1: is a live graph: fill a shared store with 'tfdb serve', and publish that" in text
    for lost, said in ((bag, "--keep-lost"), (bag / "lost", "lost")):
        arguments = "publish", bag, "--as", "r", "--listen", endpoint, "--keep-lost", lost
        assert said in tool(*arguments, code=2).err
    assert "Missing option '--as'" in tool("publish", bag, code=2).err
