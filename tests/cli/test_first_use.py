"""The first steps of a user on the command line."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from typing import TYPE_CHECKING, Any

import click
import numpy as np
import pytest

import tfdb
from tfdb.cli import common, convert
from tfdb.recordings.rewriter import Rewriter
from tfdb_measure import machine
from tfdb_measure.results import Results

if TYPE_CHECKING:
    from pathlib import Path

    from conftest import Tool

START = tfdb.stamp("1700000000.25")


# -- help, errors ----------------------------------------------------------------------------------


def test_the_bare_command_shows_the_help(tool: Tool) -> None:
    assert tool().out == tool("--help").out
    done = tool.installed()
    assert (done.code, done.err) == (0, "")
    assert "\n  lookup " in done.out


@pytest.mark.parametrize(
    ("arguments", "command", "kind"),
    [
        (("lookup", "--json"), "lookup", "InvalidArgument"),
        (("frobnicate", "--json"), None, "InvalidArgument"),
        (("--json",), None, "InvalidArgument"),
        (("info", "--frobnicate", "--json", "x"), "info", "InvalidArgument"),
        (("lookup", "BAG", "map", "odom", "noon", "--json"), "lookup", "InvalidArgument"),
        (("poses", "BAG", "map", "odom", "-o", "-", "--json"), "poses", "InvalidArgument"),
        (("lookup", "BAG", "map", "nowhere", "--json"), "lookup", "UnknownFrame"),
        (("lookup", "BAG", "map", "odom", "5", "--json"), "lookup", "Extrapolation"),
        (("poses", "BAG", "map", "odom", "--start", "5", "--rate", "1", "-o", "OUT", "--json"),
         "poses", "Extrapolation"),
        (("info", "none.bag", "--json"), "info", "FileNotFoundError"),
        (("check", "TEXT", "--json"), "check", "RecordingError"),
        (("poses", "BAG", "map", "odom", "--at", "TEXT", "-o", "OUT", "--json"),
         "poses", "InvalidStamp"),
    ],
)  # fmt: skip
def test_errors_are_json_where_json_is_asked_for(
    tool: Tool, bag: Path, tmp_path: Path, arguments: tuple[str, ...], command: Any, kind: str
) -> None:
    text = tmp_path / "text"
    text.write_text("no stamp\n")
    files = {"BAG": str(bag), "TEXT": str(text), "OUT": str(tmp_path / "out.csv")}
    done = tool(*(files.get(argument, argument) for argument in arguments), code=2)
    body = done.json
    assert (body["command"], body["error"]["type"]) == (command, kind)
    assert body["error"]["message"] == done.error
    assert hasattr(tfdb.errors, kind) or kind == "FileNotFoundError"


def test_missing_folders_are_named(tool: Tool, mcap: Path, tmp_path: Path) -> None:
    folder = tmp_path / "results" / "today"
    for name in ("a.tum", "a.csv", "a.npz"):
        said = tool("poses", mcap, "map", "odom", "-o", folder / name, code=2).error
        assert said.startswith(f"{tmp_path / 'results'}: the folder is missing")
    for name in ("a.mcap", "a.bag", "a.db3"):
        said = tool("convert", mcap, folder / name, code=2).error
        assert said.startswith(f"{tmp_path / 'results'}: the folder is missing")
    said = tool("info", folder / "drive.mcap", code=2).error
    assert said.startswith(f"{folder / 'drive.mcap'}: missing folder {tmp_path / 'results'}")
    said = tool("poses", mcap, "map", "odom", "-o", mcap / "a.tum", code=2).error
    assert said.startswith(f"{mcap}: is not a folder")


# -- times -----------------------------------------------------------------------------------------


def test_minus_half_a_second_counts_from_the_end(tool: Tool, bag: Path) -> None:
    end = tool("info", bag, "--json").json["end_ns"]
    for arguments in (("-0.5",), ("--json", "-0.5"), ("--", "-.5"), ("-500000000ns", "--json")):
        shown = tool("lookup", bag, "map", "base_link", *arguments).out
        if "--json" in arguments:
            assert json.loads(shown)["stamp_ns"] == end - 500_000_000
        else:
            assert f"{end - 500_000_000}"[-9:] in shown
    rows = tool("poses", bag, "map", "base_link", "--start", "-0.5", "--rate", "2").out
    assert rows.startswith(f"{(end - 500_000_000) // 10**9}.")
    body = tool("tree", bag, "--at", "-0.5", "--json").json
    assert body["time_ns"] == end - 500_000_000


def test_a_dash_is_still_an_option(tool: Tool, bag: Path) -> None:
    for given in (("--frob",), ("-x",), ("-0.5", "--frob")):
        assert "No such option" in tool("lookup", bag, "map", "odom", *given, code=2).error
    assert "No such option" in tool("lookup", "--frob", bag, "map", "odom", code=2).error
    assert "before time 0" in tool("lookup", bag, "map", "odom", "-2300000000", code=2).error


def test_static_transforms_have_no_time(tool: Tool, bag: Path) -> None:
    shown = tool("lookup", bag, "base_link", "base_laser_link").out
    assert "holds at all times" in shown
    assert "0.000000000" not in shown
    assert tool("lookup", bag, "base_link", "base_laser_link", "--json").json["stamp_ns"] == 0


@pytest.mark.parametrize("arguments", ["info BAG", "info BAG --json"])
def test_an_output_that_takes_no_more_is_one_line(bag: Path, arguments: str) -> None:
    command = [sys.executable, "-m", "tfdb.cli", *arguments.replace("BAG", str(bag)).split()]
    with open("/dev/full", "w") as full:  # noqa: PTH123
        done = subprocess.run(
            command, stdout=full, stderr=subprocess.PIPE, text=True, check=False, timeout=120
        )
    assert done.returncode == 2
    assert done.stderr.startswith("tfdb: error: ")
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("option", ["--seconds", "--skew", "--read-ratio"])
@pytest.mark.parametrize("number", ["nan", "inf"])
def test_a_benchmark_takes_finite_numbers(tool: Tool, option: str, number: str) -> None:
    assert "Invalid value" in tool("bench", option, number, code=2).error


# -- poses that are missing ------------------------------------------------------------------------


@pytest.mark.parametrize("rate", [(), ("--rate", "4")])
def test_missing_poses_are_left_out_on_request(
    tool: Tool, mcap: Path, tmp_path: Path, rate: tuple[str, ...]
) -> None:
    """One edge ends before the other: a gap limit leaves these poses out."""
    buffer = tfdb.Buffer(history=None)
    turn = (0.0, 0.0, np.sin(0.2), np.cos(0.2))
    for i in (*range(11), *range(31, 41)):
        buffer.set_transform("map", "base", START + i * 100_000_000, (0.1 * i, 1, -2), turn)
        buffer.set_transform("base", "arm", START + i * 100_000_000, (1, 0.1 * i, 0), turn)
    file = tmp_path / "gap.mcap"
    tfdb.recordings.write_recording(file, buffer)
    wanted = (file, "map", "arm", "--policy", "interpolate:0.15", *rate)
    span = ("--start", str(START // 10**9), "--end", f"{START + 6 * 10**9}ns") if rate else ()
    if rate:
        assert "--skip-missing" in tool("poses", *wanted, *span, code=2).error
    out = tmp_path / "poses.csv"
    body = tool("poses", *wanted, *span, "--skip-missing", "-o", out, "--json").json
    path = buffer.trajectory(
        "map",
        "arm",
        float(rate[1]) if rate else None,
        START // 10**9 * 10**9 if rate else None,
        START + 6 * 10**9 if rate else None,
        tfdb.Interpolate(max_gap=0.15),
        missing="nan",
    )
    found = np.isfinite(path.poses).all(axis=1)
    assert (body["poses"], body["missing"]) == (found.sum(), (~found).sum())
    assert found.any()
    assert found.all() == (not rate)
    rows = np.loadtxt(out, delimiter=",", skiprows=1)
    assert np.allclose(rows[:, 1:], path.poses[found], atol=1e-12)


# -- progress, pipes, signals ----------------------------------------------------------------------


def test_progress_ends_at_the_end(
    tool: Tool, bag: Path, mcap: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[tuple[int, int]] = []
    for source in (bag, mcap):
        seen.clear()
        tfdb.load(source, progress=lambda *step: seen.append(step))
        assert seen[-1][0] == seen[-1][1] > 0

    class Bar:
        def __enter__(self) -> Any:
            return lambda *step: seen.append(step)

        def __exit__(self, *_: object) -> None:
            pass

    seen.clear()
    monkeypatch.setattr(convert.common, "progress_bar", lambda what: Bar())
    tool("convert", bag, tmp_path / "a.mcap")
    assert seen[-1] == (750, 750)


@pytest.mark.parametrize(
    "arguments", ["info BAG", "check BAG", "check BAG --json", "poses BAG map odom", "--help"]
)
def test_a_closed_pipe_is_not_a_finding(bag: Path, arguments: str) -> None:
    """The command ends by SIGPIPE without a message, like `cat`."""
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-m", "tfdb.cli", *arguments.replace("BAG", str(bag)).split()]
    done = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, check=False, timeout=120)
    os.close(writer)
    assert (done.returncode, done.stderr) == (-signal.SIGPIPE, b"")


def test_a_bug_is_not_a_finding() -> None:
    program = "import tfdb_command; from tfdb.cli.app import cli; cli.main = None; "
    command = [sys.executable, "-c", program + "tfdb_command.main()"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 2
    assert "TypeError" in done.stderr


@pytest.mark.parametrize("during", ["inspect", "click", "json"])
def test_ctrl_c_at_start_prints_no_traceback(tmp_path: Path, during: str) -> None:
    """Ctrl-C is pressed while the program imports its modules."""
    (tmp_path / f"{during}.py").write_text(
        "import os, signal\nos.kill(os.getpid(), signal.SIGINT)\nraise SystemExit(3)\n"
    )
    program = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import tfdb_command; "
    done = subprocess.run(
        [sys.executable, "-c", program + "tfdb_command.main()"],
        capture_output=True,
        check=False,
        timeout=120,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    assert (done.returncode, done.stderr) == (-signal.SIGINT, b"")


# -- completion ------------------------------------------------------------------------------------


def test_completion_reads_only_the_beginning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Completion takes the same time for any length of the recording."""
    buffer = tfdb.Buffer(history=None)
    buffer.set_static_transform("base", "base_camera", (1, 2, 3))
    for i in range(2000):
        buffer.set_transform("map", f"base_{i}", START + i * 10**7, (0, 1, 2), (0, 0, 0, 1))
    decoded = 0
    decode = Rewriter.decoded

    def counted(*message: Any, **kind: Any) -> Any:
        nonlocal decoded
        decoded += 1
        return decode(*message, **kind)

    monkeypatch.setattr(Rewriter, "decoded", counted)
    for suffix in ("bag", "mcap"):
        file = tmp_path / f"long.{suffix}"
        tfdb.recordings.write_recording(file, buffer)
        decoded = 0
        context = click.Context(click.Command("lookup"))
        context.params["file"] = str(file)
        offered = common.complete_frames(context, click.Argument(["target"]), "base")
        assert offered == sorted(["base", "base_camera", *(f"base_{i}" for i in range(200))])
        assert decoded == 201


