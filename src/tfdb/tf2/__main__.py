"""`python -m tfdb.tf2 [-m MODULE | PROGRAM] [ARGUMENTS]`: run a tf2 program on tfdb."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

from .installing import install

USAGE = """usage: python -m tfdb.tf2 [-m MODULE | PROGRAM] [ARGUMENTS]

Run a Python program unchanged, with tfdb in place of tf2_py, tf2_ros, tf2_geometry_msgs,
tf2_sensor_msgs, tf2_kdl and tf. Without ROS, tfdb also provides the message packages, such as
geometry_msgs, and rclpy.time and rclpy.duration. Nodes of rospy and rclpy need that ROS.
"""


def main() -> None:
    """Run the program that the command line names."""
    arguments = sys.argv[1:]
    if not arguments or arguments[0] in {"-h", "--help"} or arguments == ["-m"]:
        sys.stdout.write(USAGE)
        sys.exit(0 if arguments[:1] in (["-h"], ["--help"]) else 2)
    install()
    if arguments[0] == "-m":
        sys.argv = arguments[1:]
        runpy.run_module(arguments[1], run_name="__main__", alter_sys=True)
        return
    sys.argv = arguments
    sys.path[0] = str(Path(arguments[0]).resolve().parent)
    runpy.run_path(arguments[0], run_name="__main__")


main()
