"""A player shows in a store what the recording held at the time of the store's clock."""

from __future__ import annotations

import random
import threading
import warnings
from contextlib import ExitStack, contextmanager, suppress
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pytest

import tfdb
from tfdb import errors
from tfdb.player.controls import CONTROLS, KEYS, obey
from tfdb.player.player import SOURCE, Player
from tfdb.player.tape import tape_of
from tfdb.recordings.open_recordings import OpenRecordings
from tfdb.recordings.selection import Selection

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

SECOND = 10**9
PERIOD = SECOND // 100
START = 1_000 * SECOND
COUNT = 400
HISTORY = 1.0
LONGEST = 60.0  # seconds: a test that waits longer has failed
TURN = (0.0, 0.6, 0.0, 0.8)
EDGES = [("map", "base"), ("base", "arm"), ("base", "mast")]


class Message(NamedTuple):
    received: int
    transforms: list[tfdb.TransformStamped]
    static: bool


def one(parent: str, child: str, stamp: int) -> tfdb.TransformStamped:
    return tfdb.TransformStamped(parent, child, stamp, (stamp % 977, 2, 3), TURN)


def messages() -> list[Message]:
    """A fast edge, a slow one with late data, and statics at the beginning and in the middle."""
    made = [Message(START, [one("base", "mast", 0)], True)]
    for tick in range(COUNT):
        stamp = START + tick * PERIOD
        made.append(Message(stamp, [one("map", "base", stamp)], False))
        if tick % 10 == 3:
            late = [one("base", "arm", stamp - 2 * PERIOD), one("base", "arm", stamp - 5 * PERIOD)]
            made.append(Message(stamp + 1, late, False))
        if tick == COUNT // 2:
            made.append(Message(stamp + 2, [one("mast", "lamp", 0)], True))
    return made


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("player") / "drive.mcap"
    with tfdb.recordings.RecordingWriter(path) as writer:
        for received, transforms, static in messages():
            data = tfdb.encode_tf_message(transforms, writer.encoding)
            topic = "/tf_static" if static else "/tf"
            writer.write(data, received, topic=topic, static=static)
    return path


def states(store: tfdb.Buffer) -> dict[str, tuple[list[int], list[list[float]]]]:
    """Stamps and poses of all edges."""
    found = {}
    with store.snapshot() as state:
        for info in state.tree():
            if info.parent is not None:
                stamps, poses, *_ = state.samples(info.name)
                found[f"{info.parent}>{info.name}"] = (stamps.tolist(), np.asarray(poses).tolist())
    return found


def expected(at: int, *, shift: int = 0) -> dict[str, tuple[list[int], list[list[float]]]]:
    """What a store holds in which the messages up to a time are stored one by one."""
    store = tfdb.Buffer(HISTORY)
    for received, transforms, static in messages():
        if received <= at and static:
            store.set_transforms(transforms, static=True)
        elif received <= at:
            store.set_transforms(
                [one(t.parent, t.child, int(t.stamp) + shift) for t in transforms]
                if shift
                else transforms
            )
    return states(store)


@contextmanager
def playing(
    path: Path | list[Path], store: tfdb.Buffer, **options: object
) -> Iterator[tuple[Player, threading.Thread]]:
    """Run a player in a thread. At the end it is stopped, and what it raised is raised."""
    with OpenRecordings(path, Selection()) as recordings:
        player = Player(store, tape_of(recordings)[0], **options)  # type: ignore[arg-type]
        raised: list[BaseException] = []

        def run() -> None:
            try:
                player.run()
            except BaseException as error:
                raised.append(error)

        thread = threading.Thread(target=run)
        thread.start()
        try:
            yield player, thread
        finally:
            player.stop()
            thread.join()
        if raised:
            raise raised[0]


def settled(player: Player) -> None:
    """Wait until a player has done all that it was told."""
    done = threading.Event()
    player._orders.put(done.set)
    assert done.wait(LONGEST)