@pytest.mark.parametrize("command", ["lookup", "poses"])
def test_completion_imports_little(bag: Path, command: str) -> None:
    """Imports take most of the time of a completion."""
    code = """
import sys
from tfdb.cli.app import cli
try:
    cli.main(prog_name="tfdb", complete_var="_TFDB_COMPLETE")
except SystemExit:
    print(sorted({"numpy", "rich", "matplotlib", "rosbags"} & set(sys.modules)))
"""
    words = {"_TFDB_COMPLETE": "bash_complete", "COMP_CWORD": "3"}
    words["COMP_WORDS"] = f"tfdb {command} {bag} base_l"
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, **words},
        capture_output=True,
        text=True,
        check=True,
    )
    offered, imported = done.stdout.splitlines()[0], done.stdout.splitlines()[-1]
    assert offered.startswith("plain,base_l")
    assert imported == "[]"


# -- bench -----------------------------------------------------------------------------------------


def test_bench_warns_of_a_busy_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine.os, "cpu_count", lambda: 2)
    monkeypatch.setattr(machine.os, "getloadavg", lambda: (0.2, 9.0, 9.0))
    assert machine.busy() is None
    monkeypatch.setattr(machine.os, "getloadavg", lambda: (1.5, 0.0, 0.0))
    assert "1.5 programs" in str(machine.busy())


