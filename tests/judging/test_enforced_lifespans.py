"""Lifespans that are enforced: each way to ask raises Stale, until a new sample comes."""

from __future__ import annotations

import asyncio
import os
import threading
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import tfdb
from tfdb.errors import InvalidArgument, Stale, WaitTimeout
from tfdb.judging import Expectation

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

S = 10**9
START = 1_000 * S
PAST = START - 2 * S


@pytest.fixture
def robot() -> Iterator[tfdb.Buffer]:
    """map <- odom <- base <- camera (static). The edge odom -> base is a second old."""
    buf = tfdb.Buffer(history=None)
    buf.clock.pause()
    buf.clock.seek(START)
    for back in (3 * S, S):
        buf.set_transform("map", "odom", START - back + S, (1, 2, 3))
        buf.set_transform("odom", "base", START - back, (4, 5, 6), (0, 0, 0.6, 0.8))
    buf.set_static_transform("base", "camera", (0, 0, 1), (0.6, 0, 0, 0.8))
    yield buf
    buf.close()


LOOKUPS: dict[str, Callable[[Any], object]] = {
    "latest": lambda r: r.lookup_transform("map", "camera"),
    "past": lambda r: r.lookup_transform("camera", "map", PAST),
    "newest samples": lambda r: r.lookup_latest_transform("map", "camera"),
    "full": lambda r: r.lookup_transform_full("map", PAST, "camera", PAST, "odom"),
    "velocity": lambda r: r.lookup_velocity("map", "camera", PAST),
    "batch": lambda r: r.lookup_transforms("map", "camera", [PAST] * 5),
    "edges": lambda r: r.lookup_edges(["odom", "base"], missing="raise"),
    "points": lambda r: r.transform_points("map", "camera", np.ones((4, 3)), PAST),
}


