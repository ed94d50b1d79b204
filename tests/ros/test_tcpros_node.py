"""The TcprosNode in a real ROS 1 graph, with rospy programs, in both directions."""

from __future__ import annotations

import itertools
import signal
import subprocess
import sys
import threading
import xmlrpc.client
from typing import TYPE_CHECKING, Any

import pytest

import tfdb
from ros.messages import clock, transforms
from ros.real_ros1 import SECONDS, free_port, until
from tfdb import tf2
from tfdb.ros import choose_node
from tfdb.ros.choose_node import node_for
from tfdb.ros.tcpros_node import TcprosNode

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from ros.real_ros1 import RospyChild

TF = "tf2_msgs/TFMessage"
MOVES = [
    transforms(("map", "base", 1_000_000_001 + i, float(i)), ("base", "arm", 7, 0.5))
    for i in range(9)
]


class Heard:
    """The arguments of a callback's calls."""

    def __init__(self) -> None:
        self.changed = threading.Condition()
        self.messages: list[bytes] = []
        self.publishers: list[str] = []

    def __call__(self, data: bytes | memoryview, publisher: str) -> None:
        with self.changed:
            self.messages.append(bytes(data))
            self.publishers.append(publisher)
            self.changed.notify_all()

    def wait(self, count: int) -> list[bytes]:
        with self.changed:
            assert self.changed.wait_for(lambda: len(self.messages) >= count, SECONDS)
            return list(self.messages)


@pytest.fixture
def node(ros1: str) -> Iterator[TcprosNode]:
    with TcprosNode("ours", arguments=[]) as node:
        yield node


def hex_of(messages: list[bytes]) -> list[str]:
    return [message.hex() for message in messages]


def test_theirs_to_ours(node: TcprosNode, rospy_child: RospyChild) -> None:
    heard, buffer = Heard(), tfdb.Buffer()

    def take(data: bytes | memoryview, publisher: str) -> None:
        buffer.ingest(data, encoding="ros1", authority=publisher)
        heard(data, publisher)

    rospy_child.call("advertise", "/moves", TF, False, 100)
    subscription = node.subscribe("moves", TF, take)
    assert rospy_child.call("joined", "/moves", 1, SECONDS)
    rospy_child.call("send", "/moves", hex_of(MOVES))
    assert heard.wait(len(MOVES)) == MOVES
    assert set(heard.publishers) == {"/theirs"}
    assert buffer.lookup_transform("map", "base", 1_000_000_003).translation[0] == 2.0
    subscription.close()
    subscription.close()
    rospy_child.call("withdraw", "/moves")


def test_ours_to_theirs(node: TcprosNode, rospy_child: RospyChild) -> None:
    publisher = node.advertise("ours_to_theirs", TF)
    rospy_child.call("listen", "/ours_to_theirs", TF)
    until(lambda: publisher.subscribers == ["/theirs"], "a subscriber")
    for move in MOVES:
        publisher.publish(move)
    assert rospy_child.call("heard", "/ours_to_theirs", len(MOVES), SECONDS) == [
        hex_of(MOVES),
        ["/ours"] * len(MOVES),
    ]


def test_a_late_joiner_gets_the_last_message_of_each_latched_publisher(
    node: TcprosNode, rospy_child: RospyChild
) -> None:
    first, second = (node.advertise("late", TF, latched=True) for _ in range(2))
    for publisher, move in zip([first, first, second], MOVES, strict=False):
        publisher.publish(move)
    rospy_child.call("listen", "/late", TF)
    assert rospy_child.call("heard", "/late", 2, SECONDS)[0] == hex_of(MOVES[1:3])
    heard = Heard()
    node.subscribe("late", TF, heard)
    assert heard.wait(2) == MOVES[1:3]
    second.close()
    first.publish(MOVES[5])
    assert rospy_child.call("heard", "/late", 3, SECONDS)[0] == hex_of([*MOVES[1:3], MOVES[5]])


