"""The server of the page: HTTP for its files, a WebSocket for each viewer; one thread."""

from __future__ import annotations

import asyncio
import http
import ipaddress
import logging
import secrets
import socket
import time
from collections import deque
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import parse_qs, urlsplit

from websockets.asyncio.server import ServerConnection, broadcast, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from tfdb.data.errors import NotSupported, TfdbError, WaitTimeout

from .messages import (
    EVENTS,
    FASTEST,
    MOST_BYTES,
    At,
    BadMessage,
    Rate,
    read_question,
    write_text,
)
from .metrics import OPEN_METRICS, OPEN_METRICS_TYPE, PROMETHEUS_TYPE, one, write_metrics

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence
    from typing import Any

    from .model import Model, Topology
    from .shapes import Shapes

VIEWERS = 32
"""Largest number of viewers; others get the status 503."""
BACKLOG = 1 << 20
"""Unread bytes of a viewer from which on it misses ticks."""
_GATHERS = 0.005
"""Seconds to wait after an awaited commit for others that often follow it. The next tick is then
late enough to find the next commit without a wait."""
_IDLE = 1.0
"""Seconds between two checks of the viewers, and of the clock of a store without commits."""
_LOOK = 0.1
"""Seconds between two checks of expectations on missing data."""
_COUNTED = {
    "ticks": "Times that poses were sent.",
    "dropped": "Ticks that a viewer missed because it left too much unread.",
    "sent_bytes": "Bytes that were sent to viewers.",
    "questions": "Messages of viewers.",
    "refused": "Messages of viewers that could not be answered.",
}
_TYPES = {
    "index.html": "text/html; charset=utf-8",
    "app.js": "text/javascript; charset=utf-8",
    "scene.js": "text/javascript; charset=utf-8",
    "shapes.js": "text/javascript; charset=utf-8",
    "tree.js": "text/javascript; charset=utf-8",
    "three.js": "text/javascript; charset=utf-8",
    "style.css": "text/css; charset=utf-8",
    "favicon.svg": "image/svg+xml",
}
"""The files of the page and their types. Other than these, only a robot's shapes are served."""
_HEADERS = {
    "Content-Security-Policy": "default-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-cache",
}
_LOGGER = logging.getLogger("tfdb.view")
_QUIET = logging.getLogger("tfdb.view.connections")
_QUIET.setLevel(logging.CRITICAL)  # peers may send anything


@dataclass(eq=False)
class Viewer:
    """An open page."""

    connection: ServerConnection
    hz: int = FASTEST
    past: int | None = None
    """The stamp that it shows; None: the newest samples."""
    topology: Topology | None = None
    """The tree that it has."""
    is_behind: bool = True
    """Whether it needs all poses, because it has missed some."""
    lacks_facts: bool = False
    missed: deque[str] = field(default_factory=lambda: deque(maxlen=EVENTS))
    """Events that could not be sent yet."""
    next: float = 0.0
    """Monotonic time of its next poses, if it limits their rate."""
    asked: asyncio.Event = field(default_factory=asyncio.Event)
    """Set when it requests another stamp."""

    @property
    def is_full(self) -> bool:
        """Whether it has too many unread bytes."""
        return self.connection.transport.get_write_buffer_size() > BACKLOG

    def tell(self, message: str | bytes) -> None:
        """Send without waiting; nothing happens if the connection is closed."""
        broadcast([self.connection], message)


