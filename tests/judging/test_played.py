"""A played store is judged by its clock: as the recording itself, whatever the pace."""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING

import pytest

import tfdb
from tests.player.test_player import begun, playing
from tfdb.judging import Event, Expectation
from tfdb.judging.proposing import judge_recording, recorded_arrivals

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

S = 10**9
START = 1_000 * S
TURN = (0.0, 0.6, 0.0, 0.8)


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """34 s at 10 Hz: base is silent from 6 s to 12 s, steps aside at 16 s, and is late at 20 s."""
    path = tmp_path_factory.mktemp("played") / "drive.mcap"
    with tfdb.recordings.RecordingWriter(path) as writer:
        for tick in range(340):
            now, aside = START + tick * S // 10, 5.0 if tick >= 160 else 0.0
            made = [tfdb.TransformStamped("map", "odom", now, (1, 2, 3), TURN)]
            if not 60 < tick < 120:
                stamp = now - S if tick == 200 else now
                made.append(tfdb.TransformStamped("odom", "base", stamp, (aside, 2, 3), TURN))
            writer.write(tfdb.encode_tf_message(made, writer.encoding), now, topic="/tf")
    return path


EXPECTED = tfdb.Expectations(
    [Expectation("odom", "base", max_step=1, max_late=0.5)],
    default=Expectation(deadline=3, lifespan=3),
)


def told(events: Iterable[Event]) -> dict[tuple[str, str], list[bool]]:
    """By kind and frame: what began and ended, in its order."""
    found: dict[tuple[str, str], list[bool]] = defaultdict(list)
    for event in events:
        found[event.kind, "" if event.kind == "time-jump" else event.child].append(event.begins)
    return dict(found)


def test_pauses_and_jumps_give_the_events_of_the_recording(drive: Path) -> None:
    wanted = told(judge_recording(recorded_arrivals([drive]), EXPECTED))
    assert wanted.keys() == {(each, "base") for each in ("deadline", "lifespan", "step", "late")}
    store, events = tfdb.Buffer(10), list[Event]()
    clock = store.clock
    with playing(drive, store, paused=True) as (player, _):
        begun(player, store)
        store.expectations.on_event = events.append
        store.expect(EXPECTED)
        clock.speed = 4.0
        clock.resume()

        def reach(seconds: float) -> None:
            assert clock.sleep_until(START + round(seconds * S), timeout=60)
            clock.pause()
            assert store.expectations.drain(60)

        for at in (2, 8):
            reach(at)
            assert not clock.sleep(1, timeout=1.0)  # a second of pause, longer than the deadline
            clock.resume()
        reach(18)
        clock.seek(START + 14 * S)
        clock.resume()
        reach(22)
        clock.seek(START + 28 * S)
        clock.resume()
        reach(31)
        found = told(events)  # the end of the player is another jump
    wanted["step", "base"] *= 2  # on both ways
    assert found == wanted | {("time-jump", ""): [True, False] * 2}
