"""Rewriting of messages: the native code equals Python, message by message."""

from __future__ import annotations

import heapq
import random
from operator import itemgetter
from typing import TYPE_CHECKING, Any

import pytest

import tfdb
from tfdb import _core
from tfdb.recordings import Recording, RecordingWriter
from tfdb.recordings.load_report import refused_by
from tfdb.recordings.open_recordings import OpenRecordings
from tfdb.recordings.rewriting import Rewriting, merged, rewrite
from tfdb.recordings.selection import Selection
from wire import oracle

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from tfdb.recordings.rewriter import Rewriter

S = 10**9
FRAMES = ["map", "odom", "base", "cam", "/two", "\u00e4", "t#l", ""]
OPTIONS: list[dict[str, Any]] = [
    {},
    {"prefix": "q/"},
    {"rename": {"base": "B", "t": "u"}},
    {"exclude": ["cam", "/driver"]},
    {"start": 22 * S, "end": 25 * S},
    {"by_namespace": True},
    {"by_namespace": True, "exclude": "/tf:odom", "rename": {"robot1/map": "m"}},
]


def member(rng: random.Random, now: int) -> tfdb.TransformStamped:
    """Make a random transform; some are invalid."""
    parent, child = rng.sample(FRAMES, 2)
    stamp = now if rng.random() < 0.95 else 2_200_000_000 * S  # fits into ROS 1 only
    place = (float("nan"), 0.0, 0.0) if rng.random() < 0.02 else (rng.random(), 2.0, 3.0)
    return tfdb.TransformStamped(parent, child, stamp, place, (0.0, 0.0, 0.6, 0.8))


def message(rng: random.Random, now: int, encoding: str) -> bytes | None:
    """Make a random message in any layout; some are damaged."""
    layouts = ["ros1"] if encoding == "ros1" else ["cdr", "cdr", "cdr_be", "cdr2_le", "cdr2_be"]
    members = [member(rng, now) for _ in range(rng.choice([0, 1, 2, 5]))]
    try:
        made = bytearray(tfdb.encode_tf_message(members, rng.choice(layouts)))
    except tfdb.errors.InvalidStamp:
        return None
    made = made.replace(b"t#l", bytes([ord("t"), rng.choice([0, 0xFF, 0xC3, ord("o")]), ord("l")]))
    if rng.random() < 0.05:
        made[rng.randrange(len(made))] ^= 1 << rng.randrange(8)
    return bytes(made[: rng.randrange(len(made))] if rng.random() < 0.03 else made)


