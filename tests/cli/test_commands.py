"""Each command on the shipped recording, with text and JSON output."""

from __future__ import annotations

import json
import math
import re
from typing import TYPE_CHECKING

import numpy as np
import pytest

import tfdb

if TYPE_CHECKING:
    from pathlib import Path

    from conftest import Tool

EDGE_KEYS = {
    "frame": str,
    "parent": str,
    "static": bool,
    "samples": int,
    "rate_hz": float | None,
    "oldest_ns": int | None,
    "newest_ns": int | None,
    "longest_gap_ns": int | None,
    "gaps": int,
    "late": int,
    "authority": str,
}


def check_keys(body: dict[str, object], keys: dict[str, object]) -> None:
    assert set(body) == set(keys)
    for key, kind in keys.items():
        assert isinstance(body[key], kind), f"{key} is {body[key]!r}"


def test_version(tool: Tool) -> None:
    assert tool("--version").out == f"tfdb {tfdb.__version__}\n"
    assert tool.installed("--version").out == f"tfdb {tfdb.__version__}\n"


def test_help_names_every_command(tool: Tool) -> None:
    shown = tool("--help").out
    names = "info tree lookup echo monitor view view-frames plot compare poses check expect watch"
    names += " gaps shm record play publish mirror net serve bridge"
    names += " static-publisher change-notifier buffer-server freeze convert merge rename"
    names += " bench verify completion"
    assert re.findall(r"^  ([a-z][\w-]*)  ", shown, re.MULTILINE) == names.split()
    groups = {
        "shm": ("ls", "info", "reset-clock", "compact", "rm"),
        "net": ("top",),
        "bridge": ("ros1", "ros2"),
        "serve": ("follow", "ros1", "ros2"),
    }
    for name in names.split():
        for part in groups.get(name, ("",)):
            assert "--json" in tool(*filter(None, (name, part)), "--help").out


def test_info(tool: Tool, bag: Path) -> None:
    shown = tool("info", bag).out
    assert "85 frames, 32 moving and 52 static edges" in shown
    assert re.search(r"base_footprint +odom +50 Hz +440", shown)
    assert "/robot_state_publisher" in shown


def test_info_json(tool: Tool, bag: Path) -> None:
    body = tool("info", bag, "--json").json
    expected = {
        "tfdb": int,
        "command": str,
        "files": list,
        "topics": list,
        "messages": int,
        "transforms": int,
        "refused": int,
        "refused_transforms": int,
        "mixed": type(None),
        "frames": int,
        "roots": list,
        "start_ns": int,
        "end_ns": int,
        "edges": list,
    }
    check_keys(body, expected)
    assert body["frames"] == 85
    assert body["roots"] == ["map"]
    assert {topic["name"] for topic in body["topics"]} == {"/tf", "/tf_static"}
    assert sum(topic["messages"] for topic in body["topics"]) == body["messages"] == 750
    for edge in body["edges"]:
        check_keys(edge, EDGE_KEYS)
    moving = [edge for edge in body["edges"] if not edge["static"]]
    assert len(moving) == 32
    assert sum(edge["samples"] for edge in body["edges"]) <= body["transforms"]


def test_bag_and_mcap_are_the_same_run(tool: Tool, bag: Path, mcap: Path) -> None:
    one, other = tool("info", bag, "--json").json, tool("info", mcap, "--json").json
    for body in (one, other):
        for edge in body["edges"]:
            del edge["authority"]
    assert one["edges"] == other["edges"]


def test_tree(tool: Tool, bag: Path) -> None:
    shown = tool("tree", bag).out.splitlines()
    assert shown[0] == "map"
    assert re.match(r"└── odom +10 Hz +/localization", shown[1])
    assert len(shown) == 85


def test_tree_json(tool: Tool, bag: Path) -> None:
    body = tool("tree", bag, "--json").json
    check_keys(
        body,
        {
            "tfdb": int,
            "command": str,
            "files": list,
            "time_ns": type(None),
            "roots": list,
            "frames": list,
        },
    )
    root, *others = body["frames"]
    assert root == {"frame": "map", "parent": None, "depth": 0}
    seen = {"map": 0}
    for frame in others:
        check_keys(frame, {**EDGE_KEYS, "depth": int})
        assert frame["depth"] == seen[frame["parent"]] + 1
        seen[frame["frame"]] = frame["depth"]
    assert len(seen) == 85


