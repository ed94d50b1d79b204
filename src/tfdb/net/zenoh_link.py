"""The network over Zenoh; no other file uses Zenoh."""

from __future__ import annotations

import atexit
import json
import os
import threading
import time
import weakref
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import zenoh

from tfdb.data.errors import InvalidArgument, TfdbError

from .link import CONNECT_MS, ask_key, log_key, name_of, status_key, token_of, tokens_key
from .messages import question_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from .link import Declared, Token
    from .messages import Question, Role

_ROLES: tuple[Role, Role] = "home", "mirror"
_ANSWERS = 4
"""Number of requests that are answered at the same time."""
_MOST_QUESTIONS = 64
"""Number of further requests that wait. Beyond it requests are ignored, and mirrors repeat them."""
_SHARED_MEMORY = "transport/shared_memory/enabled"
_PATIENCE = 5.0
"""Seconds to wait for an answer, or for its next message."""
_LONGEST_ANSWER = 3600.0
"""Seconds after which a request ends even if messages of its answer still come."""
_RENEWAL = 10.0
"""Seconds between two declarations of the same queryables.

If a connection between two routers ends and begins again at once, a router of Zenoh 1.10 may lose
the other one's queryables, and requests then end without an answer.
"""
_LAST_CALLS = 5.0
"""Seconds to wait for running calls when a session is closed."""


def open_link(data: zenoh.Config, tokens: zenoh.Config, where: str) -> ZenohLink:
    """Open the sessions. Raises ConnectionError, or OSError if Zenoh panics."""
    first = _open(data, where)
    try:
        return ZenohLink(first, _open(tokens, where))
    except BaseException:
        _close(first)
        raise


def _open(config: zenoh.Config, where: str) -> zenoh.Session:
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        text = f"no Zenoh router at {where}: start one, for example with listen= (--listen) in one "
        text += "of the processes"
        if here := listeners(config):
            text = f"cannot listen at {', '.join(here)}: another program listens there, or this "
            text += "machine does not have the address"
        raise ConnectionError(text) from error
    except BaseException as error:
        if type(error).__name__ != "PanicException":  # Zenoh's package does not export it
            raise
        text = f"Zenoh cannot open a session ({error}): check the limit of open files (ulimit -n)"
        raise OSError(text) from error


def _close(session: zenoh.Session) -> None:
    """Close a session, even one that does not reach its router."""
    with suppress(zenoh.ZError):  # Zenoh's own timeout has passed
        session.close()


def configs_of(text: str, where: str) -> tuple[zenoh.Config, zenoh.Config]:
    """Read the configuration for data, and derive that for tokens. Raises InvalidArgument."""
    try:
        data, tokens = zenoh.Config.from_json5(text), zenoh.Config.from_json5(text)
        for config in (data, tokens):
            _disable_listening(config)
        own = listeners(tokens)
        if own:  # tokens go through the router in the data session
            _set(tokens, "mode", "client")
            _set(tokens, "connect/endpoints", own)
            _set(tokens, "listen/endpoints", [])
            _set(tokens, "transport/link/tls/verify_name_on_connect", value=False)
            _set(tokens, "access_control/enabled", value=False)
    except zenoh.ZError as error:
        text = f"{where}: not a configuration of Zenoh in JSON5"
        raise InvalidArgument(f"config: {text}") from error
    return data, tokens


def listeners(config: zenoh.Config) -> list[str]:
    """Return the endpoints at which a configuration listens."""
    found: Any = json.loads(config.get_json("listen/endpoints"))
    if isinstance(found, dict):
        found = found.get(json.loads(config.get_json("mode")), [])
    return list(found)


def connect_later(config: zenoh.Config) -> list[str]:
    """Let a configuration that listens open before it is connected; Zenoh tries again by itself.

    Return the endpoints of the routers; none if the configuration stays as it was.
    """
    found: Any = json.loads(config.get_json("connect/endpoints"))
    if not found or not listeners(config) or config.get_json("connect/timeout_ms") == "-1":
        return []
    _set(config, "connect/timeout_ms", -1)
    _set(config, "connect/exit_on_failure", value=False)
    return [str(each) for each in found]


