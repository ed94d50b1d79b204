"""Copies by `commits_bytes`, `state_bytes` and `apply`: equal after each commit, bit for bit."""

from __future__ import annotations

import random
import struct
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np
import pytest

import tfdb
from tfdb import errors

from .test_changes import NAMES, SEEDS, Writer, assert_same, pose

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.usefixtures("by_both_appliers")

KEEP = "local"


def assert_equal(copy: tfdb.Buffer, source: tfdb.Buffer) -> None:
    """The visible states of both are equal, except for commit numbers."""
    assert_same(copy, source)
    for theirs, ours in zip(source.tree(), copy.tree(), strict=True):
        assert theirs == ours
    assert [p.commit for p in copy.positions()] == [source.commit] * (source.commit > 0)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("filled", [1, 7, 64])
def test_a_copy_is_equal_after_each_sample(seed: int, filled: int) -> None:
    history = 60e-9 if seed % 2 else None
    source = tfdb.Buffer(history=history)
    copy = tfdb.Buffer(history=history)
    writer = Writer(seed)
    held = source.snapshot()
    seen = 0
    for _ in range(300):
        for _ in range(filled):
            writer.act(source)
        while data := source.commits_bytes(seen, max_commits=filled):
            seen = copy.apply(data).commit
        assert_equal(copy, source)
        held.close()
        held = source.snapshot()
    assert writer.refused > 10
    assert copy.commit == source.commit, "one commit here for each commit there"


@pytest.mark.parametrize("seed", SEEDS)
def test_a_state_replaces_all_that_its_source_had(seed: int) -> None:
    history = 60e-9 if seed % 2 else None
    source = tfdb.Buffer(history=history)
    copy = tfdb.Buffer(history=history)
    writer = Writer(seed)
    seen = 0
    for _ in range(60):
        for _ in range(20):
            writer.act(source)
        before = copy.commit
        with source.snapshot() as snap:
            position = copy.apply(snap.state_bytes())
            is_new = snap.commit > seen
        assert copy.commit == before + is_new
        assert position == copy.positions()[0]
        assert_equal(copy, source)
        while data := source.commits_bytes(position.commit, max_commits=3):
            position = copy.apply(data)
        seen = position.commit


def test_a_copy_with_a_shorter_history_is_copied_and_followed_itself() -> None:
    source = tfdb.Buffer(history=None)
    copy, second = tfdb.Buffer(history=10.0), tfdb.Buffer(history=10.0)
    for stamp in (100, 50, 101, 89, 95):
        source.set_transform("map", "base", stamp * 10**9, (stamp, 0, 0))
    with copy.follow() as stream:
        copy.apply(source.commits_bytes(0))
        assert second.apply(copy.commits_bytes(0)).commit == copy.commit == 5
        read = [stream.read_next() for _ in range(4)]
    assert [each and each.commit for each in read] == [1, 3, 5, None]
    assert [len(each.stored) for each in copy.changes(0)] == [1, 0, 1, 0, 1]
    assert_same(second, copy)
    stamps, _, _ = second.samples("base")
    assert stamps.tolist() == [95 * 10**9, 100 * 10**9, 101 * 10**9]


def test_samples_in_any_order_never_leave_a_gap() -> None:
    source, copy = tfdb.Buffer(), tfdb.Buffer()
    rng = random.Random(5)
    for i in range(200):
        source.set_transform("map", NAMES[i % 3], i, *pose(i))
    samples = [
        source.commits_bytes(since, max_commits=1 + rng.randrange(5)) for since in range(200)
    ] * 3
    rng.shuffle(samples)
    refused = 0
    for data in samples:
        before = copy.positions()[0].commit if copy.positions() else 0
        try:
            after = copy.apply(data).commit
        except errors.OutOfOrder as error:
            refused += 1
            assert error.since is not None
            assert error.since > before
        else:
            assert after >= before
        assert copy.commit == (copy.positions()[0].commit if copy.positions() else 0)
    assert refused > 50
    seen = copy.positions()[0].commit if copy.positions() else 0
    while data := source.commits_bytes(seen):
        seen = copy.apply(data).commit
    assert_equal(copy, source)


