"""Listeners store published messages completely, by the rules of their side of ROS."""

from __future__ import annotations

import logging
from typing import Any

import pytest
from tests.test_unreadable_members import Member, encode

import tfdb
from tf2.loopback import Graph, LoopbackNode
from tf2.ours import Records, message, plain
from tfdb import tf2
from tfdb.tf2 import msgs
from tfdb.tf2.phrases import bad_frame

SECOND = 1_000_000_000
POSE = [1.0, 2.0, 3.0, 0.0, 0.6, 0.0, 0.8]
OTHER = [-4.0, 0.5, 0.0, 0.6, 0.0, 0.0, -0.8]
NOWHERE = [1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 0.0]
FLAVORS = ["ros1", "ros2"]


class World:
    """A publisher and a listener."""

    def __init__(self, flavor: Any) -> None:
        graph = Graph()
        self.robot = LoopbackNode(graph, name="/robot", flavor=flavor)
        self.node = LoopbackNode(graph, name="/reader", flavor=flavor)
        self.buffer = tf2.Buffer()
        self.listener = tf2.TransformListener(self.buffer, self.node)
        self.moving = tf2.TransformBroadcaster(self.robot)
        self.static = tf2.StaticTransformBroadcaster(self.robot)
        self.raw = self.robot.advertise("/tf", "tf2_msgs/TFMessage")

    def at(self, target: str, source: str, stamp: int = 0) -> Any:
        return plain(self.buffer.lookup_transform(target, source, msgs.Time(stamp)))


@pytest.fixture(params=FLAVORS)
def world(request: pytest.FixtureRequest) -> World:
    return World(request.param)


def sent(parent: str, child: str, stamp: int, pose: list[float] = POSE) -> msgs.TransformStamped:
    return message(parent, child, stamp * SECOND, pose)


def test_one_message_is_one_commit(world: World) -> None:
    before = world.buffer.buffer.commit
    world.moving.sendTransform([sent("map", "base", 1), sent("base", "arm", 1, OTHER)])
    assert world.buffer.buffer.commit == before + 1
    assert world.at("map", "base") == ["map", "base", SECOND, pytest.approx(POSE)]
    assert world.at("base", "arm", 1)[3] == pytest.approx(OTHER)
    world.moving.sendTransform(sent("map", "base", 2))
    world.moving.sendTransform(iter([sent("map", "base", 3)]))
    assert world.at("map", "base")[2] == 3 * SECOND
    assert world.buffer.flavor == world.node.flavor


def test_the_publisher_is_the_authority(world: World) -> None:
    world.moving.sendTransform(sent("map", "base", 1))
    assert world.buffer.buffer.frame_info("base").authority == "/robot"
    assert "broadcaster: '/robot'" in world.buffer.all_frames_as_yaml()


def test_statics_reach_late_joiners_all_of_them_the_newest(world: World) -> None:
    world.static.sendTransform(sent("base", "lidar", 1))
    world.static.sendTransform([sent("base", "camera", 1), sent("base", "lidar", 2, OTHER)])
    known = ["base", "camera", "lidar"]
    if world.node.flavor == "ros1":
        # A second broadcaster of the same node has the same latched message.
        tf2.StaticTransformBroadcaster(world.robot).sendTransform(sent("base", "imu", 1))
        known.insert(2, "imu")
    late = tf2.Buffer()
    late_node = LoopbackNode(world.robot.graph, name="/late", flavor=world.node.flavor)
    tf2.TransformListener(late, late_node)
    assert late._getFrameStrings() == known
    assert plain(late.lookup_transform("base", "lidar", msgs.Time(77)))[3] == pytest.approx(OTHER)


def test_statics_of_two_broadcasters_in_turns(world: World) -> None:
    other = tf2.StaticTransformBroadcaster(world.robot)
    world.static.sendTransform(sent("base", "mount", 1))
    other.sendTransform(sent("base", "other", 1))
    world.static.sendTransform(sent("base", "mount", 2, OTHER))

    def late_joiner() -> Any:
        late = tf2.Buffer()
        node = LoopbackNode(world.robot.graph, name="/late", flavor=world.node.flavor)
        tf2.TransformListener(late, node)
        return plain(late.lookup_transform("base", "mount", msgs.Time()))[3]

    if world.node.flavor == "ros1":
        assert late_joiner() == pytest.approx(OTHER)
        other.close()
        assert late_joiner() == pytest.approx(OTHER)
    other.close()
    with pytest.raises(tfdb.errors.NodeClosed):
        other.sendTransform(sent("base", "other", 1))
    world.static.sendTransform(sent("base", "mount", 3))
    world.static.close()
    # A topic that was taken back begins anew.
    tf2.StaticTransformBroadcaster(world.robot).sendTransform(sent("base", "imu", 1))
    assert world.at("base", "imu")[3] == pytest.approx(POSE)