def begun(player: Player, store: tfdb.Buffer) -> None:
    """Wait until a paused player has played what was received first, and has paused the clock."""
    store.wait_for_transform("map", "base", timeout=LONGEST)
    settled(player)


def test_all_of_a_recording_is_played(recording: Path) -> None:
    store = tfdb.Buffer(HISTORY)
    with playing(recording, store, speed=float("inf")) as (player, thread):
        thread.join(LONGEST)
    assert player.tally.transforms == sum(len(message.transforms) for message in messages())
    assert states(store) == expected(10**18)
    assert store.clock.is_system


def test_each_message_is_one_commit(recording: Path) -> None:
    store = tfdb.Buffer(None)
    with playing(recording, store, speed=float("inf")) as (_, thread):
        thread.join(LONGEST)
    kept = [len(record.stored) + len(record.stored_static) for record in store.changes(1)[1:-1]]
    assert kept == [len(message.transforms) for message in messages()][-len(kept) :]


def test_the_clock_paces_the_messages(recording: Path) -> None:
    """Fast, but by the clock: no stamp is later than what the clock shows."""
    store = tfdb.Buffer(HISTORY)
    with playing(recording, store, speed=50.0) as (_, thread):
        while thread.is_alive():
            before = store.clock
            with store.snapshot() as state:
                shown = [info.newest or 0 for info in state.tree()]
            assert max(shown, default=0) <= before.now()
    assert states(store) == expected(10**18)


def test_steps_forth_and_back(recording: Path) -> None:
    store = tfdb.Buffer(HISTORY)
    with playing(recording, store, paused=True) as (player, _):
        begun(player, store)
        times = sorted({message.received for message in messages()})
        for place in range(1, 21):
            commit = store.commit
            player.step()
            settled(player)
            assert store.wait_for_commit(commit, LONGEST) == commit + 1
            assert player.position == times[place]
        assert states(store) == expected(times[20])
        for place in range(19, 10, -1):
            commit = store.commit
            player.step_back()
            settled(player)
            assert store.commit == commit + 1
            assert states(store) == expected(times[place])


@pytest.mark.parametrize("seed", range(3))
def test_no_reader_sees_the_future_or_an_empty_store(recording: Path, seed: int) -> None:
    random_number = random.Random(seed)
    store = tfdb.Buffer(HISTORY)
    ended = threading.Event()
    faults: list[str] = []

    def read() -> None:
        while not ended.is_set():
            before = store.clock.now()
            with store.snapshot() as state:
                infos = state.tree()
            after = store.clock.now()
            newest = max((info.newest or 0 for info in infos), default=0)
            if newest > max(before, after):
                faults.append(f"a stamp {newest} while the clock shows {before} to {after}")
            if not newest:
                faults.append(f"no sample in the store at {after}")

    with playing(recording, store, paused=True) as (player, _):
        begun(player, store)
        reader = threading.Thread(target=read)
        reader.start()
        for _ in range(80):
            kind = random_number.choice(("seek", "skip", "step", "back"))
            if player.position < START + SECOND // 2:
                kind = "step"  # there is a beginning of the recording
            if kind == "seek":
                player.seek(random_number.uniform(0.5, 3.9))
            elif kind == "skip":
                player.seek_by(random_number.choice((-0.2, 0.2)))
            elif kind == "step":
                player.step()
            else:
                player.step_back()
            settled(player)
            if player.position > START + 37 * SECOND // 10:
                player.seek(2.0)
                settled(player)
        ended.set()
        reader.join()
    assert not faults, faults[:3]


def test_a_jump_shows_the_state_of_straight_playing(recording: Path) -> None:
    store = tfdb.Buffer(HISTORY)
    with playing(recording, store, paused=True) as (player, _):
        begun(player, store)
        for seconds in (3.0, 0.5, 2.5, 2.0, 3.9, 0.031):
            player.seek(seconds)
            settled(player)
            assert states(store) == expected(START + round(seconds * SECOND))


