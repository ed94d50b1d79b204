"""Commands keep the readable transforms of a message with undecodable ones."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import pytest
from tests.stored import samples_of
from tests.test_unreadable_members import (
    ENCODINGS,
    NAMELESS,
    Member,
    S,
    encode,
    messages,
    naive,
    recording,
)

import tfdb

if TYPE_CHECKING:
    from pathlib import Path

    from conftest import Tool

UNREADABLE = [
    Member(b"map", b"gear", 5, S, error="InvalidStamp"),
    Member(b"map", b"c\0am", 5, error="InvalidName"),
]


@pytest.mark.parametrize("suffix", [".mcap", ".bag"])
@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("command", ["convert", "rename", "prefix", "merge"])
def test_commands_that_write_keep_the_good_members(
    tool: Tool, tmp_path: Path, command: str, encoding: str, suffix: str
) -> None:
    rows = [*messages(3, unsigned=True), UNREADABLE]
    path, out = recording(tmp_path / "a", encoding, rows), tmp_path / f"out{suffix}"
    if command == "convert":
        done = tool("convert", path, out, "--json")
    elif command == "rename":
        done = tool("rename", path, "--rename", "map:=world", "-o", out, "--json")
    elif command == "prefix":
        done = tool("rename", path, "--prefix", "q/", "-o", out, "--json")
    else:
        other = recording(tmp_path / "b", encoding, [[Member(b"robot", b"tool", 5), *UNREADABLE]])
        done = tool("merge", path, other, "-o", out, "--json")
    names = {"rename": {"map": "world"}, "merge": {}, "convert": {}, "prefix": {}}[command]
    prefix = "q/" if command == "prefix" else ""
    unreadable = [
        each
        for members in rows
        for each in members
        if each.error == "InvalidStamp" or b"\0" in each.parent + each.child
    ]
    whole = sum(all(each in unreadable for each in members) for members in rows if members)
    lost = [each for members in rows if members for each in members if each in unreadable]
    alone = [m for members in rows if all(e in unreadable for e in members) for m in members]
    more = 2 if command == "merge" else 0
    assert done.json["skipped"] == whole >= 1
    assert done.json["refused_transforms"] == len(lost) - len(alone) + more
    every = sum(map(len, rows)) + (3 if command == "merge" else 0)
    assert done.json["transforms"] == every - len(lost) - more
    assert "of frame 'gear'" in done.err
    assert "a second or more" in done.err

    def renamed(name: str) -> str:
        return prefix + names.get(name, name)

    store = tfdb.Buffer(history=None)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tfdb.TfdbWarning)
        store.load(out)
    kept = samples_of(store)
    assert ("tool" in kept) == (command == "merge")
    for name in ("robot", "tool"):
        kept.pop(name, None)
    assert kept == {
        renamed(name): (stamps, poses, [renamed(each) for each in parents])
        for name, (stamps, poses, parents) in samples_of(naive(rows)).items()
    }


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_a_prefix_leaves_empty_names_empty(tool: Tool, tmp_path: Path, encoding: str) -> None:
    rows = [[Member(b"map", b"base", 5), *NAMELESS], NAMELESS]
    path, out = recording(tmp_path / "a", encoding, rows), tmp_path / "out.mcap"
    done = tool("rename", path, "--prefix", "q/", "-o", out)
    assert "11 transforms in 2 messages" in " ".join(done.out.split())
    # A store refuses the unnamed frame, as in the renamed recording.
    with pytest.warns(tfdb.TfdbWarning, match="refused with Invalid(Name|Transform)"):
        assert tfdb.load(out).frames() == ["q/base", "q/map"]


def test_following_a_file_keeps_the_good_members(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    store = tfdb.Buffer(history=None)
    with tfdb.recordings.RecordingWriter(path) as writer:
        for n in range(3):
            row = [Member(b"map", b"base", 5 + n), *UNREADABLE]
            writer.write(encode(row, "cdr"), n, topic="/tf")
    with pytest.warns(tfdb.TfdbWarning, match="3 transforms of frame '(gear|c.*am)' were refused"):
        report = tfdb.recordings.follow_recording(store, path)
    assert (report.transforms, report.refused, report.refused_transforms) == (3, 0, 6)
