"""Peers that violate the protocol end their own connection only."""

from __future__ import annotations

import socket
import threading
import xmlrpc.client
from contextlib import ExitStack, contextmanager, suppress
from typing import TYPE_CHECKING, Any
from xmlrpc.server import SimpleXMLRPCServer

import pytest

import tfdb
from ros.messages import transforms
from ros.real_ros1 import SECONDS, until
from ros.test_tcpros_node import Heard
from tfdb.ros import tcpros_server
from tfdb.ros.message_kinds import kind_of
from tfdb.ros.tcpros import encode_header, frame
from tfdb.ros.tcpros_node import TcprosNode

if TYPE_CHECKING:
    from collections.abc import Iterator

TF = "tf2_msgs/TFMessage"
MOVE = transforms(("map", "base", 5, 1.0))
GOOD = {"callerid": "/fake", "md5sum": kind_of(TF).md5sum, "type": TF, "latching": "0"}


@pytest.fixture
def node(ros1: str) -> Iterator[TcprosNode]:
    with TcprosNode("ours", arguments=[]) as node:
        yield node


@contextmanager
def answering(**methods: Any) -> Iterator[str]:
    """Start an XML-RPC server with these methods; return its URI."""
    server = SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False)
    for name, method in methods.items():
        server.register_function(method, name)
    thread = threading.Thread(target=server.serve_forever, args=(0.01,))
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}/"
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


class FakePublisher:
    """Accepts subscribers, and sends each the bytes that the test chooses."""

    def __init__(self, stack: ExitStack) -> None:
        self.listener = stack.enter_context(socket.create_server(("127.0.0.1", 0)))
        self.listener.settimeout(SECONDS)
        address = list(self.listener.getsockname())
        self.uri = stack.enter_context(
            answering(requestTopic=lambda *_: [1, "", ["TCPROS", *address]])
        )
        self.stack = stack

    def accept(self, *parts: bytes) -> socket.socket:
        """Accept the next connection, and send these bytes."""
        connection = self.stack.enter_context(self.listener.accept()[0])
        for part in parts:
            connection.sendall(part)
        return connection


@pytest.fixture
def fake() -> Iterator[FakePublisher]:
    with ExitStack() as stack:
        yield FakePublisher(stack)


def tell(node: TcprosNode, topic: str, *uris: str) -> None:
    """Report the publishers to the node, as the master would."""
    with xmlrpc.client.ServerProxy(node.uri) as slave:
        assert slave.publisherUpdate("/master", topic, list(uris)) == [1, "", 0]


HEADER = encode_header(GOOD)


@pytest.mark.parametrize(
    ("sent", "said"),
    [
        ([b"HTTP/1.1 400 Bad Request\r\n\r\n"], "a frame has 1347703880 bytes"),
        ([frame(b"\x09\0\0\0abc")], "claims 9 bytes"),
        ([HEADER, b"\xff\xff\xff\xff"], "has 4294967295 bytes; at most 268435456"),
        ([encode_header({**GOOD, "md5sum": "0" * 32})], "of md5sum 0000"),
        ([encode_header({"error": "go away"})], "the publisher refuses: go away"),
        ([], "before its header"),
    ],
)
def test_a_publisher_that_breaks_the_protocol_is_left_and_tried_again(
    node: TcprosNode,
    fake: FakePublisher,
    caplog: pytest.LogCaptureFixture,
    sent: list[bytes],
    said: str,
) -> None:
    heard = Heard()
    node.subscribe("tf", TF, heard)
    tell(node, "/tf", fake.uri)
    for _ in range(2):
        connection = fake.accept(*sent)
        with suppress(OSError):  # the node may have disconnected already
            connection.shutdown(socket.SHUT_WR)
    # The third time it follows the protocol.
    fake.accept(HEADER, frame(MOVE))
    assert heard.wait(1) == [MOVE]
    assert heard.publishers == ["/fake"]
    assert caplog.text.count(said) == 1, "said once"


