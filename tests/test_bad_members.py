"""A refused transform does not affect the others of its message, at every entry."""

from __future__ import annotations

import random
import struct
import warnings
from typing import TYPE_CHECKING, Any

import pytest

import tfdb
from oracle import quaternion
from tests.stored import samples_of
from tests.wire import oracle

if TYPE_CHECKING:
    from pathlib import Path

S = 1_000_000_000
TURN = quaternion((1, -2, 0.5), 0.9)
POSE = (1.25, -2.5, 3.75, *TURN)
ZERO = (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 0.0)
NAN = (float("nan"), 2.0, 3.0, *TURN)
ENGINES = ("snapshot", "giant", "silo")


class Robot:
    """Makes random messages, most with members of which one is bad."""

    CHAIN = ("map", "odom", "base", "arm", "hand")

    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)
        self.now = 100 * S

    def good(self) -> oracle.Row:
        at = self.random.randrange(1, len(self.CHAIN))
        stamp = self.now - self.random.randrange(0, 9) * S
        turn = quaternion([self.random.uniform(-1, 1) for _ in range(3)], self.random.uniform(0, 3))
        pose = (*(self.random.uniform(-9, 9) for _ in range(3)), *turn)
        return oracle.row(self.CHAIN[at - 1], self.CHAIN[at], stamp, pose)

    def bad(self) -> tuple[oracle.Row, str]:
        good = self.good()
        return self.random.choice(
            [
                (oracle.row(good.parent, good.child, good.stamp, ZERO), "InvalidTransform"),
                (oracle.row(good.parent, "new", good.stamp, NAN), "InvalidTransform"),
                (oracle.row(good.child, good.child, good.stamp, POSE), "InvalidTransform"),
                (oracle.row("map", "bell\x07", good.stamp, POSE), "InvalidName"),
                (oracle.row("", good.child, good.stamp, POSE), "InvalidName"),
                (oracle.row(good.parent, good.child, self.now - 60 * S, POSE), "TooOld"),
                (oracle.row("map", "camera", good.stamp, POSE), "StaticConflict"),
                (oracle.row("hand", "map", self.now, POSE), "CycleError"),
            ]
        )

    def message(self) -> list[tuple[oracle.Row, str]]:
        self.now += S
        members = [(self.good(), "") for _ in range(self.random.randrange(0, 6))]
        for _ in range(self.random.randrange(0, 4)):
            members.insert(self.random.randrange(0, len(members) + 1), self.bad())
        return members


def start(concurrency: Any = "snapshot") -> tfdb.Buffer:
    """The chain, a camera that stands, and a history of 30 s."""
    buffer = tfdb.Buffer(history=30.0, concurrency=concurrency)
    for parent, child in zip(Robot.CHAIN, Robot.CHAIN[1:], strict=False):
        for stamp in (90, 100):
            buffer.set_transform(parent, child, stamp * S, (1, 2, stamp), TURN)
    buffer.set_static_transform("map", "camera", (0.5, 0, 1), TURN)
    return buffer


@pytest.mark.parametrize("concurrency", ENGINES)
@pytest.mark.parametrize("seed", range(20))
def test_messages_equal_their_members_one_by_one(seed: int, concurrency: Any) -> None:
    robot = Robot(seed)
    whole, naive = start(concurrency), start()
    expected: dict[tuple[str, str], int] = {}
    for _ in range(40):
        members = robot.message()
        data = oracle.encode([row for row, _ in members], "cdr")
        before = whole.commit
        result = whole.ingest_many([data], encoding="cdr")
        wrong = []
        for row, error in members:
            try:
                naive.set_transform(row.parent, row.child, row.stamp, row.pose[:3], row.pose[3:])
            except tfdb.TfdbError as refused:
                wrong.append((row.child, type(refused).__name__))
                assert type(refused).__name__ == error
            else:
                assert error == ""
        assert result.transforms == len(members) - len(wrong)
        assert result.refused_transforms == len(wrong)
        assert result.refused == (bool(wrong) and len(wrong) == len(members))
        assert whole.commit == result.commit == before + (result.transforms > 0)
        assert result.commits == result.commit - before
        counts = {(each.edge, each.error): each.count for each in result.refused_edges}
        assert counts == {each: wrong.count(each) for each in wrong}
        assert {name: r.count for name, r in result.reasons.items()} == {
            error: [name for _, name in wrong].count(error) for _, error in wrong
        }
        for key, count in counts.items():
            expected[key] = expected.get(key, 0) + count
    assert samples_of(whole) == samples_of(naive)
    assert len(expected) > 5


