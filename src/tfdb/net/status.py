"""Status of the homes and mirrors of a network."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

from tfdb._core import duration_to_nanoseconds
from tfdb.data.errors import CorruptMessage, InvalidArgument

from .home import HomeStats, link_of
from .link import ALL, check_network_name
from .messages import NONE, status_of
from .mirroring import MirrorStats

if TYPE_CHECKING:
    from tfdb.data.types import Epoch

    from .link import Token
    from .messages import Told
    from .session import Session

State: TypeAlias = Literal[
    "publishing",
    "fenced",
    "absent",
    "catching up",
    "live",
    "stale",
    "ended",
    "closed",
    "silent",
]


@dataclass(frozen=True)
class Status:
    """Status of a home or a mirror. `status` returns it."""

    name: str
    """The namespace."""
    role: Literal["home", "mirror"]
    owner: str
    """Identifies a mirror in its namespace; empty for a home."""
    state: State
    """As `Home.state` or `Mirror.state`. `silent`: it is connected, but did not answer in time."""
    epoch: Epoch | None
    """The home's epoch, or the latest that the mirror has received. None: it has received none."""
    commit: int | None
    """The last commit that the home has sent, or the mirror has applied. None: `silent`."""
    lag: int | None
    """Number of commits that the home has not sent, or the mirror lacks. None: `silent`."""
    behind: float | None
    """Seconds since the mirror last had all commits of its home; 0 for a home or a live or absent
    mirror.

    It is measured by the mirror's clock. If the network is cut, it counts from the last message.
    """
    stats: HomeStats | MirrorStats | None
    """Its counts. None: `silent`."""


def status(
    name: str | None = None, *, session: Session | None = None, timeout: float = 1.0
) -> list[Status]:
    """Return the status of the homes and mirrors of a network.

    ```python
    for each in tfdb.net.status():
        print(each.name, each.role, each.state, each.lag)
    ```

    Parameters
    ----------
    name
        The namespace. None: all. If access control permits only some namespaces, give one.
    session
        The connection. None: one to the router at tcp/127.0.0.1:7447, closed at the end.
    timeout
        Seconds to wait for answers. A home or mirror that is connected but does not answer is
        `silent`.

    Returns
    -------
    list
        Sorted by namespace, homes first.

    Raises
    ------
    InvalidName
        No namespace can have the name.
    InvalidArgument, TypeError
        The timeout is not positive, or an argument is invalid.
    NotSupported
        PyPI's eclipse-zenoh is not installed.
    ConnectionError
        No router answers.
    """
    key = ALL if name is None else check_network_name(name)
    seconds = duration_to_nanoseconds(timeout, "timeout") / 1e9
    if seconds <= 0:
        raise InvalidArgument(f"timeout must be positive, got {timeout!r}", value=timeout)
    with link_of(session) as (link, owned):
        try:
            tokens = link.tokens(key)
            answers = link.statuses(key, seconds)
        finally:
            if owned is not None:
                owned.close()
    found = [each for namespace, data in answers if (each := _read(namespace, data)) is not None]
    known = {_place(each) for each in found}
    silent = [_silent(namespace, token) for namespace, token in tokens]
    found += [each for each in silent if _place(each) not in known]
    return sorted(found, key=lambda each: (each.name, each.role, each.epoch or NONE, each.owner))


def _place(each: Status) -> tuple[object, ...]:
    """Sort key that identifies a home by its epoch, a mirror by its owner."""
    return each.name, each.role, each.owner or each.epoch


def _read(name: str, data: bytes) -> Status | None:
    """Return the status in an answer. None: another program sent it."""
    try:
        told = status_of(data)
    except CorruptMessage:
        return None
    stats: HomeStats | MirrorStats
    stats = HomeStats(*told.counts) if told.role == "home" else MirrorStats(*told.counts)
    return Status(
        name,
        told.role,
        told.owner if told.role == "mirror" else "",
        told.state,  # type: ignore[arg-type]
        told.epoch if told.epoch > NONE else None,
        told.commit,
        _lag(told, stats),
        told.behind / 1e9,
        stats,
    )


def _lag(told: Told, stats: HomeStats | MirrorStats) -> int:
    return stats.lag if isinstance(stats, MirrorStats) else max(told.newest - told.commit, 0)


def _silent(name: str, token: Token) -> Status:
    return Status(name, token.role, token.owner, "silent", token.epoch, None, None, None, None)