def test_a_static_that_is_changed_after_it_was_sent_stays_as_it_was(world: World) -> None:
    one = sent("base", "lidar", 1)
    world.static.sendTransform(one)
    one.transform.translation.x = 50.0
    world.static.sendTransform(sent("base", "camera", 1))
    assert world.at("base", "lidar")[3] == pytest.approx(POSE)


def test_refused_transforms_are_logged_and_the_others_stored(world: World) -> None:
    records = Records()
    logger = logging.getLogger("tfdb.tf2")
    logger.addHandler(records)
    try:
        world.moving.sendTransform(
            [
                sent("map", "base", 1),
                sent("base", "base", 1),
                sent("base", "arm", 1, NOWHERE),
                sent("base", "lidar", 1),
            ]
        )
    finally:
        logger.removeHandler(records)
    assert world.buffer._getFrameStrings() == ["base", "lidar", "map"]
    own, lost = records.texts
    assert own.startswith('TF_SELF_TRANSFORM: Ignoring transform from authority "/robot"')
    assert lost.startswith("TF_DENORMALIZED_QUATERNION: Ignoring transform for child_frame_id")
    assert isinstance(records.errors[1], tfdb.errors.InvalidTransform)
    assert world.listener.refused == {"/robot": 2}


@pytest.mark.parametrize("watching", [False, True])
def test_an_undecodable_name_refuses_only_its_transform(
    world: World, caplog: pytest.LogCaptureFixture, watching: bool
) -> None:
    class Watching(tf2.Buffer):
        def set_transform(self, transform: Any, authority: str) -> bool:
            return super().set_transform(transform, authority)

    buffer = Watching() if watching else tf2.Buffer()
    listener = tf2.TransformListener(buffer, world.node)
    world.listener.unregister()
    message = [sent("map", "base", 1), sent("map", "broken", 1), sent("base", "arm", 1, OTHER)]
    data = tfdb.encode_tf_message(message, world.node.encoding).replace(b"broken", b"br\xffken")
    world.raw.publish(data)
    assert buffer._getFrameStrings() == ["arm", "base", "map"]
    assert buffer.buffer.commit == (2 if watching else 1)
    assert listener.refused == {"/robot": 1}
    (said,) = [r for r in caplog.records if hasattr(r, "error")]
    assert isinstance(said.__dict__["error"], tfdb.errors.InvalidName)


def test_the_same_stamp_again(world: World, caplog: pytest.LogCaptureFixture) -> None:
    world.moving.sendTransform(sent("map", "base", 1))
    world.moving.sendTransform([sent("map", "base", 1, OTHER), sent("map", "cart", 1)])
    ros1 = world.node.flavor == "ros1"
    assert world.at("map", "base", 1)[3] == pytest.approx(POSE if ros1 else OTHER)
    assert ("TF_REPEATED_DATA" in caplog.text) == ros1
    assert world.at("map", "cart", 1)[3] == pytest.approx(POSE)


def test_a_frame_changes_between_static_and_moving(world: World) -> None:
    world.static.sendTransform(sent("base", "arm", 1))
    world.moving.sendTransform([sent("base", "arm", 5, OTHER), sent("map", "base", 5)])
    if world.node.flavor == "ros1":
        assert world.at("base", "arm", 99)[3] == pytest.approx(OTHER)
    else:
        with pytest.raises(tf2.ExtrapolationException):
            world.at("base", "arm", 99)
    assert world.at("base", "arm", 5)[3] == pytest.approx(OTHER)


def test_the_log_of_old_data_names_the_sender(
    world: World, caplog: pytest.LogCaptureFixture
) -> None:
    world.moving.sendTransform(sent("map", "base", 100))
    world.moving.sendTransform(sent("map", "base", 1))
    assert "TF_OLD_DATA ignoring data from the past" in caplog.text
    assert "according to authority /robot" in caplog.text


