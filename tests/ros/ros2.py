"""A real ROS 2 for tests: Jazzy's rclpy, in processes that have its environment.

`python tools/make_ros2_env.py` makes it. If it is missing, tests that need it are skipped; with
CI=true they fail.
"""

from __future__ import annotations

import atexit
import importlib.util
import os
import socket
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from compat.tf2_oracle import unavailable

if TYPE_CHECKING:
    from types import ModuleType

ROOT = Path(__file__).resolve().parents[2]
LIMIT = 240.0


def _tool() -> ModuleType:
    spec = importlib.util.spec_from_file_location("make_ros2_env", ROOT / "tools/make_ros2_env.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@cache
def _domain() -> tuple[int, socket.socket]:
    """Reserve a ROS domain for this process; the socket holds it until the process ends."""
    for number in range(100):
        domain = 1 + (os.getpid() + number) % 100
        lock = socket.socket()
        try:
            # DDS uses UDP ports from here on, so only other tests use this TCP port.
            lock.bind(("127.0.0.1", 7400 + 250 * domain))
        except OSError:
            lock.close()
        else:
            atexit.register(lock.close)
            return domain, lock
    raise AssertionError("each of the 100 ROS domains is taken")


def own_domain() -> int:
    """A ROS domain that no other test process uses."""
    return _domain()[0]


def environment() -> dict[str, str]:
    """Return the environment of a process with ROS 2, tfdb and its own graph, or skip the test."""
    tool = _tool()
    if not tool.is_made():
        unavailable("no ROS 2: python tools/make_ros2_env.py")
    found: dict[str, str] = tool.environment()
    return found | {
        "PYTHONPATH": os.pathsep.join([found["PYTHONPATH"], str(ROOT / "tests")]),
        "ROS_DOMAIN_ID": str(own_domain()),
    }


def run_cases(path: Path) -> None:
    """Run a file of tests in a process that has ROS 2."""
    # ROS 2 imports deprecated parts of Python. A hanging test prints its stack before the limit.
    options = ["-q", "-p", "no:cacheprovider", "-W", "ignore::DeprecationWarning"]
    options += ["-o", f"faulthandler_timeout={LIMIT / 3}"]
    command = [sys.executable, "-m", "pytest", *options, str(path)]
    done = subprocess.run(
        command,
        env=environment(),
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        timeout=LIMIT,
    )
    assert done.returncode == 0, done.stdout + done.stderr
