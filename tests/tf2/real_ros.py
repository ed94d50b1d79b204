"""Runs programs with the real messages of ROS 1 or ROS 2.

Where a ROS is missing the tests that need it skip and say so; with CI=true they fail.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from tools import make_ros2_env

from compat.tf2_oracle import unavailable
from tf2 import real_tf2

TESTS = Path(__file__).resolve().parents[1]


def run_with_ros1(program: str) -> None:
    """Run a program that prints `done` at its end."""
    if real_tf2.missing():
        unavailable(f"no ROS 1: {real_tf2.missing()}")
    if sys.version_info[:2] != (3, 11):
        unavailable("Debian's ROS 1 is for Python 3.11")
    # After our own, or the system's numpy would be taken.
    path = "import sys; sys.path.append('/usr/lib/python3/dist-packages')\n"
    _run(path + program, dict(os.environ))


def run_with_ros2(program: str) -> None:
    """Run a program that prints `done` at its end."""
    if not make_ros2_env.is_made():
        unavailable("no ROS 2: make ros2")
    _run(program, make_ros2_env.environment())


def _run(program: str, environment: dict[str, str]) -> None:
    paths = [str(TESTS), str(TESTS.parent), environment.get("PYTHONPATH", "")]
    done = subprocess.run(
        [sys.executable, "-c", program],
        env=environment | {"PYTHONPATH": os.pathsep.join(filter(None, paths))},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout) == (0, "done\n"), done.stderr
