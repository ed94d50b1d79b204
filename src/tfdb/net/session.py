"""The connection of homes and mirrors to a network."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from tfdb.data.closable import Closable
from tfdb.data.errors import InvalidArgument, NotSupported
from tfdb.data.path_checks import check_path
from tfdb.data.stamps import shown

if TYPE_CHECKING:
    import os
    from collections.abc import Iterable

    from .link import Link

_ROUTER = "tcp/127.0.0.1:7447"


class Session(Closable):
    """A connection to other machines by Zenoh, for any number of homes and mirrors.

    It opens two sessions of Zenoh: one for data, one that follows who is alive. It is a context
    manager; close its homes and mirrors first.

    Parameters
    ----------
    connect
        Endpoint of a router, or several to try in turn, such as `tcp/10.0.0.1:7447`. Default: the
        router at tcp/127.0.0.1:7447, without `listen`.
    listen
        Endpoint, or several, at which this process is a router itself, such as
        `tcp/127.0.0.1:7447`. By default nothing listens.
    config
        Instead of both: Zenoh's configuration, as `tfdb.net.secure` makes it, or a file of it.
        Where it says nothing else, the mode is `client`, nothing listens, and scouting is off.

    Raises
    ------
    NotSupported
        PyPI's eclipse-zenoh is not installed.
    ConnectionError
        No router answers, or the endpoint is taken.
    InvalidArgument
        `config` beside the others or not valid, or an endpoint that is none.
    OSError
        The file cannot be read.
    """

    def __init__(
        self,
        *,
        connect: str | Iterable[str] = (),
        listen: str | Iterable[str] = (),
        config: str | os.PathLike[str] | Mapping[str, Any] | None = None,
    ) -> None:
        there = check_endpoints("connect", connect, _ROUTER)
        here = check_endpoints("listen", listen, _ROUTER)
        if config is not None and (there or here):
            raise InvalidArgument("config is given without connect and listen: it has them")
        try:
            from .zenoh_link import config_for, configs_of, open_link  # noqa: PLC0415 - an extra
        except ImportError as error:
            text = f"tfdb.net needs eclipse-zenoh: pip install 'tfdb[net]' ({error})"
            raise NotSupported(text, reason="eclipse-zenoh") from error
        if config is not None:
            text, self._where = _read(config)
            data, tokens = configs_of(text, self._where)
        elif here:
            self._where = ", ".join([*here, *there])
            data, tokens = config_for("router", there, here), config_for("client", here, [])
        else:
            there = there or [_ROUTER]
            self._where = ", ".join(there)
            data, tokens = config_for("client", there, []), config_for("client", there, [])
        self._link: Link = open_link(data, tokens, self._where)
        self._is_closed = False

    @property
    def link(self) -> Link:
        """What homes and mirrors use."""
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
    """Return a configuration as text, and what errors call it."""
    if not isinstance(config, Mapping):
        return check_path(config).read_text(), str(config)
    try:
        text = json.dumps(dict(config))
    except (TypeError, ValueError) as error:
        raise InvalidArgument(f"config cannot be written as JSON: {error}") from error
    ends = [config.get(each) for each in ("listen", "connect")]
    found = [each for end in ends if isinstance(end, Mapping) for each in end.get("endpoints", ())]
    return text, ", ".join(map(str, found)) or "those of config"


def check_endpoints(name: str, value: str | Iterable[str], example: str) -> list[str]:
    """Return endpoints. Raises InvalidArgument."""
    found: list[Any] = [value] if isinstance(value, str) else list(value)
    for each in found:
        if not isinstance(each, str) or each.count("/") != 1 or not all(each.split("/")):
            text = f"{name} has endpoints such as {example}, got {shown(each)}"
            raise InvalidArgument(text, value=each)
    return found
