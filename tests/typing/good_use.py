"""Checked by mypy, never run."""

from __future__ import annotations

from typing import assert_type

import numpy as np
import numpy.typing as npt

import tfdb


class RosTime:
    """A message with plain attributes."""

    sec: int = 5
    nanosec: int = 7


def everything(buffer: tfdb.Buffer, stamps: npt.NDArray[np.int64]) -> None:
    buffer.set_transform("map", "base", 5, (1, 2, 3), (0, 0, 0, 1), authority="ekf")
    buffer.set_transform("map", "base", RosTime(), [1.0, 2.0, 3.0], np.array([0.0, 0, 0, 1]))
    buffer.set_transform("map", "base", np.datetime64(5, "ns"), (1, 2, 3), (0, 0, 0, 1))
    buffer.set_static_transform("base", "camera", (0, 0, 1))
    buffer.set_transforms([tfdb.TransformStamped("map", "base", 5, (1, 2, 3))], authority="x")
    buffer.set_transforms(tfdb.Columns("map", "base", stamps, np.zeros((5, 7))), static=False)
    assert_type(buffer.lookup_transform("map", "camera"), tfdb.Transform)
    assert_type(buffer.lookup_transform("map", "camera", 5, tfdb.Previous(0.1)), tfdb.Transform)
    assert_type(buffer.lookup_latest_transform("map", "camera", max_age=0.1), tfdb.Transform)
    assert_type(buffer.can_transform("map", "camera", np.int64(5)), bool)
    assert_type(buffer.lookup_transforms("map", "camera", stamps), npt.NDArray[np.float64])
    buffer.lookup_transforms("map", "camera", [5, 6], layout="matrix", missing="nan")
    buffer.transform_points("map", "camera", np.zeros((5, 3), np.float32), stamps)
    facts = buffer.tree_columns(5)
    assert_type(facts, tfdb.types.TreeColumns)
    assert_type(facts.parents, tuple[str | None, ...])
    singles = np.zeros((5, 7), np.float32)
    assert_type(buffer.lookup_edges(facts.names), npt.NDArray[np.float64])
    assert_type(buffer.lookup_edges(["map"], 5, out=singles), npt.NDArray[np.float32])
    assert_type(buffer.lookup_edges(["map"], dtype=np.float32), npt.NDArray[np.float32])
    assert_type(buffer.lookup_edges(["map"], dtype=np.float64), npt.NDArray[np.float64])
    assert_type(buffer.trajectory("map", "camera", rate=10.0), tfdb.Trajectory)
    assert_type(buffer.explain("map", "camera").error, tfdb.TfdbError | None)
    assert_type(buffer.frame_info("base"), tfdb.types.FrameInfo)
    assert_type(buffer.tree(), list[tfdb.types.FrameInfo])
    assert_type(buffer.commit, int)
    assert_type(buffer.changes(0), list[tfdb.types.Changes])
    with buffer.snapshot() as snapshot:
        assert_type(snapshot, tfdb.Snapshot)
        assert_type(snapshot.lookup_velocity("map", "base").linear, npt.NDArray[np.float64])
    found = buffer.lookup_transform("map", "base") @ buffer.lookup_transform("base", "camera")
    assert_type(found, tfdb.Transform)
    assert_type(found.inverse().matrix, npt.NDArray[np.float64])
    assert_type(found.report.edges[0].before, int | None)
    assert_type(tfdb.stamp("12.5"), int)
    assert_type(tfdb.encode_tf_message([]), bytes)


def comparisons(buffer: tfdb.Buffer, truth: tfdb.Trajectory) -> None:
    found = tfdb.compare(truth, "slam.tum", offset="estimate", align="sim3", delta_unit="m")
    assert_type(found, tfdb.Comparison)
    assert_type(found.ape_translation.rmse, float)
    assert_type(found.rpe_rotation.values, npt.NDArray[np.float64])
    assert_type(found.reference, tfdb.Trajectory)
    assert_type(found.alignment, tfdb.Transform)
    other = ("odom", "base")
    tfdb.compare(buffer, buffer.snapshot(), frames=("map", "base"), estimate_frames=other)


def transactions(buffer: tfdb.Buffer, stamps: npt.NDArray[np.int64]) -> None:
    with buffer.transaction(priority=3) as tx:
        assert_type(tx, tfdb.Transaction)
        assert_type(tx.lookup_transform("map", "base", 5, tfdb.Exact()), tfdb.Transform)
        assert_type(tx.lookup_latest_transform("map", "base", max_age=0.1), tfdb.Transform)
        assert_type(tx.lookup_transforms("map", "base", stamps), npt.NDArray[np.float64])
        assert_type(tx.can_transform("map", "base", RosTime()), bool)
        tx.set_transform("map", "base", 5, (1, 2, 3), (0, 0, 0, 1), authority="ekf")
        tx.set_static_transform("base", "camera", np.zeros(3))
        tx.set_transforms([tfdb.TransformStamped("map", "base", 5, (1, 2, 3))], static=True)
        tx.set_transforms(tfdb.Columns("map", "base", stamps, np.zeros((5, 7))))
        tx.reparent("cup", "gripper", 5)
        tx.reparent("cup", "gripper", None, (1, 2, 3), rotation=(0, 0, 0, 1), authority="arm")
        tx.remove_frames("camera", recursive=True)
        assert_type(tx.closed, bool)
        tx.abort()
    assert_type(tx.commit, int | None)
    assert_type(buffer.run(lambda tx: tx.frame_exists("cup"), retries=3, timeout=0.1), bool)
    assert_type(buffer.run(decide, priority=7), str)


