"""Periods, gaps, trees, and the chain of the demo."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

import tfdb
from tfdb.store.summary import Forest, Gap, edge_summaries, find_gaps, longest_moving_chain, span

MS = 1_000_000
UNIT = (0.0, 0.0, 0.0, 1.0)


@pytest.fixture
def robot() -> tfdb.Buffer:
    """map <- odom (2 Hz) <- base (10 Hz, with a hole) <- lidar (static), and a tree of its own."""
    buf = tfdb.Buffer(history=None)
    for i in range(5):
        buf.set_transform("map", "odom", 1000 * MS + i * 500 * MS, (i, 0, 0), UNIT)
    for i in [*range(10), *range(18, 31)]:
        buf.set_transform("odom", "base", 1000 * MS + i * 100 * MS, (i, 0, 0), UNIT)
    buf.set_static_transform("base", "lidar", (0.0, 0.0, 1.0))
    buf.set_static_transform("dock", "charger", (0.0, 0.0, 1.0))
    return buf


def test_gaps_of_nothing() -> None:
    assert find_gaps(np.array([], dtype=np.int64)) == (None, None, ())
    assert find_gaps(np.array([7], dtype=np.int64)) == (None, None, ())


def test_gaps() -> None:
    stamps = np.array([0, 10, 20, 30, 90, 100, 110, 150], dtype=np.int64)
    period, longest, gaps = find_gaps(stamps)
    assert period == 10
    assert longest == Gap(30, 90)
    assert gaps == (Gap(30, 90),)
    assert longest.length == 60
    assert find_gaps(stamps, 39)[2] == (Gap(30, 90), Gap(110, 150))
    assert find_gaps(stamps, 60)[2] == ()


def test_edges(robot: tfdb.Buffer) -> None:
    edges = {edge.info.name: edge for edge in edge_summaries(robot)}
    assert list(edges) == ["base", "charger", "lidar", "odom"]
    assert edges["base"].period == 100 * MS
    assert edges["base"].gaps == (Gap(1900 * MS, 2800 * MS),)
    assert edges["odom"].gaps == ()
    assert edges["lidar"].period is None
    assert edges["lidar"].longest is None


def test_edges_of_a_snapshot_are_the_snapshots(robot: tfdb.Buffer) -> None:
    with robot.snapshot() as snap:
        robot.set_static_transform("dock", "lamp", (0.0, 0.0, 1.0))
        assert len(edge_summaries(snap)) == 4
    assert len(edge_summaries(robot)) == 5


def test_span(robot: tfdb.Buffer) -> None:
    assert span(robot.tree()) == robot._span() == (1000 * MS, 4000 * MS)
    assert span([]) is tfdb.Buffer()._span() is None


def test_forest(robot: tfdb.Buffer) -> None:
    forest = Forest(robot.tree())
    assert forest.roots == ["map", "dock"]
    rows = [(row.info.name, row.depth, row.last) for row in forest.rows()]
    assert rows == [
        ("map", 0, True),
        ("odom", 1, True),
        ("base", 2, True),
        ("lidar", 3, True),
        ("dock", 0, True),
        ("charger", 1, True),
    ]
    assert [info.name for info in forest.chain("lidar")] == ["lidar", "base", "odom"]
    assert forest.chain("map") == []


def test_longest_moving_chain(robot: tfdb.Buffer) -> None:
    assert longest_moving_chain(robot.tree()) == ("map", "lidar")


def test_no_chain_where_nothing_moves() -> None:
    buf = tfdb.Buffer()
    buf.set_static_transform("a", "b", (1.0, 0.0, 0.0))
    assert longest_moving_chain(buf.tree()) is None


@dataclass(frozen=True)
class Frame:
    """The fields of FrameInfo that the chain needs."""

    name: str
    parent: str | None
    oldest: int | None = None
    newest: int | None = None
    is_static: bool = False


def test_chain_without_common_time_does_not_count() -> None:
    infos = [
        Frame("map", None),
        Frame("a", "map", 0, 10),
        Frame("b", "a", 20, 30),
        Frame("c", "map", 0, 5),
    ]
    assert longest_moving_chain(infos) == ("map", "a")


def test_deep_trees_need_no_recursion() -> None:
    infos = [Frame("f0", None)] + [Frame(f"f{i}", f"f{i - 1}") for i in range(1, 5000)]
    forest = Forest(infos)
    assert len(forest.rows()) == 5000
    assert len(forest.chain("f4999")) == 4999