def _disable_listening(config: zenoh.Config) -> None:
    """Disable listening and scouting in a configuration, unless it sets them.

    Also disable Zenoh's shared memory: a process that is suspended for 0.1 s would lose a state,
    and a killed one would leave 16 MiB.
    """
    _set(config, _SHARED_MEMORY, value=False)
    if config.get_json("mode") == "null":
        _set(config, "mode", "client")
    for key in ("scouting/multicast/enabled", "scouting/gossip/enabled"):
        if config.get_json(key) == "null":
            _set(config, key, value=False)
    key = "listen/endpoints"
    if config.get_json(key) == zenoh.Config().get_json(key):  # all addresses
        _set(config, key, [])


def _set(config: zenoh.Config, key: str, value: object) -> None:
    config.insert_json5(key, json.dumps(value))


def config_for(mode: str, connect: list[str], listen: list[str]) -> zenoh.Config:
    """Make a configuration without scouting, which listens only at given endpoints."""
    config = zenoh.Config()
    for key, value in (
        ("mode", mode),
        ("connect/endpoints", connect),
        ("connect/timeout_ms", CONNECT_MS if connect else 0),
        ("connect/exit_on_failure", bool(connect)),
        ("listen/endpoints", listen),
        ("listen/exit_on_failure", True),
        ("scouting/multicast/enabled", False),
        ("scouting/gossip/enabled", False),
        (_SHARED_MEMORY, False),
    ):
        _set(config, key, value)
    return config