def test_bench_counts_points_with_one_round() -> None:
    results = Results()
    for label, rounds in (("1", 1), ("2", 3), ("4", 1)):
        for turn in range(rounds):
            results.add("threads", label, turn, "snapshot", {"reads_per_s": 1.0})
    assert results.single_rounds() == 2


# -- two clocks ------------------------------------------------------------------------------------


def test_two_clocks_are_one_finding(tool: Tool, tmp_path: Path) -> None:
    """An arm has simulated stamps, its base current ones: one finding, not one for each edge."""
    turn = (0.0, 0.0, np.sin(0.2), np.cos(0.2))
    buffer = tfdb.Buffer(history=None)
    for i in range(50):
        now = START + i * 20_000_000
        buffer.set_transform("map", "base", now, (0.1 * i, 1, -2), turn)
        buffer.set_transform("base", "joint_0", now - START, (0, 0.1, 0.02 * i), turn)
        for joint in range(1, 6):
            frames = (f"joint_{joint - 1}", f"joint_{joint}")
            buffer.set_transform(*frames, now - START, (0, 0.1, 0.02 * i), turn)
    file = tmp_path / "mixed.mcap"
    tfdb.recordings.write_recording(file, buffer)
    done = tool("check", file, "--json", code=1)
    (finding,) = done.json["findings"]
    assert done.err == ""
    assert (finding["kind"], finding["severity"]) == ("two-clocks", "error")
    assert finding["frames"] == ["base"]
    assert "joint_0, joint_1, joint_2 and 3 more from 0 s to 0.98 s" in finding["message"]
    assert f"base from {START // 10**9}.25 s" in finding["message"]
    assert "tfdb: warning: " in tool("info", file).err
    assert tool("check", file, "--ignore", "two-clocks").code == 0


def test_each_clock_is_judged_alone(tool: Tool, tmp_path: Path) -> None:
    buffer = tfdb.Buffer(history=None)
    for i in (*range(50), *range(150, 200)):
        buffer.set_transform("map", "base", START + i * 20_000_000, (i, 1, -2), (0, 0, 0, 1))
        buffer.set_transform("base", "arm", 5 + i * 20_000_000, (i, 0.1, 2), (0, 0, 0, 1))
    buffer.set_transform("map", "base", 7, (1, 1, -2), (0, 0, 0, 1))
    file = tmp_path / "mixed.mcap"
    tfdb.recordings.write_recording(file, buffer)
    found = tool("check", file, "--json", code=1).json["findings"]
    assert [(one["kind"], one["frames"]) for one in found if one["kind"] != "coverage"] == [
        ("two-clocks", ["base"]),
        ("gap", ["arm"]),
        ("gap", ["base"]),
    ]
    assert "base has stamps of both" in found[0]["message"]


def test_a_file_given_twice_is_refused(tool: Tool, bag: Path) -> None:
    assert "given twice" in tool("info", bag, bag, code=2).error
    body = tool("check", bag, bag, "--json", code=2).json
    assert body["error"]["type"] == "InvalidArgument"