def test_a_message_that_is_cut_off_is_dropped_and_the_rest_goes_on(
    node: TcprosNode, fake: FakePublisher
) -> None:
    heard = Heard()
    node.subscribe("tf", TF, heard)
    tell(node, "/tf", fake.uri)
    fake.accept(HEADER, frame(MOVE), frame(MOVE)[:-1]).close()
    fake.accept(HEADER, frame(MOVE + b"2"))
    assert heard.wait(2) == [MOVE, MOVE + b"2"]


def test_silent_and_slow_publishers_delay_no_other(node: TcprosNode, fake: FakePublisher) -> None:
    heard = Heard()
    node.subscribe("tf", TF, heard)
    with ExitStack() as stack:
        silent, slow = FakePublisher(stack), FakePublisher(stack)
        tell(node, "/tf", silent.uri, slow.uri, fake.uri)
        silent.accept()
        rest = slow.accept(HEADER, frame(MOVE)[:5])
        fake.accept(HEADER, frame(MOVE))
        assert heard.wait(1) == [MOVE]
        for position in range(5, len(frame(MOVE))):
            rest.sendall(frame(MOVE)[position : position + 1])
        assert heard.wait(2) == [MOVE, MOVE]
        # The node disconnects from former publishers, and its `close` does not wait for the silent
        # one.
        tell(node, "/tf", fake.uri)
        assert rest.recv(1 << 16)
        assert rest.recv(1) == b""
        node.close()


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        ([-1, "not mine", 0], "does not offer it: not mine"),
        ([1, "", ["UDPROS", "127.0.0.1", 1]], "has no TCPROS"),
        ([1, "", []], "has no TCPROS"),
        ("nothing", "not answer with code, message and value"),
        ([1, "", ["TCPROS", "127.0.0.1", "port"]], "invalid literal"),
    ],
)
def test_a_publisher_with_a_broken_api(
    node: TcprosNode, caplog: pytest.LogCaptureFixture, answer: Any, said: str
) -> None:
    node.subscribe("tf", TF, Heard())
    with answering(requestTopic=lambda *_: answer) as uri:
        tell(node, "/tf", uri, "http://127.0.0.1:1", "no uri")
        until(lambda: said in caplog.text, said)
        until(lambda: "'no uri' is not a ROS URI" in caplog.text, "the refusal of no uri")
        tell(node, "/tf")


def test_a_master_that_refuses_or_answers_nonsense() -> None:
    answers = {"getParam": [-1, "not set", 0], "registerSubscriber": [0, "not you", 0]}
    methods = {name: lambda *_, found=found: found for name, found in answers.items()}
    with answering(**methods) as uri, TcprosNode("n", master=uri, arguments=[]) as node:
        with pytest.raises(tfdb.errors.MasterRefused, match="of /n: not you") as caught:
            node.subscribe("tf", TF, Heard())
        assert caught.value.uri == uri
        with pytest.raises(tfdb.errors.NoMaster, match="registerPublisher"):
            node.advertise("tf", TF)
        assert node._subscribed == node._advertised == {}


def subscriber(node: TcprosNode, *parts: bytes) -> socket.socket:
    connection = socket.create_connection(("127.0.0.1", node._server.port), timeout=SECONDS)
    for part in parts:
        connection.sendall(part)
    return connection


def read_all(connection: socket.socket) -> bytes:
    found = b""
    while piece := connection.recv(1 << 20):
        found += piece
    return found


WANTS = {"callerid": "/slow", "topic": "/out", "md5sum": kind_of(TF).md5sum, "type": TF}


@pytest.mark.parametrize(
    ("sent", "said"),
    [
        (b"GET / HTTP/1.1\r\n\r\n", b""),
        (b"\xff\xff\xff\xff", b""),
        (frame(b"\x01\0\0\0a"), b""),
        (encode_header({}), b"does not offer nothing"),
        (encode_header({"topic": "/none", "md5sum": "*"}), b"does not offer /none"),
        (encode_header({"service": "/none", "md5sum": "*"}), b"does not offer /none"),
        (
            encode_header({**WANTS, "md5sum": "0"}),
            b"the subscriber expects tf2_msgs/TFMessage of md5sum 0",
        ),
    ],
)
def test_peers_with_another_protocol_are_refused(
    node: TcprosNode, sent: bytes, said: bytes
) -> None:
    publisher = node.advertise("out", TF, latched=True)
    publisher.publish(MOVE)
    with subscriber(node, sent) as connection:
        assert said in read_all(connection)
    with subscriber(node, encode_header(WANTS)) as connection:
        until(lambda: publisher.subscribers == ["/slow"], "a good one")
        node.close()
        assert read_all(connection).endswith(frame(MOVE))


