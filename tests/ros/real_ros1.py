"""A real ROS 1 graph: Debian's master, and rospy programs in separate processes.

If Debian's packages are missing, tests that need them are skipped; with CI=true they fail.
"""

from __future__ import annotations

import json
import os
import socket
import subprocess
import time
import xmlrpc.client
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from compat.tf2_oracle import unavailable

if TYPE_CHECKING:
    from collections.abc import Iterator

PYTHON = "/usr/bin/python3"
CHILD = Path(__file__).with_name("rospy_child.py")
SECONDS = 20.0  # seconds after which a wait fails


@cache
def missing() -> str:
    """Return why ROS 1 is missing; empty: it is installed."""
    command = [PYTHON, "-c", "import rospy, rosmaster, tf2_ros, tf2_msgs.msg, tf.msg, actionlib"]
    environment = {"PATH": os.environ["PATH"]}
    try:
        tried = subprocess.run(
            command, env=environment, capture_output=True, text=True, check=False
        )
    except OSError as error:
        return f"{PYTHON}: {error}"
    return "" if tried.returncode == 0 else tried.stderr.strip().splitlines()[-1]


def need() -> None:
    """Skip the test without ROS 1, or fail with CI=true."""
    if missing():
        packages = "python3-rosmaster python3-rospy python3-tf2-ros python3-tf"
        unavailable(f"no real ROS 1: {missing()}; apt-get install {packages}")


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as tried:
        port: int = tried.getsockname()[1]
        return port


def environment(uri: str) -> dict[str, str]:
    """Return the environment in which a ROS program finds this master only."""
    return {
        "PATH": os.environ["PATH"],
        "HOME": os.environ.get("HOME", "/tmp"),
        "ROS_MASTER_URI": uri,
        "ROS_IP": "127.0.0.1",
    }


def until(holds: Any, what: str, seconds: float = SECONDS) -> None:
    """Poll for a state of another process."""
    deadline = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < deadline, f"not within {seconds} s: {what}"
        time.sleep(0.01)


def _answers(uri: str) -> bool:
    try:
        with xmlrpc.client.ServerProxy(uri) as master:
            return bool(master.getPid("/test"))
    except OSError:
        return False


@contextmanager
def running_master() -> Iterator[str]:
    """URI of a master that ends with the context."""
    need()
    port = free_port()
    uri = f"http://127.0.0.1:{port}"
    master = subprocess.Popen(
        ["/usr/bin/rosmaster", "--core", "-p", str(port)],
        env=environment(uri),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        until(lambda: _answers(uri), "an answer of the master")
        yield uri
    finally:
        master.terminate()
        master.wait(SECONDS)


class RospyChild:
    """A rospy program that executes commands."""

    def __init__(self, uri: str, name: str, python: str = PYTHON, script: Path = CHILD) -> None:
        self.process = subprocess.Popen(
            [python, script],
            env=environment(uri),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        self._name = name

    def call(self, verb: str, *arguments: Any) -> Any:
        """Execute a command; return the answer."""
        self.ask(verb, *arguments)
        return self.answer()

    def ask(self, verb: str, *arguments: Any) -> None:
        """Send a command, without waiting for the answer."""
        assert self.process.stdin
        if self._name:
            name, self._name = self._name, ""
            self.call("start", name)
        self.process.stdin.write(json.dumps([verb, *arguments]) + "\n")
        self.process.stdin.flush()

    def answer(self) -> Any:
        """Return the answer to the last command."""
        assert self.process.stdout
        line = self.process.stdout.readline()
        assert line, f"the program of rospy has ended with {self.process.wait()}"
        word, value = json.loads(line)
        assert word == "ok", value
        return value

    def kill(self) -> None:
        """Kill it by SIGKILL, so that it unregisters nothing."""
        self.process.kill()
        self.process.communicate()

    def end(self) -> None:
        """End it."""
        if self.process.poll() is None:
            self.process.stdin.close()  # type: ignore[union-attr]
            self.process.wait(SECONDS)
        self.process.stdout.close()  # type: ignore[union-attr]