def test_the_log_names_the_sender_of_a_stamp_far_in_the_future(
    world: World, caplog: pytest.LogCaptureFixture
) -> None:
    world.node.time = 100 * SECOND
    world.moving.sendTransform(sent("map", "base", 100_000))
    for stamp in (101, 102):
        world.moving.sendTransform(sent("map", "base", stamp))
    said = [record for record in caplog.records if "TF_FUTURE_DATA" in record.getMessage()]
    assert len(said) == 1
    assert "has the time 100000.000000, 99900.000000 s ahead of this clock" in said[0].getMessage()
    error = said[0].__dict__["error"]
    assert (error.authority, error.edge, error.newest) == ("/robot", "base", 100_000 * SECOND)


@pytest.mark.parametrize("damage", ["cut", "count", "empty", "noise"])
def test_a_damaged_message_is_counted_and_logged_once(
    world: World, caplog: pytest.LogCaptureFixture, damage: str
) -> None:
    whole = tfdb.encode_tf_message([sent("map", "base", 1)], world.node.encoding)
    start = 0 if world.node.encoding == "ros1" else 4
    bad = {
        "cut": whole[:-3],
        "count": whole[:start] + b"\xff\xff\xff\xff" + whole[start + 4 :],
        "empty": b"",
        "noise": bytes(range(200, 256)) * 3,
    }[damage]
    before = world.buffer.buffer.commit
    for _ in range(3):
        world.raw.publish(bad)
    assert world.buffer.buffer.commit == before
    assert world.listener.corrupt == {"/robot": 3}
    assert len([r for r in caplog.records if "damaged message of /robot" in r.getMessage()]) == 1
    assert isinstance(caplog.records[0].__dict__["error"], tfdb.errors.CorruptMessage)
    world.raw.publish(whole)
    assert world.at("map", "base", 1)[3] == pytest.approx(POSE)


def test_a_bag_that_is_looped_with_simulated_time(
    world: World, caplog: pytest.LogCaptureFixture
) -> None:
    world.static.sendTransform(sent("base", "lidar", 1))
    for _ in range(3):
        for stamp in range(10, 20):
            world.node.set_time(stamp * SECOND)
            world.moving.sendTransform(sent("map", "base", stamp))
            assert world.at("map", "lidar")[2] == stamp * SECOND
    assert caplog.text.count("Detected jump back in time of 9.000000s. Clearing TF buffer.") == 2


def test_unregister_ends_it(world: World) -> None:
    world.listener.unregister()
    world.listener.unregister()
    world.moving.sendTransform(sent("map", "base", 1))
    world.static.sendTransform(sent("base", "arm", 1))
    assert not world.buffer._getFrameStrings()
    assert len(world.node.watches) == 1  # of the buffer, for the node's end


def test_an_unreferenced_listener_continues() -> None:
    node = LoopbackNode()
    buffer = tf2.Buffer()
    tf2.TransformListener(buffer, node)
    tf2.TransformBroadcaster(node).sendTransform(sent("map", "base", 1))
    assert buffer.can_transform("map", "base", msgs.Time(1))


def test_static_listener() -> None:
    node = LoopbackNode()
    buffer = tf2.Buffer()
    tf2.StaticTransformListener(buffer, node)
    tf2.TransformBroadcaster(node).sendTransform(sent("map", "base", 1))
    tf2.StaticTransformBroadcaster(node).sendTransform(sent("base", "arm", 1))
    assert buffer._getFrameStrings() == ["arm", "base"]


def test_a_subclass_sees_each_transform() -> None:
    class Watching(tf2.Buffer):
        seen: list[str]

        def set_transform(self, transform: Any, authority: str) -> None:
            self.seen.append(transform.child_frame_id)
            super().set_transform(transform, authority)

    node = LoopbackNode()
    buffer = Watching()
    buffer.seen = []
    tf2.TransformListener(buffer, node)
    tf2.TransformBroadcaster(node).sendTransform([sent("a", "b", 1), sent("b", "c", 1)])
    assert buffer.seen == ["b", "c"]
    assert buffer.can_transform("a", "c", msgs.Time(1))


def test_anything_that_takes_transforms_can_be_filled() -> None:
    class Recorder:
        def __init__(self) -> None:
            self.got: list[tuple[str, str, str]] = []

        def set_transform(self, transform: Any, authority: str) -> None:
            self.got.append(("moving", transform.child_frame_id, authority))

        def set_transform_static(self, transform: Any, authority: str) -> None:
            self.got.append(("static", transform.child_frame_id, authority))

    node = LoopbackNode()
    recorder = Recorder()
    tf2.TransformListener(recorder, node, queue_size=1)
    tf2.TransformBroadcaster(node).sendTransform(sent("a", "b", 1))
    tf2.StaticTransformBroadcaster(node).sendTransform(sent("b", "c", 1))
    assert recorder.got == [("moving", "b", "/here"), ("static", "c", "/here")]


