"""Debian's tf, tf2_geometry_msgs and tf2_sensor_msgs, unchanged, on `tf2_ros` by tfdb."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

from compat.tf2_oracle import unavailable
from tf2 import real_tf2, test_real_conversions
from tf2.test_tf1 import close, theirs

HERE = Path(__file__).parent
DEBIAN = "/usr/lib/python3/dist-packages"
BEGIN = f"""
import sys
# After our own, or the system's numpy would be taken.
sys.path.append({DEBIAN!r})
from importlib.machinery import PathFinder
from tfdb import tf2
tf2.install()
class Debian:
    def find_spec(name, path=None, target=None):
        return PathFinder.find_spec(name, path) if name.split(".")[0] in PACKAGES else None
sys.meta_path.insert(0, Debian)
import tf2_ros, rospy, geometry_msgs.msg, sensor_msgs.msg
"""
TRANSFORMER = """
import json, tf, tf1_program
assert tf.__file__.startswith("/usr/lib")
assert tf.listener.tf2_ros.Buffer is tf2.Buffer
classes = geometry_msgs.msg, sensor_msgs.msg, rospy.Time, rospy.Duration
json.dump(tf1_program.Program(tf, *classes).run(), sys.stdout)
"""
CONVERSIONS = """
import tf2_geometry_msgs, tf2_sensor_msgs
from sensor_msgs.point_cloud2 import create_cloud_xyz32, read_points
buffer = tf2_ros.Buffer(debug=False)
placed = geometry_msgs.msg.TransformStamped()
placed.header.frame_id, placed.child_frame_id, placed.header.stamp = "map", "base", rospy.Time(5)
placed.transform.translation.x = 1.5
placed.transform.rotation.y, placed.transform.rotation.w = 0.6, 0.8
buffer.set_transform(placed, "me")
for module, kind, function in (
    (tf2_geometry_msgs, geometry_msgs.msg.PointStamped, "do_transform_point"),
    (tf2_geometry_msgs, geometry_msgs.msg.PoseStamped, "do_transform_pose"),
    (tf2_sensor_msgs, sensor_msgs.msg.PointCloud2, "do_transform_cloud"),
):
    assert module.__file__.startswith("/usr/lib")
    # What a package registers for a class counts before what tfdb has for its name.
    assert buffer.registration.get(kind) is getattr(module, function)
point = geometry_msgs.msg.PointStamped()
point.header.frame_id, point.header.stamp, point.point.z = "base", rospy.Time(5), 1.0
found = buffer.transform(point, "map").point
cloud = create_cloud_xyz32(point.header, [(0.0, 0.0, 1.0)])
[place] = read_points(buffer.transform(cloud, "map", rospy.Duration(1)))
for x, y, z in ((found.x, found.y, found.z), place):
    assert abs(x - 2.46) + abs(y) + abs(z - 0.28) < 1e-6, (x, y, z)
print("done")
"""


def run(packages: tuple[str, ...], program: str) -> str:
    """What a program says on `tf2_ros` by tfdb with some packages as Debian has them."""
    if real_tf2.missing() or test_real_conversions.missing():
        unavailable(real_tf2.missing() or test_real_conversions.missing())
    if sys.version_info[:2] != (3, 11):
        unavailable("Debian's ROS 1 is for Python 3.11")
    done = subprocess.run(
        [sys.executable, "-c", f"PACKAGES = {packages!r}\n{BEGIN}{program}"],
        env=os.environ | {"PYTHONPATH": str(HERE)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_tf() -> None:
    real = theirs()[0]
    found = json.loads(run(("tf",), TRANSFORMER))
    assert len(found) == len(real)
    for mine, (name, answer) in zip(found, real, strict=True):
        expected = [name, answer]
        # `latest_common_time` in `tfdb.tf2.differences`.
        if name == "getLatestCommonTime" and "TransformException" in str(answer):
            expected = [name, ["ConnectivityException", *answer[1:]]]
        assert close(mine, expected), (mine, expected)


def test_conversions() -> None:
    assert run(("tf2_geometry_msgs", "tf2_sensor_msgs"), CONVERSIONS) == "done\n"