def test_prefixes_and_shared_frames_of_several_sources() -> None:
    robots = [tfdb.Buffer(), tfdb.Buffer()]
    fleet = tfdb.Buffer()
    for number, robot in enumerate(robots):
        robot.set_transform("map", "base", 10, *pose(number + 1), authority="slam")
        robot.set_static_transform("base", "camera", *pose(5))
        fleet.apply(
            robot.commits_bytes(0), source=f"r{number}", prefix=f"r{number}/", shared=["map"]
        )
    assert fleet.frames() == ["map", "r0/base", "r0/camera", "r1/base", "r1/camera"]
    ours = fleet.lookup_transform("r0/camera", "r1/camera", 10)
    camera = [robot.lookup_transform("camera", "map", 10).matrix for robot in robots]
    assert np.allclose(ours.matrix, camera[0] @ np.linalg.inv(camera[1]))
    assert fleet.frame_info("r0/base").authority == "slam"
    assert [p.source for p in fleet.positions()] == ["r0", "r1"]
    robots[0].remove_frames("map", recursive=True)
    fleet.apply(robots[0].commits_bytes(2), source="r0", prefix="r0/", shared=["map"])
    assert fleet.frames() == ["map", "r1/base", "r1/camera"], "the other robot still uses map"


def test_overlapping_and_changed_prefixes_are_refused() -> None:
    source, copy = tfdb.Buffer(), tfdb.Buffer()
    source.set_transform("map", "base", 10, *pose(1))
    data = source.commits_bytes(0)
    copy.apply(data, source="a", prefix="robot")
    for prefix in ("robot1/", "", "rob"):
        with pytest.raises(tfdb.InvalidArgument, match="overlaps prefix 'robot' of source 'a'"):
            copy.apply(data, source="b", prefix=prefix)
    with pytest.raises(tfdb.InvalidArgument, match="with prefix 'robot', not 'r/'"):
        copy.apply(data, source="a", prefix="r/")
    assert copy.frames() == ["robotbase", "robotmap"]


def test_a_root_hangs_under_a_local_frame_until_its_source_gives_it_a_parent() -> None:
    source, copy = tfdb.Buffer(), tfdb.Buffer()
    source.set_transform("odom", "base", 10, *pose(1))
    copy.apply(source.commits_bytes(0), prefix="r/")
    copy.set_static_transform("world", "r/odom", *pose(2))
    source.set_transform("odom", "base", 20, *pose(3))
    copy.apply(source.commits_bytes(1), prefix="r/")
    with source.snapshot() as snap:
        source.set_transform("odom", "base", 30, *pose(4))
        source.remove_frames("base")
        source.set_transform("odom", "base", 40, *pose(4))
        copy.apply(source.commits_bytes(2), prefix="r/")
        assert snap.commit == 2
    with source.snapshot() as snap:
        source.set_transform("odom", "base", 50, *pose(4))
    with source.snapshot() as snap:
        copy.apply(snap.state_bytes(), prefix="r/")
    assert copy.parent_of("r/odom") == "world"
    assert copy.lookup_transform("world", "r/base", 50).source == "r/base"
    source.set_static_transform("map", "odom", *pose(6))
    with pytest.warns(
        tfdb.errors.TfdbWarning, match="frame 'r/odom' lost the parent that was stored here: source"
    ):
        copy.apply(source.commits_bytes(source.commit - 1), prefix="r/")
    assert copy.parent_of("r/odom") == "r/map"
    assert copy.frame_exists("world")


def test_a_removed_frame_stays_for_local_children() -> None:
    source, copy = tfdb.Buffer(), tfdb.Buffer()
    source.set_transform("map", "base", 10, *pose(1))
    copy.apply(source.commits_bytes(0))
    copy.set_static_transform("base", "sticker", *pose(2))
    source.remove_frames("base")
    copy.apply(source.commits_bytes(1))
    assert copy.frames() == ["base", "map", "sticker"]
    assert copy.parent_of("base") is None
    copy.remove_frames("sticker")
    source.set_transform("map", "base", 20, *pose(3))
    copy.apply(source.commits_bytes(2))
    assert_same(copy, source)


def test_chosen_frames() -> None:
    source, copy = tfdb.Buffer(), tfdb.Buffer()
    for i in range(30):
        source.set_transform("map", NAMES[i % 3], i, *pose(i))
    data = source.commits_bytes(0, frames=NAMES[1], max_commits=4)
    assert copy.apply(data).commit == 11
    assert copy.frames() == [NAMES[1], "map"]
    while data := source.commits_bytes(copy.positions()[0].commit, frames=NAMES[1]):
        copy.apply(data)
    assert copy.positions()[0].commit == source.commit
    assert np.array_equal(copy.samples(NAMES[1])[1], source.samples(NAMES[1])[1])
    cut = tfdb.Buffer()
    with source.snapshot() as snap:
        cut.apply(snap.state_bytes(frames=[NAMES[1], NAMES[2]], newest=2))
    assert cut.frames() == [NAMES[1], NAMES[2], "map"]
    assert cut.samples(NAMES[2])[0].tolist() == source.samples(NAMES[2])[0].tolist()[-2:]


