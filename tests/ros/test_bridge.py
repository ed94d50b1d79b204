"""`tfdb bridge` in graphs over Zenoh and over DDS, on loopback."""

from __future__ import annotations

import importlib.util
import json
import os
import signal
import threading
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import tfdb
from ros import ros2
from ros.commands import Command, tfdb_says
from ros.hearing import LIMIT, TF, Heard, S, message, published_until_heard
from ros.routers import free_endpoint, overriding, router_at

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

MODULES = {"zenoh": ("zenoh", "xxhash"), "dds": ("cyclonedds",)}
COUNT = 50


def is_there(wire: str) -> bool:
    return all(importlib.util.find_spec(name) for name in MODULES[wire])


def need(wire: str) -> None:
    if not is_there(wire) and "CI" not in os.environ:
        pytest.skip(f"{' and '.join(MODULES[wire])} are not installed")


@pytest.fixture
def zenoh_router(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    endpoint = free_endpoint()
    monkeypatch.setenv("ZENOH_CONFIG_OVERRIDE", overriding(endpoint))
    monkeypatch.delenv("ZENOH_SESSION_CONFIG_URI", raising=False)
    with router_at(endpoint) if is_there("zenoh") else ExitStack():
        yield endpoint


@pytest.fixture(params=["zenoh", "dds"])
def wire(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch, zenoh_router: str) -> str:
    need(request.param)
    monkeypatch.setenv("ROS_DOMAIN_ID", str(ros2.own_domain()))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    return str(request.param)


@pytest.fixture
def new_store() -> Iterator[Callable[[str], tfdb.Buffer]]:
    """Creates shared stores, which are removed after the test."""
    with ExitStack() as stack:

        def make(name: str) -> tfdb.Buffer:
            store = tfdb.Buffer.open(full(name), history=3600.0)
            stack.callback(tfdb.Buffer.unlink, full(name))
            return store

        yield make


def full(name: str) -> str:
    """Return the name of a store of this process."""
    return f"test-bridge-{name}-{os.getpid()}"


def node(wire: str, name: str, domain: int | None = None) -> Any:
    from tfdb.ros import DdsNode, ZenohNode

    kind = ZenohNode if wire == "zenoh" else DdsNode
    return kind(name, domain=domain, arguments=[])


def bridge(wire: str, store: str, *options: object) -> Command:
    return Command("bridge", "ros2", "--rmw", wire, full(store), *options)


def moved(child: str, number: int, parent: str = "map") -> tfdb.TransformStamped:
    pose = (0.1 * number, 2.0, -3.0, 0.6, 0.0, 0.0, 0.8)
    return tfdb.TransformStamped(parent, child, 5 * S + number, pose)


def move(store: tfdb.Buffer, child: str, number: int) -> int:
    return store.set_transforms([moved(child, number), moved(f"{child}_arm", number, child)])


def fix(store: tfdb.Buffer, child: str, number: int) -> int:
    return store.set_transforms([moved(child, number)], static=True)


def arrive(store: tfdb.Buffer, child: str, number: int) -> None:
    store.lookup_transform("map", child, 5 * S + number, timeout=LIMIT)


def arrive_fixed(store: tfdb.Buffer, child: str, number: int) -> None:
    """Wait for a static transform, or for its new value."""
    store.lookup_transform("map", child, None, timeout=LIMIT)
    commit = store.commit
    while store.lookup_transform("map", child, None).translation[0] != 0.1 * number:
        commit = store.wait_for_commit(commit, LIMIT)


def join(one: tfdb.Buffer, other: tfdb.Buffer, child: str) -> None:
    """Wait until moving samples of one store arrive in the other, and none is in transit."""
    number = 0
    while True:
        number += 1
        move(one, child, number)
        try:
            other.lookup_transform("map", child, 5 * S + number, timeout=0.1)
        except tfdb.TfdbError:
            assert number < 10 * LIMIT
        else:
            return


def meet(a: tfdb.Buffer, b: tfdb.Buffer, number: int) -> None:
    """Wait until all messages have arrived, and all messages caused by them."""
    for one, other, child in ((a, b, "from_a"), (b, a, "from_b"), (a, b, "from_a_again")):
        move(one, child, number)
        arrive(other, child, number)


def same(a: tfdb.Buffer, b: tfdb.Buffer, *children: str) -> None:
    for child in children:
        for ours, theirs in zip(a.samples(child), b.samples(child), strict=True):
            assert np.array_equal(ours, theirs), child


def children_of(data: bytes) -> set[str]:
    return {each.child for each in tfdb.decode_tf_message(data, "cdr")}


def test_two_stores_on_one_graph(wire: str, new_store: Callable[[str], tfdb.Buffer]) -> None:
    a, b = new_store("a"), new_store("b")
    fix(a, "lidar", 1)
    with bridge(wire, "a") as at_a:
        assert "shm:" + full("a") in at_a.line()
        with bridge(wire, "b", "--json") as at_b:
            arrive_fixed(b, "lidar", 1)  # for a node that joins later
            fix(b, "camera", 2)
            arrive_fixed(a, "camera", 2)  # for a node that joined before
            join(a, b, "from_a")
            join(b, a, "from_b")
            meet(a, b, 1000)
            before = a.commit, b.commit
            for number in range(COUNT):
                move(a, "base", number)
                move(b, "crane", number)
                if number % 10 == 9:
                    arrive(b, "base", number)
                    arrive(a, "crane", number)
            meet(a, b, 2000)
            # Each commit of one store is one commit in the other.
            assert (a.commit, b.commit) == (before[0] + 2 * COUNT + 3, before[1] + 2 * COUNT + 3)
            same(a, b, "base", "base_arm", "crane", "crane_arm", "lidar", "camera")
            fix(a, "lidar", 3)
            arrive_fixed(b, "lidar", 3)
            meet(a, b, 3000)
            assert (a.commit, b.commit) == (before[0] + 2 * COUNT + 7, before[1] + 2 * COUNT + 7)

            heard = Heard()
            with node(wire, "late") as late:
                late.subscribe("/tf_static", TF, heard, latched=True)
                found = [children_of(heard.next()[0]) for _ in range(2)]
                assert sorted(found, key=sorted) == [{"camera"}, {"lidar"}]
            code, said = at_b.end()
            assert code == 130
            told = json.loads(said)
            assert told["command"] == "bridge ros2"
            assert told["origin"] == f"ros2+{wire}:{ros2.own_domain()}"
            assert (told["sent_static"], told["missed"], told["gone"]) == (1, 0, 0)
            assert told["received"] + told["sent"] + told["sent_static"] == told["commits"]
        code, said = at_a.end()
        assert code == 130
        assert "2 on /tf_static" in said
    prefix = f"ros2+{wire}:{ros2.own_domain()}/"
    assert a.frame_info("crane").authority.startswith(prefix)
    assert a.frame_info("base").authority == ""


def test_a_killed_bridge_goes_on(wire: str, new_store: Callable[[str], tfdb.Buffer]) -> None:
    a, b = new_store("a"), new_store("b")
    fix(a, "lidar", 1)
    fix(b, "camera", 1)
    with bridge(wire, "b") as at_b:
        at_b.line()
        with bridge(wire, "a") as at_a:
            arrive_fixed(a, "camera", 1)
            arrive_fixed(b, "lidar", 1)
            at_a.process.kill()
            at_a.process.wait(LIMIT)
        fix(a, "lidar", 2)
        fix(b, "camera", 2)
        with bridge(wire, "a") as again:
            arrive_fixed(a, "camera", 2)
            arrive_fixed(b, "lidar", 2)
            join(a, b, "from_a")
            join(b, a, "from_b")
            meet(a, b, 1000)
            before = a.commit, b.commit
            for number in range(10):
                move(a, "base", number)
            meet(a, b, 2000)
            assert (a.commit, b.commit) == (before[0] + 13, before[1] + 13)
            same(a, b, "base", "lidar", "camera")
            # The store has a static transform of the graph, which is not sent back.
            heard = Heard()
            with node(wire, "late") as late:
                late.subscribe("/tf_static", TF, heard, latched=True)
                found = [children_of(heard.next()[0]) for _ in range(2)]
                assert sorted(found, key=sorted) == [{"camera"}, {"lidar"}]
            assert again.end()[0] == 130


@pytest.mark.parametrize("second", ["zenoh", "dds"])
def test_one_store_joins_two_graphs(
    second: str,
    monkeypatch: pytest.MonkeyPatch,
    zenoh_router: str,
    new_store: Callable[[str], tfdb.Buffer],
) -> None:
    need("zenoh")
    need(second)
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    domain, store = ros2.own_domain(), new_store("both")
    # The graphs have one domain if their transports differ.
    graphs = [("zenoh", domain + (second == "zenoh")), (second, domain)]
    with ExitStack() as stack:
        one, two = (stack.enter_context(node(kind, "same", number)) for kind, number in graphs)
        for kind, number in graphs:
            stack.enter_context(bridge(kind, "both", "--domain", number)).line()
        on_one, on_two = Heard(), Heard()
        one.subscribe("/tf_static", TF, on_one, latched=True)
        two.subscribe("/tf_static", TF, on_two, latched=True)
        one.advertise("/tf_static", TF, latched=True, depth=1).publish(message(1, child="base"))
        assert on_one.next()[0] == message(1, child="base")
        assert children_of(on_two.next()[0]) == {"base"}
        two.advertise("/tf_static", TF, latched=True, depth=1).publish(message(2, child="arm"))
        assert on_two.next()[0] == message(2, child="arm")
        assert children_of(on_one.next()[0]) == {"arm"}
        fix(store, "local", 3)
        assert children_of(on_one.next()[0]) == {"arm", "local"}
        assert children_of(on_two.next()[0]) == {"base", "local"}
        assert on_one.messages.empty()
        assert on_two.messages.empty()


def sent_at_once(sender: Any) -> None:
    """Let the sender send all commits, in this thread."""
    sender.end()
    sender.run()
    sender.close()


def test_a_lapped_bridge_counts_and_keeps_static_transforms(
    wire: str, caplog: pytest.LogCaptureFixture
) -> None:
    from tfdb.bridge.sending import CommitSender

    store, moving, fixed = tfdb.Buffer(history=3600.0), Heard(), Heard()
    with node(wire, "sends") as sends, node(wire, "hears") as hears:
        sender = CommitSender(store, sends, sends.graph)
        hears.subscribe("/tf_static", TF, fixed, latched=True)
        fix(store, "lidar", 1)
        for number in range(40_000):
            store.set_transforms([moved("base", number)])
        sent_at_once(sender)
        assert sender.missed > 20_000
        assert sender.missed + sender.sent == 40_001
        assert children_of(fixed.next()[0]) == {"lidar"}
    assert len([line for line in caplog.messages if "were not sent" in line]) == 1
    assert moving.messages.empty()


class LappingNode:
    """A node that makes a whole feed of commits at the first message of each read."""

    encoding = "cdr"
    senders: frozenset[str] = frozenset()

    def __init__(self, store: tfdb.Buffer) -> None:
        self.store, self.sent = store, 0

    def advertise(self, *_: object, **__: object) -> LappingNode:
        return self

    def publish(self, _: bytes) -> None:
        self.sent += 1
        assert self.sent < 2000, "it sends commits that were made after its end"
        if self.sent % 256 == 1:
            for number in range(20_000):
                self.store.set_transforms([moved("later", 1000 * self.sent + number)])

    def close(self) -> None:
        pass


def test_commits_after_its_end_do_not_keep_a_bridge() -> None:
    from tfdb.bridge.sending import CommitSender

    store = tfdb.Buffer(history=3600.0)
    node: Any = LappingNode(store)
    sender = CommitSender(store, node, "ros2")
    for number in range(600):
        store.set_transforms([moved("base", number)])
    sent_at_once(sender)
    assert sender.sent == 256
    assert sender.missed > 600 - 256


def send_until_error(publisher: Any, is_sent: threading.Event, errors: list[Exception]) -> None:
    data = tfdb.encode_tf_message([moved(f"child{number}", number) for number in range(500)], "cdr")
    while not errors:
        try:
            publisher.publish(data)
            is_sent.set()
        except Exception as error:
            errors.append(error)


def test_a_node_is_closed_while_another_thread_publishes(wire: str) -> None:
    for _ in range(20):
        with node(wire, "sends") as sends:
            publisher = sends.advertise("/tf", TF)
            is_sent = threading.Event()
            errors: list[Exception] = []

            thread = threading.Thread(target=send_until_error, args=(publisher, is_sent, errors))
            thread.start()
            try:
                assert is_sent.wait(LIMIT)
                sends.close()
                thread.join(LIMIT)
                assert not thread.is_alive()
                assert [type(error) for error in errors] == [tfdb.errors.NodeClosed]
            finally:
                errors.append(RuntimeError("the test ended"))
                thread.join(LIMIT)


def test_stamps_without_message_and_removed_frames(
    wire: str, caplog: pytest.LogCaptureFixture
) -> None:
    from tfdb.bridge.sending import CommitSender

    store, fixed = tfdb.Buffer(history=None), Heard()
    fix(store, "lidar", 1)
    fix(store, "camera", 1)
    with node(wire, "sends") as sends, node(wire, "hears") as hears:
        hears.subscribe("/tf_static", TF, fixed, latched=True)
        sender = CommitSender(store, sends, sends.graph)
        store.set_transforms([moved("base", 1), moved("late", (1 << 31) * S)])
        store.set_transforms([moved("late", (1 << 31) * S + 1)])
        store.remove_frames("camera")
        sent_at_once(sender)
        assert (sender.sent, sender.refused, sender.sent_static) == (1, 2, 1)
        assert children_of(fixed.next()[0]) == {"lidar"}
    assert len([line for line in caplog.messages if "of late was not sent" in line]) == 1


def test_a_frame_that_begins_to_move_is_static_no_more(wire: str) -> None:
    from tfdb.bridge import Bridge

    a, b = tfdb.Buffer(history=None), tfdb.Buffer(history=None)
    with (
        node(wire, "a") as at_a,
        node(wire, "b") as at_b,
        Bridge(a, at_a) as bridge_a,
        Bridge(b, at_b),
    ):
        fix(a, "arm", 1)
        fix(a, "lidar", 1)
        arrive_fixed(b, "lidar", 1)
        join(a, b, "base")
        commit = b.commit
        a.set_transforms([moved("arm", 7)], change_kind=True)
        while b.frame_info("arm").is_static:
            commit = b.wait_for_commit(commit, LIMIT)
        heard = Heard()
        at_b.subscribe("/tf_static", TF, heard, latched=True)
        while children_of(heard.next()[0]) != {"lidar"}:
            pass
        fix(a, "lidar", 2)
        arrive_fixed(b, "lidar", 2)
        assert not b.frame_info("arm").is_static
        assert bridge_a.stats.received == 0
        assert not bridge_a.wait(0)
        at_a.close()
        with pytest.raises(tfdb.errors.NodeClosed, match="/a was closed"):
            bridge_a.wait(LIMIT)


def test_ros1_and_ros2_meet_in_one_store(ros1: str, wire: str) -> None:
    from tfdb.bridge import Bridge
    from tfdb.ros import TcprosNode

    store, on_one, on_two = tfdb.Buffer(history=None), Heard(), Heard()
    with ExitStack() as stack:
        one, at_one = (
            stack.enter_context(TcprosNode(name, arguments=[])) for name in ("one", "bridge")
        )
        two, at_two = (stack.enter_context(node(wire, name)) for name in ("two", "bridge"))
        for each in (at_one, at_two):
            stack.enter_context(Bridge(store, each))
        one.subscribe("/tf_static", TF, on_one, latched=True)
        two.subscribe("/tf_static", TF, on_two, latched=True)
        data = tfdb.encode_tf_message([moved("base", 1)], "ros1")
        one.advertise("/tf_static", TF, latched=True, depth=1).publish(data)
        assert on_one.next() == (data, "/one")
        assert children_of(on_two.next()[0]) == {"base"}
        two.advertise("/tf_static", TF, latched=True, depth=1).publish(message(2, child="arm"))
        assert on_two.next()[0] == message(2, child="arm")
        data, sender = on_one.next()
        assert sender == "/bridge"
        assert [each.child for each in tfdb.decode_tf_message(data, "ros1")] == ["arm"]
        assert store.frame_info("base").authority == f"{at_one.graph}/one"
        assert at_one.graph.startswith("ros1:http://")
        assert store.commit == 2


def test_the_command_for_ros1(ros1: str, new_store: Callable[[str], tfdb.Buffer]) -> None:
    from tfdb.ros import TcprosNode

    store, heard = new_store("ros1"), Heard()
    fix(store, "lidar", 1)
    with (
        TcprosNode("theirs", arguments=[]) as theirs,
        Command("bridge", "ros1", full("ros1"), "--origin", "yard", "--json") as joined,
    ):
        theirs.subscribe("/tf_static", TF, heard, latched=True)
        data, _ = heard.next()
        assert [each.child for each in tfdb.decode_tf_message(data, "ros1")] == ["lidar"]
        sent = tfdb.encode_tf_message([moved("base", 2)], "ros1")
        theirs.advertise("/tf_static", TF, latched=True, depth=1).publish(sent)
        arrive_fixed(store, "base", 2)
        assert store.frame_info("base").authority == "yard/theirs"
        code, said = joined.end()
        told = json.loads(said)
        assert (code, told["command"], told["origin"]) == (130, "bridge ros1", "yard")
        assert (told["received"], told["sent_static"], told["commits"]) == (1, 1, 1)


@pytest.mark.skipif(not is_there("zenoh") and "CI" not in os.environ, reason="no eclipse-zenoh")
def test_a_burst_that_waits_is_stored_whole(zenoh_router: str) -> None:
    from tfdb.bridge import Bridge
    from tfdb.ros import ZenohNode

    is_stored, count = threading.Event(), 300

    class Slow(ZenohNode):
        """A node whose bridge stores nothing before `is_stored`."""

        def subscribe(self, topic: str, kind: str, on_message: Any, **options: Any) -> Any:
            def wait(data: bytes, publisher: str) -> None:
                assert is_stored.wait(LIMIT)
                on_message(data, publisher)

            return super().subscribe(topic, kind, wait if topic == "/tf" else on_message, **options)

    store, arrived = tfdb.Buffer(history=None), Heard()
    with Slow("bridge", domain=7, arguments=[]) as at, node("zenoh", "peer", 7) as peer:
        at.subscribe("/end", TF, arrived)
        sender, end = peer.advertise("/tf", TF), peer.advertise("/end", TF)
        with Bridge(store, at) as bridge:
            published_until_heard(end, arrived, message(0))  # the two nodes are connected
            for number in range(count):
                sender.publish(message(number, stamp=5 * S + number))
            end.publish(message(1))
            while arrived.next()[0] != message(1):  # after the whole burst
                pass
            is_stored.set()
            arrive(store, "base", count - 1)
            assert bridge.stats.received == count
            assert store.commit == count


def is_from_graph(store: tfdb.Buffer, child: str) -> bool:
    """Whether a listener stored the newest sample of a frame."""
    return store.frame_info(child).authority != ""


def test_messages_that_another_listener_stores_are_not_sent_again(wire: str) -> None:
    from tfdb import tf2
    from tfdb.bridge import Bridge

    store, fixed, moving = tfdb.Buffer(history=None), Heard(), Heard()
    fix(store, "lidar", 1)
    with node(wire, "bridge") as at, node(wire, "serve") as serve, node(wire, "peer") as peer:
        peer.subscribe("/tf", TF, moving)
        peer.subscribe("/tf_static", TF, fixed, latched=True)
        listener = tf2.TransformListener(tf2.Buffer(buffer=store, clock=serve), serve)
        with Bridge(store, at):
            arrive_from_graph(store, "lidar")
            number = 0
            while (
                moving.messages.empty()
                or fixed.messages.empty()
                or not is_from_graph(store, "base")
            ):
                number += 1
                store.wait_for_commit(move(store, "base", number), 0.1)
            for each in range(10):
                move(store, "base", number + 1 + each)
                arrive_from_graph(store, "base")
            fix(store, "camera", 2)
            arrive_from_graph(store, "camera")
            move(store, "end", 1)
            heard = [moving.next()[0]]
            while "end" not in children_of(heard[-1]):
                heard.append(moving.next()[0])
        listener.unregister()
    assert len(heard) == len(set(heard))
    assert [children_of(fixed.next()[0]) for _ in range(2)] == [{"lidar"}, {"lidar", "camera"}]
    assert fixed.messages.empty()


def arrive_from_graph(store: tfdb.Buffer, child: str) -> None:
    commit = store.commit
    while not is_from_graph(store, child):
        commit = store.wait_for_commit(commit, LIMIT)


def test_a_store_has_one_bridge_to_a_graph(
    wire: str, new_store: Callable[[str], tfdb.Buffer]
) -> None:
    from tfdb.bridge import Bridge

    shared = new_store("one")
    name = f"ros2+{wire}:{ros2.own_domain()}"
    with node(wire, "a") as a, node(wire, "b") as b:
        for store in (shared, tfdb.Buffer()):
            for _ in range(2):  # after the end of a bridge, another one may begin
                with Bridge(store, a):
                    for origin in (None, name):
                        with pytest.raises(tfdb.InvalidArgument, match="already") as caught:
                            Bridge(store, b, origin=origin)
                        assert caught.value.value == name
                    with Bridge(store, b, origin="yard"), Bridge(tfdb.Buffer(), b):
                        pass
    with bridge(wire, "one") as first:
        first.line()
        assert f"has a bridge to {name} already" in tfdb_says(
            "bridge", "ros2", "--rmw", wire, full("one"), code=2
        )
        first.process.kill()
        first.process.wait(LIMIT)
        with bridge(wire, "one") as second:
            second.line()
            second.end()


def test_a_forked_child_does_not_keep_a_graph(new_store: Callable[[str], tfdb.Buffer]) -> None:
    from tfdb.bridge.claim import Claim

    store = new_store("fork")
    (begun, begin), (ended, end) = os.pipe(), os.pipe()
    parent = os.fork()
    if parent == 0:
        claim = Claim(store, "graph")
        if os.fork() == 0:
            os.close(end)
            os.write(begin, b"1")
            os.read(ended, 1)  # until the test closes the other end
        os._exit(0 if claim else 1)  # as if the process was killed
    try:
        assert os.read(begun, 1) == b"1"
        assert os.waitpid(parent, 0)[1] == 0
        Claim(store, "graph").close()
    finally:
        for pipe in (begun, begin, ended, end):
            os.close(pipe)


class SlowName(str):
    """A name of a graph that another thread is claiming."""

    hashed, goes_on = threading.Event(), threading.Event()

    def __hash__(self) -> int:
        self.hashed.set()
        self.goes_on.wait()
        return super().__hash__()


def test_a_forked_child_may_claim_while_another_thread_of_its_parent_does() -> None:
    from tfdb.bridge.claim import Claim

    store, name = tfdb.Buffer(), SlowName("slow")
    thread = threading.Thread(target=lambda: Claim(store, name).close())
    thread.start()
    assert name.hashed.wait(LIMIT)
    child = os.fork()
    if child == 0:
        signal.alarm(int(LIMIT))
        Claim(store, "graph").close()
        os._exit(0)
    name.goes_on.set()
    thread.join()
    assert os.waitpid(child, 0)[1] == 0


def test_a_bridge_that_ended_by_an_error_stores_no_messages(
    wire: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    from tfdb.bridge import Bridge
    from tfdb.bridge.sending import CommitSender

    def fail(sender: CommitSender) -> None:
        raise tfdb.errors.NoSuchStore("the store was removed")

    store = tfdb.Buffer()
    with node(wire, "bridged") as bridged, node(wire, "other") as other:
        with monkeypatch.context() as patched:
            patched.setattr(CommitSender, "run", fail)
            first = Bridge(store, bridged)
            with pytest.raises(tfdb.errors.NoSuchStore):
                first.wait(LIMIT)
        with Bridge(store, bridged) as second:
            publisher = other.advertise("/tf", TF)
            heard = Heard()
            bridged.subscribe("/tf", TF, heard)
            published_until_heard(publisher, heard, message(1))
            arrive_from_graph(store, "base")
            assert second.stats.received > 0
            assert first.stats.received == 0
        first.close()


def test_a_store_that_is_only_read_is_refused(
    wire: str, new_store: Callable[[str], tfdb.Buffer]
) -> None:
    from tfdb.bridge import Bridge

    new_store("read")
    with (
        node(wire, "a") as at,
        tfdb.Buffer.open(full("read"), mode="r") as store,
        pytest.raises(tfdb.errors.ReadOnly, match="mode='rw'"),
    ):
        Bridge(store, at)


@pytest.mark.parametrize("origin", ["", "a/b", "a b", "a\n", "/a", "a/", "ros1:http://host/"])
def test_a_name_that_no_graph_has_is_refused(origin: str) -> None:
    from tfdb.bridge import Bridge
    from tfdb.ros import DdsNode

    need("dds")
    with DdsNode("a", domain=ros2.own_domain(), arguments=[]) as at:
        with pytest.raises(tfdb.errors.InvalidName, match="not a valid name of a graph"):
            Bridge(tfdb.Buffer(), at, origin=origin)
        with Bridge(tfdb.Buffer(), at, origin="ros1:http://host:11311"):
            pass


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        (("",), "the store's name '' is empty"),
        (("a/b",), "has a slash"),
        (("robot1", "--origin", "a/b"), "not a valid name of a graph"),
        (("robot1", "--ros-args", "-p", "use_sim_time:=yes"), "must be true or false"),
    ],
)
def test_bad_names_are_refused_before_the_wait_for_a_router(
    arguments: tuple[str, ...], error: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    need("zenoh")
    monkeypatch.setenv("ZENOH_CONFIG_OVERRIDE", overriding(free_endpoint()))
    assert error in tfdb_says("bridge", "ros2", "--rmw", "zenoh", *arguments, code=2)


def test_a_node_without_senders_is_refused() -> None:
    from tfdb.bridge import Bridge

    with pytest.raises(TypeError, match="DdsNode or TcprosNode"):
        Bridge(tfdb.Buffer(), object())  # type: ignore[arg-type]
    assert "--rmw" in tfdb_says("bridge", "ros2", "robot1", code=2)


@pytest.mark.skipif(not is_there("zenoh") and "CI" not in os.environ, reason="no eclipse-zenoh")
def test_it_waits_for_a_router(
    monkeypatch: pytest.MonkeyPatch, new_store: Callable[[str], tfdb.Buffer]
) -> None:
    endpoint = free_endpoint()
    monkeypatch.setenv("ZENOH_CONFIG_OVERRIDE", overriding(endpoint))
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    store = new_store("waits")
    with bridge("zenoh", "waits") as waiting:
        assert waiting.process.stderr is not None
        line = waiting.process.stderr.readline()
        assert f'no Zenoh router at ["{endpoint}"]' in line
        assert "waiting for it" in line
        with router_at(endpoint), node("zenoh", "theirs") as theirs:
            theirs.advertise("/tf_static", TF, latched=True, depth=1).publish(message(1))
            store.lookup_transform("map", "base", None, timeout=LIMIT)
            assert store.frame_info("base").authority == "ros2+zenoh:7/theirs"
            waiting.process.send_signal(2)
            _, errors = waiting.process.communicate(timeout=LIMIT)
            assert errors.split() == ["tfdb:", "stopped"]


@pytest.mark.skipif(not is_there("zenoh") and "CI" not in os.environ, reason="no eclipse-zenoh")
def test_it_goes_on_with_a_new_router(monkeypatch: pytest.MonkeyPatch) -> None:
    from tfdb.bridge import Bridge

    endpoint = free_endpoint()
    monkeypatch.setenv("ZENOH_CONFIG_OVERRIDE", overriding(endpoint))
    monkeypatch.delenv("ZENOH_SESSION_CONFIG_URI", raising=False)
    a, b = tfdb.Buffer(history=None), tfdb.Buffer(history=None)
    with ExitStack() as stack:
        with router_at(endpoint):
            for name, store in (("a", a), ("b", b)):
                joined = stack.enter_context(node("zenoh", name, 7))
                stack.enter_context(Bridge(store, joined))
            fix(a, "lidar", 1)
            arrive_fixed(b, "lidar", 1)
        fix(a, "lidar", 2)
        fix(b, "camera", 3)
        with router_at(endpoint):
            arrive_fixed(b, "lidar", 2)
            arrive_fixed(a, "camera", 3)
            join(a, b, "base")
            join(b, a, "crane")