def test_their_latched_message_reaches_every_late_callback(
    node: TcprosNode, rospy_child: RospyChild
) -> None:
    rospy_child.call("advertise", "/their_latched", TF, True, 10)
    rospy_child.call("send", "/their_latched", hex_of(MOVES[:2]))
    first, second = Heard(), Heard()
    node.subscribe("their_latched", TF, first)
    assert first.wait(1) == [MOVES[1]]
    node.subscribe("their_latched", TF, second)
    assert second.messages == [MOVES[1]]
    assert second.publishers == ["/theirs"]


def test_the_old_type_of_tf_is_the_same(node: TcprosNode, rospy_child: RospyChild) -> None:
    rospy_child.call("advertise", "/old", "tf/tfMessage", True, 10)
    rospy_child.call("send", "/old", hex_of(MOVES[:1]))
    heard = Heard()
    node.subscribe("old", TF, heard)
    assert heard.wait(1) == MOVES[:1]


def test_a_publisher_of_another_type_is_refused_and_logged(
    node: TcprosNode, rospy_child: RospyChild, caplog: pytest.LogCaptureFixture
) -> None:
    rospy_child.call("advertise", "/other", "rosgraph_msgs/Clock", True, 1)
    node.subscribe("other", TF, Heard())
    until(lambda: "topic types do not match" in caplog.text, "the refusal")
    publisher = node.advertise("other2", TF)
    rospy_child.call("listen", "/other2", "rosgraph_msgs/Clock")
    until(lambda: "of md5sum 94810" in caplog.text, "our refusal")
    assert publisher.subscribers == []


def test_a_publisher_that_is_killed_and_comes_back_is_heard_again(
    node: TcprosNode, new_child: Callable[[str], RospyChild]
) -> None:
    heard = Heard()
    for number in range(2):
        child = new_child("mortal")
        child.call("advertise", "/mortal_moves", TF, False, 100)
        if number == 0:
            node.subscribe("mortal_moves", TF, heard)
        assert child.call("joined", "/mortal_moves", 1, SECONDS)
        child.call("send", "/mortal_moves", hex_of(MOVES[number : number + 1]))
        assert heard.wait(number + 1) == MOVES[: number + 1]
        if number == 0:
            child.kill()
    assert set(heard.publishers) == {"/mortal"}


def test_simulated_time(node: TcprosNode, rospy_child: RospyChild) -> None:
    wall: list[int] = []
    node.on_clock(wall.append)
    node.on_clock(wall.append).close()
    assert node.now() > 1_600_000_000_000_000_000
    assert not node.simulated
    rospy_child.call("advertise", "/clock", "rosgraph_msgs/Clock", True, 1)
    rospy_child.call("set_parameter", "/use_sim_time", True)
    try:
        with TcprosNode("simulated", arguments=[]) as simulated:
            called: list[int] = []
            set_again = threading.Event()

            def on_clock(now: int) -> None:
                called.append(now)
                assert simulated.now() == now
                set_again.set()

            assert simulated.simulated
            assert simulated.now() == 0
            subscription = simulated.on_clock(on_clock)
            for now in (12_000_000_005, 3_000_000_000):
                set_again.clear()
                rospy_child.call("send", "/clock", [clock(now).hex()])
                assert set_again.wait(SECONDS)
                assert called[-1] == simulated.now() == now
            subscription.close()
            ended: list[int] = []
            simulated.on_clock(ended.append)
            simulated.on_clock(lambda now: called[now])
            simulated.close()
            assert ended == [3_000_000_000]
            assert simulated.closed
    finally:
        rospy_child.call("delete_parameter", "/use_sim_time")
        rospy_child.call("withdraw", "/clock")
    assert wall == []
    node.close()
    assert len(wall) == 1
    node.on_clock(wall.append)
    assert len(wall) == 2


