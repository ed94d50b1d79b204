"""A network in this process: one thread delivers messages in order, but not across a cut."""

from __future__ import annotations

import queue
import threading
from collections import defaultdict
from typing import TYPE_CHECKING, Any

from tfdb.net.link import ALL

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from tfdb.net.link import Token
    from tfdb.net.messages import Question, Role


class Network:
    """The common part of links."""

    def __init__(self) -> None:
        self.calls: queue.SimpleQueue[Callable[[], object] | None] = queue.SimpleQueue()
        self.links: list[MemoryLink] = []
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def run(self) -> None:
        """Deliver messages."""
        while (call := self.calls.get()) is not None:
            call()

    def link(self) -> MemoryLink:
        """Make a link."""
        made = MemoryLink(self)
        self.links.append(made)
        return made

    def close(self) -> None:
        """End the thread."""
        self.calls.put(None)
        self.thread.join()


class MemoryLink:
    """See `tfdb.net.link.Link`."""

    def __init__(self, network: Network) -> None:
        self.network = network
        self.is_cut = self.closed = False
        self.declared: dict[str, list[Any]] = defaultdict(list)

    def reached(self) -> list[MemoryLink]:
        """Return the links that this one reaches."""
        return [
            each for each in self.network.links if each is self or not (each.is_cut or self.is_cut)
        ]

    def declare(self, key: str, what: Any) -> Declared:
        """Store a declaration under a key."""
        self.declared[key].append(what)
        return Declared(self.declared[key], what)

    def send(self, name: str) -> tuple[Callable[[bytes], None], Declared]:
        """See `Link`."""

        def put(data: bytes) -> None:
            for link in self.reached():
                for take in list(link.declared[f"{name}/log"]):
                    self.network.calls.put(lambda take=take: take(data))

        return put, self.declare(f"{name}/publisher", put)

    def hear(self, name: str, take: Callable[[bytes], None]) -> Declared:
        """See `Link`."""
        return self.declare(f"{name}/log", take)

    def serve(self, name: str, answer: Callable[[Question], Iterable[bytes]]) -> Declared:
        """See `Link`."""
        return self.declare(f"{name}/server", answer)

    def ask(self, name: str, question: Question, take: Callable[[bytes | None], None]) -> Request:
        """See `Link`."""
        request = Request(take)

        def reply() -> None:
            for link in self.reached():
                for answer in list(link.declared[f"{name}/server"]):
                    for message in answer(question):
                        request.take(message)
            request.end()

        self.network.calls.put(reply)
        return request

    def renew(self) -> None:
        """This network loses no declarations."""

    def announce(self, name: str, token: Token) -> Declared:
        """See `Link`."""
        made = self.declare(f"{name}/tokens", token)
        self.tell(name, token, True)
        made.ended = lambda: self.tell(name, token, False)
        return made

    def tell(self, name: str, token: Token, alive: bool) -> None:
        """Call the watchers of a token."""
        for link in self.reached() if token.role == "home" else ():
            for take in list(link.declared[f"{name}/watchers"]):
                self.network.calls.put(lambda take=take: take(token, alive))

    def watch(self, name: str, take: Callable[[Token, bool], None]) -> Declared:
        """See `Link`."""
        made = self.declare(f"{name}/watchers", take)
        for _, token in self.tokens(name):
            if token.role == "home":
                self.network.calls.put(lambda token=token: take(token, True))
        return made

    def tokens(self, name: str) -> list[tuple[str, Token]]:
        """See `Link`."""
        return self.found(name, "tokens")

    def report(self, name: str, role: Role, status: Callable[[], bytes]) -> Declared:
        """See `Link`."""
        return self.declare(f"{name}/statuses", status)

    def statuses(self, name: str, timeout: float) -> list[tuple[str, bytes]]:
        """See `Link`."""
        return [(where, status()) for where, status in self.found(name, "statuses")]

    def found(self, name: str, kind: str) -> list[tuple[str, Any]]:
        """Return the declarations of a kind, with their namespaces."""
        return [
            (key.removesuffix(f"/{kind}"), each)
            for link in self.reached()
            for key, declared in list(link.declared.items())
            if key == f"{name}/{kind}" or (name == ALL and key.endswith(f"/{kind}"))
            for each in declared
        ]

    def heal(self) -> None:
        """End a cut: tokens of both sides become visible again."""
        self.is_cut = False
        for link in self.network.links:
            for key, tokens in list(link.declared.items()):
                name, _, kind = key.rpartition("/")
                for token in list(tokens) if kind == "tokens" else ():
                    link.tell(name, token, True)

    def close(self) -> None:
        """See `Link`."""
        self.closed = True
        self.declared.clear()


class Request:
    """See `tfdb.net.link.Request`."""

    def __init__(self, take: Callable[[bytes | None], None]) -> None:
        self.pass_on: Callable[[bytes | None], None] | None = take

    def take(self, message: bytes) -> None:
        """Pass a message on, unless the request has ended."""
        if self.pass_on is not None:
            self.pass_on(message)

    def check(self) -> None:
        """No message of this network is late."""

    def end(self) -> None:
        """See `tfdb.net.link.Request`."""
        pass_on, self.pass_on = self.pass_on, None
        if pass_on is not None:
            pass_on(None)


class Declared:
    """A declaration."""

    def __init__(self, where: list[Any], what: Any) -> None:
        self.where, self.what = where, what
        self.ended: Callable[[], None] = lambda: None

    def undeclare(self) -> None:
        """End the declaration. A second call does nothing."""
        if any(each is self.what for each in self.where):
            self.where[:] = [each for each in self.where if each is not self.what]
            self.ended()