def record(path: Path, seed: int) -> Path:
    rng, now = random.Random(seed), 20 * S
    with RecordingWriter(path) as writer:
        for _ in range(250):
            now += rng.choice([0, S // 20])
            data = message(rng, now, writer.encoding)
            topic = rng.choices(["/tf", "/tf_static", "/robot1/tf"], [20, 1, 5])[0]
            if data is not None:
                node = rng.choice(["/driver", "/filter"])
                writer.write(data, now, topic=topic, static=topic == "/tf_static", authority=node)
    return path


def opened(path: Path, options: dict[str, Any]) -> OpenRecordings:
    """Open a recording of groups that may disagree: its topics are named."""
    with Recording(path) as recording:
        topics = [topic.name for topic in recording.topics]
    return OpenRecordings(path, Selection(topics=topics, **options))


def in_python(
    recordings: OpenRecordings, encoding: str
) -> tuple[list[tuple[str, int, list[str]]], list[int], Rewriter]:
    """Return the messages written from a recording, their counts, and the refused ones."""
    choice, rewriter = recordings.choice, recordings.rewriter()
    written: list[tuple[str, int, list[str]]] = []
    transforms = refused = broken = left_out = 0
    for source, received, data in recordings.files[0].messages(choice.wants):
        static, before = choice.is_static(source), len(rewriter.refused_members)
        try:
            given = rewriter.decoded(data, source, received, static=static)
        except tfdb.TfdbError as error:
            rewriter.refusals.append(error)
            broken += 1
            continue
        chosen = rewriter.transforms(given, source, static=static)
        made = rewriter.encoded(chosen, encoding)
        refused += len(rewriter.refused_members) - before
        if made is None:
            broken += 1
        elif given and not chosen:
            left_out += 1
        else:
            transforms += made[1]
            written.append((source.topic, received, contents(made[0], encoding)))
    return written, [len(written), transforms, refused, broken, left_out], rewriter


def contents(data: bytes, encoding: str) -> list[str]:
    """Return the content of a message, with all bits of its numbers."""
    return list(map(repr, _core.decode_members(data, encoding, static=True, authority="")))


@pytest.mark.parametrize("by_time", [False, True])
def test_progress_counts_each_message_once(tmp_path: Path, by_time: bool) -> None:
    """Messages that cannot be written, or have no wanted transform, count as well."""
    seen: list[tuple[int, int]] = []
    path, options = record(tmp_path / "in.mcap", 3), {"start": 22 * S, "end": 25 * S}
    with opened(path, options) as recordings, RecordingWriter(tmp_path / "out.mcap") as writer:
        rewriters = [recordings.rewriter()]
        with pytest.warns(tfdb.TfdbWarning):
            found = rewrite(
                recordings, rewriters, writer, lambda *step: seen.append(step), by_time=by_time
            )
        count = recordings.count
    assert found.skipped
    assert found.left_out
    assert seen == sorted(seen)
    assert seen[-1] == (count, count)


@pytest.mark.parametrize("options", OPTIONS, ids=str)
@pytest.mark.parametrize("to", ["bag", "mcap"])
@pytest.mark.parametrize("kind", ["bag", "mcap", "db3"])
def test_python_would_write_the_same(
    tmp_path: Path, kind: str, to: str, options: dict[str, Any]
) -> None:
    path = record(tmp_path / f"in.{kind}", 3)
    out = tmp_path / f"out.{to}"
    with opened(path, options) as recordings, RecordingWriter(out) as writer:
        expected, counts, python = in_python(recordings, writer.encoding)
        rewriter = recordings.rewriter()
        rewriting = Rewriting(writer, recordings.choice)
        for part in rewriting.messages(recordings.files[0], rewriter):
            writer.write_messages(part)
    with Recording(out) as written:
        found = [
            (source.topic, received, contents(data, source.encoding))
            for source, received, data in written.messages()
        ]
    assert found == expected
    done = rewriting.written
    assert [
        done.messages,
        done.transforms,
        done.refused,
        done.skipped,
        done.left_out,
    ] == counts
    assert min(counts[:4]) > 0
    by_edge = {(each.edge, each.error, each.is_message): each for each in refused_by([python])}
    natively = rewriting.refusals()
    assert {(each.edge, each.error, each.is_message): each for each in natively} == by_edge
    assert rewriter.left_out == python.left_out


def test_messages_that_stay_keep_their_bytes(tmp_path: Path) -> None:
    """A leading slash, `seq` and padding stay; only renamed messages are written anew."""
    path, out = tmp_path / "in.bag", tmp_path / "out.bag"
    kept, changed = (
        bytearray(
            tfdb.encode_tf_message(
                [tfdb.TransformStamped("/map", child, 5, (1, 2, 3), (0, 0, 0, 1))], "ros1"
            )
        )
        for child in ("base", "arm")
    )
    kept[4:8] = changed[4:8] = b"\x07\0\0\0"
    with RecordingWriter(path) as writer:
        for received, data in enumerate([kept, changed], 10):
            writer.write(bytes(data), received, topic="/tf", authority="/node")
    renamed = {"rename": {"arm": "tool"}}
    with opened(path, renamed) as recordings, RecordingWriter(out) as writer:
        rewrite(recordings, [recordings.rewriter()], writer)
    with Recording(out) as written:
        first, second = (data for _, _, data in written.messages())
    assert first == kept
    assert second[4:8] == bytes(4)
    assert b"tool" in second


def test_a_name_that_stays_keeps_its_slash(tmp_path: Path) -> None:
    path, out = tmp_path / "in.mcap", tmp_path / "out.bag"
    edges = [("/map", "/odom"), ("/odom", "/base"), ("/odom", "")]
    pose = (1, 2, 3, 0, 0, 0.6, 0.8)
    with RecordingWriter(path) as writer:
        for edge in edges:
            data = oracle.encode([oracle.row(*edge, 5, pose)], "cdr")
            writer.write(data, 10, topic="/tf")
    with opened(path, {"rename": {"map": "world"}}) as recordings, RecordingWriter(out) as writer:
        done = rewrite(recordings, [recordings.rewriter()], writer)
    assert (done.messages, done.refused, done.skipped) == (3, 0, 0)
    with Recording(out) as written:
        rows = [oracle.decode(data, "ros1")[0] for _, _, data in written.messages()]
    names = [(row.parent, row.child) for row in rows]
    assert names == [("world", "/odom"), ("/odom", "/base"), ("/odom", "")]


@pytest.mark.parametrize("seed", range(20))
def test_streams_merge_as_heapq_merges_them(seed: int) -> None:
    rng = random.Random(seed)
    streams: list[list[list[tuple[int, int, bytes]]]] = []
    for number in range(rng.randrange(1, 5)):
        times = sorted(rng.randrange(30) for _ in range(rng.randrange(40)))
        messages = [(at, number, bytes([number, count])) for count, at in enumerate(times)]
        cuts = sorted(rng.randrange(len(messages) + 1) for _ in range(4))
        bounds = zip([0, *cuts], [*cuts, len(messages)], strict=True)
        streams.append([messages[first:last] for first, last in bounds])

    def parts(stream: list[list[tuple[int, int, bytes]]]) -> Iterator[_core.Recorded]:
        for messages in stream:
            made = _core.Recorded()
            for each in messages:
                made.add(*each)
            yield made

    found = [part[index] for part in merged([*map(parts, streams)]) for index in range(len(part))]
    flat = [[each for part in stream for each in part] for stream in streams]
    assert found == list(heapq.merge(*flat, key=itemgetter(0)))
