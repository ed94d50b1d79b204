"""An undecodable stamp or name affects only its transform, not its message."""

from __future__ import annotations

import itertools
import random
import re
import struct
import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import pytest

import tfdb
from oracle import quaternion
from tests.stored import samples_of

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

S = 1_000_000_000
TURN = quaternion((1, -2, 0.5), 0.9)
POSE = (1.25, -2.5, 3.75, *TURN)
ZERO = (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 0.0)
ENCODINGS = ("cdr", "ros1")
SUFFIX = {"cdr": ".mcap", "ros1": ".bag"}


@dataclass(frozen=True)
class Member:
    """One transform as its message has it, and the error that it is refused with; "": none."""

    parent: bytes
    child: bytes
    seconds: int
    nanoseconds: int = 7
    pose: tuple[float, ...] = POSE
    error: str = ""

    @property
    def edge(self) -> str:
        return self.child.decode("latin-1")


def encode(members: Sequence[Member], encoding: str) -> bytes:
    """The bytes of a message, whatever its members hold."""
    cdr = encoding == "cdr"
    data = b""

    def put(layout: str, size: int, *values: Any) -> None:
        nonlocal data
        data += b"\0" * (-len(data) % size if cdr else 0) + struct.pack("<" + layout, *values)

    put("I", 4, len(members))
    for n, each in enumerate(members):
        if not cdr:
            put("I", 4, n)
        put("II", 4, each.seconds & 0xFFFFFFFF, each.nanoseconds)
        for name in (each.parent, each.child):
            put("I", 4, len(name) + cdr)
            data += name + b"\0" * cdr
        put("7d", 8, *each.pose)
    return b"\0\1\0\0" * cdr + data


def bad_members(now: int, *, unsigned: bool = False) -> list[Member]:
    """Without negative seconds where they are unsigned: in ROS 1 they are the year 2106."""
    signed = [
        Member(b"map", b"base", -1, error="InvalidStamp"),
        Member(b"map", b"newer", -now, 999_999_999, error="InvalidStamp"),
        Member(b"m\0ap", b"dome", -5, error="InvalidStamp"),
    ]
    return [
        *([] if unsigned else signed),
        Member(b"odom", b"gear", now, S, error="InvalidStamp"),
        Member(b"odom", b"cam", now, 2**32 - 1, error="InvalidStamp"),
        Member(b"odom", b"late", -1, S + 5, error="InvalidStamp"),
        Member(b"map", b"c\0am", now, error="InvalidName"),
        Member(b"m\0ap", b"cam", now, error="InvalidName"),
        Member(b"map", b"cam", now, pose=ZERO, error="InvalidTransform"),
        Member(b"cam", b"cam", now, error="InvalidTransform"),
        Member(b"map", b"bell\x07", now, error="InvalidName"),
    ]


def messages(seed: int, *, unsigned: bool = False) -> list[list[Member]]:
    """Random messages: good members of a chain, and bad ones in between."""
    chain = (b"map", b"odom", b"base", b"arm")
    chance = random.Random(seed)
    made = []
    for now in range(100, 130):
        members = []
        for parent, child in itertools.pairwise(chain):
            pose = (chance.uniform(-9, 9), *POSE[1:])
            members += [Member(parent, child, now, chance.randrange(S), pose)] * chance.choice(
                (0, 1, 1)
            )
        for _ in range(chance.randrange(4)):
            place = chance.randrange(len(members) + 1)
            members.insert(place, chance.choice(bad_members(now, unsigned=unsigned)))
        made.append(members)
    return made


def recording(path: Path, encoding: str, rows: list[list[Member]], *, static: bool = False) -> Path:
    path = path.with_suffix(SUFFIX[encoding])
    with tfdb.recordings.RecordingWriter(path) as writer:
        for n, members in enumerate(rows):
            topic = "/tf_static" if static else "/tf"
            writer.write(encode(members, encoding), 200 * S + n, topic=topic, authority="/ekf")
    return path


def naive(rows: list[list[Member]], *, static: bool = False) -> tfdb.Buffer:
    """A store of the good members, one commit for each message."""
    store = tfdb.Buffer(history=None)
    for members in rows:
        good = [
            tfdb.TransformStamped(
                each.parent.decode(),
                each.child.decode(),
                each.seconds * S + each.nanoseconds,
                each.pose[:3],
                each.pose[3:],
            )
            for each in members
            if not each.error
        ]
        if good:
            store.set_transforms(good, static=static, authority="/ekf")
    return store


def counts(refused: Sequence[tfdb.types.RefusedEdge]) -> dict[tuple[str, str], int]:
    return {(each.edge, each.error): each.count for each in refused}


def expected(rows: list[list[Member]]) -> dict[tuple[str, str], int]:
    wrong = [(each.edge, each.error) for members in rows for each in members if each.error]
    return {key: wrong.count(key) for key in wrong}


