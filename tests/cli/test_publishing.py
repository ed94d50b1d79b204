"""`static-publisher` and `change-notifier` on shared stores and recordings."""

from __future__ import annotations

import json
import math
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import tfdb
from tfdb.cli.angles import quaternion_of
from tfdb.cli.change_notifier import Pair, Told

if TYPE_CHECKING:
    from pathlib import Path

    from conftest import Tool

S = 1_000_000_000
ANGLES = (0.3, -0.2, 1.1)
TURN = tuple(quaternion_of(*ANGLES))


def test_quaternion_of_angles() -> None:
    assert np.allclose(tfdb.Transform("a", "b", (0, 0, 0), TURN).rpy, ANGLES)


def flags(**values: object) -> list[str]:
    return [part for key, value in values.items() for part in (f"--{key}", str(value))]


ENDS = ["map", "base"]
NAMED = ["--frame-id", "map", "--child-frame-id", "base"]
WAYS = [
    ["1", "-2", "3.5", *map(str, TURN), *ENDS],
    ["1", "-2", "3.5", *map(str, reversed(ANGLES)), *ENDS],
    [
        *flags(x=1, y=-2, z=3.5, qx=TURN[0], qy=TURN[1], qz=TURN[2], qw=TURN[3]),
        *NAMED,
    ],
    [*flags(x=1, y=-2, z=3.5, roll=ANGLES[0], pitch=ANGLES[1], yaw=ANGLES[2]), *NAMED],
]


@pytest.mark.parametrize("way", WAYS)
def test_every_form_of_arguments(tool: Tool, name: str, way: list[str]) -> None:
    assert "map -> base" in tool("static-publisher", f"shm:{name}", *way).out
    store = tfdb.Buffer.open(name, mode="r")
    found = store.lookup_transform("map", "base")
    assert found.report.timeless
    assert np.allclose(found.translation, (1, -2, 3.5))
    assert np.allclose(found.rotation, TURN)
    assert store.frame_info("base").authority == "tfdb static-publisher"


def test_defaults_are_those_of_ros_2(tool: Tool, name: str) -> None:
    tool("static-publisher", f"shm:{name}", "--x", "2", *NAMED)
    found = tfdb.Buffer.open(name, mode="r").lookup_transform("map", "base")
    assert found.translation.tolist() == [2, 0, 0]
    assert found.rotation.tolist() == [0, 0, 0, 1]


URDF = """<robot name="r"><link name="base"/><link name="arm"/><link name="wheel"/>
<joint name="a" type="fixed"><parent link="base"/><child link="arm"/>
<origin xyz="1 2 3" rpy="0.3 -0.2 1.1"/></joint>
<joint name="w" type="continuous"><parent link="base"/><child link="wheel"/></joint></robot>"""


