"""Homes and mirrors in network namespaces with faults, and the check of their states."""

from __future__ import annotations

import os
import subprocess
from typing import TYPE_CHECKING

import pytest

import tfdb
from tests.net.bad_network import BadNetwork
from tests.net.batches import (
    MOVING,
    STILL,
    UNIT,
    Copy,
    Judge,
    last_batch,
    parent_of,
    write_batch,
)
from tests.net.conftest import needs_zenoh
from tests.net.network_faults import Faults
from tests.net.world import BrokenPromiseError
from tfdb.data.types import Epoch
from tfdb.net.messages import in_epoch

if TYPE_CHECKING:
    from collections.abc import Callable

CYCLES = int(os.environ.get("TFDB_NET_FAULT_CYCLES", "20"))
EPOCH, LATER = Epoch(5, b"a" * 16), Epoch(6, b"b" * 16)


def why_no_namespaces() -> str:
    """Return why this process may not create network namespaces; empty if it may."""
    try:
        with BadNetwork(1, 0):
            return ""
    except subprocess.CalledProcessError as error:
        return f"{' '.join(error.cmd)}: {error.stderr.decode().strip()}"
    except OSError as error:
        return str(error)


@needs_zenoh
def test_a_bad_network_tears_nothing_and_all_are_equal_at_the_end() -> None:
    if why := why_no_namespaces():
        pytest.skip(f"no network namespaces: {why}")
    with Faults(7, spans=(0.3, 3.0), pace=0.25) as faults:
        for _ in range(CYCLES):
            faults.cycle()
        assert faults.judge.states > 20 * CYCLES
        assert faults.network.lost > CYCLES


# -- the judge -------------------------------------------------------------------------------------


def written(last: int, tag: int = 1, buffer: tfdb.Buffer | None = None) -> tfdb.Buffer:
    """Return a store with the first batches of another one, and later batches of a tag."""
    buffer = buffer or tfdb.Buffer()
    for number in range(last_batch(buffer)[0] + 1, last + 1):
        write_batch(buffer, number, tag)
    return buffer


def mirror_of(source: tfdb.Buffer, epoch: Epoch) -> tfdb.Buffer:
    """A mirror's store with the state of another, in an epoch."""
    copy = tfdb.Buffer()
    with source.snapshot() as snap:
        copy.apply(in_epoch(snap.state_bytes(), epoch), source="robot1")
    return copy


def look(*buffers: tfdb.Buffer) -> Copy:
    """Check stores one after the other, as if they were one. Tag 2 begins after batch 30 of tag
    1.
    """
    judge = Judge()
    judge.begins |= {1: (0, 0), 2: (30, 1)}
    copy = Copy(buffers[0])
    for each in buffers:
        copy.buffer, copy.commit = each, -1
        copy.look(judge)
    return copy


def test_the_judge_takes_all_that_homes_write() -> None:
    buffer = tfdb.Buffer()
    for number in range(1, 300):
        look(written(number, 1 + (number > 30), buffer))
    longest = look(tfdb.Buffer(), buffer)
    assert (longest.batch, longest.steps_back) == ((299, 2), 0)
    assert look(mirror_of(buffer, EPOCH)).batch == (299, 2)


def spoil_edge(frame: str) -> Callable[[tfdb.Buffer], None]:
    """Write only one edge of a batch."""

    def spoil(buffer: tfdb.Buffer) -> None:
        at, number = MOVING.index(frame), 41
        buffer.set_transform(parent_of(frame, number), frame, number * UNIT, (number, 1, at), STILL)

    return spoil


SPOILED: dict[str, Callable[[tfdb.Buffer], object]] = {
    "the last batch lacks two edges": spoil_edge("base"),
    "an edge has a later batch": spoil_edge("cup"),
    "a batch is missing": lambda buffer: write_batch(buffer, 42, 1),
    "a batch is of another home": lambda buffer: write_batch(buffer, 41, 2),
    "a batch is of no home": lambda buffer: write_batch(buffer, 41, 3),
    "a static is old": lambda buffer: buffer.set_static_transform(
        "base", "sensor", (28, 1, -1), STILL
    ),
    "a static is another home's": lambda buffer: buffer.set_static_transform(
        "base", "sensor", (35, 2, -1), STILL
    ),
    "a removed frame is there": lambda buffer: buffer.set_static_transform(
        "base", "gone", (35, 1, -1), STILL
    ),
    "a frame is missing": lambda buffer: buffer.remove_frames("tool"),
    "samples are lost": lambda buffer: buffer.remove_frames("cup") or spoil_edge("cup")(buffer),
    "all is cleared": lambda buffer: buffer.clear(),
    "all but one frame is cleared": lambda buffer: buffer.clear() or spoil_edge("cup")(buffer),
    "a parent is another": lambda buffer: buffer.set_transform(
        "base", "cup", 40 * UNIT, (40, 1, 2), STILL
    ),
}


@pytest.mark.parametrize("how", SPOILED)
def test_the_judge_refuses_states_that_no_home_had(how: str) -> None:
    buffer = written(40)
    look(buffer)
    SPOILED[how](buffer)
    with pytest.raises(BrokenPromiseError):
        look(buffer)


def test_the_judge_refuses_positions_that_go_back_or_have_another_state() -> None:
    one, two, other = written(30), written(35), written(38, 2, written(30))
    look(mirror_of(one, EPOCH), mirror_of(two, EPOCH))
    for wrong in (
        (mirror_of(two, EPOCH), mirror_of(one, EPOCH)),
        (mirror_of(one, LATER), mirror_of(two, EPOCH)),
        (mirror_of(two, EPOCH), mirror_of(other, EPOCH)),
    ):
        with pytest.raises(BrokenPromiseError, match="is followed by"):
            look(*wrong)
    skipped = written(30)
    skipped.set_static_transform("base", "sensor", (28, 1, -1), STILL)  # no batch
    with pytest.raises(BrokenPromiseError, match="commit 31 was batch 31, and is 30"):
        look(mirror_of(one, EPOCH), mirror_of(skipped, EPOCH))


def test_the_judge_counts_steps_back_to_a_later_home() -> None:
    assert look(mirror_of(written(30), EPOCH), mirror_of(written(30), LATER)).steps_back == 0
    other = written(38, 2, written(30))
    assert look(mirror_of(written(30), EPOCH), mirror_of(other, LATER)).steps_back == 0
    assert look(mirror_of(written(31), EPOCH), mirror_of(other, LATER)).steps_back == 1
    assert look(mirror_of(written(35), EPOCH), mirror_of(written(30), LATER)).steps_back == 1


def test_the_judge_compares_the_fork_with_the_commits_that_the_old_home_lost() -> None:
    judge = Judge()
    judge.begins |= {1: (0, 0), 2: (30, 1), 3: (50, 2)}
    assert not judge.compare_fork(9, (40, 1), 10)
    judge.tag_of |= {8: 3, 9: 2}
    for later in (8, 9):  # the later one of two, and the first
        assert judge.compare_fork(later, (40, 1), 10)
        assert judge.compare_fork(later, (30, 1), 0)
        for wrong in (9, 11):
            with pytest.raises(BrokenPromiseError, match="the later home has batch 30"):
                judge.compare_fork(later, (40, 1), wrong)
