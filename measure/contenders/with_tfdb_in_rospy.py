"""tfdb's listener in a live graph of ROS 1: in a process of rospy, through rospy's connections."""

from __future__ import annotations

import atexit
import os
import sys
import tempfile

# Debian's packages behind those of this interpreter.
sys.path.append("/usr/lib/python3/dist-packages")
FOLDER = tempfile.TemporaryDirectory()
os.environ |= {"ROS_IP": "127.0.0.1", "ROS_HOME": FOLDER.name, "ROS_LOG_DIR": FOLDER.name}

import rospy  # noqa: E402
import with_tfdb_live  # noqa: E402

from tfdb.ros.rospy_node import RospyNode  # noqa: E402


class Contender(with_tfdb_live.Contender):
    """A node that listens."""

    def join(self, uri: str) -> None:
        """Become a node of that master."""
        os.environ["ROS_MASTER_URI"] = uri
        rospy.init_node("measure", anonymous=True, disable_signals=True)
        atexit.register(rospy.signal_shutdown, "measured")
        self.node = RospyNode()
