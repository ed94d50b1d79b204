"""The tree as text in tf2's formats, and names that break tf2's."""

from __future__ import annotations

import itertools
import re
from typing import Any

import pytest

from tf2 import real_tf2
from tf2.ours import Ours, Records, message
from tfdb import tf2
from tfdb.tf2.differences import DIFFERENCES

SECOND = 1_000_000_000
TURNED = [1.0, 2.0, 3.0, 0.0, 0.6, 0.0, 0.8]
WRITES = [
    ["set", False, "a", "b", SECOND, TURNED, "me"],
    ["set", False, "b", "c", SECOND, TURNED, "you"],
    ["set", False, "b", "c", 3 * SECOND, TURNED, "they"],
    ["set", True, "a", "s", 5 * SECOND, TURNED, ""],
]


def blocks(text: str) -> set[str]:
    """The entries of a listing in YAML, whatever their order."""
    return set(re.split(r"\n(?=\S)", text))


def test_listings_are_those_of_tf2() -> None:
    script: list[list[Any]] = [["new", 10 * SECOND], ["yaml"], ["string"], ["dot"], *WRITES]
    script += [["yaml"], ["string"], ["dot"], ["dot", 10 * SECOND], ["clear"], ["string"]]
    ours = Ours("ros1", Records())
    answers = zip(script, [ours.answer(each) for each in script], real_tf2.run(script), strict=True)
    for operation, our, their in answers:
        if operation[0] == "yaml":
            assert blocks(our[1].rstrip()) == blocks(their[1].rstrip())
        elif operation[0] == "string":
            assert sorted(our[1].splitlines()) == sorted(their[1].splitlines())
        elif operation[0] == "dot":
            edges = [sorted(re.findall(r'".*" -> ".*', text)) for text in (our[1], their[1])]
            assert edges[0] == edges[1]


def test_of_ros2() -> None:
    core = tf2.BufferCore(flavor="ros2")
    assert core.all_frames_as_yaml() == "[]"
    for _, _, parent, child, stamp, pose, authority in WRITES[1:3]:
        core.set_transform(message(parent, child, stamp, pose), authority)
    assert core.all_frames_as_yaml() == (
        "c: \n  parent: 'b'\n  broadcaster: 'they'\n  rate: 1.000\n"
        "  most_recent_transform: 3.000000\n  oldest_transform: 1.000000\n  buffer_length: 2.000\n"
    )


def test_seconds_are_rounded_as_tf2_rounds_them() -> None:
    stamps = [312_500_000, 500_000, 1_500_000, 1_700_000_000_123_500_000]
    for stamp in stamps:
        script = [["new", 10 * SECOND], ["set", False, "a", "b", stamp, TURNED, "me"], ["yaml"]]
        ours = Ours("ros1", Records())
        answers = [ours.answer(each) for each in script]
        assert blocks(answers[-1][1].rstrip()) == blocks(real_tf2.run(script)[-1][1].rstrip())


def test_any_name_can_be_parsed() -> None:
    yaml = pytest.importorskip("ruamel.yaml").YAML(typ="safe")
    names = ["par'ent", 'say "hi"', "a: b", "#", "1", "yes", "- x", "back\\slash", "ünï"]
    core = tf2.BufferCore()
    for parent, child in itertools.pairwise(names):
        core.set_transform(message(parent, child, SECOND, TURNED), "it's")
    found = yaml.load(core.all_frames_as_yaml())
    assert {child: each["parent"] for child, each in found.items()} == dict(
        zip(names[1:], names, strict=False)
    )
    assert all(each["broadcaster"] == "it's" for each in found.values())
    assert r'"say \"hi\"" -> "a: b"' in core._allFramesAsDot()
    assert "listings" in DIFFERENCES


def test_a_long_name_can_be_parsed() -> None:
    yaml = pytest.importorskip("ruamel.yaml").YAML(typ="safe")
    core = tf2.BufferCore()
    names = ["a" * 1024, "'" * 1024, "\x80" * 512, "root"]
    for name in names[:-1]:
        core.set_transform(message("root", name, SECOND, TURNED), "me")
    found = yaml.load(core.all_frames_as_yaml())
    assert {child: each["parent"] for child, each in found.items()} == dict.fromkeys(
        names[:-1], "root"
    )


ODD = ["\x80", "\x85", "\x9f", "\u2028", "\u2029", "\ufeff", "\ufffe", "\uffff"]


@pytest.mark.parametrize("odd", [*ODD, "\x00", "\n", "\r", "\x1b", "\x7f"], ids=ascii)
def test_any_character_can_be_parsed(odd: str) -> None:
    yaml = pytest.importorskip("ruamel.yaml").YAML(typ="safe")
    core = tf2.BufferCore()
    name = f'say "a{odd}b" \\' if odd in ODD else "plain"
    authority = f"it's \\ \"{odd}"
    for parent, child in (("root", name), (name, "leaf")):
        core.set_transform(message(parent, child, SECOND, TURNED), authority)
    found = yaml.load(core.all_frames_as_yaml())
    assert {child: each["parent"] for child, each in found.items()} == {name: "root", "leaf": name}
    assert {each["broadcaster"] for each in found.values()} == {authority}
    dot = core._allFramesAsDot(2 * SECOND)
    assert odd == "\n" or odd not in dot
    code = f"x{ord(odd):02x}" if ord(odd) < 0x100 else f"u{ord(odd):04x}"
    assert rf"\\ \"\\{code}" in dot


def test_every_root_has_the_legend() -> None:
    core = tf2.BufferCore()
    core.set_transform(message("a", "b", SECOND, TURNED), "me")
    core.set_transform(message("q", "r", SECOND, TURNED), "me")
    dot = core._allFramesAsDot(2 * SECOND)
    assert re.findall(r'"Recorded at time: 2.000"->"(\w)"', dot) == ["a", "q"]
    assert "( 1.000 sec old)" in dot