def decide(tx: tfdb.Transaction) -> str:
    return tx.lookup_transform("map", "base").source


def batches(buffer: tfdb.Buffer, partly: bool) -> None:
    batch = [tfdb.TransformStamped("map", "base", 5, (1, 2, 3))]
    assert_type(buffer.set_transforms(batch), int)
    assert_type(buffer.set_transforms(batch, partial=False), int)
    refused = buffer.set_transforms(batch, partial=True)
    assert_type(refused, list[tfdb.types.Refused])
    assert_type(refused[0].index, int)
    assert_type(buffer.set_transforms(batch, partial=partly), int | list[tfdb.types.Refused])
    assert_type(buffer.remove_frames(name for name in ("a", "b")), int)
    assert_type(buffer.remove_frames("a", recursive=True), int)
    assert_type(buffer.reparent("cup", "gripper", 5), int)
    found = buffer.lookup_transform("map", "base")
    assert_type(buffer.set_transform(found, authority="copy"), int)
    assert_type(buffer.set_transforms([found]), int)
    buffer.run(lambda tx: tx.set_transform(found))
    engine = tfdb.Buffer(concurrency="2pl-wait-die")
    if engine.concurrency == "silo":
        assert_type(engine.counters().lock_waits, int)


def both(reads: tfdb.Buffer | tfdb.Snapshot) -> tfdb.Transform:
    """Take a buffer or a snapshot."""
    return reads.lookup_transform("map", "base")


def errors(buffer: tfdb.Buffer) -> int | None:
    try:
        both(buffer)
    except tfdb.Extrapolation as error:
        return error.newest
    except tfdb.Conflict as error:
        return error.attempts
    except tfdb.TfdbError as error:
        return error.index
    return None


def one_or_many(path: tfdb.Trajectory, stamps: npt.NDArray[np.int64]) -> None:
    assert_type(tfdb.stamp(5), int)
    assert_type(tfdb.stamp(np.float64(5)), int)
    assert_type(tfdb.stamp(["0.5", "1.5"]), npt.NDArray[np.int64])
    assert_type(tfdb.stamp(stamps), npt.NDArray[np.int64])
    assert_type(path.at(np.int64(5)), tfdb.Transform)
    assert_type(path.at(stamps + 1), npt.NDArray[np.float64])
    assert_type(path.at([1, 2], missing="nan"), npt.NDArray[np.float64])
    assert_type(path[-1], tfdb.Transform)
    assert_type(path[np.int64(3)], tfdb.Transform)
    assert_type(path[3:5], tfdb.Trajectory)
    assert_type(path[path.valid], tfdb.Trajectory)
    assert_type(tfdb.Trajectory.read("a.tum", target="map", source="base"), tfdb.Trajectory)
    assert_type(path.rpy, npt.NDArray[np.float64])
    assert_type(path.seconds, npt.NDArray[np.float64])
    assert_type(path.speed, npt.NDArray[np.float64])
    assert_type(path.to_numpy(), npt.NDArray[np.void])
    assert_type(tfdb.Buffer().set_trajectory("map", "base", path), int)
    assert_type(path[np.array([1, 2])], tfdb.Trajectory)
    assert_type(path[0] @ path @ path[0], tfdb.Trajectory)


def dtypes(
    buffer: tfdb.Buffer, cloud: npt.NDArray[np.float32], doubles: npt.NDArray[np.float64]
) -> None:
    found = buffer.lookup_transform("map", "base")
    assert_type(found.apply(cloud), npt.NDArray[np.float32])
    assert_type(found.apply(doubles), npt.NDArray[np.float64])
    assert_type(found.apply([[1, 2, 3]]), npt.NDArray[np.float64])
    assert_type(buffer.transform_points("map", "base", cloud, 5), npt.NDArray[np.float32])
    assert_type(
        buffer.transform_points("map", "base", doubles, [5], out=doubles), npt.NDArray[np.float64]
    )


class Turned:
    """A Rotation of scipy, for all that is asked of it."""

    def as_quat(self) -> npt.NDArray[np.float64]:
        return np.array([[0.0, 0.0, 0.0, 1.0]])


def numbers(buffer: tfdb.Buffer, integers: npt.NDArray[np.int64]) -> None:
    buffer.set_transform("map", "base", np.int64(5), np.array([1, 2, 3]), np.array([0, 0, 0, 1]))
    buffer.set_transform("map", "base", 5, integers, Turned())
    tfdb.Trajectory("map", "base", [5], translations=[[1, 2, 3]], rotations=Turned())
    tfdb.Extrapolate(max_ns=5)


def tf2(buffer: tfdb.tf2.Buffer) -> None:
    assert_type(buffer.can_transform("map", "base", 0), bool)
    answer = buffer.can_transform("map", "base", 0, return_debug_tuple=True)
    assert_type(answer, tuple[bool, str])


report = tfdb.Buffer(history=None).load("drive.bag", start="+1", exclude=["cam"], topics="/tf")
read: list[tfdb.recordings.TopicReport] = list(report.topics)
loaded: tfdb.Buffer = tfdb.load("drive.bag", rename={"map": "world"}, mix=True, cache=True)
selection = tfdb.recordings.Selection(keep=5.0, stamp_unit="ms")
kept: float | None = selection.keep
