"""The end of a RclpyNode, and its behaviour with changed private parts of rclpy."""

from __future__ import annotations

import gc
import signal
import subprocess
import sys
import threading
import weakref
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
import rclpy
from tf2_msgs.msg import TFMessage

import tfdb
from ros.in_ros2.graph import TF, Graph, Heard, as_bytes, connected, message, numbers, until
from tfdb.ros import rclpy_receiving

if TYPE_CHECKING:
    from collections.abc import Iterator

CHILD = Path(__file__).with_name("listening_child.py")

both_ways = pytest.mark.parametrize("own_thread", [True, False], ids=["own thread", "executor"])


@pytest.fixture
def flood() -> Iterator[None]:
    """A publisher in another context, which publishes on /tf until the end of the test."""
    other = Graph(rclpy.Context())
    publisher = other.node("flood").create_publisher(TFMessage, "/tf", 10)
    over = threading.Event()

    def run() -> None:
        data = as_bytes(1, frames=10)
        while not over.is_set():
            publisher.publish(data)

    thread = threading.Thread(target=run)
    thread.start()
    yield
    over.set()
    thread.join()
    other.end()


@pytest.fixture
def watcher() -> Iterator[Graph]:
    """A node that sees the graph from another context."""
    other = Graph(rclpy.Context())
    yield other
    other.end()


@both_ways
@pytest.mark.parametrize("round_", range(3))
def test_taken_back_amid_messages(graph: Graph, flood: None, own_thread: bool, round_: int) -> None:
    node = graph.node("ours", spin=True)
    ours = graph.ours(node, own_thread=own_thread)
    first, second = Heard(), Heard()
    opened = ours.subscribe("/tf", TF, first)
    ours.subscribe("/tf", TF, second)
    first.until(lambda it: len(it.messages) > 5)
    opened.close()
    opened.close()
    seen = len(second.messages)
    second.until(lambda it: len(it.messages) > seen + 5)
    until(lambda: node.count_subscribers("/tf") == 1)
    ended = len(first.messages)
    second.until(lambda it: len(it.messages) > seen + 10)
    assert len(first.messages) == ended


def test_closing_from_a_callback(graph: Graph, flood: None) -> None:
    ours = graph.ours(graph.node("ours"), own_thread=True)
    closed = threading.Event()

    def on_message(data: bytes | memoryview, publisher: str) -> None:
        ours.close()
        closed.set()

    ours.subscribe("/tf", TF, on_message)
    assert closed.wait(20)
    assert ours.closed
    for use in (lambda: ours.subscribe("/tf", TF, on_message), lambda: ours.advertise("/tf", TF)):
        with pytest.raises(tfdb.errors.NodeClosed, match="the node /ours is closed"):
            use()
    until(no_listener)


@pytest.mark.parametrize("end", ["destroyed", "shut down", "closed"])
def test_the_node_ends_amid_messages(graph: Graph, watcher: Graph, flood: None, end: str) -> None:
    node = graph.node("ours")
    ours = graph.ours(node, own_thread=True)
    heard = Heard()
    ours.subscribe("/tf", TF, heard)
    ours.subscribe("/tf_static", TF, heard, latched=True)
    heard.until(lambda it: len(it.messages) > 5)
    told: list[int] = []
    ours.on_clock(told.append)
    publisher = ours.advertise("/other", TF)
    publisher.publish(as_bytes(1))
    if end == "destroyed":
        node.destroy_node()
    elif end == "closed":
        ours.close()
    else:
        graph.context.shutdown()
    assert ours.closed
    assert len(told) == 1
    ours.on_clock(told.append)
    assert len(told) == 2
    with pytest.raises(tfdb.errors.NodeClosed):
        publisher.publish(as_bytes(1))
    until(no_listener)
    watch = watcher.node("watch")
    until(lambda: watch.count_subscribers("/tf") == 0)


def no_listener() -> bool:
    """Whether no receiving thread of tfdb remains."""
    return not [each for each in threading.enumerate() if each.name == "tfdb listener"]