@pytest.mark.parametrize("seed", SEEDS)
def test_a_state_has_the_newest_samples_of_each_edge(seed: int) -> None:
    source = tfdb.Buffer(history=60e-9 if seed % 2 else None)
    writer, rng = Writer(seed), random.Random(seed)
    held = source.snapshot()
    for number in range(600):
        writer.act(source)
        if number % 3 == 0:  # late samples and evictions
            with suppress(errors.TooOld):
                source.set_transform("map", "late", rng.randrange(5, 200), *pose(number))
        if number % 50 == 49:
            held.close()
            held = source.snapshot()
        if number % 20:
            continue
        for newest in (1, 2, rng.randrange(3, 80)):
            cut = tfdb.Buffer(history=None)
            cut.apply(held.state_bytes(newest=newest))
            assert cut.frames() == held.frames()
            for name in held.frames():
                expected, got = held.samples(name), cut.samples(name)
                first = max(len(expected[0]) - newest, 0)
                for theirs, ours in zip(expected[:2], got[:2], strict=True):
                    assert np.array_equal(theirs[first:], ours)


def test_a_copy_of_frames_that_are_missing_at_first() -> None:
    source, copy = tfdb.Buffer(), tfdb.Buffer()
    source.set_transform("map", "base", 10, *pose(1))
    data = state_of(source, ["later"])
    assert copy.apply(data).commit == 1
    assert copy.frames() == []
    source.set_transform("map", "later", 20, *pose(2))
    copy.apply(source.commits_bytes(1, frames="later"))
    assert copy.frames() == ["later", "map"]
    assert copy.lookup_transform("map", "later", 20) == source.lookup_transform("map", "later", 20)
    for call in (
        source.snapshot().state_bytes,
        lambda frames: source.commits_bytes(0, frames=frames),
    ):
        with pytest.raises(errors.InvalidName, match="frame name ''"):
            call(frames=["base", ""])


@pytest.mark.parametrize("seed", SEEDS)
def test_chosen_frames_in_samples_of_any_size(seed: int) -> None:
    """Chosen frames are removed and made again, within a sample and after it."""
    source = tfdb.Buffer(history=None)
    writer = Writer(seed)
    copies = {most: tfdb.Buffer(history=None) for most in (1, 5, 10_000)}
    seen = dict.fromkeys(copies, 0)
    with source.snapshot() as held:
        for _ in range(200):
            writer.act(source)
        for most, copy in copies.items():
            while seen[most] < source.commit:
                data = source.commits_bytes(seen[most], max_commits=most, frames=NAMES[:2])
                seen[most] = copy.apply(data).commit
        assert held.commit == 0
    whole = copies.pop(10_000)
    assert whole.commit > 20
    for copy in copies.values():
        assert_same(copy, whole)


def test_limits_of_a_sample() -> None:
    source = tfdb.Buffer()
    assert source.commits_bytes(0) == b""
    columns = tfdb.Columns(
        "map", "base", np.arange(1000), np.tile([1.0, 2, 3, 0, 0, 0, 1], (1000, 1))
    )
    columns.poses[:, 0] = np.arange(1000)
    source.set_transforms(columns)
    for i in range(100):
        source.set_transform("map", "base", 1000 + i, *pose(i))
    alone = source.commits_bytes(0, max_bytes=100)
    assert tfdb.Buffer().apply(alone).commit == 1
    assert len(alone) > 1000
    small = source.commits_bytes(1, max_bytes=1000)
    assert 900 < len(small) <= 1000
    copy = tfdb.Buffer()
    copy.apply(alone)
    assert copy.apply(small).commit < 30
    with pytest.raises(tfdb.InvalidArgument, match="no commit 1000 yet"):
        source.commits_bytes(1000)
    with pytest.raises(tfdb.InvalidArgument, match="max_commits"):
        source.commits_bytes(0, max_commits=0)


