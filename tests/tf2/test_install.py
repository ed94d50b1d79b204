"""Programs written for tf2 run unchanged."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tfdb

ROOT = Path(__file__).parents[2]
BAG = ROOT / "examples/data/pr2.bag"
DEBIAN = "/usr/lib/python3/dist-packages"


def run(*command: str | Path, code: int = 0, folder: Path = ROOT, **environment: str) -> str:
    done = subprocess.run(
        [sys.executable, *map(str, command)],
        capture_output=True,
        text=True,
        cwd=folder,
        env={**os.environ, "MPLBACKEND": "Agg", "HOME": str(folder), **environment},
        check=False,
    )
    assert done.returncode == code, done.stdout + done.stderr
    return done.stdout + done.stderr


NAMES = """
import sys
before = set(sys.modules)
from tfdb import tf2
assert not {"tf2_ros", "tf2_py", "tf", "rclpy", "geometry_msgs"} & set(sys.modules)
tf2.install()
tf2.install()
import tf2_py, tf2_ros, tf2_geometry_msgs, tf2_sensor_msgs, tf
import tf2_ros.buffer, tf2_geometry_msgs.tf2_geometry_msgs
from tf2_py._tf2 import BufferCore, LookupException
from tf2_ros import *
from tf2_ros.buffer_interface import TypeException, convert, TransformStamped
from tf2_ros.transform_listener import TransformListener
from tf2_ros.static_transform_broadcaster import StaticTransformBroadcaster
from tf2_sensor_msgs.tf2_sensor_msgs import do_transform_cloud
from tf2_geometry_msgs import PoseStamped, do_transform_pose
assert tf2 is tf2_py  # as the star import has it
from tfdb import tf2
assert tf2_ros.Buffer is Buffer is tf2.Buffer is tf2_ros.buffer.Buffer
assert tf2_py.BufferCore is BufferCore is tf2.BufferCore
assert issubclass(tf2_py.ExtrapolationException, tf2_ros.TransformException)
assert tf.Transformer is tf.listener.Transformer
"""
WITHOUT_ROS = """
from geometry_msgs.msg import TransformStamped, PointStamped
from builtin_interfaces.msg import Time as Stamp
from rclpy.time import Time
from rclpy.duration import Duration
buffer = tf2_ros.Buffer(Duration(seconds=20))
one = TransformStamped()
one.header.stamp = Time(seconds=5, nanoseconds=7).to_msg()
one.header.frame_id, one.child_frame_id = "map", "base"
one.transform.translation.x = 2.5
buffer.set_transform(one, "me")
found = buffer.lookup_transform("map", "base", Time(), timeout=Duration(seconds=1))
assert type(found) is TransformStamped and found.header.stamp == Stamp(5, 7)
latest = buffer.get_latest_common_time("map", "base")
assert type(latest) is Time and latest == Time(seconds=5, nanoseconds=7)
assert latest + Duration(nanoseconds=1) > latest and latest - latest == Duration()
assert Time.from_msg(latest.to_msg()).seconds_nanoseconds() == (5, 7)
point = PointStamped()
point.header = one.header
point.header.frame_id = "base"
assert buffer.transform(point, "map").point.x == 2.5
"""


def test_all_names_are_there() -> None:
    run("-c", NAMES)


def test_messages_can_be_imported_without_ros() -> None:
    run("-I", "-c", NAMES + WITHOUT_ROS)


def test_where_a_ros_is_installed_its_messages_stay() -> None:
    if not Path(DEBIAN, "geometry_msgs").is_dir():
        if os.environ.get("CI") == "true":
            pytest.fail("no geometry_msgs of Debian")
        pytest.skip("no geometry_msgs of Debian (python3-geometry-msgs)")
    code = """
import geometry_msgs.msg, rospy
assert hasattr(geometry_msgs.msg.TransformStamped, "_md5sum")
assert tf2_ros.buffer.TransformStamped is geometry_msgs.msg.TransformStamped
one = geometry_msgs.msg.TransformStamped()
one.header.frame_id, one.child_frame_id = "map", "base"
one.header.stamp = rospy.Time(3, 4)
one.transform.rotation.w = 1.0
core = tf2_py.BufferCore(rospy.Duration(20))
core.set_transform(one, "me")
found = core.lookup_transform_core("map", "base", rospy.Time(0))
assert type(found) is geometry_msgs.msg.TransformStamped and found.header.stamp == rospy.Time(3, 4)
"""
    path = os.pathsep.join(["tests", DEBIAN])
    run("-c", NAMES + code, PYTHONPATH=path)


def test_earlier_imports_are_not_replaced() -> None:
    code = """
import sys, types
sys.modules["tf2_ros"] = real = types.ModuleType("tf2_ros")
import tfdb
from tfdb import tf2
try:
    tf2.install()
except tfdb.InvalidArgument as error:
    print(error)
assert sys.modules["tf2_ros"] is real and "tf2_py" not in sys.modules
"""
    assert "tf2_ros is already imported: call tfdb.tf2.install() before" in run("-c", code)


def test_a_program_is_run_as_it_is(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(
        "import sys, tf2_ros\n"
        "print(__name__, sys.argv[1:], hasattr(tf2_ros, '__tfdb__'))\n"
        "import beside\n"
        "sys.exit(3)\n"
    )
    (tmp_path / "beside.py").write_text("print('beside')\n")
    said = run("-m", "tfdb.tf2", program, "one", "--two", code=3)
    assert said.splitlines() == ["__main__ ['one', '--two'] True", "beside"]
    said = run("-m", "tfdb.tf2", "-m", "beside", PYTHONPATH=str(tmp_path))
    assert said == "beside\n"
    assert "usage: python -m tfdb.tf2" in run("-m", "tfdb.tf2", code=2)
    assert "usage: python -m tfdb.tf2" in run("-m", "tfdb.tf2", "--help")


def test_evo_reads_a_bag_without_ros(tmp_path: Path) -> None:
    """PyPI's evo: its own program, its own reading of the bag, our BufferCore."""
    pytest.importorskip("evo")
    program = Path(sys.executable).with_name("evo_traj")
    said = run(
        *("-m", "tfdb.tf2", program, "bag", BAG, "/tf:map.base_footprint", "--save_as_tum"),
        folder=tmp_path,
    )
    assert "87 poses" in said
    written: Any = np.loadtxt(tmp_path / "tf_map.base_footprint.tum")
    buffer = tfdb.Buffer(None)
    buffer.load(BAG)
    stamps = np.round(written[:, 0] * 1e9).astype(np.int64)
    expected = buffer.lookup_transforms("map", "base_footprint", stamps)
    # Seconds as floats are good for a quarter of a microsecond.
    assert written[:, 1:4] == pytest.approx(expected[:, :3], abs=1e-6)
    assert written[:, 4:] == pytest.approx(expected[:, 3:], abs=1e-6)
