"""The messages that `tfdb.tf2` uses where no ROS is installed."""

from __future__ import annotations

from tfdb.ros.msgs import *  # noqa: F403 - the same names
