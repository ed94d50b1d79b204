"""Unchanged public programs of ROS 1 on tfdb and on Debian's tf2, if sources are available.

TFDB_PUBLIC_PROGRAMS names a folder with `geometry_tutorials-kinetic`, the branch kinetic-devel of
geometry_tutorials. Its turtle_tf2_listener_wait.py is omitted, because it uses `tf2_ros.Exception`,
which no tf2 has. `tests/ros/in_ros2/public_programs_cases.py` has the tests for ROS 2.
"""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from ros.real_ros1 import PYTHON, environment, need, running_master
from ros.test_programs_of_tf2 import DEBIAN, LIMIT, OURS, THEIRS

if TYPE_CHECKING:
    from collections.abc import Iterator

PROGRAMS = Path(os.environ.get("TFDB_PUBLIC_PROGRAMS", "/nowhere"), "geometry_tutorials-kinetic")
MESSAGES = """
from genpy.dynamic import generate_dynamic


def made(name, text):
    return generate_dynamic("turtlesim/" + name, text)["turtlesim/" + name]


FIELDS = "float32 x\\nfloat32 y\\nfloat32 theta\\n"


class msg:
    Pose = made("Pose", FIELDS)


class srv:
    class Spawn:
        _type, _md5sum = "turtlesim/Spawn", "0b2d2e872a8e2887d5ed626f2bf2c561"
        _request_class = made("SpawnRequest", FIELDS + "string name\\n")
        _response_class = made("SpawnResponse", "string name\\n")
"""
# Two turtles that do not move; the first command of the second one is printed.
SIMULATOR = """
import rospy, turtlesim.msg, turtlesim.srv
from geometry_msgs.msg import Twist

rospy.init_node("turtlesim")
spawned = rospy.Service("spawn", turtlesim.srv.Spawn, lambda asked: [asked.name])
turtles = [rospy.Publisher("turtle%d/pose" % n, turtlesim.msg.Pose, queue_size=1) for n in (1, 2)]
commands = []
rospy.Subscriber("turtle2/cmd_vel", Twist, commands.append)
rate = rospy.Rate(50)
while not commands:
    turtles[0].publish(3.0, 5.0, 0.5)
    turtles[1].publish(1.0, 2.0, -0.25)
    rate.sleep()
print("%.5f %.5f" % (commands[0].linear.x, commands[0].angular.z))
"""
STANDING = {"turtle_tf_listener.py", "turtle_tf2_listener.py"}
"""These programs follow a turtle that does not move; the others follow a rotating carrot."""


@contextmanager
def running(
    how: list[str], uri: str, folder: Path, *command: str
) -> Iterator[subprocess.Popen[str]]:
    path = os.pathsep.join([str(folder), *([DEBIAN] if how is OURS else [])])
    with subprocess.Popen(
        [*how, *command],
        env=environment(uri) | {"PYTHONPATH": path},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as program:
        try:
            yield program
        finally:
            program.terminate()


def followed(how: list[str], folder: Path, nodes: Path, listener: str) -> str:
    """Return the first command to a turtle that follows another turtle or a carrot."""
    package = nodes.parent.name
    broadcaster = str(nodes / f"{package}_broadcaster.py")
    with running_master() as uri, ExitStack() as stack:
        for turtle in ("turtle1", "turtle2"):
            arguments = (f"_turtle:={turtle}", f"__name:=broadcaster_{turtle}")
            stack.enter_context(running(how, uri, folder, broadcaster, *arguments))
        for kind in ("dynamic", "fixed"):
            carrot = nodes / f"{kind}_{package.removeprefix('turtle_')}_broadcaster.py"
            stack.enter_context(running(how, uri, folder, str(carrot)))
        stack.enter_context(running(how, uri, folder, str(nodes / listener)))
        simulator = stack.enter_context(
            running([PYTHON], uri, folder, str(folder / "simulator.py"))
        )
        said, _ = simulator.communicate(timeout=LIMIT)
        assert simulator.returncode == 0, said
        return said


@pytest.mark.parametrize(
    "listener",
    [
        "turtle_tf/turtle_tf_listener.py",
        "turtle_tf/turtle_tf_listener_wait.py",
        "turtle_tf2/turtle_tf2_listener.py",
    ],
)
def test_a_turtle_follows(listener: str, tmp_path: Path) -> None:
    need()
    package, _, name = listener.partition("/")
    nodes = PROGRAMS / package / "nodes"
    if not nodes.is_dir():
        pytest.skip("TFDB_PUBLIC_PROGRAMS has no geometry_tutorials-kinetic")
    if sys.version_info[:2] != (3, 11):
        pytest.skip("Debian's ROS 1 is for Python 3.11")
    (tmp_path / "simulator.py").write_text(SIMULATOR)
    turtlesim = tmp_path / "turtlesim"
    turtlesim.mkdir()
    (turtlesim / "__init__.py").write_text(
        MESSAGES
        + "import sys\nsys.modules['turtlesim.msg'], sys.modules['turtlesim.srv'] = msg, srv\n"
    )
    ours = followed(OURS, tmp_path, nodes, name)
    assert all(float(word) for word in ours.split()), ours
    if name in STANDING:
        assert ours == followed(THEIRS, tmp_path, nodes, name)
