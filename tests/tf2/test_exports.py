"""Every exported name of tf2's packages exists, in `dir()` and by a star import.

ROS 1 is asked itself. `tools/record_tf2_exports.py` found ROS 2's names in its sources, and
`tests/ros/in_ros2/exports_cases.py` compares them where rclpy is installed.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import TypeAlias

import pytest

from ros.real_ros1 import PYTHON, need
from tf2.test_debians_packages import DEBIAN

ROOT = Path(__file__).parents[2]
CHILD = Path(__file__).with_name("exports_child.py")
RECORDED: dict[str, dict[str, str]] = json.loads(
    Path(__file__).with_name("exports.json").read_text()
)
ROS1 = (
    *("tf2_py", "tf2_py._tf2", "tf2_ros", "tf2_ros.buffer", "tf2_ros.buffer_client"),
    *("tf2_ros.buffer_interface", "tf2_ros.static_transform_broadcaster"),
    *("tf2_ros.transform_broadcaster", "tf2_ros.transform_listener"),
    *("tf2_geometry_msgs", "tf2_geometry_msgs.tf2_geometry_msgs"),
    *("tf2_sensor_msgs", "tf2_sensor_msgs.tf2_sensor_msgs"),
    *("tf", "tf.listener", "tf.broadcaster", "tf.transformations", "tf.msg", "tf.srv"),
)
MORE = {
    *("BackwardExtrapolationException", "BufferServer", "FilterFailureReason"),
    *("ForwardExtrapolationException", "MessageFilter", "NoDataForExtrapolationException"),
    *("StaticTransformListener", "TransformableResult"),
}
"""What a star import of our tf2_ros gives beyond that of the real one."""
SHOWN = {"exports"}
"""Differences from tf2 that are shown here."""
Exports: TypeAlias = "dict[str, dict[str, list[str]]]"


def exports(*command: str, path: str = "") -> Exports:
    """What a process says that modules offer."""
    program = f"import sys, runpy; sys.path.append({path!r}); sys.argv = sys.argv[1:]; "
    program += f"runpy.run_path({str(CHILD)!r})"
    python, *arguments = command
    done = subprocess.run(
        [python, "-c", program, str(CHILD), *arguments], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    found: Exports = json.loads(done.stdout)
    return found


@pytest.fixture(scope="module")
def theirs() -> Exports:
    need()
    found = exports(PYTHON, *ROS1)
    assert set(found) == set(ROS1)
    return found


@pytest.fixture(scope="module")
def ours() -> Exports:
    if sys.version_info[:2] != (3, 11):
        pytest.skip("Debian's ROS 1 is for Python 3.11")
    return exports(sys.executable, "--tfdb", *ROS1, "tf2_kdl", "tf2_py._tf2_py", path=DEBIAN)


@pytest.mark.parametrize("how", ["dir", "star"])
@pytest.mark.parametrize("module", ROS1)
def test_ros1_has_every_name(module: str, how: str, theirs: Exports, ours: Exports) -> None:
    missing = set(theirs[module][how]) - set(ours[module][how])
    assert {name for name in missing if not name.startswith("_")} == set()


def test_private_names_are_left_out_and_a_few_names_are_more(
    theirs: Exports, ours: Exports
) -> None:
    assert "_EPS" in theirs["tf.transformations"]["dir"]
    assert "_EPS" not in ours["tf.transformations"]["dir"]
    more = set(ours["tf2_ros"]["star"]) - set(theirs["tf2_ros"]["star"])
    assert more == MORE


def test_kdl_has_every_name(ours: Exports) -> None:
    assert set(RECORDED["tf2_kdl"]) <= set(ours["tf2_kdl"]["star"])


def test_without_ros_every_name_of_the_packages_themselves_is_there() -> None:
    """What ROS 2's modules define, and what they take of messages that tfdb has itself."""
    command = [sys.executable, "-I", str(CHILD), "--tfdb", *RECORDED]
    found: Exports = json.loads(subprocess.run(command, capture_output=True, check=True).stdout)
    assert set(RECORDED) - set(found) == {"tf2_kdl", "tf2_kdl.tf2_kdl"}
    for module, offered in found.items():
        own = {name for name, source in RECORDED[module].items() if not source}
        assert own - set(offered["star"]) == set(), module
    assert {"Time", "Duration", "TFMessage", "PoseStamped", "tf2_ros", "rclpy"} <= set(
        found["tf2_ros"]["star"]
    )


def test_one_changed_import_has_all_names() -> None:
    """`from tfdb import tf2 as tf2_ros`, without ROS."""
    program = """
from tfdb import tf2 as tf2_ros
from tfdb.tf2 import msgs, stand_ins
assert tf2_ros.Duration is stand_ins.Duration and tf2_ros.Time is stand_ins.Time
assert tf2_ros.TFMessage is msgs.TFMessage and tf2_ros.PoseStamped is msgs.PoseStamped
try:
    tf2_ros.Durations
except AttributeError as error:
    assert "'tfdb.tf2' has no attribute 'Durations'" in str(error), error
else:
    raise AssertionError
"""
    subprocess.run([sys.executable, "-I", "-c", program], check=True)


def test_tf_msg_without_the_package_tf() -> None:
    program = """
from tfdb import tf2
tf2.install()
import tf.msg
from tf2_msgs.msg import TFMessage
assert issubclass(tf.msg.tfMessage, TFMessage) and tf.msg.tfMessage._type == "tf/tfMessage"
assert tf.msg.tfMessage(["one"]).transforms == ["one"]
"""
    subprocess.run([sys.executable, "-I", "-c", program], check=True)


def test_a_missing_name_names_the_missing_package() -> None:
    program = """
from tfdb import tf2
tf2.install()
import tf2_ros.buffer
try:
    tf2_ros.buffer.Node
except AttributeError as error:
    assert "rclpy.node" in str(error), error
else:
    raise AssertionError
try:
    import tf2_kdl
except ImportError as error:
    assert "PyKDL" in str(error), error
else:
    raise AssertionError
"""
    subprocess.run([sys.executable, "-I", "-c", program], check=True)