@pytest.mark.parametrize("static", [False, True])
@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("seed", range(8))
def test_both_ways_of_a_load_keep_the_good_members(
    tmp_path: Path, seed: int, encoding: str, static: bool
) -> None:
    """The native way, and with an option that takes each message apart."""
    rows = messages(seed, unsigned=static and encoding == "ros1")
    path = recording(tmp_path / "a", encoding, rows, static=static)
    oracle = naive(rows, static=static)
    found = []
    for options in ({}, {"start": 0}):
        buffer = tfdb.Buffer(history=None)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", tfdb.TfdbWarning)
            report = buffer.load(path, **options)
        assert samples_of(buffer) == samples_of(oracle)
        assert buffer.commit == oracle.commit
        assert counts(report.refused_edges) == expected(rows)
        assert report.refused_transforms == sum(expected(rows).values())
        assert report.refused == sum(all(each.error for each in m) for m in rows if m)
        # Which message of an edge is the first may differ, and with it the numbers.
        texts = {(e.edge, e.error): re.sub(r"\d+", "#", e.first) for e in report.refused_edges}
        found.append((texts, report.reasons))
    assert found[0] == found[1]
    assert len(found[0][0]) > 3


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("seed", range(4))
def test_ingest_stores_the_good_members_as_one_commit(seed: int, encoding: str) -> None:
    rows = messages(seed)
    many = tfdb.Buffer(history=None)
    result = many.ingest_many([encode(each, encoding) for each in rows], encoding=encoding)
    assert counts(result.refused_edges) == expected(rows)
    one = tfdb.Buffer(history=None)
    for members in rows:
        errors = [each.error for each in members]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", tfdb.TfdbWarning)
            if errors and all(errors):
                with pytest.raises(tfdb.TfdbError) as caught:
                    one.ingest(encode(members, encoding), encoding=encoding)
                assert [each.error for each in caught.value.refused or ()] == errors
            else:
                one.ingest(encode(members, encoding), encoding=encoding)
    assert samples_of(one) == samples_of(many) == samples_of(naive(rows))
    assert one.commit == many.commit == naive(rows).commit


def test_the_texts_name_edge_value_and_publisher() -> None:
    rows = [Member(b"map", b"base", 5), *bad_members(5)[:2], Member(b"map", b"c\0am", 5)]
    result = tfdb.Buffer().ingest_many([encode(rows, "cdr")], encoding="cdr", authority="/ekf")
    assert {each.edge: each.first for each in result.refused_edges} == {
        "base": "stamp -999999993 ns of T[map<-base] from '/ekf' is out of range: stamps are "
        "from 0 to 2^61 - 1 ns (the year 2043)",
        "newer": "stamp -4000000001 ns of T[map<-newer] from '/ekf' is out of range: stamps "
        "are from 0 to 2^61 - 1 ns (the year 2043)",
        "c\0am": "child frame name 'c\\x00am' from '/ekf' has a control character: a name has 1 "
        "to 1024 bytes of UTF-8 and no control characters",
    }
    excess = [Member(b"map", b"base", 5), Member(b"odom", b"cam", 5, S + 1)]
    with pytest.warns(tfdb.TfdbWarning) as warned:
        tfdb.Buffer().ingest(encode(excess, "cdr"), authority="/ekf")
    assert [str(each.message) for each in warned] == [
        "InvalidStamp: the stamp of T[odom<-cam] from '/ekf' was refused: 1000000001 "
        "nanoseconds are a second or more; the rest of its message is stored"
    ]


@pytest.mark.parametrize("options", [{}, {"start": 0}, {"prefix": "r/"}])
def test_a_static_transform_may_have_any_stamp_of_ros1(tmp_path: Path, options: Any) -> None:
    path = recording(tmp_path / "a", "ros1", [[Member(b"map", b"base", -1)]], static=True)
    store = tfdb.load(path, **options)
    assert store.frames() == [options.get("prefix", "") + name for name in ("base", "map")]


def test_decoding_names_the_member() -> None:
    good = Member(b"map", b"base", 5)
    for bad, error in (
        (Member(b"map", b"cam", -1), tfdb.InvalidStamp),
        (Member(b"map", b"cam", 5, S), tfdb.InvalidStamp),
        (Member(b"m\0ap", b"cam", 5), tfdb.errors.InvalidName),
    ):
        with pytest.raises(error) as caught:
            tfdb.decode_tf_message(encode([good, bad], "cdr"))
        assert (caught.value.index, caught.value.edge) == (1, "cam")


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_a_broken_message_is_refused_whole(encoding: str) -> None:
    rows = [Member(b"map", b"base", 5), Member(b"map", b"cam", -1)]
    data = encode(rows, encoding)
    store = tfdb.Buffer()
    for cut in range(len(data)):
        result = store.ingest_many([data[:cut]], encoding=encoding)
        assert result.reasons.keys() == {"CorruptMessage"}
    assert store.commit == 0
    result = store.ingest_many([data], encoding=encoding)
    assert (result.transforms, result.refused_transforms) == (1, 1)


NAMELESS = [
    Member(b"", b"bad", 5),
    Member(b"map", b"", 5),
    Member(b"/", b"worse", 5),
    Member(b"map", b"/", 5),
    Member(b"", b"", 5),
]


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize(
    "options", [{}, {"prefix": "q/"}, {"rename": {"map": "world"}}, {"by_namespace": True}]
)
def test_no_option_gives_a_name_to_a_frame_without_one(
    tmp_path: Path, encoding: str, options: Any
) -> None:
    rows = [[Member(b"map", b"base", 5), *NAMELESS], NAMELESS]
    path = recording(tmp_path / "a", encoding, rows)
    store = tfdb.Buffer(history=None)
    with pytest.warns(tfdb.TfdbWarning, match="were refused with Inv"):
        report = store.load(path, **options)
    prefix, names = options.get("prefix", ""), options.get("rename", {})
    assert store.frames() == sorted(prefix + names.get(name, name) for name in ("map", "base"))
    assert (report.transforms, report.refused, report.refused_transforms) == (1, 1, 10)
    plain = tfdb.Buffer(history=None)
    with pytest.warns(tfdb.TfdbWarning, match="were refused with Inv"):
        without = plain.load(path)
    assert counts(report.refused_edges) == counts(without.refused_edges)
    assert report.first_refusals == without.first_refusals
