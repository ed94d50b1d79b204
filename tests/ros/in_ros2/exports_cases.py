"""Every name that ROS 2's tf2 exports, as recorded from its sources, where rclpy is installed."""

from __future__ import annotations

import json
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

HERE = Path(__file__).parents[2] / "tf2"
RECORDED: dict[str, dict[str, str]] = json.loads((HERE / "exports.json").read_text())


@pytest.fixture(scope="module")
def ours() -> dict[str, dict[str, list[str]]]:
    command = [sys.executable, str(HERE / "exports_child.py"), "--tfdb", *RECORDED]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found: dict[str, dict[str, list[str]]] = json.loads(done.stdout)
    return found


def is_installed(source: str) -> bool:
    """Whether the module of a name is installed; "" is tfdb's own."""
    return not source or find_spec(source.partition(".")[0]) is not None or source[:3] == "tf2"


@pytest.mark.parametrize("how", ["dir", "star"])
@pytest.mark.parametrize("module", [name for name in RECORDED if not name.startswith("tf2_kdl")])
def test_every_name_is_there(module: str, how: str, ours: dict[str, dict[str, list[str]]]) -> None:
    expected = {name for name, source in RECORDED[module].items() if is_installed(source)}
    assert expected - set(ours[module][how]) == set()


def test_submodules_of_rclpy_are_loaded_and_classes_are_the_real_ones() -> None:
    program = """
from tfdb import tf2
tf2.install()
import rclpy, tf2_py
rclpy.time.Time()
import tf2_ros
rclpy.duration.Duration(), rclpy.clock.Clock(), rclpy.action, rclpy.node.Node
from tf2_ros import *
from tf2_ros.transform_listener import Buffer as Theirs
import geometry_msgs.msg, tf2_msgs.msg, tf2_geometry_msgs
assert Node is rclpy.node.Node and Duration is rclpy.duration.Duration and Time is rclpy.time.Time
assert tf2_ros.TFMessage is tf2_msgs.msg.TFMessage and tf2_ros.tf2_ros is tf2_ros
assert tf2_ros.PoseStamped is tf2_geometry_msgs.PoseStamped is geometry_msgs.msg.PoseStamped
assert Theirs is Buffer is tf2_ros.buffer.Buffer and tf2 is __import__('tf2_py')
"""
    subprocess.run([sys.executable, "-c", program], check=True)


def test_one_changed_import_has_all_names() -> None:
    program = """
from tfdb import tf2 as tf2_ros
import rclpy.duration, tf2_msgs.msg
assert tf2_ros.Duration is rclpy.duration.Duration and tf2_ros.TFMessage is tf2_msgs.msg.TFMessage
"""
    subprocess.run([sys.executable, "-c", program], check=True)
