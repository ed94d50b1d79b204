"""`tfdb view --foxglove` as a viewer sees it that speaks Foxglove's protocol."""

from __future__ import annotations

import base64
import json
import struct
import threading
from contextlib import ExitStack, contextmanager, suppress
from typing import TYPE_CHECKING, Any, Self

import pytest
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

import tfdb

if TYPE_CHECKING:
    from collections.abc import Iterator

pytest.importorskip("foxglove")
descriptor_pb2 = pytest.importorskip("google.protobuf.descriptor_pb2")
descriptor_pool = pytest.importorskip("google.protobuf.descriptor_pool")
message_factory = pytest.importorskip("google.protobuf.message_factory")

from tfdb.view.foxglove_server import serve_foxglove  # noqa: E402 - it needs foxglove

S = 1_000_000_000
TURN = (0.0, 0.6, 0.0, 0.8)
PATIENCE = 60.0


class Viewer:
    """A client of the protocol."""

    def __init__(self, address: str, *protocols: str) -> None:
        self._address = address
        self._protocols = [*map(Subprotocol, protocols or ["foxglove.sdk.v1"])]
        self._stack = ExitStack()
        self.connection: ClientConnection
        self.channels: dict[str, Any] = {}
        self.topics: dict[int, str] = {}
        self.info: dict[str, Any] = {}

    def __enter__(self) -> Self:
        self.connection = self._stack.enter_context(
            connect(self._address, subprotocols=self._protocols, open_timeout=PATIENCE)
        )
        while len(self.channels) < 2:
            message = self.connection.recv(timeout=PATIENCE)
            body = json.loads(message)
            if body["op"] == "serverInfo":
                self.info = body
            elif body["op"] == "advertise":
                self.channels |= {each["topic"]: each for each in body["channels"]}
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def subscribe(self, *topics: str) -> None:
        asked = []
        for topic in topics:
            number = len(self.topics)
            self.topics[number] = topic
            asked.append({"id": number, "channelId": self.channels[topic]["id"]})
        self.connection.send(json.dumps({"op": "subscribe", "subscriptions": asked}))

    def receive(self) -> tuple[str, int, list[Any]]:
        """Return the topic, the log time and the transforms of the next message."""
        while True:
            data = self.connection.recv(timeout=PATIENCE)
            if isinstance(data, bytes) and data[0] == 1:
                break
        number, time = struct.unpack_from("<IQ", data, 1)
        topic = self.topics[number]
        message = decode(self.channels[topic], data[13:])
        return topic, time, list(message.transforms)


def decode(channel: dict[str, Any], data: bytes) -> Any:
    """Decode a message by the schema that its channel has."""
    assert (channel["encoding"], channel["schemaEncoding"]) == ("protobuf", "protobuf")
    files = descriptor_pb2.FileDescriptorSet.FromString(base64.b64decode(channel["schema"]))
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    kind = pool.FindMessageTypeByName(channel["schemaName"])
    return message_factory.GetMessageClass(kind).FromString(data)


def told(transforms: list[Any]) -> dict[str, tuple[str, int, list[float], list[float]]]:
    return {
        each.child_frame_id: (
            each.parent_frame_id,
            each.timestamp.seconds * S + each.timestamp.nanos,
            [each.translation.x, each.translation.y, each.translation.z],
            [each.rotation.x, each.rotation.y, each.rotation.z, each.rotation.w],
        )
        for each in transforms
    }


@contextmanager
def serving(store: tfdb.Buffer) -> Iterator[str]:
    """Serve a store in a thread; closing the store ends it."""
    ready = threading.Event()
    addresses: list[str] = []

    def tell(address: str) -> None:
        addresses.append(address)
        ready.set()

    def run() -> None:
        with suppress(tfdb.errors.BufferClosed):
            serve_foxglove(store, "shm:robot", host="127.0.0.1", port=0, ready=tell)

    thread = threading.Thread(target=run)
    thread.start()
    try:
        assert ready.wait(PATIENCE)
        yield addresses[0]
    finally:
        store.close()
        thread.join(PATIENCE)
        assert not thread.is_alive()


@pytest.fixture
def store() -> tfdb.Buffer:
    buf = tfdb.Buffer()
    buf.set_static_transform("base", "camera", (0.2, 0.0, 1.1), TURN)
    buf.set_transform("map", "base", 100 * S + 5, (1, 2, 3), TURN)
    buf.set_transform("base", "tool", 99 * S, (0, 0, 1), TURN)
    return buf