def test_the_first_message_of_each_error_is_reported() -> None:
    buffer = start()
    rows = [oracle.row("base", "arm", 101 * S, POSE), oracle.row("map", "x", 101 * S, ZERO)]
    data = [oracle.encode(rows[:1], "cdr"), b"\1\2", oracle.encode(rows, "cdr")]
    result = buffer.ingest_many(data, encoding="cdr", authority=["/a", "/b", "/c"])
    assert (result.messages, result.refused, result.refused_transforms) == (3, 1, 1)
    assert {each.edge: (each.error, each.count) for each in result.refused_edges} == {
        "": ("CorruptMessage", 1),
        "x": ("InvalidTransform", 1),
    }
    assert result.reasons["InvalidTransform"].index == 2
    assert "from '/c'" in result.reasons["InvalidTransform"].first
    assert result.reasons["CorruptMessage"].index == 1


def test_members_that_exclude_each_other() -> None:
    """As in `set_transforms`: of a stamp the last counts, of a cycle the last member is refused."""
    buffer = tfdb.Buffer()
    other = (7.0, *POSE[1:])
    rows = [
        oracle.row("a", "b", S, POSE),
        oracle.row("c", "a", S, POSE),
        oracle.row("b", "c", S, POSE),  # closes a cycle
        oracle.row("a", "d", S, POSE),
        oracle.row("a", "d", S, other),
    ]
    data = oracle.encode(rows, "cdr")
    with pytest.warns(tfdb.TfdbWarning, match=r"^CycleError: T\[b<-c\]"):
        assert buffer.ingest(data) == 1
    assert buffer.frames() == ["a", "b", "c", "d"]
    assert buffer.frame_info("c").parent is None
    assert buffer.samples("d")[1].tolist() == [pytest.approx(other)]
    first = tfdb.Buffer()
    with pytest.warns(tfdb.TfdbWarning, match=r"CycleError: |RepeatedStamp: ") as warned:
        first.ingest(data, only_new=True)
    assert len(warned) == 2
    assert first.samples("d")[1].tolist() == [pytest.approx(POSE)]


def test_a_warning_names_each_edge_and_error_once() -> None:
    buffer = start()
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        for n in range(5):
            rows = [
                oracle.row("base", "arm", (101 + n) * S, POSE),
                oracle.row("map", "x", (101 + n) * S, ZERO),
                oracle.row("map", "y", (101 + n) * S, ZERO),
                oracle.row("map", "camera", (101 + n) * S, POSE),
            ]
            buffer.ingest(oracle.encode(rows, "cdr"), authority="/ekf")
    assert sorted(str(each.message).partition(" at ")[0] for each in warned) == [
        "InvalidTransform: T[map<-x]",
        "InvalidTransform: T[map<-y]",
        "StaticConflict: T[map<-camera] from '/ekf' is moving, but the stored edge of 'camera' "
        "is static: remove frame 'camera' first, or pass change_kind=True, which drops its stored "
        "samples; the rest of its message is stored",
    ]
    assert {each.category for each in warned} == {tfdb.TfdbWarning}
    assert warned[0].filename == __file__
    assert len(buffer.samples("arm")[0]) == 7


def test_a_message_of_bad_members_only_raises() -> None:
    buffer = start()
    before = samples_of(buffer), buffer.commit
    data = oracle.encode([oracle.row("map", "x", S, ZERO), oracle.row("y", "y", S, POSE)], "cdr")
    with pytest.raises(
        tfdb.errors.InvalidTransform, match="2 of 2 transforms were refused"
    ) as caught:
        buffer.ingest(data)
    assert [each.index for each in caught.value.refused or ()] == [0, 1]
    assert (samples_of(buffer), buffer.commit) == before
    with pytest.raises(tfdb.errors.CorruptMessage):
        buffer.ingest(data[:-9])


def recording(path: Path, rows: list[list[oracle.Row]], topic: str = "/tf") -> Path:
    encoding = "ros1" if path.suffix == ".bag" else "cdr"
    with tfdb.recordings.RecordingWriter(path) as writer:
        for n, each in enumerate(rows):
            writer.write(oracle.encode(each, encoding), 100 * S + n, topic=topic)
    return path


def drive() -> list[list[oracle.Row]]:
    """50 messages: two good edges and a camera without a rotation."""
    return [
        [
            oracle.row("odom", "base", (100 + n) * S, (n, *POSE[1:])),
            oracle.row("base", "cam", (100 + n) * S, ZERO),
            oracle.row("base", "lift", (100 + n) * S, POSE),
        ]
        for n in range(50)
    ]


@pytest.mark.parametrize("name", ["a.mcap", "a.bag"])
def test_a_load_keeps_the_good_members(tmp_path: Path, name: str) -> None:
    path = recording(tmp_path / name, drive())
    buffer = tfdb.Buffer(history=None)
    with pytest.warns(tfdb.TfdbWarning, match="50 transforms of frame 'cam' were ref") as warned:
        report = buffer.load(path)
    assert len(warned) == 1
    assert (report.messages, report.transforms, report.commits) == (50, 100, 50)
    assert (report.refused, report.refused_transforms) == (0, 50)
    assert report.reasons == {"InvalidTransform": 50}
    assert "squared norm of 0" in report.first_refusals["InvalidTransform"]
    (refused,) = report.refused_edges
    assert (refused.edge, refused.error, refused.count) == ("cam", "InvalidTransform", 50)
    assert len(buffer.samples("base")[0]) == len(buffer.samples("lift")[0]) == 50
    assert buffer.frames() == ["base", "lift", "odom"]
    assert ">cam</td><td>InvalidTransform</td><td>50</td>" in report._repr_html_()


