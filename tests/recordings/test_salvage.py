"""After damage, `salvage` reads every message whose bytes are intact, and invents none."""

from __future__ import annotations

import random
import re
import sqlite3
import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Reader as BagReader

from tfdb.errors import RecordingError
from tfdb.recordings import Recording

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

Found = list[tuple[int, bytes]]
KINDS = (
    *("bag", "bag-lz4", "bag-bz2"),
    *("mcap", "mcap-zstd", "mcap-no-crc", "mcap-no-index", "mcap-no-chunks"),
)


@dataclass(frozen=True)
class Region:
    """A range of a file, and the messages whose bytes are in it."""

    start: int
    end: int
    messages: Found


def bag(recorder: Any, path: Path, messages: list[Any], kind: str) -> list[Region]:
    recorder.bag(path, messages, kind.partition("-")[2] or None)
    with BagReader(path) as reader:
        places = sorted(chunk.pos for chunk in reader.chunk_infos)
        times = {chunk.pos: (chunk.start_time, chunk.end_time) for chunk in reader.chunk_infos}
        held = [(received, bytes(data)) for _, received, data in reader.messages()]
    ends = [*places[1:], path.stat().st_size]
    return [
        Region(at, end, [one for one in held if times[at][0] <= one[0] <= times[at][1]])
        for at, end in zip(places, ends, strict=True)
    ]


def mcap(recorder: Any, path: Path, messages: list[Any], kind: str) -> list[Region]:
    packing = CompressionType.ZSTD if kind == "mcap-zstd" else CompressionType.NONE
    indexes = IndexType.NONE if kind == "mcap-no-index" else IndexType.ALL
    held = [(message.received, recorder.encode(message, "cdr")) for message in messages]
    with path.open("wb") as file:
        writer = McapWriter(
            file,
            chunk_size=4096,
            compression=packing,
            index_types=indexes,
            use_chunking=kind != "mcap-no-chunks",
            enable_crcs=kind != "mcap-no-crc",
        )
        writer.start("ros2")
        type_ = writer.register_schema("tf2_msgs/msg/TFMessage", "ros2msg", b"x")
        topic = writer.register_channel("/tf", "cdr", type_)
        for received, data in held:
            writer.add_message(topic, received, data, received)
        writer.finish()
    if kind == "mcap-no-chunks":
        raw, regions, at = path.read_bytes(), [], 0
        for one in held:
            at = raw.index(one[1], at)
            regions.append(Region(at - 31, at := at + len(one[1]), [one]))
        return regions
    if kind == "mcap-no-index":  # the same chunks, but the summary does not list them
        regions = mcap(recorder, path.with_name("indexed.mcap"), messages, "mcap")
        raw = path.read_bytes()
        starts = [match.start() for match in re.finditer(rb"\x06.{5}\0\0\0.{28}\0{4}", raw, re.S)]
        sizes = [9 + struct.unpack_from("<Q", raw, at + 1)[0] for at in starts]
        return [
            Region(at, at + size, region.messages)
            for at, size, region in zip(starts, sizes, regions, strict=True)
        ]
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    return [
        Region(
            chunk.chunk_start_offset,
            chunk.chunk_start_offset + chunk.chunk_length,
            [one for one in held if chunk.message_start_time <= one[0] <= chunk.message_end_time],
        )
        for chunk in summary.chunk_indexes
    ]


def flipped(raw: bytearray, at: int, rng: np.random.Generator) -> int:
    raw[at] ^= 1 << int(rng.integers(8))
    return at + 1


def zeroed(raw: bytearray, at: int, _rng: np.random.Generator) -> int:
    end = min(at + 512, len(raw))
    raw[at:end] = bytes(end - at)
    return end


def shortened(raw: bytearray, at: int, rng: np.random.Generator) -> int:
    end = min(at + int(rng.choice([1, 8, 700])), len(raw))
    del raw[at:end]
    return end


def lengthened(raw: bytearray, at: int, rng: np.random.Generator) -> int:
    raw[at:at] = rng.bytes(int(rng.choice([1, 8, 700])))
    return at + 1


def salvaged(path: Path) -> tuple[Found, tuple[Any, ...]]:
    with Recording(path, salvage=True) as recording:
        return [(received, data) for _, received, data in recording.messages()], recording.losses


@pytest.mark.parametrize("damage", [flipped, zeroed, shortened, lengthened])
@pytest.mark.parametrize("kind", KINDS)
def test_messages_with_intact_bytes_are_read(
    recorder: Any,
    messages: list[Any],
    tmp_path: Path,
    kind: str,
    damage: Callable[[bytearray, int, np.random.Generator], int],
) -> None:
    """Messages in a chunk are intact if the chunk is.

    Outside of the regions are declarations of topics, which have no second source.
    """
    path = tmp_path / f"a.{kind[:4].strip('-')}"
    make = bag if kind.startswith("bag") else mcap
    regions = make(recorder, path, messages[:300], kind)
    raw = path.read_bytes()
    whole = sorted(one for region in regions for one in region.messages)
    assert (sorted(salvaged(path)[0]), salvaged(path)[1]) == (whole, ())
    assert len(whole) == 300
    rng = np.random.default_rng(5)
    for at in rng.integers(regions[0].start, regions[-1].end, 25).tolist():
        damaged = bytearray(raw)
        end = damage(damaged, at, rng)
        path.write_bytes(damaged)
        found, losses = salvaged(path)
        for region in regions:
            if region.end <= at or region.start >= end:
                assert set(region.messages) <= set(found), (at, region.start)
        hurt = [region for region in regions if region.end > at and region.start < end]
        assert len(found) == len(set(found)), at
        changed = set(found) - set(whole)
        assert len(changed) <= sum(len(region.messages) for region in hurt), at
        if kind in ("mcap", "mcap-zstd", "mcap-no-index") and len(damaged) == len(raw):
            # Each chunk has a checksum, and none is cut short.
            assert set(found) <= set(whole), at
        assert losses or len(found) == len(whole), at


