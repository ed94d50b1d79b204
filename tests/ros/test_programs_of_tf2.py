"""Debian's unchanged tf2 programs, on Debian's tf2_ros and on tfdb, with Debian's publisher."""

from __future__ import annotations

import re
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from ros.real_ros1 import PYTHON, environment, need
from tfdb import tf2
from tfdb.ros import TcprosNode
from tfdb.tf2 import msgs

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

DEBIAN = "/usr/lib/python3/dist-packages"
TOOLS = "/usr/lib/tf2_tools"
PUBLISHER = "/usr/lib/tf2_ros/static_transform_publisher"
POSE = ["1.25", "2", "3", "0", "0.6", "0", "0.8"]
LIMIT = 60.0
OURS = [sys.executable, "-m", "tfdb.tf2"]
THEIRS = [PYTHON]


@pytest.fixture
def robot(ros1: str) -> Iterator[str]:
    """Start Debian's static_transform_publisher of T[map<-base_link]; return the graph's URI."""
    need()
    with subprocess.Popen(
        [PUBLISHER, *POSE, "map", "base_link"],
        env=environment(ros1),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    ) as publisher:
        yield ros1
        publisher.terminate()


def program(how: list[str], uri: str, folder: Path, *command: str) -> subprocess.Popen[str]:
    path = {"PYTHONPATH": DEBIAN} if how is OURS else {}
    return subprocess.Popen(
        [*how, *command],
        env=environment(uri) | path,
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def test_tools_print_the_same_as_on_tf2(robot: str, tmp_path: Path) -> None:
    """`echo.py` and `view_frames.py` run at the same time, because one of them listens for 5 s."""
    said = {}
    running = []
    for name, how in (("ours", OURS), ("theirs", THEIRS)):
        folder = tmp_path / name
        folder.mkdir()
        # Two nodes with the same name would end each other.
        echo_arguments = ("map", "base_link", "-l", "1", f"__name:=echo_{name}")
        echo = program(how, robot, folder, f"{TOOLS}/echo.py", *echo_arguments)
        view = program(how, robot, folder, f"{TOOLS}/view_frames.py", f"__name:=view_{name}")
        running.append((name, folder, echo, view))
    for name, folder, echo, view in running:
        out, _ = echo.communicate(timeout=LIMIT)
        assert echo.returncode == 0, out
        out = re.sub("current time [0-9.]*", "", out)
        # Without `dot` no picture is drawn.
        view.communicate(timeout=LIMIT)
        graph = (folder / "frames.gv").read_text()
        said[name] = out, re.sub("at time: [0-9.]*", "", graph)
    assert "- Translation: [1.250, 2.000, 3.000]" in said["ours"][0]
    assert '"map" -> "base_link"[label=" Broadcaster: /static_trans' in said["ours"][1]
    assert said["ours"] == said["theirs"]


def test_a_late_joiner_gets_their_publishers_transforms(robot: str) -> None:
    with TcprosNode("late") as node:
        buffer = tf2.Buffer(node=node)
        tf2.TransformListener(buffer, node)
        found = buffer.lookup_transform("map", "base_link", msgs.Time(), LIMIT)
        move, turn = found.transform.translation, found.transform.rotation
        pose = [move.x, move.y, move.z, turn.x, turn.y, turn.z, turn.w]
        assert pose == pytest.approx([float(value) for value in POSE])
        authority = buffer.buffer.frame_info("base_link").authority
        assert authority.startswith("/static_transform_publisher")


def test_a_program_of_rospy_on_ours(robot: str, tmp_path: Path) -> None:
    """The program is that of a tutorial, without tfdb."""
    source = tmp_path / "tutorial.py"
    source.write_text("""
import rospy, tf2_ros, tf2_geometry_msgs
from geometry_msgs.msg import PointStamped, TransformStamped

rospy.init_node("tutorial")
buffer = tf2_ros.Buffer(cache_time=rospy.Duration(20))
listener = tf2_ros.TransformListener(buffer)
broadcaster = tf2_ros.TransformBroadcaster()
carrot = TransformStamped()
carrot.header.stamp = rospy.Time.now()
carrot.header.frame_id, carrot.child_frame_id = "base_link", "carrot"
carrot.transform.translation.x, carrot.transform.rotation.w = 2.0, 1.0
assert buffer.can_transform("map", "base_link", rospy.Time(), rospy.Duration(20))
while not buffer.can_transform("map", "carrot", carrot.header.stamp, rospy.Duration(0.2)):
    broadcaster.sendTransform(carrot)
point = PointStamped(header=carrot.header)
point.header.frame_id = "carrot"
moved = buffer.transform(point, "map", rospy.Duration(1))
print(type(moved).__module__.split(".")[0], moved.header.frame_id, round(moved.point.z, 6))
try:
    buffer.lookup_transform("map", "nowhere", rospy.Time(), rospy.Duration(0.05))
except (tf2_ros.LookupException, tf2_ros.ExtrapolationException) as error:
    print(error)
""")
    said = {}
    for name, how in (("ours", OURS), ("theirs", THEIRS)):
        ran = program(how, robot, tmp_path, str(source))
        said[name], _ = ran.communicate(timeout=LIMIT)
        assert ran.returncode == 0, said[name]
    assert said["ours"].splitlines()[0] == "geometry_msgs map 1.08"
    assert said["ours"] == said["theirs"]


BY_HAND = """
import copy, threading
import rospy, tf2_ros
from tf2_msgs.msg import TFMessage
from geometry_msgs.msg import TransformStamped

rospy.init_node("by_hand", anonymous=True)


class Counting(tf2_ros.TransformListener):
    def __init__(self, buffer):
        self.heard = threading.Event()
        tf2_ros.TransformListener.__init__(self, buffer)

    def static_callback(self, data):
        print(type(data).__name__.strip("_"), data._connection_header["callerid"][:28])
        header, data = data._connection_header, copy.deepcopy(data)
        data._connection_header = header
        data.transforms[0].child_frame_id = "renamed"
        tf2_ros.TransformListener.static_callback(self, data)
        self.heard.set()


class Own(tf2_ros.TransformListener):
    def __init__(self, buffer):
        self.buffer = buffer
        self.last_update = rospy.Time.now()
        self.last_update_lock = threading.Lock()
        self.tf_sub = rospy.Subscriber("/tf", TFMessage, self.callback)
        self.tf_static_sub = rospy.Subscriber("/tf_static", TFMessage, self.static_callback)


def wait(buffer, frame):
    return buffer.can_transform("map", frame, rospy.Time(), rospy.Duration(20))


counted = tf2_ros.Buffer(debug=False)
counting = Counting(counted)
assert counting.heard.wait(20)
print(wait(counted, "renamed"), counted.can_transform("map", "base_link", rospy.Time()))

own = tf2_ros.Buffer()
print(own.frame_server.resolved_name.split("/")[-1], own.frame_server.service_class.__name__)
listener = Own(own)
print(wait(own, "base_link"))
broadcaster = tf2_ros.TransformBroadcaster()
moved = TransformStamped()
moved.header.stamp = rospy.Time.now()
moved.header.frame_id, moved.child_frame_id = "map", "carrot"
moved.transform.translation.x, moved.transform.rotation.w = 2.0, 1.0
while broadcaster.pub_tf.get_num_connections() < 1:
    rospy.sleep(0.01)
broadcaster.pub_tf.publish(TFMessage([moved]))
print(wait(own, "carrot"), broadcaster.pub_tf.resolved_name)
moved.child_frame_id = "apple"
broadcaster.pub_tf.publish([moved])
print(wait(own, "apple"))
listener.unregister()

plain = tf2_ros.TransformListener(own)
while plain.tf_sub.get_num_connections() < 1:
    rospy.sleep(0.01)
plain.check_for_reset()
other = tf2_ros.Buffer(debug=False)
plain.buffer = other
moved.child_frame_id = "pear"
broadcaster.sendTransform([moved])
print(wait(other, "pear"), own.can_transform("map", "pear", rospy.Time()), plain.tf_sub.name)
plain.tf_sub.unregister()
plain.tf_static_sub.unregister()
print(plain.tf_sub.impl, plain.tf_static_sub.impl)
client = tf2_ros.BufferClient("nowhere")
print(type(client.client).__name__, client.client.wait_for_server(rospy.Duration(0.01)))
"""


def test_overridden_callbacks_and_topics_by_hand(robot: str, tmp_path: Path) -> None:
    """The same program prints the same on both."""
    source = tmp_path / "by_hand.py"
    source.write_text(BY_HAND)
    said = {}
    for name, how in (("ours", OURS), ("theirs", THEIRS)):
        ran = program(how, robot, tmp_path, str(source))
        said[name], _ = ran.communicate(timeout=LIMIT)
        assert ran.returncode == 0, said[name]
    assert said["theirs"].splitlines()[0] == "TFMessage /static_transform_publisher_"
    assert said["ours"] == said["theirs"]