def test_tree_at_a_time(tool: Tool, bag: Path) -> None:
    body = tool("tree", bag, "--at", "+1", "--json").json
    start = tool("info", bag, "--json").json["start_ns"]
    assert body["time_ns"] == start + 10**9


def test_lookup(tool: Tool, bag: Path) -> None:
    shown = tool("lookup", bag, "map", "base_link", "+2.5").out
    assert shown.startswith("T[map<-base_link]\n")
    assert "2.500000000 from the start" in shown
    assert re.search(r"^base_footprint +odom +(interpolated|exact) ", shown, re.MULTILINE)
    assert "interpolated" in shown
    assert "limited by odom" in shown


def test_lookup_json_equals_the_library(tool: Tool, bag: Path) -> None:
    body = tool("lookup", bag, "map", "base_link", "+2.5", "--json").json
    check_keys(
        body,
        {
            "tfdb": int,
            "command": str,
            "files": list,
            "target": str,
            "source": str,
            "asked": str,
            "stamp_ns": int,
            "translation": list,
            "rotation_xyzw": list,
            "rpy_deg": list,
            "matrix": list,
            "edges": list,
            "limiting": str,
        },
    )
    found = tfdb.load(bag).lookup_transform("map", "base_link", body["stamp_ns"])
    assert body["translation"] == found.translation.tolist()
    assert body["rotation_xyzw"] == found.rotation.tolist()
    assert body["matrix"] == found.matrix.tolist()
    x, y, z, w = found.rotation
    assert math.radians(body["rpy_deg"][2]) == pytest.approx(
        math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    )
    for edge in body["edges"]:
        check_keys(
            edge,
            {
                "child": str,
                "parent": str,
                "used": str,
                "inverted": bool,
                "before_ns": int | None,
                "after_ns": int | None,
                "gap_ns": int | None,
                "age_ns": int | None,
            },
        )
        if edge["used"] == "interpolated":
            assert edge["before_ns"] < body["stamp_ns"] < edge["after_ns"]
            assert edge["gap_ns"] == edge["after_ns"] - edge["before_ns"]


def test_lookup_takes_every_kind_of_time(tool: Tool, bag: Path) -> None:
    relative = tool("lookup", bag, "map", "base_link", "+2.5", "--json").json
    ns = relative["stamp_ns"]
    seconds = f"{ns // 10**9}.{ns % 10**9:09d}"
    for text in (f"{ns}ns", seconds):
        body = tool("lookup", bag, "map", "base_link", text, "--json").json
        assert body["stamp_ns"] == ns
        assert body["translation"] == relative["translation"]
    latest = tool("lookup", bag, "map", "base_link", "--json").json
    assert latest["asked"] == "latest"
    store = tfdb.load(bag)
    assert latest["stamp_ns"] == store.latest_common_time("map", "base_link")


@pytest.mark.parametrize(
    ("policy", "used"),
    [
        ("interpolate", "interpolated"),
        ("interpolate:0.2", "interpolated"),
        ("previous", "held"),
        ("nearest", "nearest"),
    ],
)
def test_lookup_policies(tool: Tool, bag: Path, policy: str, used: str) -> None:
    body = tool("lookup", bag, "map", "odom", "+2.5", "--policy", policy, "--json").json
    assert body["edges"][0]["used"] == used


def test_policy_that_refuses(tool: Tool, bag: Path) -> None:
    said = tool("lookup", bag, "map", "odom", "+2.5", "--policy", "interpolate:0.01", code=2).error
    assert "odom" in said
    said = tool("lookup", bag, "map", "odom", "+2.5", "--policy", "exact", code=2).error
    assert "valid from" in said


def test_extrapolation_by_name(tool: Tool, bag: Path) -> None:
    end = tool("info", bag, "--json").json["end_ns"]
    wanted = (bag, "odom", "base_link", f"{end + 20_000_000}ns")
    assert "valid from" in tool("lookup", *wanted, code=2).error
    body = tool("lookup", *wanted, "--policy", "extrapolate:0.1", "--json").json
    assert "extrapolated" in {edge["used"] for edge in body["edges"]}