class Server:
    """Serves one store to browsers. Threads: one, that of its loop.

    Parameters
    ----------
    model
        The store.
    host, port
        Where to listen; port 0: any free port.
    names
        Host names that browsers may use for the server, beside addresses and localhost.
    hz
        Poses a second.
    shapes
        The shapes of a robot model that the page draws.
    """

    def __init__(
        self,
        model: Model,
        *,
        host: str = "127.0.0.1",
        port: int = 0,
        names: Iterable[str] = (),
        hz: int = 30,
        shapes: Shapes | None = None,
    ) -> None:
        self._model, self._host, self._port, self._hz = model, host, port, hz
        self._token = "" if is_loopback(host) else secrets.token_urlsafe(24)
        self._names = {"localhost", host.lower(), *(name.lower() for name in names)}
        if self._token:
            self._names.add(socket.gethostname().lower())
        folder = Path(__file__).parent / "page"
        self._files = {name: (kind, (folder / name).read_bytes()) for name, kind in _TYPES.items()}
        self._shapes = ""
        """Identifies the shapes; empty without shapes."""
        if shapes is not None:
            self._shapes = shapes.mark
            self._files["shapes.json"] = "application/json", shapes.text
            for number, mesh in enumerate(shapes.meshes):
                self._files[f"mesh/{number}"] = "application/octet-stream", mesh
        self._viewers: list[Viewer] = []
        self._came = asyncio.Event()
        """Set when a viewer connects."""
        self._told = -1, -1
        """The commit and clock settings of the facts that were sent last."""
        self._counts = dict.fromkeys(_COUNTED, 0)

    async def run(self, ready: Callable[[str], None]) -> None:
        """Serve until it is cancelled; `ready` is called with the address for browsers.

        Raises OSError if it cannot listen, and the error that ends a live store.
        """
        async with serve(
            self._meet,
            self._host,
            self._port,
            process_request=self._respond,
            compression=None,
            max_size=MOST_BYTES,
            server_header=None,
            close_timeout=1,
            ping_timeout=60,
            logger=_QUIET,
        ) as server:
            self._port = next(iter(server.sockets)).getsockname()[1]
            ready(self._address())
            try:
                await self._follow()
            except Exception as error:
                self._send_all(self._viewers, write_text("error", text=f"{error}", ends=True))
                raise

    def _address(self) -> str:
        host = self._host
        if host in ("0.0.0.0", "::"):  # noqa: S104 - the user chose it
            host = socket.gethostname()
        host = f"[{host}]" if ":" in host else host
        token = f"?token={self._token}" if self._token else ""
        return f"http://{host}:{self._port}/{token}"

    # Ticks.

    async def _follow(self) -> None:
        """Send each tick to all viewers. Raises the error that ends a live store."""
        model = self._model
        if model.live is None:
            await asyncio.Event().wait()
        facts, waited = 0.0, -1
        while True:
            commit = await self._wait()
            began = time.monotonic()
            events = model.judge()
            if self._viewers:
                if commit != model.commit:
                    changed = model.tick()
                    events += model.take_tree_events()
                    self._send(changed, began)
                elif self._is_owed():
                    self._send(b"", began)
                if events or (began >= facts and self._has_news()):
                    facts = began + model.rest
                    model.look()
                    if self._is_owed():
                        self._send(b"", began)
                    self._send_facts([*events, *model.take_tree_events()])
            if commit == waited:  # the removal of the store ends only a wait
                continue
            waited = commit
            if self._viewers or model.judges:
                await asyncio.sleep(max(began + 1 / self._hz - time.monotonic(), 0.0))
                continue
            self._came.clear()
            with suppress(TimeoutError):
                await asyncio.wait_for(self._came.wait(), _IDLE)

    async def _wait(self) -> int:
        """Wait for a new commit, or for the time of a check; return the newest commit."""
        model = self._model
        after = model.commit if self._viewers else model.store.commit
        timeout = _IDLE
        if model.judges or self._is_owed():
            timeout = _LOOK
        elif self._viewers and self._has_news():
            timeout = model.rest
        newest = model.store._last_to_follow
        if newest > after:
            return newest
        try:
            await model.store.wait_for_commit_async(after, timeout)
        except WaitTimeout:
            return after
        except NotSupported:  # this process may not wait at the store: it looks
            await asyncio.sleep(1 / self._hz)
        await asyncio.sleep(_GATHERS)
        return model.store.commit

    def _has_news(self) -> bool:
        """Whether the newest facts were not sent yet: after a commit, or a setting of the clock."""
        return self._told != (self._model.commit, self._model.settings)

    def _is_owed(self) -> bool:
        """Whether a viewer of the newest state has missed poses."""
        tree = self._model.topology
        return any(
            each.past is None and (each.is_behind or each.topology is not tree)
            for each in self._viewers
        )

    def _send_facts(self, events: Sequence[Mapping[str, Any]]) -> None:
        model = self._model
        self._told = model.commit, model.settings
        texts = [write_text("event", **event) for event in events]
        for viewer in self._viewers:
            if viewer.is_full:
                viewer.is_behind = viewer.lacks_facts = True
                viewer.missed.extend(texts)
                continue
            for text in texts:
                self._send_all([viewer], text)
            if viewer.topology is model.topology:
                self._send_all([viewer], model.facts)

    def _send(self, changed: bytes, now: float) -> None:
        """Send poses to viewers of the newest state: one message for all up-to-date viewers."""
        model = self._model
        self._counts["ticks"] += 1
        current = []
        whole = b""
        for viewer in self._viewers:
            if viewer.past is not None:
                continue
            if viewer.is_full:
                viewer.is_behind = True
                self._counts["dropped"] += bool(changed)
            elif viewer.topology is not model.topology or (viewer.is_behind and now >= viewer.next):
                whole = whole or model.whole()
                viewer.next = now + 1 / viewer.hz
                self._send_whole(viewer, whole)
            elif viewer.hz >= self._hz and not viewer.is_behind:
                current.append(viewer)
            elif changed:
                viewer.is_behind = True
        if changed:
            self._send_all(current, changed)

    def _send_whole(self, viewer: Viewer, whole: bytes) -> None:
        """Send a viewer all data that it needs before it gets changes only."""
        if viewer.topology is not self._model.topology:
            viewer.lacks_facts = True
        self._send_tree(viewer, self._model.topology)
        self._send_all([viewer], whole)
        for text in viewer.missed:
            self._send_all([viewer], text)
        if viewer.lacks_facts:
            self._send_all([viewer], self._model.facts)
        viewer.missed.clear()
        viewer.is_behind = viewer.lacks_facts = False

    def _send_tree(self, viewer: Viewer, topology: Topology) -> None:
        if viewer.topology is not topology:
            viewer.topology = topology
            self._send_all([viewer], topology.text)

    def _send_all(self, viewers: Sequence[Viewer], message: str | bytes) -> None:
        self._counts["sent_bytes"] += len(message) * len(viewers)
        broadcast([each.connection for each in viewers], message)

    # Viewers.

    async def _meet(self, connection: ServerConnection) -> None:
        """Serve one viewer until it leaves."""
        if len(self._viewers) >= VIEWERS:
            await connection.close(1013, f"{VIEWERS} viewers are already connected")
            return
        viewer = Viewer(connection)
        if self._model.live is not None and not self._viewers:
            self._model.look()
            self._told = self._model.commit, self._model.settings
            self._model.tick()
        self._viewers.append(viewer)
        self._came.set()
        past = asyncio.create_task(self._show_past(viewer))
        try:
            viewer.tell(self._model.hello(self._shapes))
            self._send_whole(viewer, self._model.whole())
            async for message in connection:
                self._counts["questions"] += 1
                await self._take(viewer, message)
        except ConnectionClosed:
            pass
        except Exception:
            _LOGGER.exception("a request of a viewer failed")
            raise
        finally:
            self._viewers.remove(viewer)
            past.cancel()
            await asyncio.wait([past])

    async def _take(self, viewer: Viewer, message: str | bytes) -> None:
        """Handle a viewer's message; the answer to an invalid one names the valid values."""
        try:
            question = read_question(message)
        except BadMessage as error:
            self._counts["refused"] += 1
            await viewer.connection.send(write_text("error", text=f"{error}", ends=False))
            return
        if isinstance(question, Rate):
            viewer.hz = question.hz
        elif isinstance(question, At):
            viewer.past = question.stamp
            if question.stamp is None:
                viewer.lacks_facts = True
                self._send_whole(viewer, self._model.whole())
                await viewer.connection.drain()
            else:
                viewer.asked.set()
        else:
            await viewer.connection.send(self._model.answer(question))

    async def _show_past(self, viewer: Viewer) -> None:
        """Send a viewer the past stamp that it requested last."""
        while True:
            await viewer.asked.wait()
            viewer.asked.clear()
            if viewer.past is None:
                continue
            try:
                topology, poses = self._model.at(viewer.past)
            except TfdbError as error:
                self._counts["refused"] += 1
                viewer.tell(write_text("error", text=f"{error}", ends=False))
                continue
            self._send_tree(viewer, topology)
            self._counts["sent_bytes"] += len(poses)
            try:
                await viewer.connection.send(poses)
            except ConnectionClosed:
                return

    # HTTP.

    def _respond(self, _connection: ServerConnection, request: Request) -> Response | None:
        """Answer plain HTTP requests; None: continue with the handshake of a WebSocket."""
        # Before version 17, websockets itself refuses other methods.
        if getattr(request, "method", "GET") != "GET":
            response = _text(http.HTTPStatus.METHOD_NOT_ALLOWED, "the page answers GET alone")
            response.headers["Allow"] = "GET"
            return response
        hosts, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
        path, _, query = request.path.partition("?")
        if len(hosts) != 1 or not self._is_host(hosts[0]):
            text = "the Host of a request must be an address or localhost; --allow-host adds names"
            return _text(http.HTTPStatus.FORBIDDEN, text)
        if any(each.partition("://")[2].lower() != hosts[0].lower() for each in origins):
            return _text(http.HTTPStatus.FORBIDDEN, "the Origin of a request must be its Host")
        cookie = f"tfdb_{self._port}"
        given = parse_qs(query).get("token", [])
        if not self._knows(given, request.headers.get_all("Cookie"), cookie):
            text = "open the address that tfdb view printed: it includes the token"
            return _text(http.HTTPStatus.UNAUTHORIZED, text)
        if path == "/live":
            if len(self._viewers) < VIEWERS:
                return None
            text = f"{VIEWERS} viewers are already connected: close one"
            return _text(http.HTTPStatus.SERVICE_UNAVAILABLE, text)
        if path == "/metrics":
            accepted = " ".join(request.headers.get_all("Accept"))
            kind = OPEN_METRICS_TYPE if OPEN_METRICS in accepted else PROMETHEUS_TYPE
            return _body(http.HTTPStatus.OK, kind, self._metrics().encode(errors="replace"))
        name = path.removeprefix("/") or "index.html"
        if name not in self._files:
            return _text(http.HTTPStatus.NOT_FOUND, f"no page at {path[:200]!r}")
        response = _body(http.HTTPStatus.OK, *self._files[name])
        if given and self._token:
            response.headers["Set-Cookie"] = (
                f"{cookie}={self._token}; Path=/; HttpOnly; SameSite=Strict"
            )
        return response

    def _is_host(self, host: str) -> bool:
        try:
            name = urlsplit(f"//{host}").hostname or ""
        except ValueError:
            return False
        return name in self._names or _is_address(name)

    def _knows(self, given: Sequence[str], cookies: Sequence[str], name: str) -> bool:
        """Whether a request has the token, in its URL or in a cookie."""
        if not self._token:
            return True
        pairs = [each.strip().partition("=") for line in cookies for each in line.split(";")]
        tokens = [*given, *(value for key, _, value in pairs if key == name)]
        mine = self._token.encode()
        return any(secrets.compare_digest(_raw(each), mine) for each in tokens)

    def _metrics(self) -> str:
        gauges = {
            "viewers": ("Viewers that are connected.", len(self._viewers)),
            "frames": ("Frames of the tree that was shown last.", len(self._model.topology.names)),
            "commit": ("The commit that was shown last.", self._model.commit),
        }
        return write_metrics(
            [
                *(one(f"tfdb_view_{name}", "gauge", *rest) for name, rest in gauges.items()),
                *(
                    one(f"tfdb_view_{name}", "counter", _COUNTED[name], count)
                    for name, count in self._counts.items()
                ),
                *self._model.metrics(),
            ]
        )


def is_loopback(host: str) -> bool:
    """Return whether only programs on this machine can reach a host."""
    return host == "localhost" or (_is_address(host) and ipaddress.ip_address(host).is_loopback)


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def _raw(text: str) -> bytes:
    return text.encode(errors="surrogateescape")


def _text(status: http.HTTPStatus, text: str) -> Response:
    return _body(status, "text/plain; charset=utf-8", f"{text}\n".encode())


def _body(status: http.HTTPStatus, kind: str, body: bytes) -> Response:
    headers = Headers(
        {"Content-Type": kind, "Content-Length": str(len(body)), "Connection": "close", **_HEADERS}
    )
    return Response(status.value, status.phrase, headers, body)