def test_samples_that_are_gone() -> None:
    source = tfdb.Buffer()
    source.set_transform("map", "base", 10, *pose(1))
    source.remove_frames("base")
    with pytest.raises(errors.Gone, match="commit 1 stored of frame 'base'") as caught:
        source.commits_bytes(0)
    assert (caught.value.edge, caught.value.commit) == ("base", 1)
    for i in range(20_000):
        source.set_transform("map", "base", i, *pose(i))
    with pytest.raises(errors.FeedLapped):
        source.commits_bytes(0)


def test_epochs() -> None:
    old, new = tfdb.Buffer(), tfdb.Buffer()
    assert new.epoch > old.epoch
    assert len(new.epoch.id) == 16
    copy = tfdb.Buffer()
    for source in (old, new):
        source.set_transform("map", "base", 10, *pose(1))
    copy.apply(old.commits_bytes(0))
    with pytest.raises(errors.OutOfOrder, match=r"is later than .* apply a state"):
        copy.apply(new.commits_bytes(0))
    with new.snapshot() as snap:
        position = copy.apply(snap.state_bytes())
    assert position.epoch == new.epoch
    with old.snapshot() as snap, pytest.raises(errors.Fenced, match="has ended"):
        copy.apply(snap.state_bytes())
    with pytest.raises(errors.Fenced):
        copy.apply(old.commits_bytes(0))
    new.set_transform("map", "base", 20, *pose(1))
    with pytest.raises(errors.OutOfOrder, match="nothing of source 'x' has been applied yet"):
        copy.apply(new.commits_bytes(1), source="x", prefix="x/")


def test_a_frozen_state_goes_on_by_commits(tmp_path: Path) -> None:
    source = tfdb.Buffer()
    writer = Writer(3)
    for _ in range(200):
        writer.act(source)
    source.freeze(tmp_path / "state.tfdb")
    copy = tfdb.Buffer()
    frozen = tfdb.open(tmp_path / "state.tfdb")
    assert isinstance(frozen, tfdb.Buffer)
    assert frozen.commits_bytes(frozen.commit) == b""
    with frozen.snapshot() as snap:
        position = copy.apply(snap.state_bytes())
    assert position.epoch == source.epoch
    assert_equal(copy, source)
    with source.snapshot():
        for _ in range(50):
            writer.act(source)
        copy.apply(source.commits_bytes(position.commit))
    assert_equal(copy, source)


def test_a_frozen_store_sends_chosen_frames_and_takes_nothing(tmp_path: Path) -> None:
    robot, source, copy = tfdb.Buffer(), tfdb.Buffer(), tfdb.Buffer()
    for frame in NAMES[:2]:
        robot.set_transform("map", frame, 10, *pose(1))
    source.apply(robot.commits_bytes(0), source="robot")
    source.freeze(tmp_path / "state.tfdb")
    frozen = tfdb.open(tmp_path / "state.tfdb")
    assert isinstance(frozen, tfdb.Buffer)
    assert frozen.positions() == []
    for name in ("robot", "other"):
        with pytest.raises(errors.ReadOnly, match=r"state\.tfdb is frozen.*another Buffer"):
            frozen.forget_source(name)
    for data in (robot.commits_bytes(0), state_of(robot), state_of(robot, NAMES[:1])):
        with pytest.raises(errors.ReadOnly, match="is frozen"):
            frozen.apply(data, source="robot")
    assert frozen.commits_bytes(frozen.commit, frames=NAMES[0]) == b""
    with pytest.raises(errors.FeedLapped):
        frozen.commits_bytes(0, frames=NAMES[0])
    assert state_of(frozen, NAMES[:1]) == state_of(source, NAMES[:1])
    position = copy.apply(state_of(frozen, NAMES[:1]))
    assert copy.frames() == sorted([NAMES[0], "map"])
    before = robot.commit
    for frame in NAMES[:2]:
        robot.set_transform("map", frame, 20, *pose(2))
    source.apply(robot.commits_bytes(before), source="robot")
    with pytest.raises(errors.OutOfOrder, match="other frames"):
        copy.apply(source.commits_bytes(position.commit))
    copy.apply(source.commits_bytes(position.commit, frames=NAMES[:1]))
    assert copy.samples(NAMES[0])[0].tolist() == [10, 20]
    assert copy.frames() == sorted([NAMES[0], "map"])


