"""The connection of homes and mirrors to a network."""

from __future__ import annotations

import json
import math
import re
import time
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from tfdb._core import duration_to_nanoseconds
from tfdb.data.argument_checks import unknown_word
from tfdb.data.closable import Closable
from tfdb.data.errors import InvalidArgument, NotSupported
from tfdb.data.path_checks import check_path
from tfdb.data.stamps import shown

if TYPE_CHECKING:
    import os
    from collections.abc import Callable

    from .link import Link

_ROUTER = "tcp/127.0.0.1:7447"
_PROTOCOLS = "tcp", "tls", "udp", "quic", "ws", "unixsock-stream", "serial", "vsock", "unixpipe"
_WITH_PORT = _PROTOCOLS[:5]
_ADDRESS = re.compile(r"(?:\[[0-9A-Fa-f:.%\w]+\]|[^\s:/\[\]]+):([0-9]{1,5})(?:[?#]\S*)?")
_PAUSE = 1.0
"""Seconds until the next attempt to reach a missing router."""


class Session(Closable):
    """A connection to other machines over Zenoh, for any number of homes and mirrors.

    It opens two sessions of Zenoh: one for data, one for liveliness tokens. It is a context
    manager; close its homes and mirrors first.

    Parameters
    ----------
    connect
        Endpoint of a router, such as `tcp/10.0.0.1:7447`, or several to try one after the other.
        Default without `listen`: the router at tcp/127.0.0.1:7447.
    listen
        Endpoint, or several, at which this process itself is a router, such as
        `tcp/127.0.0.1:7447`. By default it does not listen.
    config
        In place of both: a configuration of Zenoh, such as that of `tfdb.net.secure`, or a file
        with it. Unless it sets them, the mode is `client`, no port is opened, and scouting is off.
    wait
        Seconds to wait for a missing router. None: without limit. A process that listens does not
        wait: it connects once a router of `connect` answers.
    on_wait
        Function that is called once, if the router is missing, with a text that names it.

    Raises
    ------
    NotSupported
        PyPI's eclipse-zenoh is not installed.
    ConnectionError
        No router answers, and the process does not listen; or it cannot listen at an endpoint.
    InvalidArgument
        `config` together with `connect` or `listen`; an invalid `config`; an endpoint that is not
        PROTOCOL/HOST:PORT; a negative `wait`.
    TypeError
        `connect` or `listen` is neither a text nor a sequence of texts.
    OSError
        The file cannot be read, or the process may not open enough files.
    """

    def __init__(
        self,
        *,
        connect: str | Iterable[str] = (),
        listen: str | Iterable[str] = (),
        config: str | os.PathLike[str] | Mapping[str, Any] | None = None,
        wait: float | None = 0.0,
        on_wait: Callable[[str], object] | None = None,
    ) -> None:
        there = check_endpoints("connect", connect, _ROUTER)
        here = check_endpoints("listen", listen, _ROUTER)
        if config is not None and (there or here):
            raise InvalidArgument(
                "config cannot be combined with connect or listen: it contains the endpoints"
            )
        seconds = math.inf if wait is None else duration_to_nanoseconds(wait, "wait") / 1e9
        if seconds < 0:
            raise InvalidArgument(f"wait must not be negative, got {wait!r}", value=wait)
        try:
            from . import zenoh_link  # noqa: PLC0415 - an extra
        except ImportError as error:
            text = f"tfdb.net needs eclipse-zenoh: pip install 'tfdb[net]' ({error})"
            raise NotSupported(text, reason="eclipse-zenoh") from error
        if config is not None:
            text, self._where = _read(config)
            configs = zenoh_link.configs_of(text, self._where)
        else:
            there = there if there or here else [_ROUTER]
            self._where = ", ".join([*here, *there])
            configs = (
                zenoh_link.config_for("router" if here else "client", there, here),
                zenoh_link.config_for("client", here or there, []),
            )
        missing = ""
        until = -math.inf if zenoh_link.listeners(configs[0]) else time.monotonic() + seconds
        while True:
            try:
                self._link: Link = zenoh_link.open_link(*configs, self._where)
                if missing and on_wait is not None:
                    on_wait(missing)
                break
            except ConnectionError:
                if routers := zenoh_link.connect_later(configs[0]):
                    missing = f"no Zenoh router at {', '.join(routers)} yet: this process listens"
                    missing += ", and connects once it answers"
                    continue
                left = until - time.monotonic()
                if left <= 0:
                    raise
            if on_wait is not None:
                on_wait(f"no Zenoh router at {self._where}: retrying every second")
                on_wait = None
            time.sleep(min(_PAUSE, left))
        self._is_closed = False

    @property
    def link(self) -> Link:
        """The network interface for homes and mirrors."""
        if self._is_closed:
            raise InvalidArgument(f"the session at {self._where} is closed: make another")
        return self._link

    def close(self) -> None:
        """Close it. A second call does nothing."""
        if not self._is_closed:
            self._is_closed = True
            self._link.close()

    def __repr__(self) -> str:
        return f"<tfdb.net.Session at {self._where}>"


def _read(config: str | os.PathLike[str] | Mapping[str, Any]) -> tuple[str, str]:
    """Return a configuration as text, and its name for error texts."""
    if not isinstance(config, Mapping):
        return check_path(config).read_text(), str(config)
    try:
        text = json.dumps(dict(config))
    except (TypeError, ValueError) as error:
        raise InvalidArgument(f"config cannot be written as JSON: {error}") from error
    ends = [config.get(each) for each in ("listen", "connect")]
    found = [each for end in ends if isinstance(end, Mapping) for each in end.get("endpoints", ())]
    return text, ", ".join(map(str, found)) or "the endpoints of config"


def check_endpoints(name: str, value: str | Iterable[str], example: str) -> list[str]:
    """Return endpoints. Raises TypeError, InvalidArgument."""
    if not isinstance(value, Iterable):
        raise TypeError(f"{name} must be an endpoint such as {example}, or several, got {value!r}")
    found: list[Any] = [value] if isinstance(value, str) else list(value)
    for each in found:
        why = _why_no_endpoint(each)
        if why:
            text = f"{name} must have endpoints such as {example}, got {shown(each)}: {why}"
            raise InvalidArgument(text, value=each)
    return found


def _why_no_endpoint(value: Any) -> str:
    """Return why an endpoint is invalid; empty for a valid one."""
    protocol, slash, address = value.partition("/") if isinstance(value, str) else ("", "", "")
    if not slash or not address:
        return f"PROTOCOL/HOST:PORT is valid, with one of {', '.join(_WITH_PORT)}"
    if protocol not in _PROTOCOLS:
        return unknown_word(protocol, _PROTOCOLS)
    if protocol not in _WITH_PORT:
        return ""
    port = _ADDRESS.fullmatch(address)
    if port is None or not 0 < int(port[1]) < 1 << 16:
        return f"{protocol}/HOST:PORT is valid, with a port from 1 to 65535"
    return ""