@pytest.mark.parametrize(
    "protocols",
    [["foxglove.sdk.v1"], ["foxglove.websocket.v1", "foxglove.sdk.v1"]],
    ids=["Foxglove", "Lichtblick"],
)
def test_a_viewer_gets_the_held_edges_and_then_each_sample(
    store: tfdb.Buffer, protocols: list[str]
) -> None:
    with serving(store) as address, Viewer(address, *protocols) as viewer:
        assert viewer.info["name"] == "tfdb: shm:robot"
        assert viewer.channels["/tf"]["schemaName"] == "foxglove.FrameTransforms"
        viewer.subscribe("/tf_static")
        topic, time, transforms = viewer.receive()
        assert (topic, time) == ("/tf_static", 100 * S + 5)
        assert told(transforms) == {
            "camera": ("base", 100 * S + 5, [0.2, 0.0, 1.1], list(TURN)),
        }
        viewer.subscribe("/tf")
        topic, time, transforms = viewer.receive()
        assert (topic, time) == ("/tf", 100 * S + 5)
        assert told(transforms) == {
            "base": ("map", 100 * S + 5, [1, 2, 3], list(TURN)),
            "tool": ("base", 99 * S, [0, 0, 1], list(TURN)),
        }
        for step in range(1, 6):
            store.set_transform("map", "base", (100 + step) * S, (step, 0, 0), TURN)
        got: list[Any] = []
        while len(got) < 5:
            topic, _, transforms = viewer.receive()
            assert topic == "/tf"
            got += transforms
        assert [each.translation.x for each in got] == [1, 2, 3, 4, 5]
        assert [each.timestamp.seconds for each in got] == [101, 102, 103, 104, 105]


def test_a_viewer_that_comes_late_gets_static_edges_that_came_before(store: tfdb.Buffer) -> None:
    with serving(store) as address:
        with Viewer(address) as first:
            first.subscribe("/tf_static")
            assert told(first.receive()[2]).keys() == {"camera"}
            store.set_static_transform("base", "lidar", (0, 0, 2), TURN)
            assert told(first.receive()[2]).keys() == {"lidar"}
        with Viewer(address) as second:
            second.subscribe("/tf_static", "/tf")
            got = dict([second.receive()[::2], second.receive()[::2]])
            assert told(got["/tf_static"]).keys() == {"camera", "lidar"}
            assert told(got["/tf"]).keys() == {"base", "tool"}


def test_viewers_come_and_go_while_the_store_is_written(store: tfdb.Buffer) -> None:
    stop = threading.Event()

    def feed() -> None:
        stamp = 101 * S
        while not stop.wait(0.002):
            store.set_transform("map", "base", stamp, (stamp / S, 0, 0), TURN)
            stamp += S // 100

    thread = threading.Thread(target=feed)
    with serving(store) as address:
        thread.start()
        try:
            for _ in range(20):
                with Viewer(address) as viewer:
                    viewer.subscribe("/tf")
                    held = told(viewer.receive()[2])
                    assert held.keys() == {"base", "tool"}
                    at = held["base"][1]
                    for _ in range(5):
                        found = viewer.receive()[2]
                        assert {each.child_frame_id for each in found} <= {"base", "tool"}
                        assert told(found)["base"][1] >= at
        finally:
            stop.set()
            thread.join(PATIENCE)


def test_an_empty_store_is_served_and_fills() -> None:
    store = tfdb.Buffer()
    with serving(store) as address, Viewer(address) as viewer:
        viewer.subscribe("/tf", "/tf_static")
        store.set_static_transform("base", "camera", (0, 0, 1), TURN)
        assert told(viewer.receive()[2]).keys() == {"camera"}
        store.set_transform("map", "base", 5 * S, (1, 0, 0), TURN)
        topic, time, transforms = viewer.receive()
        while topic != "/tf":  # the camera again, if it came while the viewer subscribed
            topic, time, transforms = viewer.receive()
        assert (time, told(transforms).keys()) == (5 * S, {"base"})


def test_a_port_in_use_raises(store: tfdb.Buffer) -> None:
    with serving(store) as address:
        port = int(address.rpartition(":")[2])
        with pytest.raises(OSError, match="in use"):
            serve_foxglove(store, "x", host="127.0.0.1", port=port, ready=lambda _: None)