@pytest.mark.parametrize(
    "concurrency", ["giant", "fine", "2pl-no-wait", "2pl-wait-die", "2pl-wound-wait", "silo"]
)
def test_other_engines_send_chosen_frames_and_take_nothing(
    concurrency: tfdb.types.Concurrency,
) -> None:
    source, copy = tfdb.Buffer(concurrency=concurrency), tfdb.Buffer()
    for frame in NAMES[:2]:
        source.set_transform("map", frame, 10, *pose(1))
    for data in (state_of(source), state_of(source, NAMES[:1])):
        with pytest.raises(errors.NotSupported, match=f"in the engine '{concurrency}'"):
            source.apply(data)
    with pytest.raises(errors.NotSupported, match=f"in the engine '{concurrency}': only in the"):
        source.forget_source("robot")
    assert (source.positions(), source.commit) == ([], 2)
    position = copy.apply(state_of(source, NAMES[:1]))
    assert copy.frames() == sorted([NAMES[0], "map"])
    source.set_transform("map", NAMES[0], 20, *pose(2))
    if concurrency == "giant":
        copy.apply(source.commits_bytes(position.commit, frames=NAMES[:1]))
    else:
        with pytest.raises(errors.NotSupported, match=f"'{concurrency}' keeps no feed"):
            source.commits_bytes(position.commit, frames=NAMES[:1])
        copy.apply(state_of(source, NAMES[:1]))
    assert copy.samples(NAMES[0])[0].tolist() == [10, 20]