def test_transforms_of_files(tool: Tool, bag: Path, name: str, tmp_path: Path) -> None:
    urdf, listed = tmp_path / "robot.urdf", tmp_path / "more.json"
    urdf.write_text(URDF)
    rpy = [math.degrees(angle) for angle in ANGLES]
    members = [
        {"parent": "arm", "child": "tool", "translation": [1, 2, 3], "rpy_deg": rpy},
        {"parent": "arm", "child": "eye", "rotation_xyzw": list(TURN)},
    ]
    listed.write_text(json.dumps(members))
    sources = ("--from", urdf, "--from", listed, "--from", bag)
    told = tool("static-publisher", f"shm:{name}", *sources, *WAYS[3], "--json").json
    store = tfdb.Buffer.open(name, mode="r")
    assert len(told["transforms"]) == len([i for i in store.tree() if i.is_static])
    for frames in (("base", "arm"), ("arm", "tool")):
        found = store.lookup_transform(*frames)
        assert np.allclose(found.translation, (1, 2, 3))
        assert np.allclose(found.rotation, TURN)
    assert np.allclose(store.lookup_transform("arm", "eye").rotation, TURN)
    assert store.lookup_transform("base_footprint", "base_link").report.timeless
    assert "wheel" not in store.frames()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["1", "2", "3"], "3 values"),
        (["1", "2", "x", "0", "0", "0", "1", *ENDS], "could not convert"),
        ([*WAYS[0], "--x", "1"], "not both"),
        (["--x", "1"], "--frame-id"),
        ([*NAMED, "--qx", "1", "--yaw", "1"], "exclude"),
        (["0", "0", "0", "0", "0", "0", "5", *ENDS], "5"),
        (["0", "0", "0", "0", "0", "0", "1", "map", "map"], "map"),
        (["nan", "0", "0", "0", "0", "0", "1", *ENDS], "not finite"),
        (["--bogus"], "1 values"),
        ([], "--frame-id"),
        (["--from", "nowhere.bag"], "nowhere.bag"),
    ],
)
def test_invalid_transforms_are_refused(
    tool: Tool, name: str, arguments: list[str], said: str
) -> None:
    assert said in tool("static-publisher", f"shm:{name}", *arguments, code=2).error
    with pytest.raises(tfdb.errors.NoSuchStore):
        tfdb.Buffer.open(name, create=False)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[", "no JSON"),
        ("[3]", "transform 1"),
        ('[{"parent": "a", "child": "b", "roll": 1}]', "transform 1"),
        ('{"parent": "a", "child": "b", "rpy_deg": [1]}', "3 numbers"),
        (
            '{"parent": "a", "child": "b", "rpy_deg": [1, 2, 3], "rotation_xyzw": [0, 0, 0, 1]}',
            "exclude",
        ),
        ('{"parent": 3, "child": "b"}', "must be strings"),
        ('{"parent": "a", "child": "b", "translation": [1, 2]}', "3 numbers"),
        ("[]", "no static transforms"),
    ],
)
def test_bad_files(tool: Tool, name: str, tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "bad.json"
    path.write_text(text)
    assert said in tool("static-publisher", f"shm:{name}", "--from", path, code=2).error


def test_neither_graph_nor_store(tool: Tool, bag: Path) -> None:
    assert "neither a graph" in tool("static-publisher", bag, *WAYS[0], code=2).error


def test_changes_in_a_recording(tool: Tool, bag: Path) -> None:
    limits = ("--distance", "0.2", "--angle", "0.5", "-r", "50")
    said = tool("change-notifier", bag, *limits, "--json").out
    told: list[dict[str, Any]] = [json.loads(line) for line in said.splitlines()]
    assert len(told) > 3
    assert (told[0]["moved_m"], told[0]["turned_rad"]) == (0, 0)
    for before, after in pairwise(told):
        moved = math.dist(before["translation"], after["translation"])
        cosine = abs(np.dot(before["rotation_xyzw"], after["rotation_xyzw"]))
        assert after["moved_m"] == pytest.approx(moved)
        assert after["turned_rad"] == pytest.approx(2 * math.acos(min(1, cosine)), abs=1e-6)
        assert after["moved_m"] > 0.2 or after["turned_rad"] > 0.5
        asked = tool("lookup", bag, "map", "base_link", f"{after['stamp_ns']}ns", "--json").json
        assert asked["translation"] == after["translation"]
    assert "T[odom<-map] is at [" in tool("change-notifier", bag, "--pair", "odom", "map").out
    assert "did you mean" in tool("change-notifier", bag, "--pair", "odm", "map", code=2).error


def test_small_motions_are_not_reported() -> None:
    store = tfdb.Buffer()
    pair, told = Pair("/map", "base"), Told("", 0.5, 0.1, as_json=True)
    assert told.look(store, pair, None) is None
    turns = [0.0, 0.0, 0.0, 0.05, 0.11, 0.11]
    for number, (x, yaw) in enumerate(zip([1, 1.4, 1.6, 1.6, 1.6, 1.6], turns, strict=True)):
        store.set_transform("map", "base", number * S, (x, 2, 3), quaternion_of(0.3, 0, yaw))
        moved = told.look(store, pair, None)
        assert (moved is not None) == (number in {0, 2, 4})
    assert pair.last is not None
    assert pair.last.stamp == 4 * S
