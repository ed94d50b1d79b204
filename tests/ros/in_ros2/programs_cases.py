"""Unchanged programs for ROS 2's tf2 from PyPI, on `tf2.install()`."""

from __future__ import annotations

import math
from typing import Any

import pytest

from ros.in_ros2.graph import Graph, message, until
from tfdb import tf2

tf2.install()

from crisp_py.utils.tf_pose import TfPose  # noqa: E402
from era_5g_tf2json.tf2_web_republisher import TFRepublisher  # noqa: E402
from osiris_agent.tf_tree_collector import TfTreeCollector  # noqa: E402

NUMBER = 7
TURN = [0.0, 0.0, math.sin(0.2), math.cos(0.2)]


def robot(graph: Graph) -> None:
    """T[map<-frame0], for all times."""
    sent = message(NUMBER, parent="map").transforms
    tf2.StaticTransformBroadcaster(graph.node("robot")).sendTransform(sent)


def test_era_5g_tf2json(graph: Graph) -> None:
    robot(graph)
    got: list[Any] = []
    republisher = TFRepublisher(graph.node("program", spin=True), got.append, rate=50.0)
    republisher.subscribe_transform("frame0", "map", 0.0, 0.0)
    until(lambda: got)
    (found,) = got[0]
    assert (found.header.frame_id, found.child_frame_id) == ("map", "frame0")
    until(lambda: republisher._tf_pairs[0].is_ok)
    move = republisher._tf_pairs[0].last_tf_msg.translation
    assert [move.x, move.y, move.z] == pytest.approx([NUMBER, 0.0, 0.0])


def test_crisp_python(graph: Graph) -> None:
    robot(graph)
    program = TfPose(graph.node("program", spin=True), "frame0", "map")
    until(lambda: program.current_pose is not None)
    assert program.pose.position == pytest.approx([NUMBER, 0.0, 0.0])
    assert program.pose.orientation.as_quat() == pytest.approx(TURN)


def test_osiris_agent(graph: Graph) -> None:
    robot(graph)
    told: list[Any] = []
    node = graph.node("program", spin=True)
    collector = TfTreeCollector(node, told.append, node.get_logger())

    def tree() -> Any:
        collector.poll(force=True)
        return told and told[-1]["data"]

    until(tree)
    assert "frame0" in str(told[-1]["data"])
    assert "map" in str(told[-1]["data"])
