"""A Zenoh router for tests."""

from __future__ import annotations

import json
import socket
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator


def free_endpoint() -> str:
    """A free address on loopback."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{taken.getsockname()[1]}"


def overriding(endpoint: str) -> str:
    """Return ZENOH_CONFIG_OVERRIDE for the nodes of a router."""
    return f'connect/endpoints=["{endpoint}"]'


@contextmanager
def router_at(endpoint: str) -> Iterator[Any]:
    """Open a session that is a router."""
    import zenoh

    config = zenoh.Config()
    for key, value in (
        ("mode", "router"),
        ("listen/endpoints", [endpoint]),
        ("scouting/multicast/enabled", False),
        ("scouting/gossip/enabled", False),
    ):
        config.insert_json5(key, json.dumps(value))
    with zenoh.open(config) as session:
        yield session
