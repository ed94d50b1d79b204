"""Debian's tf2_ros over a real roscore (ROS 1), on loopback: who publishes, and who listens."""

from __future__ import annotations

import atexit
import os
import signal
import socket
import subprocess
import tempfile
import time

# Said before ROS is imported: nothing leaves this machine, and no log stays.
FOLDER = tempfile.TemporaryDirectory()
os.environ |= {"ROS_IP": "127.0.0.1", "ROS_HOME": FOLDER.name, "ROS_LOG_DIR": FOLDER.name}

import rosgraph  # noqa: E402
import roslaunch  # noqa: E402, F401 - roscore is made of it
import rospy  # noqa: E402
import scenario  # noqa: E402
import tf2_ros  # noqa: E402
from geometry_msgs.msg import TransformStamped  # noqa: E402
from tf2_calls import message  # noqa: E402

PATIENCE = 30.0  # seconds that a master, or a connection, may take
LATEST = rospy.Time(0)


def ros_time(stamp: int) -> rospy.Time:
    """Make a time of nanoseconds."""
    return rospy.Time(*divmod(stamp, 10**9))


def wait_for(what: str, is_there: object) -> None:
    """Look again and again, for as long as one may wait."""
    end = time.monotonic() + PATIENCE
    while not is_there():
        if time.monotonic() > end:
            raise TimeoutError(f"no {what} within {PATIENCE:.0f} s")
        time.sleep(0.05)


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def stop(process: subprocess.Popen[bytes]) -> None:
    """End roscore as Ctrl-C does: it ends its own."""
    process.send_signal(signal.SIGINT)
    process.wait(timeout=PATIENCE)


class Listener(tf2_ros.TransformListener):
    """The listener of tf2_ros, counting its messages."""

    received = 0

    def callback(self, data: object) -> None:
        self.received += 1
        super().callback(data)


class Contender:
    """A node."""

    def make(self, chain: int) -> str:
        """Start a master and publish to it; return where it is."""
        port = free_port()
        uri = f"http://127.0.0.1:{port}"
        master = subprocess.Popen(
            ["roscore", "-p", str(port)],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "ROS_MASTER_URI": uri},
        )
        atexit.register(stop, master)
        wait_for("roscore", rosgraph.Master("/measure", uri).is_online)
        self.join(uri, chain)
        self.broadcaster = tf2_ros.TransformBroadcaster()
        self.next = scenario.START
        return uri

    def join(self, uri: str, chain: int) -> None:
        """Become a node of that master."""
        os.environ["ROS_MASTER_URI"] = uri
        rospy.init_node("measure", anonymous=True, disable_signals=True)
        atexit.register(rospy.signal_shutdown, "measured")
        self.names = scenario.names(chain)

    def write_each(self) -> None:
        """One message with a sample of each edge."""
        stamp = rospy.Time(self.next // 10**9, self.next % 10**9)
        self.broadcaster.sendTransform(
            [
                message(
                    TransformStamped,
                    *self.names[edge : edge + 2],
                    stamp,
                    scenario.moving_pose(edge, 0.5),
                )
                for edge in range(len(self.names) - 1)
            ]
        )
        self.next += scenario.PERIOD

    def write_now(self) -> None:
        """One message with a sample of the first edge, stamped when it was published."""
        stamp = ros_time(time.monotonic_ns())
        pose = scenario.moving_pose(0, 0.5)
        self.broadcaster.sendTransform([message(TransformStamped, *self.names[:2], stamp, pose)])

    def listen(self) -> None:
        """Subscribe; return when lookups are answered."""
        self.buffer = tf2_ros.Buffer(rospy.Duration(10), debug=False)
        self.listener = Listener(self.buffer)
        ends = self.names[0], self.names[-1]
        wait_for("transform", lambda: self.buffer.can_transform(*ends, LATEST))

    def look_up(self) -> None:
        self.buffer.lookup_transform(self.names[0], self.names[-1], LATEST)

    def received(self) -> int:
        """Messages since it listens."""
        return self.listener.received

    def leave(self) -> None:
        """Unsubscribe."""
        self.listener.unregister()