@pytest.mark.parametrize("far", [3e9, 1e300])
def test_a_jump_beyond_all_stamps_goes_to_an_end(recording: Path, far: float) -> None:
    store = tfdb.Buffer(HISTORY)
    with playing(recording, store, paused=True) as (player, thread):
        begun(player, store)
        player.seek(2.0)
        player.seek(-far)
        settled(player)
        assert states(store) == expected(START)
        player.seek_by(far)
        settled(player)
        assert states(store) == expected(START + 10 * SECOND)
        player.seek(2.0)  # it is paused, and did not end
        settled(player)
        assert states(store) == expected(START + 2 * SECOND)
        player.seek_by(far)
        player.step()
        settled(player)
        player.pause()
        thread.join(LONGEST)
        assert not thread.is_alive()
    assert states(store) == expected(START + 10 * SECOND)


def test_any_process_may_set_the_clock(recording: Path, name: str) -> None:
    store = tfdb.Buffer.open(name, history=HISTORY)
    other = tfdb.Buffer.open(name)
    with playing(recording, store, paused=True) as (player, _):
        begun(player, other)
        for seconds in (3, 1):
            commit = other.commit
            other.clock.seek(START + seconds * SECOND)
            other.wait_for_commit(commit, LONGEST)
            assert states(other) == expected(START + seconds * SECOND)
        other.clock.speed = 1000.0
        other.clock.resume()
        while not player.rounds:
            assert other.clock.speed in (1000.0, 1.0)
    assert states(other) == expected(10**18)
    assert other.clock.is_system


def test_frames_of_other_writers_stay(recording: Path) -> None:
    store = tfdb.Buffer(HISTORY)
    store.set_transform("base", "gripper", 5, (1, 2, 3), TURN, authority="arm driver")
    with playing(recording, store, paused=True) as (player, _):
        begun(player, store)
        player.seek(2.0)
        settled(player)
        assert store.frame_info("gripper").samples == 1
        assert store.lookup_latest_transform("map", "gripper").translation[2] != 0


def test_the_later_player_takes_over(recording: Path) -> None:
    store = tfdb.Buffer(HISTORY)
    with ExitStack() as players:
        first, thread = players.enter_context(playing(recording, store, paused=True))
        begun(first, store)
        commit = store.commit
        with playing(recording, store, paused=True):
            store.wait_for_commit(commit, LONGEST)
            first.seek(1.0)
            thread.join(LONGEST)
            assert not store.clock.is_system  # it is the second one's
        with pytest.raises(errors.Fenced):
            players.close()
    assert store.positions() == []


def test_no_reader_sees_an_empty_store_when_a_player_takes_over(recording: Path) -> None:
    store = tfdb.Buffer(HISTORY)
    with playing(recording, store, speed=float("inf")) as (_, thread):
        thread.join(LONGEST)
    with store.snapshot() as held:
        with playing(recording, store, paused=True) as (player, _):
            settled(player)
            assert player.position == messages()[0].received
        assert states(store) == expected(messages()[0].received)
        for changes in store.changes(held.commit):
            with held.at(changes.commit) as state:
                assert any(info.samples for info in state.tree())


def test_played_frames_are_read_only_until_the_player_ends(recording: Path) -> None:
    store = tfdb.Buffer(HISTORY)
    with playing(recording, store, paused=True) as (player, _):
        begun(player, store)
        stamp = store.frame_info("base").newest
        assert stamp is not None
        with pytest.raises(errors.ReadOnly, match=f"it comes from source '{SOURCE}'"):
            store.set_transform("map", "base", stamp + 1, (1, 2, 3), TURN)
        store.set_transform("map", "own", stamp, (1, 2, 3), TURN)
    store.set_transform("map", "base", stamp + 1, (1, 2, 3), TURN)