class ZenohLink:
    """See `Link`. Threads: any."""

    def __init__(self, data: zenoh.Session, tokens: zenoh.Session) -> None:
        self._data, self._tokens = data, tokens
        self._pool = ThreadPoolExecutor(_ANSWERS, "tfdb answers")
        self._waiting = threading.Semaphore(_ANSWERS + _MOST_QUESTIONS)
        self._handlers: set[threading.Event] = set()
        self._kept: set[_Declared] = set()
        self._queryables: set[_Queryables] = set()
        self._renewed = time.monotonic()
        self._calls, self._running = threading.Condition(), 0
        self._is_ending = False
        self._process = os.getpid()
        _LINKS.add(self)

    def send(self, name: str) -> tuple[Callable[[bytes], None], Declared]:
        """See `Link`."""
        publisher = self._data.declare_publisher(
            log_key(name), congestion_control=zenoh.CongestionControl.DROP, express=True
        )

        def put(data: bytes) -> None:
            self._call(publisher.put, data)

        return put, self._declared(publisher)

    def hear(self, name: str, take: Callable[[bytes], None]) -> Declared:
        """See `Link`."""

        def heard(sample: zenoh.Sample) -> None:
            take(sample.payload.to_bytes())

        declare = self._data.declare_subscriber
        return self._declared(self._call(declare, log_key(name), self._direct(heard)))

    def serve(self, name: str, answer: Callable[[Question], Iterable[bytes]]) -> Declared:
        """See `Link`."""

        def asked(query: zenoh.Query) -> None:
            if not self._waiting.acquire(blocking=False):
                query.drop()
                return
            try:
                self._pool.submit(self._answer, query, answer)
            except RuntimeError:  # the process is ending
                query.drop()

        return self._answered(asked, *(ask_key(name, state=state) for state in (False, True)))

    def _answer(self, query: zenoh.Query, answer: Callable[[Question], Iterable[bytes]]) -> None:
        try:
            found = query.parameters
            question = question_of(*(found.get(each) for each in ("since", "of", "epoch")))
            for message in answer(question):
                self._call(query.reply, query.key_expr, message)
        except (ValueError, zenoh.ZError):
            return  # the request is not a mirror's, or the mirror has ended
        finally:
            query.drop()
            self._waiting.release()

    def ask(self, name: str, question: Question, take: Callable[[bytes | None], None]) -> _Request:
        """See `Link`."""
        request = _Request(take)
        self._call(
            self._data.get,
            f"{ask_key(name, state=question.since is None)}?{question}",
            zenoh.handlers.Callback(request.take, request.end, indirect=False),
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=_LONGEST_ANSWER,
        )
        return request

    def announce(self, name: str, token: Token) -> Declared:
        """See `Link`."""
        declare = self._data.liveliness().declare_token
        return self._declared(self._call(declare, token.key(name)))

    def watch(self, name: str, take: Callable[[Token, bool], None]) -> Declared:
        """See `Link`."""

        def seen(sample: zenoh.Sample) -> None:
            token = _token(sample)
            if token is not None:
                take(token, sample.kind == zenoh.SampleKind.PUT)

        declare = self._tokens.liveliness().declare_subscriber
        key, called = tokens_key(name, "home"), self._direct(seen)
        return self._declared(self._call(declare, key, called, history=True))

    def tokens(self, name: str) -> list[tuple[str, Token]]:
        """See `Link`."""
        found: list[tuple[str, Token]] = []
        for role in _ROLES:
            # Zenoh reports a token to a session once, so a subscriber in this session may receive
            # it instead.
            for reply in self._call(self._replies, tokens_key(name, role)) or ():
                token = None if reply.ok is None else _token(reply.ok)
                if token is not None:
                    found.append((name_of(str(reply.ok.key_expr)), token))
        return found

    def _replies(self, key: str) -> list[Any]:
        replies: Any = self._data.liveliness().get(key, timeout=_PATIENCE)
        return list(replies)

    def report(self, name: str, role: Role, status: Callable[[], bytes]) -> Declared:
        """See `Link`."""
        key = status_key(name, role)

        def asked(query: zenoh.Query) -> None:
            # The store may be closed, or the requesting session may have ended.
            with suppress(TfdbError, zenoh.ZError):
                query.reply(key, status())
            query.drop()

        return self._answered(asked, key)

    def statuses(self, name: str, timeout: float) -> list[tuple[str, bytes]]:
        """See `Link`."""
        found: list[tuple[str, bytes]] = []
        ended = [threading.Event() for _ in _ROLES]

        def take(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                found.append((name_of(str(reply.ok.key_expr)), reply.ok.payload.to_bytes()))

        for role, end in zip(_ROLES, ended, strict=True):
            self._call(
                self._data.get,
                status_key(name, role),
                zenoh.handlers.Callback(take, end.set, indirect=False),
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
                congestion_control=zenoh.CongestionControl.DROP,
                timeout=timeout,
            )
        for end in ended:
            end.wait(timeout)  # at the end of the process, no answer comes
        return list(found)

    def renew(self) -> None:
        """See `Link`."""
        now = time.monotonic()
        if now - self._renewed < _RENEWAL:
            return
        self._renewed = now
        with suppress(RuntimeError):  # the link or the process is ending
            self._pool.submit(self._renew)

    def _renew(self) -> None:
        for each in list(self._queryables):
            with suppress(InvalidArgument, zenoh.ZError):  # the session was closed
                self._call(each.renew)

    def _answered(self, asked: Callable[[zenoh.Query], None], *keys: str) -> _Queryables:
        def declare() -> list[Declared]:
            return [self._data.declare_queryable(key, self._direct(asked)) for key in keys]

        made = _Queryables(self._call, self._kept, declare, self._queryables)
        self._kept.add(made)
        return made

    def _declared(self, *parts: Declared | None) -> _Declared:
        made = _Declared(self._call, self._kept, *filter(None, parts))
        self._kept.add(made)
        return made

    def _direct(self, call: Callable[[Any], None]) -> Any:
        """Let Zenoh's own threads make the calls; otherwise each handler would have a thread."""
        ended = threading.Event()
        self._handlers.add(ended)

        def finish() -> None:
            self._handlers.discard(ended)
            ended.set()

        return zenoh.handlers.Callback(call, finish, indirect=False)

    def _call(self, call: Callable[..., Any], *values: Any, **options: Any) -> Any:
        """Call Zenoh, but not at the end of the process: a returning thread would abort it.

        Raises InvalidArgument if the link is closed.
        """
        with self._calls:
            if self._is_ending:
                return None
            self._running += 1
        try:
            return call(*values, **options)
        except zenoh.ZError as error:
            if self.closed:
                raise InvalidArgument("the session is closed: make another") from error
            raise
        finally:
            with self._calls:
                self._running -= 1
                self._calls.notify_all()

    def end(self) -> None:
        """End the calls and close the link at the end of the process.

        Homes and mirrors may still use it, even if it was closed before.
        """
        with self._calls:
            self._is_ending = True
            self._calls.wait_for(lambda: not self._running, _LAST_CALLS)
        self.close()

    @property
    def closed(self) -> bool:
        """See `Link`."""
        return bool(self._data.is_closed())

    def close(self) -> None:
        """See `Link`."""
        if os.getpid() != self._process:
            return  # a child of `fork` has no threads of Zenoh, so this would never end
        _close(self._tokens)
        _close(self._data)
        # A thread of Zenoh that waits for the GIL when Python ends would abort the process.
        until = time.monotonic() + _LAST_CALLS
        for each in list(self._handlers):
            each.wait(max(until - time.monotonic(), 0.0))
        self._pool.shutdown()


_LINKS: weakref.WeakSet[ZenohLink] = weakref.WeakSet()
_ENDED: list[ZenohLink] = []
"""Links kept until the main thread frees them: another thread that frees a part would abort."""


def _close_all() -> None:
    _ENDED.extend(_LINKS)
    for link in _ENDED:
        link.end()


atexit.register(_close_all)


def _token(sample: zenoh.Sample) -> Token | None:
    try:
        return token_of(str(sample.key_expr))
    except ValueError:
        return None  # an answer of another program


class _Request:
    """See `Request`. Threads: any."""

    def __init__(self, take: Callable[[bytes | None], None]) -> None:
        self._take: Callable[[bytes | None], None] | None = take
        self._lock = threading.Lock()
        self._came = time.monotonic()

    def take(self, reply: zenoh.Reply) -> None:
        """Pass a message on, unless the request has ended."""
        if reply.ok is None:
            return
        data = reply.ok.payload.to_bytes()
        with self._lock:
            self._came = time.monotonic()
            if self._take is not None:
                self._take(data)

    def check(self) -> None:
        """See `Request`."""
        if time.monotonic() - self._came > _PATIENCE:
            self.end()

    def end(self) -> None:
        """See `Request`."""
        with self._lock:
            take, self._take = self._take, None
            if take is not None:
                take(None)


class _Declared:
    """A declaration of Zenoh. The link keeps it until it has ended."""

    def __init__(self, call: Callable[..., Any], kept: set[_Declared], *parts: Declared) -> None:
        self._call, self._kept, self._parts = call, kept, list(parts)

    def undeclare(self) -> None:
        """End it."""
        self._call(self._end)

    def _end(self) -> None:
        self._undeclare_parts()
        self._kept.discard(self)

    def _undeclare_parts(self) -> None:
        while self._parts:
            with suppress(zenoh.ZError):  # the session was closed before
                self._parts.pop(0).undeclare()


class _Queryables(_Declared):
    """Queryables that are declared again from time to time."""

    def __init__(
        self,
        call: Callable[..., Any],
        kept: set[_Declared],
        declare: Callable[[], list[Declared]],
        renewed: set[_Queryables],
    ) -> None:
        super().__init__(call, kept, *declare())
        self._declare, self._renewed = declare, renewed
        self._lock = threading.Lock()
        renewed.add(self)

    def renew(self) -> None:
        """Declare them again, unless they have ended."""
        with self._lock:
            if self not in self._renewed:
                return
            self._undeclare_parts()
            self._parts = self._declare()

    def _end(self) -> None:
        with self._lock:
            self._renewed.discard(self)
            super()._end()