def test_damaged_bytes_change_nothing() -> None:
    source = tfdb.Buffer()
    writer = Writer(1)
    rng = random.Random(9)
    with source.snapshot():
        for _ in range(40):
            writer.act(source)
        snap = source.snapshot()
        whole = [source.commits_bytes(0), snap.state_bytes()]
    copy = tfdb.Buffer()
    for data in whole:
        for size in [*range(60), *(rng.randrange(len(data)) for _ in range(200))]:
            with pytest.raises(tfdb.errors.CorruptMessage):
                copy.apply(data[:size])
        for _ in range(400):
            broken = bytearray(data)
            broken[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
            with pytest.raises(tfdb.errors.CorruptMessage, match="corrupt message at byte"):
                copy.apply(broken)
    assert copy.commit == 0
    assert copy.positions() == []
    with pytest.raises(TypeError, match="data must be bytes-like, got str"):
        copy.apply("TFDB")  # type: ignore[arg-type]


def resealed(data: bytes) -> bytes:
    """Return the bytes with a new checksum (CRC-32C, bit by bit)."""
    total = 0xFFFFFFFF
    for byte in data[:-4]:
        total ^= byte
        for _ in range(8):
            total = total >> 1 ^ (0x82F63B78 if total & 1 else 0)
    return data[:-4] + struct.pack("<I", total ^ 0xFFFFFFFF)


def test_bytes_of_a_sound_checksum_are_judged() -> None:
    source = tfdb.Buffer()
    for i in range(3):
        source.set_transform("map", "base", 10 * i, *pose(i))
    data = source.commits_bytes(0)
    assert resealed(data) == data
    for at, value, text in (
        (4, 1, "version 1: this program reads version 0"),
        (5, 3, "kind 3: commits are 1, a state 2"),
        (6, 1, "unknown flags"),
        (7, 1, "unknown flags"),
    ):
        broken = bytearray(data)
        broken[at] = value
        with pytest.raises(tfdb.errors.CorruptMessage, match=text) as caught:
            tfdb.Buffer().apply(resealed(bytes(broken)))
        assert caught.value.offset is not None
    for old, new, error in (
        (b"base", b"ba\xffe", tfdb.errors.InvalidName),
        (b"base", b"ba\x01e", tfdb.errors.InvalidName),
        (b"\x03map", b"\x04map", tfdb.errors.CorruptMessage),
    ):
        assert data.count(old) == 1
        copy = tfdb.Buffer()
        with pytest.raises(error):
            copy.apply(resealed(data.replace(old, new)))
        assert copy.frames() == []
    rng = random.Random(2)
    copy = tfdb.Buffer()
    for _ in range(3000):
        broken = bytearray(data)
        for _ in range(1 + rng.randrange(3)):
            broken[rng.randrange(8, len(data) - 4)] = rng.choice((0, 1, 0x7F, 0x80, 0xFF))
        try:
            copy.apply(resealed(bytes(broken)))
        except tfdb.TfdbError:
            continue
        for frame in copy.frames():
            assert np.isfinite(copy.samples(frame)[1]).all()


def test_refusals_of_the_store() -> None:
    source = tfdb.Buffer()
    source.set_transform("map", "base", 10, *pose(1))
    copy = tfdb.Buffer()
    small = tfdb.Buffer(max_frames=1)
    with pytest.raises(tfdb.errors.CapacityExceeded):
        small.apply(source.commits_bytes(0))
    assert small.frames() == []
    with pytest.raises(tfdb.errors.NotSupported):
        tfdb.Buffer(concurrency="silo").apply(source.commits_bytes(0))
    with copy.transaction(), pytest.raises(tfdb.errors.TransactionActive):
        copy.apply(source.commits_bytes(0))


def test_bytes_a_transform() -> None:
    """The sizes in `docs/wire.md`: twenty commits of ten edges in a sample."""
    source = tfdb.Buffer()
    rng = np.random.default_rng(1)
    for turns in (False, True):
        start = source.commit
        for _ in range(20):
            members = []
            for joint in range(10):
                number = rng.standard_normal(4)
                members.append(
                    tfdb.TransformStamped(
                        "base" if joint == 0 else f"joint{joint - 1}",
                        f"joint{joint}",
                        1_700_000_000_000_000_000 + 10_000_000 * (source.commit + 1),
                        (0.1, 0.2, 0.3) if turns else rng.standard_normal(3),
                        number / np.linalg.norm(number),
                    )
                )
            source.set_transforms(members)
        size = len(source.commits_bytes(start)) / 200
        assert size <= (40 if turns else 62)


def test_a_parent_that_was_not_chosen_goes_with_its_source() -> None:
    source, copy = tfdb.Buffer(), tfdb.Buffer()
    source.set_transform("p", "x", 5, *pose(1))
    source.set_transform("q", "x", 6, *pose(2))
    position = copy.apply(source.commits_bytes(0, frames="x"))
    source.remove_frames("p")
    source.set_transform("p", "x", 7, *pose(3))
    copy.apply(source.commits_bytes(position.commit, frames="x"))
    for buf in (source, copy):
        assert buf.samples("x")[2] == ["", "q", "p"]
        with pytest.raises(tfdb.Disconnected):
            buf.lookup_transform("p", "x", 5)


def test_a_local_static_parent_does_not_stop_its_source() -> None:
    source, copy = tfdb.Buffer(), tfdb.Buffer()
    source.set_transform("map", "x", 5, *pose(1))
    copy.apply(source.commits_bytes(0))
    source.clear()
    copy.apply(source.commits_bytes(1))
    copy.set_static_transform("world", "x", *pose(2))
    source.set_transform("map", "x", 6, *pose(3))
    with pytest.warns(
        errors.TfdbWarning, match="frame 'x' lost the parent that was stored here: source"
    ):
        copy.apply(source.commits_bytes(2))
    assert copy.parent_of("x") == "map"


def test_authorities_and_names_are_judged() -> None:
    source = tfdb.Buffer()
    source.set_transform("map", "base", 10, *pose(1), authority="slam")
    data = source.commits_bytes(0)
    for old, new, text in (
        (b"slam", b"sl\xffm", "authority 'sl.*m' of source '' is not valid"),
        (b"base", b"ba\x00e", "control character"),
    ):
        copy = tfdb.Buffer()
        with pytest.raises(errors.InvalidName, match=text):
            copy.apply(resealed(data.replace(old, new)))
        assert copy.commit == 0


def state_of(source: tfdb.Buffer, frames: list[str] | None = None) -> bytes:
    with source.snapshot() as snap:
        return snap.state_bytes(frames=frames)


def test_samples_of_other_frames_are_refused() -> None:
    source, copy = tfdb.Buffer(), tfdb.Buffer()
    for i in range(12):
        source.set_transform("map", NAMES[i % 3], i, *pose(i))
    x, y, z = NAMES[:3]
    copy.apply(source.commits_bytes(0, max_commits=6))
    for frames in ([x], [x, y, z], []):
        for since in (6, 4, 0):  # after the position, across it, and all applied commits again
            data = source.commits_bytes(since, frames=frames)
            with pytest.raises(errors.OutOfOrder, match=r"other frames.*apply a state") as caught:
                copy.apply(data)
            assert (caught.value.since, caught.value.commit) == (since, 6)
    assert copy.commit == 6
    position = copy.apply(state_of(source, [x, y]))
    assert copy.frames() == [x, y, "map"]
    source.set_transform("map", y, 100, *pose(1))
    with pytest.raises(errors.OutOfOrder, match="other frames"):
        copy.apply(source.commits_bytes(position.commit))
    position = copy.apply(source.commits_bytes(position.commit, frames=[y, x, y]))
    assert position.commit == source.commit
    assert copy.samples(y)[0].tolist()[-1] == 100
    # At the same commit a state of other frames is applied; an older one is refused.
    assert copy.apply(state_of(source)).commit == source.commit
    assert_same(copy, source)
    old = state_of(source, [x])
    source.set_transform("map", z, 100, *pose(1))
    copy.apply(source.commits_bytes(position.commit))
    before = copy.commit
    with pytest.raises(errors.OutOfOrder, match=r"is older than commit 14.*apply a newer state"):
        copy.apply(old)
    assert copy.commit == before
    assert_equal_but_number(copy, source)


def assert_equal_but_number(copy: tfdb.Buffer, source: tfdb.Buffer) -> None:
    assert_same(copy, source)
    assert copy.tree() == source.tree()


def test_samples_with_other_shared_frames_are_refused() -> None:
    source, copy = tfdb.Buffer(), tfdb.Buffer()
    source.set_transform("map", "base", 10, *pose(1))
    copy.apply(source.commits_bytes(0), prefix="r/", shared=["map", "earth"])
    source.set_transform("map", "base", 20, *pose(2))
    data = source.commits_bytes(1)
    for shared in ([], ["map"], "earth"):
        with pytest.raises(errors.OutOfOrder, match=r"other shared frames \(shared=\).*state"):
            copy.apply(data, prefix="r/", shared=shared)
    copy.apply(data, prefix="r/", shared=["earth", "map"])
    assert copy.frames() == ["map", "r/base"]
    copy.apply(state_of(source), prefix="r/")
    assert copy.frames() == ["r/base", "r/map"], "what was shared goes, as it was this source's"


def test_a_forgotten_source_goes_on_by_any_state() -> None:
    # The second has the earlier epoch, like a robot whose clock starts too early.
    second, first = tfdb.Buffer(), tfdb.Buffer()
    first.set_transform("map", "base", 10, *pose(1))
    first.set_transform("map", "arm", 10, *pose(1))
    second.set_transform("map", "base", 20, *pose(2))
    copy = tfdb.Buffer()
    assert copy.forget_source("robot") is False
    assert copy.commit == 0
    copy.apply(first.commits_bytes(0), source="robot")
    for data in (state_of(second), second.commits_bytes(0)):
        with pytest.raises(errors.Fenced, match=r"call forget_source\('robot'\)"):
            copy.apply(data, source="robot")
    before = copy.commit
    assert copy.forget_source("robot") is True
    assert copy.commit == before + 1
    assert copy.changes(before)[0].stored.stamps.size == 0
    assert copy.positions() == []
    assert_same(copy, first)
    assert copy.forget_source("robot") is False
    with pytest.raises(errors.OutOfOrder, match="source 'robot' was forgotten: apply a state"):
        copy.apply(second.commits_bytes(0), source="robot")
    position = copy.apply(state_of(second), source="robot")
    assert copy.positions() == [position]
    assert_same(copy, second)
    assert copy.frames() == ["base", "map"], "what the source had before is gone"
    with pytest.raises(tfdb.InvalidArgument, match="was applied with prefix '', not 'r/'"):
        copy.apply(state_of(second), source="robot", prefix="r/")
    with pytest.raises(errors.NotSupported):
        tfdb.Buffer(concurrency="silo").forget_source("robot")
    with copy.transaction(), pytest.raises(errors.TransactionActive):
        copy.forget_source("robot")
    with pytest.raises(TypeError, match="source must be a str"):
        copy.forget_source(None)  # type: ignore[arg-type]


def test_cleared_edges_come_through_a_chain_of_copies() -> None:
    source, first, second = tfdb.Buffer(), tfdb.Buffer(), tfdb.Buffer()
    source.set_transform("map", "base", 10, *pose(1), authority="slam")
    source.set_transform("map", "arm", 10, *pose(1), authority="arm")
    source.clear()
    source.set_transform("map", "arm", 20, *pose(1))
    first.apply(state_of(source))
    second.apply(first.commits_bytes(0))
    assert source.frame_info("base").cleared
    assert first.tree() == source.tree()
    assert second.frame_info("base").cleared
    third = tfdb.Buffer()
    third.apply(state_of(second))
    assert third.tree() == second.tree()
    # A state replaces the copy's data, whose edge still has samples.
    source.set_transform("map", "base", 30, *pose(1), authority="other")
    first.apply(source.commits_bytes(4))
    source.clear()
    first.apply(state_of(source))
    assert first.tree() == source.tree()


def test_a_frame_kept_for_a_local_child_goes_with_the_next_state() -> None:
    source, copy = tfdb.Buffer(), tfdb.Buffer()
    source.set_transform("map", "base", 10, *pose(1))
    source.set_transform("base", "arm", 10, *pose(2))
    source.set_transform("map", "arm", 20, *pose(2))
    copy.apply(source.commits_bytes(0))
    copy.set_static_transform("base", "sticker", *pose(3))
    source.remove_frames("base")
    copy.apply(source.commits_bytes(3))
    assert copy.parent_of("base") is None, "its own samples are gone"
    # Samples with the frame as parent do not change; at the source it is a new frame.
    assert copy.lookup_transform("sticker", "arm", 10).stamp == 10
    with pytest.raises(tfdb.UnknownFrame):
        source.lookup_transform("base", "arm", 10)
    copy.remove_frames("sticker")
    source.set_transform("map", "arm", 30, *pose(4))
    copy.apply(source.commits_bytes(4))
    assert "base" in copy.frames()
    source.set_transform("map", "arm", 40, *pose(4))
    copy.apply(state_of(source))
    assert_same(copy, source)


@pytest.mark.parametrize("shared", [(), ("map",)])
def test_a_kept_frame_that_its_source_makes_again_is_read_only_again(shared: tuple[str]) -> None:
    source, copy = tfdb.Buffer(), tfdb.Buffer()
    source.set_transform("map", "base", 10, *pose(1))
    copy.apply(source.commits_bytes(0), source="robot", prefix="r/", shared=shared)
    root = "map" if shared else "r/map"
    copy.set_static_transform(root, "sticker", *pose(2))
    source.remove_frames("map", recursive=True)
    source.set_transform("map", "base", 20, *pose(3))
    copy.apply(source.commits_bytes(1), source="robot", prefix="r/", shared=shared)
    with pytest.raises(errors.ReadOnly, match="comes from source 'robot'"):
        copy.remove_frames(root, recursive=True)
    assert copy.samples("r/base")[2] == [root]


def test_normalised_quaternions_are_copied_bit_for_bit() -> None:
    draw = np.random.default_rng(3)
    turns = draw.normal(size=(20_000, 4))
    turns *= (draw.uniform(0.999, 1.001, 20_000) / np.linalg.norm(turns, axis=1))[:, None]
    source, by_commits, by_state = (tfdb.Buffer(history=None) for _ in range(3))
    source.set_transforms(
        [
            tfdb.TransformStamped("map", "base", stamp, (0.0, 0.0, 0.0), tuple(turn))
            for stamp, turn in enumerate(turns.tolist())
        ]
    )
    by_commits.apply(source.commits_bytes(0))
    by_state.apply(state_of(source))
    for copy in (by_commits, by_state):
        assert copy.samples("base")[1].tobytes() == source.samples("base")[1].tobytes()


def test_two_sources_of_one_shared_edge_replace_each_other() -> None:
    robots = [tfdb.Buffer(), tfdb.Buffer()]
    fleet = tfdb.Buffer()
    for number, robot in enumerate(robots):
        for stamp in (10, 20):
            robot.set_transform("earth", "map", stamp + number, *pose(number + 1))
        name = f"r{number}"
        data = robot.commits_bytes(0)
        if number == 0:
            fleet.apply(data, source=name, prefix=f"{name}/", shared=["earth", "map"])
        else:
            with pytest.warns(
                errors.TfdbWarning, match="frame 'map' lost the parent that was stored here: source"
            ):
                fleet.apply(data, source=name, prefix=f"{name}/", shared=["earth", "map"])
    assert fleet.samples("map")[0].tolist() == [11, 21], "the other's are dropped"
    robots[0].set_transform("earth", "map", 30, *pose(1))
    fleet.apply(robots[0].commits_bytes(2), source="r0", prefix="r0/", shared=["earth", "map"])
    assert fleet.samples("map")[0].tolist() == [30]
