"""`tfdb record`."""

from __future__ import annotations

import inspect
import os
import signal
import subprocess
import sys
import threading
from typing import TYPE_CHECKING

import click
import pytest
from tests.ros.commands import Command

import tfdb
from tfdb.cli.record import command
from tfdb.recorder.mcap_file import McapFile

if TYPE_CHECKING:
    from pathlib import Path

    from conftest import Tool

STILL = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def count_of(path: Path) -> int:
    """Count the samples of the frame base in the file."""
    try:
        loaded = tfdb.load(path, salvage=True)
    except tfdb.errors.RecordingError:  # no transform yet
        return 0
    return loaded.frame_info("base").samples if "base" in loaded.frames() else 0


def test_the_command_and_the_recorder_have_the_same_defaults() -> None:
    context = click.Context(command)
    for option, unit in (("queue", 1), ("flush", 1e9)):
        (given,) = (each for each in command.params if each.name == option)
        value = given.process_value(context, given.get_default(context))
        assert value == inspect.signature(tfdb.Recorder).parameters[option].default * unit


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 0), (signal.SIGTERM, 0), (signal.SIGKILL, -9)]
)
def test_a_signal_ends_it(
    tool: Tool, tmp_path: Path, name: str, number: signal.Signals, code: int
) -> None:
    path = tmp_path / "drive.mcap"
    part = tmp_path / "drive.mcap.part"
    with (
        tfdb.Buffer.open(name) as buf,
        Command("record", name, "-o", path, "--flush", "0.01") as command,
    ):
        assert "Ctrl-C ends it" in command.line()
        buf.set_static_transform("base", "camera", (0.2, 0, 1.1))
        for stamp in range(100):
            buf.set_transform("map", "base", stamp * 10**9, *STILL)
        while count_of(part) < 100:
            pass
        ended, said = command.end(number)
    assert ended == code
    if number == signal.SIGKILL:
        with pytest.raises(tfdb.errors.RecordingError, match="salvage"):
            tfdb.load(part)
        assert tool("info", part, "--salvage", "--json").json["frames"] == 3
        tool("convert", part, path, "--salvage")
    else:
        assert f"{path.name}: 101 commits" in said.replace("\n", "")
        assert not part.exists()
    body = tool("info", path, "--json").json
    assert body["frames"] == 3
    tool("check", path)
    assert tool("lookup", path, "map", "camera", "+1", "--json").json