def test_silent_peers_are_disconnected(node: TcprosNode, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tcpros_server, "HANDSHAKE_SECONDS", 0.05)
    with subscriber(node, b"\x10\0") as connection:
        assert b"no header came within 0.05 s" in read_all(connection)


def test_a_subscriber_that_does_not_read_blocks_no_other_and_misses_the_oldest(
    node: TcprosNode, caplog: pytest.LogCaptureFixture
) -> None:
    heard = Heard()
    publisher = node.advertise("out", TF, depth=10)
    node.subscribe("out", TF, heard)
    with subscriber(node, encode_header(WANTS)):
        until(lambda: len(publisher.subscribers) == 2, "both subscribers")
        messages = [number.to_bytes(4, "little") * 50_000 for number in range(100)]
        for number, message in enumerate(messages):
            publisher.publish(message)
            assert heard.wait(number + 1)[number] == message
        assert "/slow receives messages too slowly" in caplog.text
    assert caplog.text.count("too slowly") == 1


def test_a_slow_subscriber_gets_the_newest_once_it_reads(node: TcprosNode) -> None:
    publisher = node.advertise("out", TF, depth=10)
    with subscriber(node, encode_header(WANTS)) as connection:
        until(lambda: publisher.subscribers == ["/slow"], "the subscriber")
        for number in range(100):
            publisher.publish(number.to_bytes(4, "little") * 50_000)
        received = connection.makefile("rb")
        received.read(int.from_bytes(received.read(4), "little"))
        numbers = []
        while not numbers or numbers[-1] != 99:
            message = received.read(200_004)[4:]
            number = message[:4]
            assert message == number * 50_000, "no message is torn"
            numbers.append(int.from_bytes(number, "little"))
    assert numbers == sorted(set(numbers))
    assert numbers[-10:] == list(range(90, 100))
    assert len(numbers) < 100


def test_a_client_that_asks_before_it_has_its_answer_is_left(node: TcprosNode) -> None:
    asked, go_on = threading.Event(), threading.Event()

    def answer(request: bytes) -> bytes:
        asked.set()
        assert go_on.wait(SECONDS)
        return request

    node.serve("~s", "tf2_msgs/FrameGraph", answer)
    header = encode_header({"callerid": "/c", "service": "/ours/s", "md5sum": "*"})
    with subscriber(node, header, frame(b"one")) as connection:
        assert asked.wait(SECONDS)
        connection.sendall(frame(b"two"))
        read_all(connection)
        go_on.set()
    with subscriber(node, header, frame(b"three")) as connection:
        until(lambda: connection.recv(1 << 16, socket.MSG_PEEK).endswith(b"three"), "an answer")


@pytest.mark.parametrize(
    "sent",
    [
        b"\0" * 100 + b"\r\n\r\n",
        b"POST / HTTP/1.1\r\nContent-Length: 99999999999\r\n\r\n",
        b"POST / HTTP/1.1\r\nContent-Length: -1\r\n\r\n",
        b"POST / HTTP/1.1\r\n\r\n",
        b"POST / HTTP/1.1\r\nContent-Length: 3\r\n\r\n<a>",
        b"POST /else HTTP/1.1\r\nContent-Length: 3\r\n\r\n<a>",
    ],
)
def test_nonsense_for_the_slave_api(node: TcprosNode, sent: bytes) -> None:
    port = node._slave.port
    with (
        socket.create_connection(("127.0.0.1", port), timeout=SECONDS) as silent,
        socket.create_connection(("127.0.0.1", port), timeout=SECONDS) as connection,
    ):
        silent.sendall(b"POST / HT")
        connection.sendall(sent)
        connection.shutdown(socket.SHUT_WR)
        read_all(connection)
        with xmlrpc.client.ServerProxy(node.uri) as slave:
            assert slave.getPid("/test")[0] == 1