def test_services(node: TcprosNode, rospy_child: RospyChild) -> None:
    texts = ["base:\n  parent: map", "a second answer"]

    def answer(request: bytes) -> bytes:
        assert request == b""
        if not texts:
            raise tfdb.errors.NotSupported("no more frames")
        return xmlrpc_string(texts.pop(0))

    served = node.serve("~tf2_frames", "tf2_msgs/FrameGraph", answer)
    name, kind = "/ours/tf2_frames", "tf2_msgs/FrameGraph"
    with pytest.raises(tfdb.InvalidArgument, match="this node already serves"):
        node.serve(name, kind, answer)
    assert rospy_child.call("ask_often", name, kind, 2) == [
        "base:\n  parent: map",
        "a second answer",
    ]
    assert rospy_child.call("ask", name, kind) == [
        "error",
        "service [/ours/tf2_frames] responded with an error: b'no more frames'",
    ]
    served.close()
    with xmlrpc.client.ServerProxy(node._master.uri) as master:
        assert master.lookupService("/test", name)[0] != 1


def test_a_clock_callback_that_is_added_while_the_node_closes_is_called(node: TcprosNode) -> None:
    ends: list[int] = []

    def called(_: int) -> None:
        node.on_clock(ends.append)

    node.on_clock(called)
    node.close()
    assert len(ends) == 1


def test_the_first_buffer_of_a_node_offers_its_tree(
    node: TcprosNode, rospy_child: RospyChild
) -> None:
    first, second = (tf2.Buffer(node=node, flavor="ros1") for _ in range(2))
    for buffer, child in ((first, "one"), (second, "two")):
        buffer.buffer.set_static_transform("map", child, (0, 0, 0))
    name, kind = "/ours/tf2_frames", "tf2_msgs/FrameGraph"
    assert rospy_child.call("ask", name, kind) == ["ok", first.all_frames_as_yaml()]
    first.close()
    third = tf2.Buffer(node=node)
    assert rospy_child.call("ask", name, kind) == ["ok", third.all_frames_as_yaml()]


def xmlrpc_string(text: str) -> bytes:
    return len(text).to_bytes(4, "little") + text.encode()


def test_a_second_node_of_the_name_closes_the_first(
    node: TcprosNode, new_child: Callable[[str], RospyChild]
) -> None:
    node.subscribe("tf", TF, Heard())
    publisher = node.advertise("by_the_first", TF)
    with TcprosNode("ours", arguments=[]) as second:
        second.subscribe("tf", TF, Heard())
        assert node.wait_closed(SECONDS)
        with pytest.raises(
            tfdb.errors.NodeClosed, match=r"/ours is closed: it was ended by a request: .*new node"
        ):
            node.subscribe("tf", TF, Heard())
        with pytest.raises(tfdb.errors.NodeClosed):
            publisher.publish(MOVES[0])
        new_child("ours").call("listen", "/tf", TF)
        assert second.wait_closed(SECONDS)


def test_two_nodes_in_one_process_and_remapped_names(ros1: str) -> None:
    heard = Heard()
    with (
        TcprosNode("first", arguments=["", "tf:=/robot/tf"]) as first,
        TcprosNode(arguments=["", "__ns:=/robot"]) as second,
    ):
        assert second.name.startswith("/robot/tfdb_")
        first.subscribe("tf", TF, heard)
        publisher = second.advertise("tf", TF, latched=True)
        publisher.publish(MOVES[0])
        assert heard.wait(1) == MOVES[:1]
        assert heard.publishers == [second.name]