def test_options(tool: Tool, tmp_path: Path, name: str) -> None:
    path = tmp_path / "drive.mcap"
    with tfdb.Buffer.open(name) as buf:
        buf.set_static_transform("base", "camera", (0.2, 0, 1.1))
        buf.set_transform("map", "base", 5, *STILL)
        options = ("--frame", "base", "--rename", "base:=robot", "--exclude", "cam*", "--sync")
        done = tool(
            "record", f"shm:{name}", "-o", path, "--for", "0.05", "--queue", "1MiB", *options,
            "--split-size", "1.5GB", "--split-time", "60", "--json",
        )  # fmt: skip
    first = tmp_path / "drive_0.mcap"
    assert done.json["files"] == [str(first)]
    assert done.json["source"] == name
    assert (done.json["commits"], done.json["lost"]) == (0, 0)
    assert done.json["bytes"] == first.stat().st_size
    assert tfdb.load(first).frames() == ["map", "robot"]


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("no-such-store", "-o", "a.mcap"), "tfdb shm ls"),
        (("STORE", "-o", "a.bag"), "must end in .mcap"),
        (("STORE", "-o", "taken.mcap"), "exists already"),
        (("STORE", "-o", "no/folder/a.mcap"), "no/folder"),
        (("taken.mcap", "-o", "a.mcap"), "taken.mcap is a file: give a live store or graph"),
        (("STORE",), "Missing option '-o'"),
        (("STORE", "-o", "a.mcap", "--queue", "many"), "write 1000000, 256MB or 1GiB"),
        (("STORE", "-o", "a.mcap", "--split-size", "0"), "write 1000000, 256MB or 1GiB"),
        (("STORE", "-o", "a.mcap", "--flush", "-1"), "write seconds"),
    ],
)
def test_bad_arguments(
    tool: Tool,
    tmp_path: Path,
    name: str,
    monkeypatch: pytest.MonkeyPatch,
    arguments: tuple[str, ...],
    text: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken.mcap").touch()
    with tfdb.Buffer.open(name):
        given = [name if each == "STORE" else each for each in arguments]
        assert text in tool("record", *given, "--for", "0.01", code=2).error
    assert list(tmp_path.iterdir()) == [tmp_path / "taken.mcap"]


def test_lost_commits_are_an_exit_code(
    tool: Tool, tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "drive.mcap"
    written = threading.Event()
    flush = McapFile.flush

    def wait(file: McapFile) -> None:
        assert written.wait(60)
        flush(file)

    monkeypatch.setattr(McapFile, "flush", wait)
    with tfdb.Buffer.open(name) as buf:

        def write() -> None:
            while not (tmp_path / "drive.mcap.part").exists():
                pass
            for stamp in range(500):  # several times more than one read returns
                names = (f"f{number}" for number in range(100))
                batch = [tfdb.TransformStamped("map", name, stamp, *STILL) for name in names]
                buf.set_transforms(batch)
            written.set()

        thread = threading.Thread(target=write)
        thread.start()
        options = ("--queue", "1kB", "--flush", "0", "--for", "3")
        done = tool("record", name, "-o", path, *options, code=1)
        thread.join()
    assert "were lost" in done.err
    with pytest.warns(tfdb.TfdbWarning, match="were lost when it was recorded"):
        assert "f0" in tfdb.load(path).frames()
    assert "were lost when it was recorded" in tool("info", path).err
    (found,) = (
        each
        for each in tool("check", path, "--json", code=1).json["findings"]
        if each["kind"] == "container"
    )
    assert "were lost when it was recorded" in found["message"]


def test_a_store_that_is_removed(tmp_path: Path, name: str) -> None:
    path = tmp_path / "drive.mcap"
    with tfdb.Buffer.open(name) as buf, Command("record", name, "-o", path) as command:
        command.line()
        buf.set_transform("map", "base", 5, *STILL)
        tfdb.Buffer.unlink(name)
        _, error = command.process.communicate(timeout=60)
        assert command.process.returncode == 2
    assert name in error
    assert tfdb.load(path).frames() == ["base", "map"]


FULL = r"""
import sys
import tfdb
from tfdb.recorder import mcap_file

buf = tfdb.Buffer(history=None)
path = sys.argv[1]
recorder = tfdb.Recorder(buf, path, flush=0)
stamp = flushed = 0
try:
    while True:
        for _ in range(100):
            stamp += 1
            where = stamp**0.5, stamp**0.3, 1 / stamp
            buf.set_transform("map", "base", stamp, where, (0, 0, 0, 1))
        flushed = recorder.flush()
except OSError as error:
    print(error)
try:
    recorder.close()
except OSError as error:
    assert error.filename == path + ".part", error
else:
    raise AssertionError("no error")
newest = tfdb.load(path + ".part", salvage=True).frame_info("base").newest
assert newest >= flushed > 0, (newest, flushed)
copy = tfdb.Buffer(history=None)
for each in tfdb.recorded_commits(path + ".part", salvage=True):
    copy.apply(each.data)
assert copy.frame_info("base").newest == newest
"""


@pytest.mark.parametrize("how", ["disk", "limit"])
def test_a_full_disk_keeps_flushed_commits(tmp_path: Path, how: str) -> None:
    folder = tmp_path / "disk"
    folder.mkdir()
    program = tmp_path / "program.py"
    limit = "import resource\nresource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))\n"
    mount = f"mount -t tmpfs -o size=160k none {folder}"
    user = [] if os.geteuid() == 0 else ["--user", "--map-root-user"]
    namespace = ["unshare", *user, "--mount", "sh", "-c"]
    if how == "disk" and subprocess.run([*namespace, mount], check=False).returncode:
        pytest.skip("this machine mounts nothing here")
    program.write_text((limit if how == "limit" else "") + FULL)
    run = f"{sys.executable} {program} {folder}/drive.mcap"
    command = [*namespace, f"{mount} && {run}"] if how == "disk" else ["sh", "-c", run]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "drive.mcap.part" in done.stdout
