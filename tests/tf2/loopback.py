"""A node whose graph is this process: topics by name, and a clock that the test sets."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tfdb.ros import Encoding, Flavor

OnMessage = Callable[[bytes | memoryview, str], None]


class Open:
    """Anything that can be closed."""

    native = None

    def __init__(self, close: Callable[[], None]) -> None:
        self._close = close

    def close(self) -> None:
        close, self._close = self._close, lambda: None
        close()


class Graph:
    """The topics that nodes share."""

    def __init__(self) -> None:
        self.readers: defaultdict[str, list[OnMessage]] = defaultdict(list)
        self.latched: dict[tuple[str, str], bytes] = {}


class LoopbackNode:
    """What `tfdb.ros.Node` says, in one process and one thread."""

    def __init__(
        self, graph: Graph | None = None, *, name: str = "/here", flavor: Flavor = "ros1"
    ) -> None:
        self.graph = graph or Graph()
        self.name = name
        self.flavor: Flavor = flavor
        self.encoding: Encoding = "ros1" if flavor == "ros1" else "cdr"
        self.closed = False
        self.simulated = False
        self.time = 0
        self.watches: list[Callable[[int], None]] = []
        self.services: dict[str, Callable[[bytes], bytes]] = {}

    def subscribe(
        self, topic: str, kind: str, on_message: OnMessage, *, latched: bool = False, **_: Any
    ) -> Open:
        readers = self.graph.readers[topic]
        readers.append(on_message)
        for (of, publisher), data in self.graph.latched.items():
            if of == topic:
                on_message(data, publisher)
        return Open(lambda: readers.remove(on_message))

    def advertise(self, topic: str, kind: str, *, latched: bool = False, **_: Any) -> Any:
        node = self

        class Publisher(Open):
            def publish(self, data: bytes) -> None:
                if latched:
                    node.graph.latched[topic, node.name] = data
                for reader in [*node.graph.readers[topic]]:
                    reader(data, node.name)

        return Publisher(lambda: node.graph.latched.pop((topic, node.name), None))

    def serve(self, name: str, kind: str, answer: Callable[[bytes], bytes]) -> Open:
        self.services[name] = answer
        return Open(lambda: self.services.pop(name))

    def now(self) -> int:
        return self.time

    def set_time(self, now: int) -> None:
        """As a message on /clock would."""
        self.simulated, self.time = True, now
        for watch in [*self.watches]:
            watch(now)

    def on_clock(self, called: Callable[[int], None]) -> Open:
        self.watches.append(called)
        return Open(lambda: self.watches.remove(called))

    def close(self) -> None:
        self.closed = True
        for watch in [*self.watches]:
            watch(self.time)