def test_the_slave_api(node: TcprosNode, rospy_child: RospyChild) -> None:
    publisher = node.advertise("asked", TF)
    rospy_child.call("listen", "/asked", TF)
    until(lambda: publisher.subscribers == ["/theirs"], "a subscriber")
    with xmlrpc.client.ServerProxy(node.uri) as slave:
        assert slave.getPublications("/test")[2] == [["/asked", TF]]
        assert slave.getSubscriptions("/test")[2] == []
        assert slave.getMasterUri("/test")[2] == node._master.uri
        assert slave.getPid("/test")[2] > 0
        assert slave.getBusInfo("/test")[2] == [[0, "/theirs", "o", "TCPROS", "/asked", True]]
        assert slave.getBusStats("/test") == [1, "", [[], [], []]]
        assert slave.paramUpdate("/test", "/x", 1)[0] == 1
        assert slave.requestTopic("/test", "/none", [["TCPROS"]])[0] == -1
        assert slave.requestTopic("/test", "/asked", [["UDPROS"]])[0] == 0
        assert slave.requestTopic("/test", "/asked", [["TCPROS"]])[2][0] == "TCPROS"
        assert slave.requestTopic("/test")[0] == -1
        assert slave.publisherUpdate("/test", "/asked", 5)[0] == -1
        assert slave._dispatch("/test")[0] == -1
        assert slave.shutdown("/test", "enough")[0] == 1
    assert node.wait_closed(SECONDS)
    with pytest.raises(tfdb.errors.NodeClosed, match="enough"):
        node.advertise("asked", TF)


def test_a_node_answers_shutdown_before_it_ends(
    node: TcprosNode, monkeypatch: pytest.MonkeyPatch
) -> None:
    answered, was_answered = threading.Event(), []
    kind = type(node._slave._node)
    tell = kind.shutdown_requested

    def wait_and_tell(self: Any, reason: str) -> None:
        was_answered.append(answered.wait(SECONDS))
        tell(self, reason)

    monkeypatch.setattr(kind, "shutdown_requested", wait_and_tell)
    with xmlrpc.client.ServerProxy(node.uri) as slave:
        assert slave.shutdown("/test", "enough")[0] == 1
    answered.set()
    assert node.wait_closed(SECONDS)
    assert was_answered == [True]


def test_closing_unregisters_everything(ros1: str) -> None:
    node = TcprosNode("brief", arguments=[])
    node.subscribe("in", TF, Heard())
    node.advertise("out", TF)
    node.serve("~x", "tf2_msgs/FrameGraph", bytes)
    with xmlrpc.client.ServerProxy(ros1) as master:
        assert "/brief" in str(master.getSystemState("/test"))
        node.close()
        node.close()
        assert "/brief" not in str(master.getSystemState("/test"))
    assert "closed" in repr(node)
    with pytest.raises(tfdb.errors.NodeClosed, match="it was closed"):
        node.serve("~x", "tf2_msgs/FrameGraph", bytes)


LEAVES = """
import threading
from tfdb import tf2
from tfdb.ros.tcpros_node import TcprosNode

node = TcprosNode("leaves", arguments=[])
buffer = tf2.Buffer(node=node)
began = threading.Event()


def look_up():
    began.set()
    try:
        buffer.lookup_transform("map", "never", tf2.msgs.Time(0), timeout=1000.0)
    except tf2.TransformException as error:
        print(type(error).__name__, flush=True)


threading.Thread(target=look_up).start()
began.wait()
"""


def test_a_process_ends_although_its_thread_waits(ros1: str) -> None:
    child = subprocess.run(
        [sys.executable, "-c", LEAVES], capture_output=True, text=True, timeout=SECONDS, check=False
    )
    assert (child.returncode, child.stderr) == (0, "")
    assert child.stdout == "LookupException\n"
    with xmlrpc.client.ServerProxy(ros1) as master:
        assert "/leaves" not in str(master.getSystemState("/test"))


FORKS = """
import os, sys, threading, xmlrpc.client
from tfdb.ros.tcpros_node import TcprosNode

node = TcprosNode("forks", arguments=[])
node.advertise("out", "tf2_msgs/TFMessage")
held, forked = threading.Event(), threading.Event()

def hold():
    with node._lock:
        held.set()
        forked.wait()

threading.Thread(target=hold).start()
held.wait()
child = os.fork()
if child == 0:
    sys.exit(7)
forked.set()
_, status = os.waitpid(child, 0)
with xmlrpc.client.ServerProxy(os.environ["ROS_MASTER_URI"]) as master:
    print(os.waitstatus_to_exitcode(status), "/forks" in str(master.getSystemState("/test")))
"""