def test_poses_at_a_rate(tool: Tool, mcap: Path, tmp_path: Path) -> None:
    out = tmp_path / "base.tum"
    said = tool("poses", mcap, "map", "base_link", "--rate", "100", "-o", out).out
    assert re.search(r"base\.tum: \d+ poses of base_link in map over 8\.\d+ s", said)
    path = tfdb.load(mcap).trajectory("map", "base_link", rate=100.0)
    rows = [line.split() for line in out.read_text().splitlines() if not line.startswith("#")]
    assert [int(row[0].replace(".", "")) for row in rows] == path.stamps.tolist()
    assert np.array_equal(np.array([row[1:] for row in rows], dtype=float), path.poses)


def test_poses_as_csv_and_npz(tool: Tool, mcap: Path, tmp_path: Path) -> None:
    stamps, poses = {}, {}
    for name in ("a.csv", "a.npz"):
        out = tmp_path / name
        body = tool("poses", mcap, "map", "base_link", "-o", out, "--json").json
        check_keys(
            body,
            {
                "tfdb": int,
                "command": str,
                "files": list,
                "target": str,
                "source": str,
                "output": str,
                "poses": int,
                "missing": int,
                "start_ns": int,
                "end_ns": int,
            },
        )
        if name.endswith("npz"):
            with np.load(out) as arrays:
                stamps[name], poses[name] = arrays["stamps"], arrays["poses"]
        else:
            table = [line.split(",") for line in out.read_text().splitlines()[1:]]
            stamps[name] = np.array([int(row[0]) for row in table])
            poses[name] = np.array([row[1:] for row in table], dtype=float)
        assert len(stamps[name]) == body["poses"]
        assert stamps[name][0] == body["start_ns"]
        assert stamps[name][-1] == body["end_ns"]
    assert np.array_equal(stamps["a.csv"], stamps["a.npz"])
    assert np.array_equal(poses["a.csv"], poses["a.npz"])


def test_poses_to_stdout(tool: Tool, mcap: Path) -> None:
    rows = tool("poses", mcap, "map", "base_link", "--rate", "1").out.splitlines()
    assert len(rows) == 9
    assert all(len(row.split()) == 8 for row in rows)


def test_poses_at_stamps(tool: Tool, mcap: Path, tmp_path: Path) -> None:
    path = tfdb.load(mcap).trajectory("map", "base_link", rate=10.0)
    wanted = path.stamps[[5, 3, 60]].tolist()
    listed = "\n".join(f"{stamp // 10**9}.{stamp % 10**9:09d}" for stamp in wanted)
    file = tmp_path / "stamps.txt"
    file.write_text(listed)
    by_file = tool("poses", mcap, "map", "base_link", "--at", file).out
    by_stdin = tool("poses", mcap, "map", "base_link", "--at", "-", stdin=listed).out
    assert by_file == by_stdin
    rows = np.array([line.split()[1:] for line in by_file.splitlines()], dtype=float)
    assert np.allclose(rows, path.poses[[5, 3, 60]], atol=1e-12)


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("a.tum", ()),
        ("a.csv", ()),
        ("a.npz", ()),
        ("a.parquet", ()),
        ("a.txt", ("--format", "kitti")),
        ("a.txt", ("--format", "euroc")),
    ],
)
def test_poses_at_unsorted_stamps_are_not_written(
    tool: Tool, bag: Path, tmp_path: Path, name: str, options: tuple[str, ...]
) -> None:
    file, out = tmp_path / "stamps", tmp_path / name
    file.write_text("1795240383.5\n1795240385.25\n1795240382\n")
    arguments = ("poses", bag, "map", "base_link", "--at", file)
    said = tool(*arguments, "-o", out, *options, code=2).error
    assert said == (
        f"{file}: stamp 1795240382 s follows 1795240385.25 s, but the stamps of {out} must "
        "increase: sort the stamps"
    )
    assert list(tmp_path.iterdir()) == [file]
    body = tool(*arguments, "--json").json
    assert body["start_ns"] == 1795240382 * 10**9
    assert body["end_ns"] == 1795240385_250000000