def test_each_byte_of_the_head_of_a_bag(recorder: Any, messages: list[Any], tmp_path: Path) -> None:
    """The head has the position of the index, and no message."""
    path = recorder.bag(tmp_path / "a.bag", messages[:200], "lz4")
    raw = path.read_bytes()
    whole = salvaged(path)[0]
    for at in range(13, 100):
        path.write_bytes(raw[:at] + bytes([raw[at] ^ 0x10]) + raw[at + 1 :])
        assert salvaged(path)[0] == whole, at


@pytest.mark.parametrize("suffix", [".bag", ".mcap"])
def test_damaged_first_bytes(
    recorder: Any, messages: list[Any], tmp_path: Path, suffix: str
) -> None:
    """The extension tells the kind of the file."""
    path = tmp_path / f"a{suffix}"
    regions = (bag if suffix == ".bag" else mcap)(recorder, path, messages[:200], suffix[1:])
    whole = sorted(one for region in regions for one in region.messages)
    raw = path.read_bytes()
    for damaged in (bytes([raw[0] ^ 1]) + raw[1:], bytes(40) + raw[40:]):
        path.write_bytes(damaged)
        with pytest.raises(RecordingError, match="neither a ROS 1 bag"):
            Recording(path)
        found, losses = salvaged(path)
        assert sorted(found) == whole
        assert losses[0].reason.startswith("its first bytes are damaged")
    path.write_text("no recording")
    with pytest.raises(RecordingError, match="neither a ROS 1 bag"):
        Recording(path, salvage=True)


def test_scrambled_bz2_data_are_not_used(
    recorder: Any, messages: list[Any], tmp_path: Path
) -> None:
    path = tmp_path / "a.bag"
    regions = bag(recorder, path, messages[:300], "bag-bz2")
    raw = path.read_bytes()
    whole = {one for region in regions for one in region.messages}
    chunk = regions[2]
    data = raw.index(b"BZh", chunk.start)
    for at in range(data + 60, data + 1000, 40):
        path.write_bytes(raw[:at] + bytes([raw[at] ^ 0x10]) + raw[at + 1 :])
        found, (loss,) = salvaged(path)
        assert set(found) == whole - set(chunk.messages), at
        assert loss.messages == len(chunk.messages)


def database(recorder: Any, messages: list[Any], tmp_path: Path) -> tuple[Path, list[int]]:
    """Write a `.db3` file; return it with the pages of its messages, in the order of rows."""
    folder = recorder.folder(tmp_path / "db3", messages[:300], "sqlite3")
    (path,) = folder.glob("*.db3")
    with sqlite3.connect(path) as opened:
        ((size,),) = opened.execute("PRAGMA page_size")
    raw = path.read_bytes()
    data = [recorder.encode(message, "cdr") for message in messages[:300]]
    return path, [raw.index(each) // size * size for each in data]


def test_rows_after_a_damaged_page_are_read(
    recorder: Any, messages: list[Any], tmp_path: Path
) -> None:
    path, pages = database(recorder, messages, tmp_path)
    raw = path.read_bytes()
    for page in sorted(set(pages)):
        path.write_bytes(raw[:page] + bytes(4096) + raw[page + 4096 :])
        rows = zip(messages[:300], pages, strict=True)
        intact = [message.received for message, at in rows if at != page]
        found, losses = salvaged(path)
        assert [received for received, _ in found] == intact, page
        assert losses


def test_an_intact_page_between_damaged_ones_is_read(
    recorder: Any, messages: list[Any], tmp_path: Path
) -> None:
    """The search in steps that double may step over it."""
    path, pages = database(recorder, messages, tmp_path)
    raw, each = path.read_bytes(), sorted(set(pages))
    for seed in range(20):
        damaged = set(random.Random(seed).sample(each, 2 * len(each) // 3))
        changed = bytearray(raw)
        for page in damaged:
            changed[page : page + 4096] = bytes(4096)
        path.write_bytes(changed)
        rows = zip(messages[:300], pages, strict=True)
        intact = [message.received for message, at in rows if at not in damaged]
        found, _ = salvaged(path)
        assert [received for received, _ in found] == intact, damaged


def test_a_row_with_a_wrong_number_hides_no_other(
    recorder: Any, messages: list[Any], tmp_path: Path
) -> None:
    """The numbers 100 to 299 are two bytes: a changed one is the largest of all."""
    path, pages = database(recorder, messages, tmp_path)
    raw = bytearray(path.read_bytes())
    page = pages[200]
    row = raw.index(recorder.encode(messages[200], "cdr"), page)
    number = bytes([0x80 | 201 >> 7, 201 & 0x7F])
    raw[raw.rindex(number, page, row)] |= 0x20
    path.write_bytes(raw)
    found, losses = salvaged(path)
    assert len(found) >= 299
    assert "out of order" in losses[0].reason
