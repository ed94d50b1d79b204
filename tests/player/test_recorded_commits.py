"""The commits of a recorder are played one by one: clears, removals and authorities included."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

import pytest
from mcap.reader import make_reader

import tfdb
from tests.stored import stored
from tfdb import errors
from tfdb.player.tape import CommitTape, MessageTape, tape_of
from tfdb.recordings.open_recordings import OpenRecordings
from tfdb.recordings.selection import Selection

from .test_player import begun, playing, settled

if TYPE_CHECKING:
    from pathlib import Path

TURN = (0.0, 0.6, 0.0, 0.8)
SECOND = 10**9


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Random commits of two writers, with all that TFMessages do not say."""
    choice = random.Random(11)
    buf = tfdb.Buffer(history=None)
    path = tmp_path_factory.mktemp("recorded") / "drive.mcap"
    pytest.importorskip("mcap")
    buf.set_static_transform("base", "camera", (1, 2, 3), TURN, authority="urdf")
    buf.set_transform("map", "base", 0, (0, 2, 3), TURN, authority="slam")
    with tfdb.Recorder(buf, path) as recorder:
        for step in range(1, 300):
            kind = choice.random()
            stamp = step * 10_000_000
            if kind < 0.02:
                buf.clear()
            elif kind < 0.05 and buf.frame_exists("gripper"):
                buf.remove_frames("gripper")
            elif kind < 0.4:
                late = stamp - choice.randrange(30_000_000)
                pose = (step, 2, 3), TURN
                buf.set_transform("base", "gripper", max(late, 0), *pose, authority="arm")
            else:
                buf.set_transform("map", "base", stamp, (step, 2, 3), TURN, authority="slam")
            if step % 10 == 0:
                recorder.flush()  # the next commits are read later
    return path


def test_a_recording_of_ours_is_played_by_commits(drive: Path) -> None:
    with OpenRecordings(drive, Selection()) as recordings:
        assert isinstance(tape_of(recordings)[0], CommitTape)
    with OpenRecordings(drive, Selection(exclude=["camera"])) as recordings:
        assert isinstance(tape_of(recordings)[0], MessageTape)


def test_the_played_store_equals_the_recorded_one(drive: Path) -> None:
    copy = tfdb.Buffer(history=None)
    for each in tfdb.recorded_commits(drive):
        copy.apply(each.data)
    store = tfdb.Buffer(history=None)
    with playing(drive, store, speed=float("inf")) as (_, thread):
        thread.join(60)
    assert stored(store) == stored(copy)
    assert store.frame_info("base").authority == "slam"


def test_recording_the_played_store_gives_the_same_recording(drive: Path, tmp_path: Path) -> None:
    store = tfdb.Buffer(history=None)
    with (
        tfdb.Recorder(store, tmp_path / "again.mcap"),
        playing(drive, store, speed=float("inf")) as (_, thread),
    ):
        thread.join(60)
    copies = [tfdb.Buffer(history=None), tfdb.Buffer(history=None)]
    for copy, path in zip(copies, (drive, tmp_path / "again.mcap"), strict=True):
        for each in tfdb.recorded_commits(path):
            copy.apply(each.data)
    assert stored(copies[0]) == stored(copies[1])


def test_split_files_are_played_in_the_order_of_their_commits(tmp_path: Path) -> None:
    buf = tfdb.Buffer(history=None)
    with tfdb.Recorder(buf, tmp_path / "drive.mcap", split_size=1, flush=0) as recorder:
        while len(recorder.files) < 11:  # a shell lists drive_10.mcap before drive_2.mcap
            buf.set_transform("map", "base", buf.commit, (buf.commit, 2, 3), TURN)
            buf.set_static_transform("base", "camera", (buf.commit, 2, 3), TURN)
            recorder.flush()
    store = tfdb.Buffer(history=None)
    with playing(sorted(recorder.files), store, speed=float("inf")) as (_, thread):
        thread.join(60)
    assert stored(store) == stored(buf)


def test_the_stores_of_two_recordings_are_played_together(tmp_path: Path) -> None:
    paths = [tmp_path / "a.mcap", tmp_path / "b.mcap"]
    for path in paths:
        buf = tfdb.Buffer(history=None)
        with tfdb.Recorder(buf, path):
            buf.set_transform(f"map_{path.stem}", f"base_{path.stem}", 1, (0, 2, 3), TURN)
    store = tfdb.Buffer(history=None)
    with playing(paths[::-1], store, speed=float("inf")) as (_, thread):
        thread.join(60)
    assert store.frames() == ["base_a", "base_b", "map_a", "map_b"]


@pytest.mark.parametrize("indexed", [True, False])
def test_jumps_show_the_state_of_the_commit(
    drive: Path, monkeypatch: pytest.MonkeyPatch, *, indexed: bool
) -> None:
    monkeypatch.setattr("tfdb.player.player._KEPT_EVERY", 20)
    if not indexed:
        monkeypatch.setattr("tfdb.recorder.commit_reader._index_of", lambda _: None)
    commits = list(tfdb.recorded_commits(drive))
    choice = random.Random(5)
    store = tfdb.Buffer(history=None)
    with playing(drive, store, paused=True) as (player, _):
        begun(player, store)
        times = sorted({each.time for each in commits})
        for at in (times[-2], *choice.choices(times[:-1], k=25)):
            player.seek((at - commits[0].time) / SECOND)
            settled(player)
            copy = tfdb.Buffer(history=None)
            for each in commits:
                if each.time <= player.position:
                    copy.apply(each.data)
            assert stored(store) == stored(copy)
        assert len(player._states) > 1


def test_a_jump_reads_the_file_near_the_moment(
    drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Damage of an earlier part, after it was played, stays unnoticed."""
    monkeypatch.setattr("tfdb.player.player._KEPT_EVERY", 20)
    commits = list(tfdb.recorded_commits(drive))
    path = tmp_path / "drive.mcap"
    path.write_bytes(drive.read_bytes())
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    store = tfdb.Buffer(history=None)
    with playing(path, store, paused=True) as (player, _):
        begun(player, store)
        player.seek((commits[-1].time - commits[0].time) / SECOND - 1e-9)
        settled(player)
        data = bytearray(path.read_bytes())
        data[summary.chunk_indexes[2].chunk_start_offset + 60] ^= 0xFF
        path.write_bytes(data)
        for at in (-40, -90, -150):
            player.seek((commits[at].time - commits[0].time) / SECOND)
            settled(player)
            copy = tfdb.Buffer(history=None)
            for each in commits:
                if each.time <= player.position:
                    copy.apply(each.data)
            assert stored(store) == stored(copy)
    with pytest.raises(errors.RecordingError, match="damaged"):
        list(tfdb.recorded_commits(path))


def test_rounds_of_commits_keep_their_stamps(drive: Path) -> None:
    store = tfdb.Buffer(history=None)
    with playing(drive, store, speed=float("inf"), loop=True) as (player, _):
        while player.rounds < 2:
            assert player.shift == 0
    assert store.positions() == []