@pytest.mark.parametrize("name", LOOKUPS)
def test_each_lookup_raises_stale_while_it_is_enforced(robot: tfdb.Buffer, name: str) -> None:
    lookup = LOOKUPS[name]

    def refused(reads: Any) -> None:
        with pytest.raises(Stale) as caught:
            lookup(reads)
        error = caught.value
        assert (error.parent, error.edge, error.limit) == ("odom", "base", S // 2)
        assert error.expectation == "odom -> *"
        assert (error.newest, error.stamp) == (START - S, START)
        assert "lifespan = 0.500000000 s" in str(error)

    with robot.snapshot() as held:
        with robot.expect("odom", "*", lifespan=0.5, enforce=True):
            refused(robot)
            refused(held)
            with robot.transaction() as transaction:
                refused(transaction)
            robot.set_transform("odom", "base", START, (7, 8, 9))
            lookup(robot)
            refused(held)
        lookup(robot)
        lookup(held)


def test_a_trajectory_raises_stale(robot: tfdb.Buffer) -> None:
    with robot.expect("odom", "base", lifespan=0.5, enforce=True), pytest.raises(Stale):
        robot.trajectory("map", "camera")
    assert len(robot.trajectory("map", "camera").stamps) > 0


def test_can_transform_and_nan_rows(robot: tfdb.Buffer) -> None:
    with robot.expect("odom", "base", lifespan=0.5, enforce=True):
        assert not robot.can_transform("map", "camera", PAST)
        rows = robot.lookup_transforms("map", "camera", [PAST] * 100, missing="nan")
        assert np.isnan(rows).all()
        edges = robot.lookup_edges(["odom", "base"], missing="nan")
        assert np.isnan(edges[1]).all()
        assert not np.isnan(edges[0]).any()
    assert robot.can_transform("map", "camera", PAST)


def test_explain_names_the_lifespan(robot: tfdb.Buffer) -> None:
    with robot.expect("odom", "base", lifespan=0.5, enforce=True):
        explained = robot.explain("map", "camera", PAST)
    assert not explained.ok
    assert "lifespan" in str(explained)
    assert [edge.ok for edge in explained.edges if edge.child == "base"] == [False]


def test_the_drop_in_of_tf2_raises_its_error(robot: tfdb.Buffer) -> None:
    from tfdb import tf2

    surface = tf2.Buffer(buffer=robot)
    with (
        robot.expect("odom", "base", lifespan=0.5, enforce=True),
        pytest.raises(tf2.TransformException, match="lifespan"),
    ):
        surface.lookup_transform("map", "camera", tf2.Time())


def test_other_expectations_are_events_only(robot: tfdb.Buffer) -> None:
    with (
        robot.expect("odom", "base", lifespan=0.5),
        robot.expect("map", "odom", lifespan=0.1, enforce=True),
    ):
        robot.lookup_transform("map", "camera")
        robot.clock.seek(START + S)
        robot.lookup_transform("odom", "base")
        with pytest.raises(Stale, match="map -> odom"):
            robot.lookup_transform("map", "odom")
    with robot.expect("map", "odom", lifespan=0.1, enforce=True) as installed:
        assert installed.enforce
        with pytest.raises(Stale):
            robot.lookup_transform("map", "camera")
        installed.remove()
        robot.lookup_transform("map", "camera")


def test_the_first_expectation_that_matches_decides(robot: tfdb.Buffer) -> None:
    expectations = tfdb.Expectations(
        [Expectation("*", "base", lifespan=0.1), Expectation("odom", "base", lifespan=100)],
        default=Expectation(lifespan=1e-3),
    )
    with robot.expect(expectations, enforce=True):
        robot.lookup_transform("odom", "camera")
        robot.clock.seek(START + 1000 * S)
        with pytest.raises(Stale) as caught:
            robot.lookup_transform("odom", "camera")
        assert caught.value.expectation == "odom -> base"
        with pytest.raises(Stale) as caught:
            robot.lookup_transform("map", "odom")
        assert caught.value.expectation == "* -> *"


def test_a_longer_lifespan_that_comes_first_counts(robot: tfdb.Buffer) -> None:
    with (
        robot.expect("*", "*", lifespan=0.5, enforce=True),
        robot.expect("odom", "base", lifespan=3),
    ):
        robot.lookup_transform("map", "camera")
    with robot.expect("*", "*", lifespan=0.5, enforce=True), pytest.raises(Stale):
        robot.lookup_transform("map", "camera")
    with pytest.raises(InvalidArgument, match="enforce must be True or False"):
        robot.expect("odom", "base", lifespan=3, enforce="yes")  # type: ignore[call-overload]


def test_a_wait_goes_on_until_the_next_sample(robot: tfdb.Buffer) -> None:
    with robot.expect("odom", "base", lifespan=0.5, enforce=True):
        with pytest.raises(Stale):
            robot.wait_for_transform("map", "camera", timeout=0.01)
        found: list[tfdb.Transform] = []
        waiting = threading.Thread(
            target=lambda: found.append(robot.wait_for_transform("odom", "camera"))
        )
        waiting.start()
        robot.set_transform("odom", "base", START, (7, 8, 9))
        waiting.join(60)
        assert found[0].stamp == START


def test_an_awaited_transform_goes_on_until_the_next_sample(robot: tfdb.Buffer) -> None:
    async def ask() -> tfdb.Transform:
        with pytest.raises((Stale, WaitTimeout)):
            await robot.wait_for_transform_async("map", "camera", timeout=0.01)
        wait = asyncio.create_task(robot.wait_for_transform_async("odom", "camera", timeout=60))
        await asyncio.sleep(0)
        robot.set_transform("odom", "base", START, (7, 8, 9))
        return await wait

    with robot.expect("odom", "base", lifespan=0.5, enforce=True):
        assert asyncio.run(ask()).stamp == START


def error_in_child(robot: tfdb.Buffer) -> bytes:
    """Look up in a forked child; return its error as text, which is empty without one."""
    told, tell = os.pipe()
    pid = os.fork()
    if pid == 0:
        try:
            robot.lookup_transform("map", "camera")
        except BaseException as error:
            os.write(tell, repr(error).encode())
        finally:
            os._exit(0)
    os.close(tell)
    with os.fdopen(told, "rb") as pipe:
        text = pipe.read()
    os.waitpid(pid, 0)
    return text


def test_processes_do_not_share_it(robot: tfdb.Buffer) -> None:
    installed = robot.expect("odom", "base", lifespan=0.5, enforce=True)
    assert error_in_child(robot) == b""
    with pytest.raises(Stale):
        robot.lookup_transform("map", "camera")
    installed.remove()


def test_a_child_forgets_it_beside_buffers_without_init(robot: tfdb.Buffer) -> None:
    """They have no store. The order of buffers in a child is that of a set."""
    blank = [tfdb.Buffer.__new__(tfdb.Buffer).expectations for _ in range(20)]
    with robot.expect("odom", "base", lifespan=0.5, enforce=True):
        assert error_in_child(robot) == b""
    assert all(len(each) == 0 for each in blank)


def test_an_impossible_enforcement_is_refused(robot: tfdb.Buffer) -> None:
    with pytest.raises(InvalidArgument, match="needs an expectation with lifespan"):
        robot.expect("odom", "base", deadline=0.5, enforce=True)
    arrivals = tfdb.Expectations([Expectation("odom", "base", lifespan=1)], clock="arrival")
    with pytest.raises(InvalidArgument, match="clock 'stamps'"):
        robot.expect(arrivals, enforce=True)
    own = tfdb.Buffer(clock=lambda: START)
    with pytest.raises(InvalidArgument, match="was made with clock="):
        own.expect("odom", "base", lifespan=0.5, enforce=True)
    with pytest.raises(InvalidArgument, match="give a name"):
        robot.expect("\ud800", "base", lifespan=0.5, enforce=True)
    assert not list(robot.expectations)
    assert not list(own.expectations)


def test_contradicting_expectations_enforce_nothing(robot: tfdb.Buffer) -> None:
    with robot.expect("odom", "base", deadline=5):
        with pytest.raises(InvalidArgument):
            robot.expect("odom", "base", lifespan=0.5, enforce=True)
        robot.lookup_transform("map", "camera")
