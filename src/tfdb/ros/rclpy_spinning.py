"""Threads that work for a node of rclpy and end with it; one of them spins the node."""

from __future__ import annotations

import atexit
import threading
import weakref
from abc import ABC, abstractmethod
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Final, Protocol

from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

if TYPE_CHECKING:
    from collections.abc import Callable


__all__ = ["NodeThread", "Spinning", "is_up", "watch"]

# Seconds that the interpreter waits for a thread at its end.
_LEAVE_WITHIN: Final = 2.0
# Seconds between two checks whether a context is valid.
_LOOK_EVERY: Final = 0.1


def is_up(node: Any) -> bool:
    """Whether the node's context is neither shut down nor destroyed."""
    try:
        return bool(node.context.ok())
    except InvalidHandle:
        return False


class NodeThread(ABC):
    """A thread that works until it is closed or its context is shut down.

    Threads: any may call it. `close` does not wait for running work.
    """

    def __init__(self, node: Any, name: str) -> None:
        self._node = node
        self._name = name
        self._stopped = False
        self.thread: threading.Thread | None = None
        """The thread, once started."""

    def close(self) -> None:
        """End the thread."""
        self._stopped = True
        self._ring()

    def join(self, seconds: float | None = _LEAVE_WITHIN) -> bool:
        """Wait for its end, unless it is the calling thread. Return whether it has ended."""
        if self.thread is None or self.thread is threading.current_thread():
            return False
        self.thread.join(seconds)
        return not self.thread.is_alive()

    def _start(self) -> None:
        _threads.add(self)
        self.thread = threading.Thread(target=self._run, name=self._name, daemon=True)
        self.thread.start()

    def _is_running(self) -> bool:
        return not self._stopped and is_up(self._node)

    @abstractmethod
    def _ring(self) -> None:
        """Wake the thread to check its state."""

    @abstractmethod
    def _run(self) -> None:
        """Work until it should end."""


_threads: weakref.WeakSet[NodeThread] = weakref.WeakSet()


@atexit.register
def _leave() -> None:
    """Leave a wait; a thread that returned from it after the interpreter's end would crash."""
    left = list(_threads)
    for each in left:
        each.close()
    for each in left:
        each.join()


class Spinning(NodeThread):
    """Spins an rclpy node in its own thread and executor.

    If another executor has the node, the node stays there. If the node is added to another
    executor, it leaves this one. The thread ends when it is closed, or when `executor` or the
    context is shut down.

    Parameters
    ----------
    node
        A node of rclpy.
    ended
        Called in the thread when it ends.
    name
        Name of the thread.
    """

    def __init__(
        self,
        node: Any,
        ended: Callable[[], object] = lambda: None,
        name: str = "tfdb executor",
    ) -> None:
        super().__init__(node, name)
        self._ended = ended
        self._lock = threading.Lock()
        self._over = False
        self.executor: Any = _Executor(self, node.context)
        """An executor of rclpy; its `shutdown` ends the thread."""
        if node.executor is None:
            self.executor.add_node(node)
        self._start()

    @property
    def has_node(self) -> bool:
        """Whether this executor spins the node."""
        return self._node.executor is self.executor

    def _ring(self) -> None:
        with self._lock:
            if not self._over:
                # A step of the executor ends after one callback.
                self.executor.create_task(lambda: None)

    def _run(self) -> None:
        try:
            while self._is_running():
                self.executor.spin_once()
        except (ExternalShutdownException, InvalidHandle):
            return  # the context was shut down or destroyed: a usual end
        except RuntimeError:  # rclpy's RCLError: the context was shut down just before
            if is_up(self._node):
                raise
        finally:
            with self._lock:
                self._over = True
            self.executor.clean_up()
            self._ended()


class ContextNode(Protocol):
    """A tfdb node that ends with the context of its rclpy node."""

    given: Any

    @property
    def closed(self) -> bool: ...

    def _end(self) -> None: ...


def watch(node: ContextNode) -> None:
    """End a node when its context is shut down, even by a signal.

    A signal of the operating system shuts contexts down without the callbacks of
    `Context.on_shutdown`.
    """
    theirs = node.given
    with _watching:
        found = _watches.get(theirs.context)
        if found is None:
            found = _watches[theirs.context] = _ShutdownWatch(theirs)
        found.nodes.add(node)
    if not is_up(theirs):
        node._end()


class _ShutdownWatch(NodeThread):
    """Waits in a thread for the end of a context, while the context has an open tfdb node.

    It polls. rclpy triggers guard conditions before it shuts a context down, so an executor that is
    woken by a signal may find the context valid, and sleep again.
    """

    def __init__(self, node: Any) -> None:
        super().__init__(node, "tfdb shutdown")
        self.nodes: weakref.WeakSet[ContextNode] = weakref.WeakSet()
        self._rung = threading.Event()
        self._start()

    def _ring(self) -> None:
        self._rung.set()

    def _run(self) -> None:
        while self._has_open_node():
            self._rung.wait(_LOOK_EVERY)
        if not self._stopped:
            for node in list(self.nodes):
                node._end()

    def _has_open_node(self) -> bool:
        """Whether the context has an open node. If not, its next node gets a new watch."""
        with _watching:
            if not self._stopped and any(not node.closed for node in self.nodes):
                return True
            del _watches[self._node.context]
            return False


_watching = threading.RLock()
# A watch references its context. So it must remove itself, or both would never be freed.
_watches: dict[Any, _ShutdownWatch] = {}


class _Executor(SingleThreadedExecutor):  # type: ignore[misc]  # rclpy is not typed
    """An executor that can be shut down while its thread spins it.

    Threads: any may shut it down.
    """

    def __init__(self, spinning: Spinning, context: Any) -> None:
        super().__init__(context=context)
        self._spinning = weakref.ref(spinning)

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        """End the thread. Return whether it ended within `timeout` seconds; None: no limit."""
        spinning = self._spinning()
        if spinning is None:
            return self.clean_up()
        spinning.close()
        return spinning.join(timeout_sec)

    def clean_up(self) -> bool:
        """Shut down as rclpy's executor does."""
        with suppress(InvalidHandle):
            return bool(super().shutdown())
        return True
