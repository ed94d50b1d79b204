"""`change_kind` and `only_new` in the public API."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import tfdb

if TYPE_CHECKING:
    from collections.abc import Callable

SECOND = 1_000_000_000
TURNED = (0.0, 0.0, 0.6, 0.8)


@pytest.fixture
def robot() -> tfdb.Buffer:
    """map <- base moves, base <- lidar is static, and scan hangs below lidar."""
    buffer = tfdb.Buffer(history=None)
    for second in (1, 2, 3):
        buffer.set_transform("map", "base", second * SECOND, (second, 0, 0), TURNED)
    buffer.set_static_transform("base", "lidar", (0, 2, 0), TURNED)
    buffer.set_static_transform("lidar", "scan", (0, 0, 3), TURNED)
    return buffer


def lidar(stamp: int, x: float) -> tfdb.TransformStamped:
    return tfdb.TransformStamped("base", "lidar", stamp, (x, 2, 0), TURNED)


WAYS: dict[str, Callable[..., Any]] = {
    "set_transform": lambda buffer, t, **rules: buffer.set_transform(
        t.parent, t.child, t.stamp, t.translation, t.rotation, **rules
    ),
    "set_transforms": lambda buffer, t, **rules: buffer.set_transforms([t], **rules),
    "columns": lambda buffer, t, **rules: buffer.set_transforms(
        tfdb.Columns(t.parent, t.child, [t.stamp], np.array([[*t.translation, *t.rotation]])),
        **rules,
    ),
    "ingest": lambda buffer, t, **rules: buffer.ingest(tfdb.encode_tf_message([t]), **rules),
}


@pytest.mark.parametrize("way", WAYS)
def test_a_static_edge_becomes_moving_with_its_children(robot: tfdb.Buffer, way: str) -> None:
    held = robot.snapshot()
    with pytest.raises(tfdb.errors.StaticConflict, match="change_kind=True"):
        WAYS[way](robot, lidar(2 * SECOND, 5.0))
    WAYS[way](robot, lidar(2 * SECOND, 5.0), change_kind=True)
    assert robot.lookup_transform("base", "lidar", 2 * SECOND).translation[0] == 5.0
    assert robot.can_transform("map", "scan", 2 * SECOND)
    assert not robot.can_transform("map", "scan", 1 * SECOND)
    assert held.lookup_transform("base", "lidar", 1 * SECOND).translation[0] == 0.0


def test_a_moving_edge_becomes_static(robot: tfdb.Buffer) -> None:
    with pytest.raises(tfdb.errors.StaticConflict):
        robot.set_static_transform("map", "base", (7, 7, 7), TURNED)
    robot.set_static_transform("map", "base", (7, 7, 7), TURNED, change_kind=True)
    assert robot.lookup_transform("map", "base", 99 * SECOND).translation.tolist() == [7, 7, 7]
    assert robot.frame_info("base").is_static
    assert robot.can_transform("map", "scan", 0)


@pytest.mark.parametrize("way", WAYS)
def test_only_new_keeps_the_first_value(robot: tfdb.Buffer, way: str) -> None:
    first = tfdb.TransformStamped("map", "base", 2 * SECOND, (50, 0, 0), TURNED)
    commit = robot.commit
    with pytest.raises(tfdb.errors.RepeatedStamp) as caught:
        WAYS[way](robot, first, only_new=True)
    assert (caught.value.edge, caught.value.stamp) == ("base", 2 * SECOND)
    assert robot.commit == commit
    assert robot.lookup_transform("map", "base", 2 * SECOND).translation[0] == 2.0
    WAYS[way](robot, first)
    assert robot.lookup_transform("map", "base", 2 * SECOND).translation[0] == 50.0


def test_only_new_with_partial_stores_new_samples_in_one_commit(robot: tfdb.Buffer) -> None:
    batch = [
        tfdb.TransformStamped("map", "base", second * SECOND, (10.0 * second, 0, 0), TURNED)
        for second in (2, 4, 3, 4, 5)
    ]
    commit = robot.commit
    refused = robot.set_transforms(batch, partial=True, only_new=True)
    assert [(member.index, member.error) for member in refused] == [
        (0, "RepeatedStamp"),
        (2, "RepeatedStamp"),
        (3, "RepeatedStamp"),
    ]
    assert robot.commit == commit + 1
    assert robot.samples("base")[1][:, 0].tolist() == [1.0, 2.0, 3.0, 40.0, 50.0]


def test_invalid_rules_are_refused(robot: tfdb.Buffer) -> None:
    with pytest.raises(tfdb.InvalidArgument, match="do not have"):
        robot.set_transforms([lidar(0, 1.0)], static=True, only_new=True)
    with pytest.raises(TypeError, match="change_kind must be a bool, got int"):
        robot.set_transform(
            "map",
            "base",
            SECOND,
            (1, 2, 3),
            TURNED,
            change_kind=1,  # type: ignore[arg-type]
        )