def test_a_message_with_an_invalid_transform_is_not_sent(world: World) -> None:
    with pytest.raises(tfdb.InvalidStamp) as refused:
        world.moving.sendTransform([sent("a", "b", 1), sent("b", "c", -1)])
    assert refused.value.index == 1
    with pytest.raises(tfdb.InvalidStamp):
        world.static.sendTransform([sent("a", "b", -1)])
    world.static.sendTransform(sent("x", "y", 1))
    assert world.buffer._getFrameStrings() == ["x", "y"]


def test_other_types_of_nodes_are_refused() -> None:
    with pytest.raises(TypeError, match=r"node must be of tfdb.ros or rclpy, or None"):
        tf2.TransformListener(tf2.Buffer(), "node")


class Counting(tf2.TransformListener):
    """Counts the messages of each topic, and stores what has no odd name."""

    def __init__(self, buffer: Any, node: Any) -> None:
        self.heard: list[tuple[str, int]] = []
        super().__init__(buffer, node)

    def callback(self, data: Any) -> None:
        self.heard.append(("tf", len(data.transforms)))
        data.transforms = [each for each in data.transforms if each.child_frame_id != "odd"]
        super().callback(data)

    def static_callback(self, data: Any) -> None:
        self.heard.append(("tf_static", len(data.transforms)))
        super().static_callback(data)


@pytest.mark.parametrize("flavor", FLAVORS)
def test_overridden_callbacks_get_each_message(flavor: Any) -> None:
    node = LoopbackNode(flavor=flavor)
    buffer = tf2.Buffer()
    listener = Counting(buffer, node)
    moving = tf2.TransformBroadcaster(node)
    moving.sendTransform([sent("map", "base", 1), sent("map", "odd", 1)])
    moving.sendTransform([sent("map", "base", 2, OTHER)])
    tf2.StaticTransformBroadcaster(node).sendTransform(sent("base", "arm", 1, OTHER))
    assert listener.heard == [("tf", 2), ("tf", 1), ("tf_static", 1)]
    assert buffer._getFrameStrings() == ["arm", "base", "map"]
    found = plain(buffer.lookup_transform("map", "base", msgs.Time(2)))
    assert found[3] == pytest.approx(OTHER)
    authority = buffer.buffer.frame_info("base").authority
    assert authority == ("/here" if flavor == "ros1" else "default_authority")
    node.graph.readers["/tf"][0](b"\x00\x01", "/hostile")
    assert listener.corrupt == {"/hostile": 1}
    assert len(listener.heard) == 3


