"""MCAP files made record by record: order of messages, summaries, violations of the format."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import tfdb
from tfdb.recordings import Recording, mcap_reader

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

MAGIC = b"\x89MCAP0\r\n"
TF = "tf2_msgs/msg/TFMessage"
Messages = list[tuple[str, int, bytes]]


def record(kind: int, body: bytes) -> bytes:
    return struct.pack("<BQ", kind, len(body)) + body


def text(value: str) -> bytes:
    return struct.pack("<I", len(value)) + value.encode()


def mapping(values: dict[int, int]) -> bytes:
    body = b"".join(struct.pack("<HQ", *pair) for pair in values.items())
    return struct.pack("<I", len(body)) + body


def schema(id_: int, name: str = TF) -> bytes:
    return record(3, struct.pack("<H", id_) + text(name) + text("ros2msg") + text("x"))


def channel(id_: int, topic: str, of: int = 1) -> bytes:
    body = struct.pack("<HH", id_, of) + text(topic) + text("cdr") + struct.pack("<I", 0)
    return record(4, body)


def payload(stamp: int, x: float = 4) -> bytes:
    rotation = (0, 0.6, 0, -0.8)
    return tfdb.encode_tf_message([tfdb.TransformStamped("P", "C", stamp, (x, 2, 3), rotation)])


def message(id_: int, time: int, data: bytes | None = None) -> bytes:
    return record(5, struct.pack("<HIQQ", id_, 0, time, time) + (data or payload(time)))


def cut_message(id_: int, time: int, length: int) -> bytes:
    return record(5, struct.pack("<HIQQ", id_, 0, time, time)[:length])


@dataclass
class File:
    """Builds an MCAP file from valid and invalid records."""

    data: bytes = MAGIC + record(1, text("ros2") + text("x"))
    indexes: list[bytes] = field(default_factory=list)

    def chunk(
        self, records: Iterable[bytes], start: int, ids: Iterable[int], packing: str = ""
    ) -> File:
        raw = packed = b"".join(records)
        if packing:
            packed = pytest.importorskip("zstandard").compress(raw)
        body = struct.pack("<QQQI", start, 10**6, len(raw), zlib.crc32(raw)) + text(packing)
        whole = record(6, body + struct.pack("<Q", len(packed)) + packed)
        place = struct.pack("<QQQQ", start, 10**6, len(self.data), len(whole))
        sizes = struct.pack("<QQ", len(packed), len(raw))
        offsets = mapping(dict.fromkeys(ids, 1))
        index = place + offsets + struct.pack("<Q", 0) + text(packing) + sizes
        self.indexes.append(record(8, index))
        self.data += whole
        return self

    def end(
        self,
        path: Path,
        declared: bytes = b"",
        counts: dict[int, int] | None = None,
        *,
        crc: int | None = None,
        has_data_crc: bool = False,
    ) -> Path:
        """End the file, with a summary if `counts` are given; `crc` replaces its checksum."""
        data_crc = zlib.crc32(self.data) if has_data_crc else 0
        data = self.data + record(15, struct.pack("<I", data_crc))
        summary = b""
        if counts is not None:
            numbers = sum(counts.values()), 1, 1, 0, 0, len(self.indexes)
            figures = struct.pack("<QHIIIIQQ", *numbers, 1, 10**6)
            summary = declared + record(11, figures + mapping(counts)) + b"".join(self.indexes)
        head = struct.pack("<BQQQ", 2, 20, len(data) if summary else 0, 0)
        crc = zlib.crc32(summary + head) if crc is None else crc
        path.write_bytes(data + summary + head + struct.pack("<I", crc) + MAGIC)
        return path


def read(path: Path, *, salvage: bool = False) -> tuple[Messages, tuple[Any, ...]]:
    """Return all messages and the losses; single and bulk reading must be equal."""
    with Recording(path, salvage=salvage) as recording:
        found = [(source.topic, time, data) for source, time, data in recording.messages()]
        at_once = []
        for run in recording.read():
            for index in range(run.first, run.last):
                time, id_, data = run.messages[index]
                at_once.append((run.sources[id_].topic, time, data))
        assert at_once == found
        return found, recording.losses


def parts(path: Path) -> list[list[int]]:
    """Return the times of the messages in each part of a bulk reading."""
    with Recording(path) as recording:
        held = {id(run.messages): run.messages for run in list(recording.read())}
        return [[each[i][0] for i in range(len(each))] for each in held.values()]


def refused(path: Path) -> str:
    """Return the error, which must be the same in single and bulk reading."""
    reasons = []
    for method in ("messages", "read"):
        with pytest.raises(tfdb.errors.RecordingError) as caught, Recording(path) as recording:
            list(getattr(recording, method)())
        assert caught.value.path == str(path)
        reasons.append(str(caught.value.reason))
    assert reasons[0] == reasons[1]
    return reasons[0]


def times(messages: Messages) -> list[int]:
    return [time for _, time, _ in messages]


# -- order -----------------------------------------------------------------------------------------


def random_times(seed: int) -> list[int]:
    """Make times with overlapping chunks, chunks out of order, and repeated times."""
    rng = np.random.default_rng(seed)
    print("seed", seed)
    return [10 + i // 60 - 3 * (i // 30 % 3) + int(rng.integers(0, 5)) for i in range(400)]


def by_writer(path: Path, received: list[int], **options: Any) -> Messages:
    """Write a file with the official library; return its messages in order."""
    from mcap.writer import CompressionType, Writer

    expected = []
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=700, compression=CompressionType.NONE, **options)
        writer.start("ros2")
        type_ = writer.register_schema(TF, "ros2msg", b"x")
        other = writer.register_schema("foxglove.Log", "protobuf", b"\xff")
        ids = [writer.register_channel(topic, "cdr", type_) for topic in ("/tf", "/tf_static")]
        log = writer.register_channel("/log", "protobuf", other)
        bare = writer.register_channel("/bare", "json", 0)
        for number, time in enumerate(received):
            writer.add_message(log, time, b"\x01", time)
            writer.add_message(bare, time, b"{}", time)
            writer.add_message(ids[number % 2], time, data := payload(number), time)
            expected.append(("/tf_static" if number % 2 else "/tf", time, data))
        writer.finish()
    return sorted(expected, key=lambda each: each[1])


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("worth", [1, 256])
def test_messages_of_one_time_are_in_the_order_of_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seed: int, worth: int
) -> None:
    monkeypatch.setattr(mcap_reader, "_PART", worth)
    path = tmp_path / "a.mcap"
    expected = by_writer(path, random_times(seed))
    for salvage in (False, True):
        assert read(path, salvage=salvage) == (expected, ())


def test_the_later_of_one_time_and_stamp_wins(tmp_path: Path) -> None:
    head = [schema(1), channel(1, "/tf")]
    file = File().chunk([*head, message(1, 5, payload(9, 1))], 5, [1])
    file.chunk([message(1, 1), message(1, 5, payload(9, 2))], 1, [1])
    path = file.end(tmp_path / "a.mcap", b"".join(head), {1: 3})
    for salvage in (False, True):
        stamps, poses, _ = tfdb.load(path, salvage=salvage).samples("C")
        assert stamps.tolist() == [1, 9]
        assert poses[:, 0].tolist() == [4, 2]


def test_parts_end_where_nothing_older_follows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mcap_reader, "_PART", 1)
    file = File()
    for chunk in ([1, 2], [2, 3], [7, 4], [6, 9], [8], [9], [9, 10]):
        head = [schema(1), channel(1, "/tf"), schema(2, "other"), channel(2, "/log", 2)]
        file.chunk([*head, *(message(1, time) for time in chunk)], min(chunk), [1])
        file.chunk([*head, message(2, 5)], 5, [])
    path = file.end(tmp_path / "a.mcap", b"".join(head), {1: 12, 2: 7})
    assert parts(path) == [[1, 2], [2, 3], [4, 6, 7, 8, 9], [9], [9, 10]]
    monkeypatch.setattr(mcap_reader, "_PART", 3)
    assert parts(path) == [[1, 2, 2, 3], [4, 6, 7, 8, 9], [9, 9, 10]]
    assert len(read(path)[0]) == 12


def test_a_long_file_is_never_held_whole(recorder: Any, messages: Any, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    by_writer(path, list(range(4000)))
    held = parts(path)
    assert [time for part in held for time in part] == list(range(4000))
    assert max(map(len, held)) < 300
    folder = recorder.folder(tmp_path / "b", messages, "mcap")
    with Recording(folder) as recording:
        found = [
            (run.messages[i], run) for run in recording.read() for i in range(run.first, run.last)
        ]
        at_once = [(run.sources[id_], time, data) for (time, id_, data), run in found]
        assert at_once == list(recording.messages())


def test_a_file_that_changes_while_it_is_read(tmp_path: Path) -> None:
    head = [schema(1), channel(1, "/tf")]
    for packing in ("", "zstd"):
        file, shorter = File(), File()
        for start in range(0, 900, 300):
            span = range(start, start + 300)
            file.chunk([*head, *(message(1, time) for time in span)], start, [1], packing)
            other = [2, *[1] * 299] if start else [1] * 300
            declared = [schema(2, "other"), channel(2, "/log", 2)]
            records = (message(*each) for each in zip(other, span, strict=True))
            shorter.chunk([*head, *declared, *records], start, [1], packing)
        path = file.end(tmp_path / "a.mcap", b"".join(head), {1: 900})
        whole = path.read_bytes()
        for change in (whole[: len(whole) // 2], shorter.data):
            with Recording(path) as recording:
                runs = recording.read()
                assert next(runs).start == 0
                path.write_bytes(change)
                with pytest.raises(tfdb.errors.RecordingError) as caught:
                    list(runs)
            assert caught.value.path == str(path)
            path.write_bytes(whole)


def test_bags_too_keep_the_order_of_the_file(recorder: Any, messages: Any, tmp_path: Path) -> None:
    received = random_times(4)
    drive = [
        type(each)(each.topic, time, each.transforms, each.callerid)
        for each, time in zip(messages, received, strict=False)
    ]
    path = recorder.bag(tmp_path / "a.bag", drive)
    expected = sorted(
        ((each.topic, each.received, recorder.encode(each, "ros1")) for each in drive),
        key=lambda each: each[1],
    )
    for salvage in (False, True):
        assert read(path, salvage=salvage) == (expected, ())


# -- the summary -----------------------------------------------------------------------------------


def test_a_byte_of_the_summary_is_wrong(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    expected = by_writer(path, [5, 6, 7, 8])
    good = path.read_bytes()
    footer = len(good) - 37
    (start,) = struct.unpack_from("<Q", good, footer + 9)
    assert struct.unpack_from("<I", good, footer + 25)[0] != 0
    for at in range(start, footer + 29):
        damaged = bytearray(good)
        damaged[at] ^= 0x15
        path.write_bytes(damaged)
        assert "damaged" in refused(path)
        found, (loss,) = read(path, salvage=True)
        assert found == expected, at
        assert loss.path == str(path)
    # Zero means a missing checksum.
    path.write_bytes(good[: footer + 25] + bytes(4) + good[footer + 29 :])
    for salvage in (False, True):
        assert read(path, salvage=salvage) == (expected, ())


@pytest.mark.parametrize("chunks", [False, True])
@pytest.mark.parametrize("channels", [False, True])
@pytest.mark.parametrize("schemas", [False, True])
def test_schemas_and_channels_missing_in_the_summary_are_found(
    tmp_path: Path, schemas: bool, channels: bool, chunks: bool
) -> None:
    path = tmp_path / "a.mcap"
    options = {"repeat_schemas": schemas, "repeat_channels": channels, "use_chunking": chunks}
    expected = by_writer(path, random_times(6), **options)
    for salvage in (False, True):
        assert read(path, salvage=salvage) == (expected, ())
        with Recording(path, salvage=salvage) as recording:
            types = {topic.name: topic.type for topic in recording.topics}
            assert types == {"/tf": TF, "/tf_static": TF, "/log": "foxglove.Log", "/bare": ""}
    with pytest.warns(tfdb.TfdbWarning, match="transforms of frame .* were refused"):
        assert tfdb.load(path).frame_info("C").parent == "P"


def test_a_whole_summary_spares_the_other_chunks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    head = [schema(1), schema(2, "other"), channel(1, "/tf"), channel(2, "/big", 2)]
    file = File().chunk([*head, message(1, 3)], 3, [1]).chunk([message(2, 5)], 5, [2])
    path = file.end(tmp_path / "a.mcap", b"".join(head), {1: 1, 2: 1})
    checked = []
    crc32 = zlib.crc32
    monkeypatch.setattr(zlib, "crc32", lambda *given: checked.append(0) or crc32(*given))
    assert times(read(path)[0]) == [3]
    assert len(checked) == 3, "the summary once, the one chunk by either way"


def test_a_summary_that_denies_when_a_chunk_starts(tmp_path: Path) -> None:
    head = [schema(1), channel(1, "/tf")]
    file = File().chunk([*head, message(1, 3)], 3, [1])
    file.indexes[0] = file.indexes[0][:9] + struct.pack("<Q", 4) + file.indexes[0][17:]
    path = file.end(tmp_path / "a.mcap", b"".join(head), {1: 1}, crc=0)
    assert "begins at another time" in refused(path)


# -- what the format forbids -----------------------------------------------------------------------

HEAD = [schema(1), schema(2, "other/Thing"), channel(1, "/tf"), channel(2, "/other", 2)]
FLAWS = {
    "undeclared": (message(7, 20), "messages of channel 7"),
    "undeclared, of no schema": (channel(7, "/x", 9) + message(7, 20), "messages of channel 7"),
    "another topic": (channel(1, "/tf_static"), "channel 1 is declared again, on '/tf_static'"),
    "another schema": (channel(2, "/other", 1), "channel 2 is declared again, on '/other'"),
    "another name": (schema(2, TF), f"schema 2 is declared again as '{TF}'"),
    **{
        f"short by {22 - length}": (
            cut_message(1, 20, length),
            f"a message of {length} bytes, too short for one",
        )
        for length in (0, 1, 2, 6, 14, 21)
    },
}


@pytest.mark.parametrize("place", ["in the midst", "at the end"])
@pytest.mark.parametrize("kind", ["no chunks", "chunks", "zstd", "summary", "known to the summary"])
@pytest.mark.parametrize("flaw", FLAWS)
def test_violations_of_the_format_are_damage(
    tmp_path: Path, flaw: str, kind: str, place: str
) -> None:
    bad, reason = FLAWS[flaw]
    records = [*HEAD, message(1, 10), bad, message(1, 30)]
    if place == "at the end":
        records[-1], records[-2] = records[-2], records[-1]
    path = tmp_path / "a.mcap"
    file = File()
    if kind == "no chunks":
        file.data += b"".join(records) + message(1, 40)
    else:
        file.chunk(records, 10, [1], "zstd" if kind == "zstd" else "")
        file.chunk([message(1, 40)], 40, [1])
    counts = {1: 3, 7: 1} if kind == "known to the summary" else {1: 3}
    file.end(path, b"".join(HEAD), counts if "summary" in kind else None)
    assert reason in refused(path)
    found, (loss,) = read(path, salvage=True)
    assert times(found) == [10, 30, 40]
    assert {topic for topic, _, _ in found} == {"/tf"}
    assert reason in loss.reason
    assert loss.bytes == (len(bad) if flaw.startswith("short") else 0)
    buffer = tfdb.Buffer(history=None)
    with pytest.raises(tfdb.errors.RecordingError):
        buffer.load(path)
    assert buffer.commit == 0
    assert buffer.load(path, salvage=True).lost == (loss,)


def test_repeated_equal_declarations_are_not_damage(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    file = File().chunk([*HEAD, message(1, 10), *HEAD, message(2, 20)], 10, [1, 2])
    file.chunk([*HEAD, message(1, 30)], 30, [1]).end(path, b"".join(HEAD), {1: 2, 2: 1})
    for salvage in (False, True):
        found, losses = read(path, salvage=salvage)
        assert (times(found), losses) == ([10, 30], ())


def test_a_cut_at_every_byte(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    file = File().chunk([*HEAD, message(1, 10)], 10, [1]).chunk([message(1, 20)], 20, [1])
    whole = file.end(path, b"".join(HEAD), {1: 2}).read_bytes()
    for size in range(len(MAGIC), len(whole)):
        path.write_bytes(whole[:size])
        assert "cut short, its end is missing" in refused(path)
        found, losses = read(path, salvage=True)
        assert times(found) in ([], [10], [10, 20])
        assert losses, size


# -- records where they must not be ----------------------------------------------------------------

NUMBERS = struct.pack("<QHIIIIQQ", 2, 2, 2, 0, 0, 1, 10, 30) + mapping({1: 2})
STRAYS = {
    "data: header": (record(1, text("") * 2), "a header before the end of its data"),
    "data: statistics": (record(11, NUMBERS), "a statistics record before the end of its data"),
    "data: end": (record(15, bytes(4)), "after the end of its data"),
    "data: footer": (record(2, bytes(20)), "a footer before the end of its data"),
    "data: none": (record(0, b"abc"), "an incomplete record of 3 bytes at"),
    "chunk: header": (record(1, text("") * 2), "a header within a chunk"),
    "chunk: chunk": (
        record(6, struct.pack("<QQQI", 1, 1, 31, 0) + text("") + struct.pack("<Q", 31) + bytes(31)),
        "a chunk within a chunk",
    ),
    "chunk: index": (record(7, struct.pack("<HI", 1, 0)), "a message index within a chunk"),
    "chunk: end": (record(15, bytes(4)), "an end of the data within a chunk"),
    "chunk: none": (record(0, b"abc"), "no record within a chunk"),
    "summary: message": (message(1, 40), "a message"),
    "summary: header": (record(1, text("") * 2), "a header"),
    "summary: end": (record(15, bytes(4)), "an end of the data"),
    "summary: none": (record(0, b"abc"), "no record in its summary"),
}


def with_stray(path: Path, place: str, stray: bytes, *, summary: bool) -> Path:
    """Make two chunks of one message, and a stray record in the data, first chunk or summary."""
    file = File().chunk([*HEAD, stray * (place == "chunk"), message(1, 10)], 10, [1])
    file.data += stray * (place == "data")
    declared = b"".join(HEAD) + stray * (place == "summary")
    file.chunk([message(1, 30)], 30, [1])
    return file.end(path, declared, {1: 2} if summary else None)


@pytest.mark.parametrize("summary", [False, True])
@pytest.mark.parametrize("stray", STRAYS)
def test_records_where_they_must_not_be(tmp_path: Path, stray: str, summary: bool) -> None:
    bad, reason = STRAYS[stray]
    place, _, kind = stray.partition(": ")
    if place == "summary" and not summary:
        return
    path = with_stray(tmp_path / "a.mcap", place, bad, summary=summary)
    assert reason in refused(path)
    found, (loss,) = read(path, salvage=True)
    assert times(found) == [10, 30, 40][: 3 if kind == "message" else 2]
    assert reason in loss.reason
    assert loss.messages == 0
    if place == "chunk" or kind == "none":
        assert loss.bytes in (len(bad), 0)


@pytest.mark.parametrize("place", ["data", "chunk", "summary"])
@pytest.mark.parametrize("kind", [0x10, 0x7F, 0x80, 0xFF])
def test_kinds_of_records_to_come(tmp_path: Path, kind: int, place: str) -> None:
    path = with_stray(tmp_path / "a.mcap", place, record(kind, b"news"), summary=True)
    for salvage in (False, True):
        found, losses = read(path, salvage=salvage)
        assert (times(found), losses) == ([10, 30], ())


@pytest.mark.parametrize("counts", [None, {1: 1}])
def test_no_header(tmp_path: Path, counts: dict[int, int] | None) -> None:
    file = File(MAGIC).chunk([*HEAD, message(1, 10)], 10, [1])
    path = file.end(tmp_path / "a.mcap", b"".join(HEAD), counts)
    assert "no header at its beginning" in refused(path)
    found, (loss,) = read(path, salvage=True)
    assert (times(found), loss.messages, loss.bytes) == ([10], 0, 0)


def test_a_message_behind_the_end_of_the_data_is_saved(tmp_path: Path) -> None:
    file = File().chunk([*HEAD, message(1, 10)], 10, [1])
    file.data += record(15, bytes(4)) + message(1, 20)
    path = file.end(tmp_path / "a.mcap")
    assert "a message after the end of its data" in refused(path)
    found, (loss,) = read(path, salvage=True)
    assert times(found) == [10, 20]
    assert loss.messages == 0


def test_statistics_that_do_not_add_up(tmp_path: Path) -> None:
    file = File().chunk([*HEAD, message(1, 10)], 10, [1])
    path = file.end(tmp_path / "a.mcap", b"".join(HEAD), {1: 2**40}, crc=0)
    assert "its index promises 1099511627776 messages" in refused(path)
    at = (whole := path.read_bytes()).rindex(struct.pack("<HQ", 1, 2**40))
    path.write_bytes(whole[:at] + struct.pack("<HQ", 1, 1) + whole[at + 10 :])
    assert "statistics that do not add up to 1099511627776 messages" in refused(path)
    found, (loss,) = read(path, salvage=True)
    assert (times(found), loss.messages) == ([10], 0)


# -- the checksum of the data ----------------------------------------------------------------------


@pytest.mark.parametrize("chunks", [False, True])
@pytest.mark.parametrize("channels", [False, True])
def test_a_byte_of_the_data_is_wrong(tmp_path: Path, channels: bool, chunks: bool) -> None:
    path = tmp_path / "a.mcap"
    options = {"repeat_channels": channels, "use_chunking": chunks, "enable_data_crcs": True}
    expected = by_writer(path, [5, 6, 7, 8], **options)
    for salvage in (False, True):
        assert read(path, salvage=salvage) == (expected, ())
    good = path.read_bytes()
    end = good.index(record(15, b"")[:1] + struct.pack("<Q", 4))
    for at in (*range(17, 25), *range(30, end, 7), *range(end + 9, end + 13)):
        damaged = bytearray(good)
        damaged[at] ^= 0x15
        path.write_bytes(damaged)
        refused(path)
        if damaged.count(b"cdr") == good.count(b"cdr"):  # the encoding is intact
            assert read(path, salvage=True)[1], at
    # Zero means a missing checksum.
    path.write_bytes(good[: end + 9] + bytes(4) + good[end + 13 :])
    for salvage in (False, True):
        assert read(path, salvage=salvage) == (expected, ())


def test_skipped_records_count_in_the_checksum(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    file = File().chunk([*HEAD, message(1, 10)], 10, [1]).chunk([message(2, 20, b"log")], 20, [2])
    file.end(path, b"".join(HEAD), {1: 1, 2: 1}, has_data_crc=True)
    assert times(read(path)[0]) == [10]
    whole = path.read_bytes()
    path.write_bytes(whole.replace(b"log", b"lag", 1))
    assert "data whose checksum is wrong" in refused(path)
    found, (loss,) = read(path, salvage=True)
    assert times(found) == [10]
    assert loss.messages == 0


# -- chunks that are not where they should be ------------------------------------------------------


@pytest.mark.parametrize("kind", [0, 1, 2, 5, 9, 0x0F, 0x86])
@pytest.mark.parametrize("which", [0, 1, 2])
@pytest.mark.parametrize("counts", [{}, {1: 3}])
def test_a_chunk_of_the_summary_is_none(
    tmp_path: Path, which: int, kind: int, counts: dict[int, int]
) -> None:
    path = tmp_path / "a.mcap"
    file = File()
    places = []
    for start in (10, 20, 30):
        places.append(len(file.data))
        file.chunk([*HEAD, message(1, start)], start, [1])
        file.data += record(7, struct.pack("<HIQQ", 1, 16, start, 0))
    file.end(path, b"".join(HEAD), counts)
    damaged = bytearray(path.read_bytes())
    damaged[places[which]] = kind
    path.write_bytes(damaged)
    assert f"no chunk at {places[which]}, where the summary has one" in refused(path)
    found, (loss,) = read(path, salvage=True)
    assert times(found) == [time for time in (10, 20, 30) if time != 10 + 10 * which]
    assert f"no chunk at {places[which]}" in loss.reason
    assert loss.messages == 1
    assert loss.bytes == (places[1] - places[0] - 9 - 22)


def test_channels_only_in_a_chunk_that_is_none(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    by_writer(path, [5, 6], repeat_channels=False)
    whole = path.read_bytes()
    at = whole.index(b"\x06", 8 + 9 + whole[9])
    path.write_bytes(whole[:at] + b"\x86" + whole[at + 1 :])
    assert f"no chunk at {at}" in refused(path)
    found, (loss,) = read(path, salvage=True)
    assert found == []
    assert loss.bytes > 0


@pytest.mark.parametrize("kind", [0x09, 0x80])
def test_a_record_that_swallows_chunks(tmp_path: Path, kind: int) -> None:
    path = tmp_path / "a.mcap"
    file = File().chunk([*HEAD, message(1, 10)], 10, [1])
    at = len(file.data)
    file.data += record(kind, b"abcd")
    for start in (20, 30):
        file.chunk([message(1, start)], start, [1])
    length = len(file.data) - at - 9
    file.data = file.data[: at + 1] + struct.pack("<Q", length) + file.data[at + 9 :]
    file.end(path, b"".join(HEAD), {})
    assert f"a record at {at} overlaps the chunk at {at + 13}" in refused(path)
    found, (loss,) = read(path, salvage=True)
    assert times(found) == [10, 20, 30]
    assert (loss.messages, loss.bytes) == (0, 13)


@pytest.mark.parametrize("packing", ["", "zstd"])
def test_a_damaged_chunk_in_a_file_without_summary(tmp_path: Path, packing: str) -> None:
    path = tmp_path / "a.mcap"
    file = File().chunk([*HEAD, message(1, 10)], 10, [1])
    at = len(file.data)
    file.chunk([message(1, 20), message(1, 21)], 20, [1], packing)
    behind = len(file.data)
    file.data += record(7, struct.pack("<HIQQQQ", 1, 32, 20, 0, 21, 9))
    file.chunk([message(1, 30)], 30, [1]).end(path)
    damaged = bytearray(path.read_bytes())
    damaged[behind - 40] ^= 1
    for cut in (len(damaged), len(damaged) - 30):
        path.write_bytes(damaged[:cut])
        refused(path)
        found, (loss,) = read(path, salvage=True)
        assert [time for time in times(found) if time not in (20, 21)] == [10, 30]
        assert loss.messages == 4 - len(found)
        assert 0 < loss.bytes <= behind - at + 400


@pytest.mark.parametrize(
    "index",
    [
        record(7, struct.pack("<HIQQ", 1, 16, 20, 0)) * 2,
        record(7, struct.pack("<HI", 1, 2**31) + bytes(16)),
        record(7, struct.pack("<HI", 1, 2**31)),
        record(7, b"\x01"),
    ],
)
def test_a_message_index_promises_no_more_than_there_is(tmp_path: Path, index: bytes) -> None:
    path = tmp_path / "a.mcap"
    file = File().chunk([*HEAD, message(1, 10)], 10, [1])
    file.chunk([message(1, 20)], 20, [1])
    file.data += index
    file.chunk([message(1, 30)], 30, [1]).end(path)
    found, losses = read(path, salvage=True)
    assert times(found) == [10, 20, 30]
    assert sum(loss.messages for loss in losses) == 0
    damaged = path.read_bytes()
    at = damaged.index(payload(20)) + 8
    path.write_bytes(damaged[:at] + b"\xff" + damaged[at + 1 :])
    found, (loss,) = read(path, salvage=True)
    assert times(found) == [10, 30]
    assert loss.messages <= 1


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"repeat_channels": False},
        {"use_statistics": False},
        {"enable_data_crcs": True},
        {"use_chunking": False, "enable_data_crcs": True},
    ],
)
def test_a_flipped_bit_is_never_silent(tmp_path: Path, options: dict[str, bool]) -> None:
    """Reading returns all messages or raises; saved and lost ones together do not exceed all."""
    path = tmp_path / "a.mcap"
    expected = by_writer(path, random_times(7)[:60], **options)
    raw = path.read_bytes()
    rng = np.random.default_rng(13)
    for at in rng.integers(8, len(raw), 120):
        damaged = bytearray(raw)
        damaged[at] ^= 1 << int(rng.integers(8))
        path.write_bytes(damaged)
        try:
            found = read(path)[0]
        except tfdb.errors.RecordingError:
            try:
                found, losses = read(path, salvage=True)
            except tfdb.errors.RecordingError as error:
                assert "encoded as" in str(error)  # transforms cannot have this encoding
                continue
            assert losses, at
            kept = sum(each in expected for each in found)
            assert kept + sum(loss.messages for loss in losses) <= len(expected), at
        else:
            assert found == expected, at
