"""Unchanged public programs of ROS 2 on `tf2.install()`, if their sources are available.

TFDB_PUBLIC_PROGRAMS names a folder with these; a missing one is skipped:
`geometry_tutorials-ros2` (its branch ros2), `geometry2` (its branch jazzy), `py_trees_ros` (its
branch devel), `autoware` with pose2tf.py and tf2pose.py of Autoware's tools, `site` with py_trees.
"""

from __future__ import annotations

import math
import os
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from diagnostic_msgs.srv import AddDiagnostics
from geometry_msgs.msg import Pose2D, PoseStamped, Twist
from rclpy.qos import DurabilityPolicy, QoSProfile
from tf2_msgs.msg import TFMessage

from ros.in_ros2.graph import Graph, message, until
from tfdb import tf2

if TYPE_CHECKING:
    from collections.abc import Iterator

PROGRAMS = Path(os.environ.get("TFDB_PUBLIC_PROGRAMS", "/nowhere"))
TURTLES = "geometry_tutorials-ros2/turtle_tf2_py/turtle_tf2_py"
INTERRUPTED = ("KeyboardInterrupt", "ExternalShutdownException", "rcl_shutdown already called")
LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
# Messages of another package replace turtlesim's.
TURTLESIM = """
import sys, types
from diagnostic_msgs.srv import AddDiagnostics
from geometry_msgs.msg import Pose2D

class Request(AddDiagnostics.Request):
    pass

Request.__name__ = AddDiagnostics.Request.__name__
Request.__module__ = AddDiagnostics.Request.__module__
class Spawn(AddDiagnostics):
    pass
Spawn.Request = Request
AddDiagnostics.Response.name = property(lambda self: self.message)
for name, members in (("msg", {"Pose": Pose2D}), ("srv", {"Spawn": Spawn})):
    module = sys.modules[f"turtlesim.{name}"] = types.ModuleType(f"turtlesim.{name}")
    vars(module).update(members)
sys.modules["turtlesim"] = types.ModuleType("turtlesim")
"""
RUN = """
import runpy, sys
from tfdb import tf2
tf2.install()
sys.argv = sys.argv[1:]
found = runpy.run_path(sys.argv[0])
assert hasattr(sys.modules["tf2_ros"], "__tfdb__")
arguments = (sys.argv[1:],) if found["main"].__code__.co_argcount else ()
sys.exit(found["main"](*arguments))
"""


def source(path: str) -> Path:
    """Return the file of a program, or skip the test."""
    found = PROGRAMS / path
    if not found.exists():
        pytest.skip(f"TFDB_PUBLIC_PROGRAMS has no {path}")
    return found


