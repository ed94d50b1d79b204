"""Common times of a path, parents over time, and times that are None."""

from __future__ import annotations

import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np
import pytest

import tfdb
from chain import BACK, TURN, chain
from oracle import matrix

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from tfdb import Buffer, Snapshot, Transaction

WAYS = ["buffer", "snapshot", "transaction"]


@contextmanager
def asked(buffer: Buffer, way: str) -> Iterator[Buffer | Snapshot | Transaction]:
    """The same reads of a buffer, its snapshot, or a transaction."""
    if way == "buffer":
        yield buffer
    elif way == "snapshot":
        with buffer.snapshot() as snapshot:
            yield snapshot
    else:
        with buffer.transaction() as tx:
            yield tx


@pytest.mark.parametrize("way", WAYS)
def test_common_times_are_those_that_the_whole_path_covers(way: str) -> None:
    buffer = chain()
    buffer.set_transform("odom", "map", 25, (1, 2, 3), TURN)
    buffer.set_transform("odom", "map", 40, (1, 2, 3), TURN)
    buffer.set_transform("odom", "cup", 50, (1, 2, 3), TURN)
    with asked(buffer, way) as reads:
        assert reads.common_times("map", "camera") == (10, 30)
        assert reads.common_times("camera", "odom") == (25, 30)
        assert reads.common_times("odom", "base")[1] == reads.latest_common_time("odom", "base")
        assert reads.common_times("base", "camera") == (0, 0)
        assert reads.common_times("map", "map") == (25, 40)
        # Both edges have data at no common stamp.
        assert reads.common_times("cup", "base") == (50, 30)
        for stamp in (25, 27, 30):
            assert reads.can_transform("odom", "camera", stamp)
        for stamp in (24, 31):
            assert not reads.can_transform("odom", "camera", stamp)
        with pytest.raises(tfdb.UnknownFrame) as caught:
            reads.common_times("map", "nowhere")
        assert caught.value.frame == "nowhere"


@pytest.mark.parametrize("way", WAYS)
def test_a_time_that_is_none_is_the_latest_common_one_of_its_side(way: str) -> None:
    buffer = chain()
    buffer.set_transform("map", "arm", 15, (1, 2, 3), TURN)
    buffer.set_transform("map", "arm", 25, (4, 5, 6), BACK)
    with asked(buffer, way) as reads:
        for target_time, source_time in ((None, 20), (15, None), (None, None)):
            question = ("arm", target_time, "camera", source_time, "map")
            found = reads.lookup_transform_full(*question)
            to, at = target_time or 25, source_time or 30
            expected = (
                reads.lookup_transform("arm", "map", to).matrix
                @ reads.lookup_transform("map", "camera", at).matrix
            )
            np.testing.assert_allclose(found.matrix, expected, atol=1e-12)
            assert found.stamp == to
            assert reads.can_transform_full(*question)
        # 0 is a stamp without data.
        assert not reads.can_transform_full("arm", 0, "camera", 20, "map")
        with pytest.raises(tfdb.Extrapolation) as caught:
            reads.lookup_transform_full("arm", 0, "camera", 20, "map")
        assert (caught.value.target, caught.value.source) == ("arm", "camera")
        assert (caught.value.edge, caught.value.stamp) == ("arm", 0)


def test_disconnected_names_edges_without_data() -> None:
    buffer = chain()
    buffer.set_transform("ship", "base", 40, (1, 2, 3), TURN)
    with pytest.raises(tfdb.Disconnected) as caught:
        buffer.lookup_transform("map", "camera", 50)
    error = caught.value
    assert (error.edge, error.parent, error.reason) == ("base", "ship", "future")
    assert (error.stamp, error.oldest, error.newest) == (50, 10, 40)
    assert "T[ship<-base] has no data at 0.000000050 s" in str(error)
    assert str(error) in str(buffer.explain("map", "camera", 50))
    buffer.clear()
    with pytest.raises(tfdb.Disconnected) as caught:
        buffer.lookup_transform("map", "camera", 20)
    assert (caught.value.edge, caught.value.reason) == (None, None)
    assert caught.value.frames == ("map", "base")


READS: dict[str, Callable[[Buffer | Snapshot], object]] = {
    "lookup_transform": lambda reads: reads.lookup_transform("map", "base", 15).stamp,
    "latest": lambda reads: reads.lookup_latest_transform("base", "map").stamp,
    "can_transform": lambda reads: reads.can_transform("map", "base", 15),
    "full": lambda reads: reads.lookup_transform_full("base", 15, "map", None, "base").stamp,
    "latest_common_time": lambda reads: reads.latest_common_time("map", "base"),
    "common_times": lambda reads: reads.common_times("map", "base"),
    "parent_of": lambda reads: reads.parent_of("base"),
    "velocity": lambda reads: reads.lookup_velocity("map", "base", 15).linear[2],
    "batch": lambda reads: len(reads.lookup_transforms("map", "base", [12, 15])),
    "points": lambda reads: len(reads.transform_points("map", "base", np.ones((2, 3)), 15)),
    "frame_exists": lambda reads: reads.frame_exists("base"),
    "frame_info": lambda reads: reads.frame_info("base").samples,
    "samples": lambda reads: len(reads.samples("base")[0]),
    "explain": lambda reads: reads.explain("map", "base", 15).ok,
    "trajectory": lambda reads: len(reads.trajectory("map", "base").stamps),
}


@pytest.mark.parametrize("engine", ["snapshot", "giant", "silo", "2pl-no-wait"])
def test_a_frame_that_every_commit_has_is_never_unknown(engine: str) -> None:
    """While a transaction removes it and makes it again, over and over."""
    buffer = tfdb.Buffer(history=None, concurrency=engine)

    def make(tx: Transaction) -> None:
        if tx.frame_exists("base"):
            tx.remove_frames("base")
        for stamp in (10, 20):
            tx.set_transform("map", "base", stamp, (1, 2, 3), TURN)

    buffer.run(make)
    expected = {name: read(buffer) for name, read in READS.items()}
    done = threading.Event()

    def renew() -> None:
        try:
            for _ in range(150):
                buffer.run(make)
        finally:
            done.set()

    writer = threading.Thread(target=renew)
    writer.start()
    rounds = 0
    while not done.is_set() or rounds == 0:
        rounds += 1
        for name, read in READS.items():
            assert read(buffer) == expected[name], name
            with buffer.snapshot() as held:
                assert read(held) == expected[name], name
    writer.join()
    assert buffer.lookup_transform("map", "base", 15).matrix == pytest.approx(
        matrix((1, 2, 3, *TURN))
    )
