"""The network interface of homes and mirrors, and its keys."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from tfdb.data.errors import InvalidName
from tfdb.data.stamps import shown

from .messages import epoch_of_text, epoch_text

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from tfdb.data.types import Epoch

    from .messages import Question, Role

_NAME = re.compile(r"[A-Za-z0-9_.\-]+(/[A-Za-z0-9_.\-]+)*")
_MOST = 255
_ROOT = "tfdb/1"
ALL = "**"
"""Stands for all namespaces in a key."""
CONNECT_MS = 3000
"""Milliseconds in which a router must answer."""


class Token(NamedTuple):
    """The liveliness token of a home, or of a mirror with its latest epoch."""

    role: Role
    epoch: Epoch
    owner: str = ""
    """Identifies a mirror. A home has none, because an epoch has one home."""

    def key(self, name: str) -> str:
        """Return its key."""
        number, ident = epoch_text(self.epoch).split("-")
        behind = f"/{self.owner}" if self.owner else ""
        return f"{_ROOT}/{name}/@{self.role}/{number}/{ident}{behind}"


def token_of(key: str) -> Token:
    """Read the key of a token. Raises ValueError for other keys."""
    _, _, rest = key.rpartition("/@")
    role, *numbers = rest.split("/")
    if len(numbers) != {"home": 2, "mirror": 3}.get(role):
        raise ValueError(f"{key!r} is not the key of a home or a mirror")
    epoch = epoch_of_text("-".join(numbers[:2]))
    return Token("home" if role == "home" else "mirror", epoch, "".join(numbers[2:]))


def name_of(key: str) -> str:
    """Return the namespace of the key of a token or a status."""
    return key.removeprefix(f"{_ROOT}/").rpartition("/@")[0]


def log_key(name: str) -> str:
    """Return the key on which a home sends its commits."""
    return f"{_ROOT}/{name}/log"


def ask_key(name: str, *, state: bool) -> str:
    """Return the key for requests to a home."""
    return f"{_ROOT}/{name}/{'state' if state else 'feed'}"


def tokens_key(name: str, role: Role) -> str:
    """Return the key that all tokens of a role match."""
    return f"{_ROOT}/{name}/@{role}/**"


def status_key(name: str, role: Role) -> str:
    """Return the key for requests of the status of homes or mirrors."""
    return f"{_ROOT}/{name}/@{role}/status"


def check_network_name(name: Any) -> str:
    """Return the name of a namespace. Raises InvalidName."""
    if not isinstance(name, str) or not _NAME.fullmatch(name) or len(name) > _MOST:
        text = f"{shown(name)} is not a valid namespace: it must be 1 to {_MOST} letters, digits, "
        text += "_ - . and single / between, such as robot1 or site2/robot1"
        raise InvalidName(text, value=name)
    return name


class Declared(Protocol):
    """A declaration that lasts until it is undeclared."""

    def undeclare(self) -> None:
        """End the declaration: no callback begins afterwards."""


class Request(Protocol):
    """A request that was sent. It ends once."""

    def check(self) -> None:
        """End it if no message has come for some seconds."""

    def end(self) -> None:
        """End it: no message of its answer comes any more, only None."""


class Link(Protocol):
    """A network. Threads: any. Its own threads run callbacks, which must not wait."""

    def send(self, name: str) -> tuple[Callable[[bytes], None], Declared]:
        """Return the function that sends a message of the log. It never waits: it may lose some."""

    def hear(self, name: str, take: Callable[[bytes], None]) -> Declared:
        """Call `take` with each message of the log."""

    def serve(self, name: str, answer: Callable[[Question], Iterable[bytes]]) -> Declared:
        """Answer requests; `answer` may wait, also between two messages."""

    def ask(
        self,
        name: str,
        question: Question,
        take: Callable[[bytes | None], None],
    ) -> Request:
        """Send a request to all homes; call `take` with each message of the answers, then None."""

    def renew(self) -> None:
        """Declare `serve` and `report` again if some seconds have passed. It never waits."""

    def announce(self, name: str, token: Token) -> Declared:
        """Publish a token until it is undeclared, or this process ends."""

    def watch(self, name: str, take: Callable[[Token, bool], None]) -> Declared:
        """Call `take` with each home's token, existing ones first, and whether it is alive."""

    def tokens(self, name: str) -> list[tuple[str, Token]]:
        """Return all present tokens of homes and mirrors, with their namespaces.

        `name` may be `ALL`.
        """

    def report(self, name: str, role: Role, status: Callable[[], bytes]) -> Declared:
        """Answer requests for the status; `status` must not wait."""

    def statuses(self, name: str, timeout: float) -> list[tuple[str, bytes]]:
        """Return the answers of homes and mirrors within `timeout` seconds, with their namespaces.

        `name` may be `ALL`.
        """

    @property
    def closed(self) -> bool:
        """Whether it has ended."""

    def close(self) -> None:
        """End it."""
