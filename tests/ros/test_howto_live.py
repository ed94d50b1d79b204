"""The pages about live nodes run on real graphs."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from docs.test_howto import ROOT, blocks
from ros import real_ros1, ros2
from tf2.ours import message
from tfdb import tf2
from tfdb.ros import TcprosNode

POSE = [1.25, 2.0, 3.0, 0.0, 0.6, 0.0, 0.8]
DEBIAN = "/usr/lib/python3/dist-packages"
FOREVER = 60.0


def run(program: str, environment: dict[str, str]) -> str:
    done = subprocess.run(
        [sys.executable, "-c", program],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=FOREVER,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_ros1_node(ros1: str) -> None:
    without_ros, within_rospy = blocks(ROOT / "docs/howto/ros1-node.md")
    environment = os.environ | real_ros1.environment(ros1)
    with TcprosNode("robot") as node:
        tf2.StaticTransformBroadcaster(node).sendTransform(message("map", "base_link", 0, POSE))
        assert "x=1.25" in run(without_ros, environment)
        said = run(within_rospy, environment | {"PYTHONPATH": DEBIAN})
        assert "x: 1.25" in said


def test_ros2_node() -> None:
    (program,) = blocks(ROOT / "docs/howto/ros2-node.md")
    robot = Path(__file__).with_name("in_ros2") / "static_robot.py"
    environment = ros2.environment()
    with subprocess.Popen(
        [sys.executable, robot], env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as child:
        assert child.stdout is not None
        assert child.stdout.readline() == b"here\n"
        assert "x=1.25" in run(program, environment)
        child.communicate()