def test_a_callback_that_was_replaced_in_the_class_is_called(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    heard: list[Any] = []
    monkeypatch.setattr(tf2.TransformListener, "callback", lambda _, data: heard.append(data))
    node = LoopbackNode()
    tf2.TransformListener(tf2.Buffer(), node)
    tf2.TransformBroadcaster(node).sendTransform(sent("map", "base", 1))
    assert [each.transforms[0].child_frame_id for each in heard] == ["base"]
    assert heard[0]._connection_header["callerid"] == "/here"


@pytest.mark.parametrize("flavor", FLAVORS)
def test_callbacks_serve_a_listener_that_subscribes_by_itself(flavor: Any) -> None:
    class Own(tf2.TransformListener):
        def __init__(self, buffer: Any, node: Any) -> None:
            self.buffer = buffer
            self.node = node
            self.called = self.callback, self.static_callback

    buffer = tf2.Buffer()
    moving, static = Own(buffer, LoopbackNode(flavor=flavor)).called
    moving(msgs.TFMessage([sent("map", "base", 1)]))
    static(msgs.TFMessage([sent("base", "arm", 1, OTHER)]))
    assert plain(buffer.lookup_transform("base", "arm", msgs.Time(9)))[3] == pytest.approx(OTHER)
    assert buffer.can_transform("map", "arm", msgs.Time(1))


def test_a_replaced_buffer_gets_later_messages(world: World) -> None:
    world.moving.sendTransform(sent("map", "base", 1))
    other = tf2.Buffer()
    world.listener.buffer = other
    assert world.listener.buffer is other
    world.moving.sendTransform(sent("map", "base", 2, OTHER))
    world.static.sendTransform(sent("base", "arm", 2))
    assert plain(other.lookup_transform("map", "base", msgs.Time()))[2] == 2 * SECOND
    assert other.flavor == world.node.flavor
    assert world.at("map", "base")[2] == SECOND
    assert other.can_transform("base", "arm", msgs.Time(5))
    world.node.set_time(9 * SECOND)
    world.node.set_time(1 * SECOND)
    assert not other.can_transform("map", "base", msgs.Time())
    assert world.buffer.can_transform("map", "base", msgs.Time())


def test_topics_are_ended_and_published_by_hand(world: World) -> None:
    world.moving.pub_tf.publish(msgs.TFMessage([sent("map", "base", 1)]))
    assert world.at("map", "base")[3] == pytest.approx(POSE)
    world.listener.tf_sub.unregister()
    world.moving.sendTransform(sent("map", "base", 2))
    assert world.at("map", "base")[2] == SECOND
    world.static.sendTransform([sent("base", "arm", 1), sent("base", "leg", 1)])
    world.static.sendTransform(sent("base", "arm", 2, OTHER))
    message = world.static.net_message
    assert [(each.child_frame_id, each.header.stamp.sec) for each in message.transforms] == [
        ("arm", 2),
        ("leg", 1),
    ]
    message.transforms.clear()
    world.static.sendTransform(sent("base", "foot", 1))
    late = tf2.Buffer()
    tf2.TransformListener(late, LoopbackNode(world.robot.graph, flavor=world.node.flavor))
    assert late._getFrameStrings() == ["base", "foot"]
    world.listener.tf_static_sub.unregister()
    world.listener.unregister()
    world.static.sendTransform(sent("base", "hat", 1))
    assert not world.buffer._frameExists("hat")


def test_a_reset_that_is_overridden_clears_nothing() -> None:
    class Keeping(tf2.TransformListener):
        resets = 0

        def check_for_reset(self) -> None:
            self.resets += 1

    node = LoopbackNode()
    buffer = tf2.Buffer()
    listener = Keeping(buffer, node)
    tf2.TransformBroadcaster(node).sendTransform(sent("map", "base", 1))
    node.set_time(9 * SECOND)
    node.set_time(1 * SECOND)
    assert listener.resets == 2
    assert buffer.can_transform("map", "base", msgs.Time(1))
    plain_listener = tf2.TransformListener(buffer, node)
    node.time = 0
    plain_listener.check_for_reset()
    assert not buffer.can_transform("map", "base", msgs.Time(1))


@pytest.mark.parametrize("static", [False, True])
@pytest.mark.parametrize("whole", [False, True])
def test_a_transform_without_a_stamp_costs_its_own(
    world: World, caplog: pytest.LogCaptureFixture, static: bool, whole: bool
) -> None:
    """Native and through a subclass that sees each transform; in the words of the callback."""
    encoding = "ros1" if world.node.flavor == "ros1" else "cdr"
    if whole:

        class Own(tf2.Buffer):
            def set_transform(self, transform: Any, authority: str) -> None:
                super().set_transform(transform, authority)

            def set_transform_static(self, transform: Any, authority: str) -> None:
                super().set_transform_static(transform, authority)

        world.buffer = Own()
        world.listener.buffer = world.buffer
    members = [
        Member(b"map", b"base", 5),
        Member(b"map", b"gear", 5, SECOND),
        Member(b"map", b"c\0am", 5),
        Member(b"base", b"arm", 5),
    ]
    if encoding == "cdr":
        members.append(Member(b"map", b"early", -1, 5))
    topic = world.robot.advertise("/tf_static", "tf2_msgs/TFMessage") if static else world.raw
    topic.publish(encode(members, encoding))
    assert world.buffer._getFrameStrings() == ["arm", "base", "map"]
    assert world.buffer.buffer.commit == (2 if whole else 1)
    assert world.listener.refused == {"/robot": len(members) - 2}
    assert not world.listener.corrupt
    said = sorted(record.getMessage() for record in caplog.records)
    if encoding == "cdr":
        assert said.pop(1) == (
            'TF_BAD_STAMP: Ignoring transform for child_frame_id "early" from authority "/robot" '
            "because its time -0.999999995 is negative or too large"
        )
    assert said == [
        "TF_BAD_FRAME_ID: Ignoring transform with frame_id 'map' and child_frame_id 'c\\x00am' "
        'from authority "/robot" because of control characters or its length',
        "the stamp of T[map<-gear] from '/robot' was refused: 1000000000 nanoseconds are a "
        "second or more",
    ]


def test_the_log_cuts_long_names() -> None:
    text = bad_frame("/robot", "map", "n" * 5000)
    assert "'map'" in text
    assert "nnn..." in text
    assert len(text) < 300