def test_a_forked_child_ends_beside_a_held_lock_and_leaves_the_node_registered(ros1: str) -> None:
    child = subprocess.run(
        [sys.executable, "-c", FORKS], capture_output=True, text=True, timeout=SECONDS, check=False
    )
    assert (child.stdout, child.stderr) == ("7 True\n", "")


CLOSES = """
import signal, sys, threading
from socketserver import ThreadingMixIn
from xmlrpc.server import SimpleXMLRPCServer
from tfdb.errors import NodeClosed
from tfdb.ros.tcpros_node import TcprosNode
from tfdb.ros.tcpros_subscription import Link


class Master(ThreadingMixIn, SimpleXMLRPCServer):
    daemon_threads = True


def register(_, name, *more):
    if what in ("subscribe", "advertise", "serve"):
        signal.pthread_kill(threading.main_thread().ident, signal.SIGTERM)
        was_unregistered.wait()
    registered.add(name)
    return [1, "", ["http://127.0.0.1:9/"]]


def unregister(_, name, *more):
    registered.discard(name)
    was_unregistered.set()
    return [1, "", 1]


class Peer:
    def send(self, data):
        signal.raise_signal(signal.SIGTERM)

    def close(self):
        pass


def start(link):
    links.append(link)
    signal.raise_signal(signal.SIGTERM)
    begin(link)


def end(*_):
    node.close()
    if is_exiting:
        sys.exit()


what, is_exiting = sys.argv[1], sys.argv[2] == "exit"
registered, was_unregistered, links = set(), threading.Event(), []
master = Master(("127.0.0.1", 0), logRequests=False)
master.register_function(lambda *_: [0, "", 0], "getParam")
for kind in ("Publisher", "Subscriber", "Service"):
    master.register_function(register, f"register{kind}")
    master.register_function(unregister, f"unregister{kind}")
threading.Thread(target=master.serve_forever, daemon=True).start()
uri = f"http://127.0.0.1:{master.server_address[1]}/"
node = TcprosNode("closes", master=uri, arguments=[])
signal.signal(signal.SIGTERM, end)
begin, Link.start = Link.start, start if what == "connect" else Link.start
try:
    if what in ("subscribe", "connect"):
        node.subscribe("in", "tf2_msgs/TFMessage", print)
    elif what == "serve":
        node.serve("asked", "tf2_msgs/FrameGraph", bytes)
    else:
        publisher = node.advertise("out", "tf2_msgs/TFMessage")
        if what == "publish":
            node._advertised["/out"]._peers.append(Peer())
            publisher.publish(b"")
            node.advertise("more", "tf2_msgs/TFMessage")
except (NodeClosed, SystemExit) as error:
    print(type(error).__name__, sorted(registered), end=" ")
for link in links:
    link.join(None)
print("ended")
"""


@pytest.mark.parametrize("how", ["return", "exit"])
@pytest.mark.parametrize("what", ["subscribe", "connect", "advertise", "publish", "serve"])
def test_a_signal_handler_closes_the_node_in_the_middle_of_a_call(what: str, how: str) -> None:
    command = [sys.executable, "-c", CLOSES, what, how]
    child = subprocess.run(command, capture_output=True, text=True, timeout=SECONDS, check=False)
    assert child.stderr == ""
    error = "NodeClosed" if how == "return" else "SystemExit"
    assert child.stdout == f"{error} [] ended\n"


def test_one_topic_has_one_type_in_a_node(node: TcprosNode) -> None:
    node.subscribe("mixed", TF, Heard())
    node.subscribe("mixed", "tf/tfMessage", Heard())
    with pytest.raises(tfdb.InvalidArgument, match="already has the type tf2_msgs/TFMessage"):
        node.subscribe("mixed", "rosgraph_msgs/Clock", Heard())
    node.advertise("mixed", TF)
    with pytest.raises(tfdb.InvalidArgument, match="already has the type"):
        node.advertise("mixed", "rosgraph_msgs/Clock")
    with pytest.raises(tfdb.InvalidArgument, match="not latched"):
        node.advertise("mixed", TF, latched=True)