@contextmanager
def running(path: str, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """A running program, which is interrupted at the end."""
    file = source(path)
    with subprocess.Popen(
        [sys.executable, "-c", TURTLESIM + RUN, str(file), *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as program:
        try:
            yield program
        finally:
            program.send_signal(2)
            out, _ = program.communicate(timeout=20)
    # Some programs raise KeyboardInterrupt, or shut down twice.
    last = out.strip().rpartition("\n")[2]
    assert "Traceback" not in out or any(each in last for each in INTERRUPTED), out


def heard(graph: Graph, kind: Any, topic: str, qos: Any = 10) -> list[Any]:
    """Received messages of a topic."""
    came: list[Any] = []
    graph.node("hearing", spin=True).create_subscription(kind, topic, came.append, qos)
    return came


def numbers(transform: Any) -> list[float]:
    t, r = transform.translation, transform.rotation
    return [t.x, t.y, t.z, r.x, r.y, r.z, r.w]


def test_a_turtles_pose_becomes_a_transform(graph: Graph) -> None:
    came = heard(graph, TFMessage, "/tf")
    publisher = graph.node("turtle").create_publisher(Pose2D, "/turtle1/pose", 1)
    path = f"{TURTLES}/turtle_tf2_broadcaster.py"
    with running(path, "--ros-args", "-p", "turtlename:=turtle1"):
        pose = Pose2D(x=2.0, y=3.0, theta=0.4)
        until(lambda: bool(came), meanwhile=lambda: publisher.publish(pose))
    (sent,) = came[0].transforms
    assert (sent.header.frame_id, sent.child_frame_id) == ("world", "turtle1")
    expected = [2.0, 3.0, 0.0, 0.0, 0.0, math.sin(0.2), math.cos(0.2)]
    assert numbers(sent.transform) == pytest.approx(expected)


def test_a_static_turtle_is_latched(graph: Graph) -> None:
    arguments = ("mystatic", "1", "2", "3", "0", "0", "0.4")
    with running(f"{TURTLES}/static_turtle_tf2_broadcaster.py", *arguments):
        came = heard(graph, TFMessage, "/tf_static", LATCHED)
        until(lambda: bool(came))
    (sent,) = came[0].transforms
    expected = [1.0, 2.0, 3.0, 0.0, 0.0, math.sin(0.2), math.cos(0.2)]
    assert (sent.header.frame_id, sent.child_frame_id) == ("world", "mystatic")
    assert numbers(sent.transform) == pytest.approx(expected)


@pytest.mark.parametrize("kind", ["fixed", "dynamic"])
def test_carrots_are_sent(graph: Graph, kind: str) -> None:
    came = heard(graph, TFMessage, "/tf")
    with running(f"{TURTLES}/{kind}_frame_tf2_broadcaster.py"):
        until(lambda: len(came) > 2)
    (sent,) = came[-1].transforms
    assert (sent.header.frame_id, sent.child_frame_id) == ("turtle1", "carrot1")
    assert numbers(sent.transform)[:2] != [0.0, 0.0]


def test_a_turtle_follows(graph: Graph) -> None:
    came = heard(graph, Twist, "turtle2/cmd_vel")
    server = graph.node("turtlesim", spin=True)

    def spawn(_: Any, response: Any) -> Any:
        response.message = "turtle2"
        return response

    server.create_service(AddDiagnostics, "spawn", spawn)
    broadcaster = tf2.StaticTransformBroadcaster(graph.node("robot"))
    placed = message(3, parent="turtle2").transforms
    placed[0].child_frame_id, placed[0].transform.translation.y = "turtle1", 4.0
    broadcaster.sendTransform(placed)
    with running(f"{TURTLES}/turtle_tf2_listener.py"):
        until(lambda: bool(came))
    assert came[0].linear.x == pytest.approx(2.5)
    assert came[0].angular.z == pytest.approx(math.atan2(4.0, 3.0))


def test_a_pose_becomes_a_transform_and_a_pose_again(graph: Graph) -> None:
    publisher = graph.node("robot").create_publisher(PoseStamped, "/pose", 1)
    pose = PoseStamped()
    pose.header.frame_id, pose.header.stamp.sec = "map", 12
    pose.pose.position.x, pose.pose.orientation.y, pose.pose.orientation.w = 1.5, 0.6, 0.8
    came = heard(graph, PoseStamped, "/tier4_debug_tools/tf2pose/pose")
    with (
        running("autoware/pose2tf.py", "/pose", "base"),
        running("autoware/tf2pose.py", "map", "base", "50"),
    ):
        until(lambda: bool(came), meanwhile=lambda: publisher.publish(pose))
    assert came[0] == pose


def test_view_frames(graph: Graph, tmp_path: Path) -> None:
    broadcaster = tf2.StaticTransformBroadcaster(graph.node("robot"))
    broadcaster.sendTransform(message(3, frames=2).transforms)
    out = tmp_path / "frames"
    with running(
        "geometry2/tf2_tools/tf2_tools/view_frames.py", "-t", "6", "-o", str(out)
    ) as program:
        program.wait(30)
    drawn = out.with_suffix(".gv").read_text()
    assert '"base" -> "frame0"' in drawn
    assert '"base" -> "frame1"' in drawn


def test_py_trees_ros(tmp_path: Path) -> None:
    """The package's tests of transforms run with only the needed parts of the package."""
    transforms = source("py_trees_ros/py_trees_ros/transforms.py")
    tests = source("py_trees_ros/tests/test_transforms.py")
    site = source("site")
    package = tmp_path / "py_trees_ros"
    package.mkdir()
    (package / "__init__.py").write_text("from . import transforms, utilities\n")
    (package / "transforms.py").write_text(transforms.read_text())
    (package / "utilities.py").write_text(
        "from rclpy.qos import QoSProfile\n\n\n"
        "def qos_profile_unlatched():\n    return QoSProfile(depth=1)\n"
    )
    path = os.pathsep.join([str(tmp_path), os.environ["PYTHONPATH"], str(site)])
    done = subprocess.run(
        [sys.executable, "-m", "tfdb.tf2", "-m", "pytest", "-q", "-p", "no:cacheprovider", tests],
        env=os.environ | {"PYTHONPATH": path},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "3 passed" in done.stdout