def test_poses_at_repeated_stamps(tool: Tool, bag: Path, tmp_path: Path) -> None:
    file = tmp_path / "stamps"
    file.write_text("1795240383.5\n1795240383.5\n")
    arguments = ("poses", bag, "map", "base_link", "--at", file, "-o")
    assert "2 poses" in tool(*arguments, tmp_path / "a.tum").out
    assert "give each stamp once" in tool(*arguments, tmp_path / "a.npz", code=2).error


def test_stamps_of_a_file_that_is_not_text(tool: Tool, mcap: Path, tmp_path: Path) -> None:
    file = tmp_path / "stamps.npz"
    np.savez_compressed(file, stamps=np.arange(9))
    said = tool("poses", mcap, "map", "base_link", "--at", file, code=2).error
    assert said == (
        f"{file}, line 1: this is not UTF-8 text; write one stamp per line in seconds, or in "
        "nanoseconds with 'ns'"
    )


def test_poses_between_two_times(tool: Tool, mcap: Path) -> None:
    options = ("--rate", "10", "--start", "+2", "--end", "+3")
    rows = tool("poses", mcap, "map", "base_link", *options).out.splitlines()
    assert len(rows) in (10, 11)


def test_poses_out_of_range(tool: Tool, mcap: Path, tmp_path: Path) -> None:
    file = tmp_path / "stamps.txt"
    inside = tool("lookup", mcap, "map", "base_link", "+2", "--json").json["stamp_ns"]
    file.write_text(f"1.0\n{inside}ns\n")
    said = tool("poses", mcap, "map", "base_link", "--at", file, code=2).error
    assert "valid from" in said
    assert "--skip-missing" in said
    out = tmp_path / "some.csv"
    options = ("--at", file, "--skip-missing", "-o", out, "--json")
    body = tool("poses", mcap, "map", "base_link", *options).json
    assert (body["poses"], body["missing"]) == (1, 1)


def test_completion(tool: Tool) -> None:
    for shell in ("bash", "zsh", "fish"):
        assert "_TFDB_COMPLETE" in tool("completion", shell).out
        body = tool("completion", shell, "--json").json
        check_keys(body, {"tfdb": int, "command": str, "shell": str, "script": str, "save": str})


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("tfdb ch", ["plain,check", "plain,change-notifier"]),
        ("tfdb info --to", ["plain,--topic"]),
        ("tfdb info pr2.b", ["file,pr2.b"]),
        ("tfdb lookup pr2.bag map base_l", ["plain,base_laser_link", "plain,base_link"]),
        ("tfdb lookup none.bag map base_l", []),
        ("tfdb check --ignore sta", ["plain,static-and-moving", "plain,static-revised"]),
    ],
)
def test_completion_completes(
    tool: Tool, bag: Path, monkeypatch: pytest.MonkeyPatch, line: str, offered: list[str]
) -> None:
    monkeypatch.chdir(bag.parent)
    monkeypatch.setenv("_TFDB_COMPLETE", "bash_complete")
    monkeypatch.setenv("COMP_WORDS", line)
    monkeypatch.setenv("COMP_CWORD", str(len(line.split()) - 1))
    assert tool.installed().out.split() == offered


def test_the_installed_program_has_the_same_exit_codes(tool: Tool, bag: Path) -> None:
    done = tool.installed("tree", bag, "--json")
    assert done.code == 0
    assert done.err == ""
    assert json.loads(done.out)["roots"] == ["map"]
    done = tool.installed("lookup", bag, "map", "nowhere")
    assert "nowhere" in done.error
    assert done.out == ""


def test_output_into_a_closed_pipe_is_not_an_error(tool: Tool, bag: Path) -> None:
    import subprocess
    import sys

    command = f"{sys.executable} -m tfdb.cli poses '{bag}' map base_link --rate 2000 | head -1"
    done = subprocess.run(command, shell=True, capture_output=True, text=True, check=True)
    assert len(done.stdout.splitlines()) == 1
    assert done.stderr == ""


def test_parts_of_a_group_print_their_whole_name(
    tool: Tool, bag: Path, mcap: Path, name: str
) -> None:
    into = ("--into", name, "--json")
    for arguments in (
        ("serve", "follow", mcap, *into),
        ("shm", "ls", "--json"),
        ("shm", "info", name, "--json"),
        ("shm", "compact", name, "--json"),
        ("shm", "rm", name, "--json"),
    ):
        assert tool(*arguments).json["command"] == " ".join(map(str, arguments[:2]))