def test_a_missing_master_is_named_by_its_uri() -> None:
    uri = f"http://127.0.0.1:{free_port()}"
    with pytest.raises(tfdb.errors.NoMaster, match=f"at {uri} .*roscore.*ROS_MASTER_URI") as caught:
        TcprosNode("lonely", master=uri, arguments=[])
    assert caught.value.uri == uri
    assert isinstance(caught.value, ConnectionError)
    with pytest.raises(tfdb.InvalidArgument, match="not a ROS URI"):
        TcprosNode("lonely", master="localhost", arguments=[])


def test_without_master_and_node_the_error_names_rclpy(monkeypatch: pytest.MonkeyPatch) -> None:
    uri = f"http://127.0.0.1:{free_port()}"
    monkeypatch.setenv("ROS_MASTER_URI", uri)
    monkeypatch.setattr(choose_node, "_own", {})
    monkeypatch.setattr(choose_node, "in_rospy", lambda: False)
    with pytest.raises(
        tfdb.errors.NoMaster, match=r"rclpy\.init\(\) first, or pass a node"
    ) as caught:
        node_for()
    assert caught.value.uri == uri


def test_a_callback_may_open_and_close_and_fail(
    node: TcprosNode, rospy_child: RospyChild, caplog: pytest.LogCaptureFixture
) -> None:
    heard = Heard()
    opened = []

    def take(data: bytes | memoryview, publisher: str) -> None:
        if not opened:
            opened.append(node.subscribe("busy", TF, heard))
            opened.append(node.advertise("from_callback", TF))
            subscription.close()
        raise tfdb.errors.CorruptMessage("not what it should be")

    publisher = node.advertise("busy", TF)
    subscription = node.subscribe("busy", TF, take)
    node.subscribe("busy", TF, lambda data, publisher: 1 / 0)
    until(lambda: publisher.subscribers, "the subscriber")
    for move in MOVES:
        publisher.publish(move)
    assert heard.wait(len(MOVES) - 1)[-1] == MOVES[-1]
    assert caplog.text.count("not what it should be") == 1
    assert caplog.text.count("a message of /ours on /busy: division by zero") == 1


PROGRAM = """
import sys, time
from tfdb import tf2
from tfdb import tf2
from tfdb.ros.tcpros_node import TcprosNode

node = TcprosNode("forgetful", arguments=[])
buffer = tf2.Buffer(flavor="ros1", debug=False)
listener = tf2.TransformListener(buffer, node)
buffer.wait_for_transform("map", "base", 0, 20.0)
print("there", flush=True)
sys.stdin.readline()
if len(sys.argv) > 1:
    time.sleep(20)
"""


@pytest.mark.parametrize("interrupted", [False, True])
def test_a_program_that_ends_without_closing_ends_cleanly(
    node: TcprosNode, *, interrupted: bool
) -> None:
    stamps = itertools.count(1)
    publisher = node.advertise("/tf", TF)
    arguments = ["wait"] if interrupted else []
    child = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    over = threading.Event()

    def publish() -> None:
        while not over.wait(0.0005):
            publisher.publish(transforms(("map", "base", next(stamps), 1.0)))

    thread = threading.Thread(target=publish)
    thread.start()
    try:
        assert child.stdout is not None
        assert child.stdout.readline() == "there\n"
        if interrupted:
            child.send_signal(signal.SIGINT)
        _, said = child.communicate("\n", timeout=SECONDS)
    finally:
        over.set()
        thread.join()
    if interrupted:
        assert said.splitlines()[-1] == "KeyboardInterrupt"
    else:
        assert (child.returncode, said) == (0, "")
    with xmlrpc.client.ServerProxy(node._master.uri) as master:
        assert "/forgetful" not in str(master.getSystemState("/test"))