def test_a_load_keeps_those_that_are_young_enough(tmp_path: Path) -> None:
    rows = drive()
    for n, each in enumerate(rows):
        each[1] = oracle.row("base", "slow", (100 + n - 40 * (n > 9)) * S, POSE)
    buffer = tfdb.Buffer(history=30.0)
    with pytest.warns(tfdb.TfdbWarning, match="samples are not kept"):
        report = buffer.load(recording(tmp_path / "a.mcap", rows))
    # 69 to 78 s are older than 109 - 30 s.
    assert report.reasons == {"TooOld": 9}
    assert report.transforms == 141
    assert len(buffer.samples("base")[0]) == 31


@pytest.mark.parametrize(
    ("edges", "text"),
    [
        (20, "12 transforms of 12 other edges were refused"),
        (9, "1 transform of 1 other edge was refused"),
    ],
)
def test_many_bad_edges_are_named_and_the_rest_counted(
    edges: int, text: str, tmp_path: Path
) -> None:
    rows = [[oracle.row("map", "base", S, POSE)]]
    rows[0] += [oracle.row("map", f"cam{n}", S, ZERO) for n in range(edges)]
    with pytest.warns(tfdb.TfdbWarning, match="1 transform of frame 'cam|other") as warned:
        report = tfdb.Buffer(history=None).load(recording(tmp_path / "a.mcap", rows))
    assert len(warned) == 9
    assert text in str(warned[-1].message)
    assert len(report.refused_edges) == edges


def test_an_empty_child_is_counted_as_a_transform(tmp_path: Path) -> None:
    rows = [[oracle.row("map", "base", S, POSE), oracle.row("map", "", S, POSE)]]
    with pytest.warns(tfdb.TfdbWarning, match="1 transform without a child frame was refused"):
        report = tfdb.Buffer(history=None).load(recording(tmp_path / "a.mcap", rows))
    (refused,) = report.refused_edges
    assert (refused.edge, refused.error, refused.count) == ("", "InvalidName", 1)
    assert not refused.is_message
    assert (report.refused, report.refused_transforms) == (0, 1)
    result = tfdb.Buffer().ingest_many([b"broken"], encoding="cdr")
    assert [each.is_message for each in result.refused_edges] == [True]


def with_name(data: bytes, name: bytes) -> bytes:
    """The message with another name, of the same length, in the place of 'broken'."""
    assert len(name) == 6
    return data.replace(b"broken", name)


def unreadable() -> bytes:
    """A message with one child whose name is not UTF-8."""
    rows = [
        oracle.row("map", "base", S, POSE),
        oracle.row("map", "broken", S, POSE),
        oracle.row("base", "arm", S, POSE),
    ]
    return with_name(oracle.encode(rows, "cdr"), b"br\xffken")


@pytest.mark.parametrize("prefix", ["", "r/"])
def test_an_undecodable_name_refuses_only_its_transform(tmp_path: Path, prefix: str) -> None:
    path = tmp_path / "a.mcap"
    with tfdb.recordings.RecordingWriter(path) as writer:
        writer.write(unreadable(), S, topic="/tf")
    buffer = tfdb.Buffer(history=None)
    text = f"1 transform of frame '{prefix}br.*' was ref.*InvalidName"
    with pytest.warns(tfdb.TfdbWarning, match=text):
        report = buffer.load(path, prefix=prefix)
    assert buffer.frames() == sorted(prefix + name for name in ("arm", "base", "map"))
    assert (report.transforms, report.refused, report.refused_transforms) == (2, 0, 1)
    assert report.reasons == {"InvalidName": 1}


def test_bytes_of_another_format_are_refused_whole(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    good = oracle.encode([oracle.row("map", "base", S, POSE)], "cdr")
    with tfdb.recordings.RecordingWriter(path) as writer:
        writer.write(good, 1, topic="/tf")
        writer.write(oracle.encode(drive()[0], "cdr")[:-40], 2, topic="/tf")
        writer.write(struct.pack("<4sI", b"\0\1\0\0", 3), 3, topic="/tf")
    with pytest.warns(tfdb.TfdbWarning, match="2 messages were refused with CorruptMessage"):
        report = tfdb.Buffer().load(path)
    assert (report.refused, report.refused_transforms, report.transforms) == (2, 0, 1)
    assert [each.edge for each in report.refused_edges] == [""]
