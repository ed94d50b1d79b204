"""One master and one rospy program for all tests of live nodes."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING

import pytest

from ros.real_ros1 import RospyChild, running_master

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


@pytest.fixture(scope="session")
def master_uri() -> Iterator[str]:
    """URI of a real master."""
    with running_master() as uri:
        yield uri


@pytest.fixture
def ros1(master_uri: str, monkeypatch: pytest.MonkeyPatch) -> str:
    """Let this process belong to the graph of the master; return the master's URI."""
    monkeypatch.setenv("ROS_MASTER_URI", master_uri)
    monkeypatch.setenv("ROS_IP", "127.0.0.1")
    monkeypatch.delenv("ROS_HOSTNAME", raising=False)
    monkeypatch.delenv("ROS_NAMESPACE", raising=False)
    return master_uri


@pytest.fixture(scope="session")
def rospy_child(master_uri: str) -> Iterator[RospyChild]:
    """A rospy program that runs until the end of all tests."""
    child = RospyChild(master_uri, "theirs")
    yield child
    child.end()


@pytest.fixture
def new_child(ros1: str) -> Iterator[Callable[[str], RospyChild]]:
    """Starts rospy programs that end with the test."""
    with ExitStack() as stack:

        def make(name: str) -> RospyChild:
            child = RospyChild(ros1, name)
            stack.callback(child.end)
            return child

        yield make