def test_a_frame_of_another_writer_is_replaced_with_a_warning(recording: Path) -> None:
    store = tfdb.Buffer(HISTORY)
    store.set_transform("world", "base", 5, (1, 2, 3), TURN, authority="ekf")
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        with playing(recording, store, speed=float("inf")) as (_, thread):
            thread.join(LONGEST)
    assert any("frame 'base'" in str(each.message) for each in told)
    assert store.frame_info("base").parent == "map"


def test_each_round_has_later_stamps(recording: Path) -> None:
    store = tfdb.Buffer(None)
    with playing(recording, store, speed=float("inf"), loop=True) as (player, _):
        while player.rounds < 3:
            with suppress(errors.WaitTimeout):
                store.wait_for_commit(store.commit, 0.1)
    stamps = store.samples("base")[0]
    assert len(stamps) > 2 * COUNT
    assert (np.diff(stamps) > 0).all()
    assert stamps[2 * COUNT] - stamps[COUNT] == stamps[COUNT] - stamps[0]


def test_rounds_with_the_recorded_stamps(recording: Path) -> None:
    store = tfdb.Buffer(HISTORY)
    options = {"speed": float("inf"), "loop": True, "keep_stamps": True}
    with playing(recording, store, **options) as (player, _):
        while player.rounds < 3:
            with suppress(errors.WaitTimeout):
                store.wait_for_commit(store.commit, 0.1)
            assert (store.frame_info("base").newest or 0) <= START + COUNT * PERIOD
        assert player.shift == 0


@pytest.mark.parametrize("speed", [0.0, -1.0, float("nan")])
def test_bad_speeds(recording: Path, speed: float) -> None:
    with (
        OpenRecordings(recording, Selection()) as recordings,
        pytest.raises(errors.InvalidArgument, match="speed must be positive"),
    ):
        Player(tfdb.Buffer(), tape_of(recordings)[0], speed=speed)


def test_keys_and_controls_mean_the_same(recording: Path) -> None:
    store = tfdb.Buffer(HISTORY)
    with playing(recording, store, paused=True) as (player, _):
        begun(player, store)
        for line in KEYS.values():
            if line not in ("pause", "reverse", "quit"):
                obey(player, line)
        assert store.clock.speed == 9.0
        obey(player, "speed 2.5\n")
        assert store.clock.speed == 2.5
        obey(player, "faster")
        assert store.clock.speed == 3.125
        for bad in ("jump", "speed", "speed inf", "seek a", "step 3"):
            with pytest.raises(errors.InvalidArgument):
                obey(player, bad)
        for bad in ("speed 0", "speed -2"):
            with pytest.raises(errors.InvalidArgument, match="positive and finite, got"):
                obey(player, bad)
    assert {line.split()[0] for line in KEYS.values()} <= {word.split()[0] for word in CONTROLS}


def test_backwards_to_the_beginning(recording: Path) -> None:
    store = tfdb.Buffer(HISTORY)
    with playing(recording, store, paused=True) as (player, _):
        begun(player, store)
        player.seek(0.3)
        settled(player)
        positions = [player.position]
        player.reverse()
        while player.position > START:
            with suppress(errors.WaitTimeout):
                store.wait_for_commit(store.commit, 0.1)
            positions.append(player.position)
        assert positions == sorted(positions, reverse=True)
        assert len(positions) > 2


def test_kept_states_are_bounded(recording: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Jumps are right, however few states are kept."""
    monkeypatch.setattr("tfdb.player.player._KEPT_EVERY", 10)
    monkeypatch.setattr("tfdb.player.player._KEPT_BYTES", 50_000)
    store = tfdb.Buffer(None)
    with playing(recording, store, paused=True) as (player, _):
        begun(player, store)
        for seconds in (3.9, 1.0, 3.0, 0.2, 3.95):
            player.seek(seconds)
            settled(player)
            stamps = store.samples("base")[0]
            assert stamps.tolist() == list(range(START, player.position + 1, PERIOD))
        assert 1 < len(player._states) < 20
        assert sum(len(data) for _, data in player._states) <= 60_000
