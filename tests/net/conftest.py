"""Networks for tests: one in memory, and Zenoh over loopback if it is installed."""

from __future__ import annotations

import importlib.util
import os
import socket
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any

import pytest

from tests.net.memory_link import Network

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from tfdb.net.link import Link

HAS_ZENOH = importlib.util.find_spec("zenoh") is not None
needs_zenoh = pytest.mark.skipif(
    not HAS_ZENOH and "CI" not in os.environ, reason="eclipse-zenoh is not installed"
)
LONGEST = 60.0
"""Seconds after which a waiting test fails."""


def free_endpoint() -> str:
    """Return a loopback endpoint that is free now."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{taken.getsockname()[1]}"


@contextmanager
def memory_links() -> Iterator[Callable[[], Link]]:
    """Links in memory."""
    network = Network()
    yield network.link
    network.close()


@contextmanager
def zenoh_links() -> Iterator[Callable[[], Link]]:
    """Sessions of Zenoh: the first is the router of the others."""
    from tfdb.net import Session

    endpoint = free_endpoint()
    with ExitStack() as stack:
        made: list[Any] = []

        def make() -> Link:
            where: dict[str, Any] = {"connect" if made else "listen": endpoint}
            made.append(Session(**where))
            stack.callback(made[-1].close)
            return made[-1].link  # type: ignore[no-any-return]

        yield make


@pytest.fixture(params=["memory", pytest.param("zenoh", marks=needs_zenoh)])
def links(request: pytest.FixtureRequest) -> Iterator[Callable[[], Link]]:
    """Makes links of one network. The first link is closed last."""
    with (memory_links if request.param == "memory" else zenoh_links)() as make:
        yield make