class Older:
    """rclpy's private parts with a part missing or replaced."""

    def __init__(self, given: Any, **other: Any) -> None:
        self._given = given
        self._other = other

    def __getattr__(self, name: str) -> Any:
        if name in self._other:
            found = self._other[name]
            if found is None:
                raise AttributeError(name)
            return found
        return getattr(self._given, name)


def no_wait_set(*_: Any) -> None:
    raise TypeError("__init__(): incompatible constructor arguments")


class Bare:
    """A subscription that returns messages in another form."""

    def __init__(self, *given: Any) -> None:
        from rclpy.impl.implementation_singleton import rclpy_implementation

        self._real = rclpy_implementation.Subscription(*given)

    def take_message(self, kind: Any, raw: bool) -> tuple[bytes]:
        return (b"",)

    def destroy_when_not_in_use(self) -> None:
        self._real.destroy_when_not_in_use()


@both_ways
@pytest.mark.parametrize(
    "other",
    [{"WaitSet": None}, {"WaitSet": no_wait_set}, {"Subscription": None}, {"Subscription": Bare}],
    ids=["no wait set", "another wait set", "no subscription", "other messages"],
)
def test_an_unknown_rclpy_is_listened_to_by_its_subscriptions(
    graph: Graph,
    own_thread: bool,
    other: dict[str, Any],
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    known = rclpy_receiving._implementation()
    monkeypatch.setattr(rclpy_receiving, "_implementation", lambda: Older(known, **other))
    arguments = ["--ros-args", "-r", "tf:=moved"]
    node = graph.node("ours", spin=not own_thread, namespace="/robot1", cli_args=arguments)
    ours = graph.ours(node, own_thread=own_thread)
    heard = Heard()
    ours.subscribe("tf", TF, heard)
    ours.subscribe("/tf_static", TF, heard, latched=True)
    publisher = graph.node("other").create_publisher(TFMessage, "/robot1/moved", 10)
    connected(publisher)
    for number in range(20):
        publisher.publish(message(number))
    heard.until(lambda it: len(it.messages) == 20)
    assert numbers(heard.messages) == list(range(20))
    assert set(heard.threads) == {"tfdb listener" if own_thread else "spinner"}
    # An executor waits without a receiving thread.
    is_as_expected = not own_thread and "WaitSet" in other
    said = capfd.readouterr().err.count("listening through rclpy's own subscriptions")
    assert said == (0 if is_as_expected else 1)
    ours.close()
    until(no_listener)


@pytest.mark.parametrize("how", ["returns", "raises", "sys.exit", "interrupted", "kept"])
def test_a_process_ends_while_it_listens(how: str) -> None:
    with subprocess.Popen(
        [sys.executable, CHILD, how], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as child:
        assert child.stdout is not None
        assert child.stdout.readline() == "listening\n"
        if how in {"interrupted", "kept"}:
            child.send_signal(signal.SIGINT)
        out, err = child.communicate(timeout=30)
    expected = {"returns": 0, "raises": 1, "sys.exit": 3, "interrupted": 0, "kept": 0}[how]
    assert child.returncode == expected, out + err
    assert ("closed True" in out) == (how in {"interrupted", "kept"}), out + err


@pytest.mark.parametrize("end", ["destroyed", "shut down", "closed"])
def test_a_context_is_freed_after_its_nodes(end: str) -> None:
    made = Graph(rclpy.Context())
    context = weakref.ref(made.context)
    node = made.node("ours")
    ours = made.ours(node, own_thread=False)
    told: list[int] = []
    ours.on_clock(told.append)
    if end == "destroyed":
        node.destroy_node()
    elif end == "shut down":
        made.context.shutdown()
    else:
        ours.close()
    made.end()
    assert len(told) == 1
    del made, node, ours

    def is_freed() -> bool:
        gc.collect()
        return context() is None

    until(is_freed)


def test_the_thread_lives_while_there_is_a_topic(graph: Graph, flood: None) -> None:
    node = graph.node("ours")
    ours = graph.ours(node, own_thread=True)
    assert no_listener()
    for _ in range(20):
        heard = Heard()
        opened = ours.subscribe("/tf", TF, heard)
        heard.until(lambda it: len(it.messages) > 1)
        opened.close()
    until(no_listener)
    assert not ours.closed
