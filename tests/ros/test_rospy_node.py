"""The RospyNode in a real graph, together with the program's own topics."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from ros.messages import clock, transforms
from ros.real_ros1 import SECONDS, RospyChild, until

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

TF = "tf2_msgs/TFMessage"
SCRIPT = Path(__file__).with_name("our_rospy_child.py")
MOVES = [transforms(("map", "base", 1_000_000_001 + i, float(i))).hex() for i in range(5)]


@pytest.fixture(scope="module")
def ours(master_uri: str) -> Iterator[RospyChild]:
    """A rospy program that uses tfdb."""
    child = RospyChild(master_uri, "", sys.executable, SCRIPT)
    assert "rospy.init_node" in child.call("too_early")
    child.call("start", "mixed")
    assert child.call("our_node") == ["/mixed", "RospyNode"]
    yield child
    child.end()


def test_theirs_to_ours(ours: RospyChild, rospy_child: RospyChild) -> None:
    rospy_child.call("advertise", "/a", TF, False, 100)
    ours.call("our_listen", "/a", TF)
    assert rospy_child.call("joined", "/a", 1, SECONDS)
    rospy_child.call("send", "/a", MOVES)
    assert ours.call("heard", "ours /a", len(MOVES), SECONDS) == [MOVES, ["/theirs"] * len(MOVES)]


def test_ours_to_theirs(ours: RospyChild, rospy_child: RospyChild) -> None:
    ours.call("our_advertise", "/b", TF, False)
    rospy_child.call("listen", "/b", TF)
    until(lambda: ours.call("our_subscribers", "/b") == ["/theirs"], "a subscriber")
    ours.call("our_send", "/b", MOVES)
    assert rospy_child.call("heard", "/b", len(MOVES), SECONDS)[0] == MOVES
    ours.call("our_advertise", "/b2", TF, True)
    ours.call("our_send", "/b2", MOVES)
    rospy_child.call("listen", "/b2", TF)
    assert rospy_child.call("heard", "/b2", 1, SECONDS)[0] == MOVES[-1:]


@pytest.mark.parametrize("theirs_first", [True, False])
def test_a_topic_that_the_program_listens_to_as_well(
    ours: RospyChild, rospy_child: RospyChild, *, theirs_first: bool
) -> None:
    topic = f"/shared_{theirs_first}".lower()
    steps = [("their_view", topic, TF), ("our_listen", topic, TF)]
    for step in steps if theirs_first else steps[::-1]:
        ours.call(*step)
    rospy_child.call("advertise", topic, TF, True, 10)
    rospy_child.call("send", topic, MOVES[1:2])
    assert ours.call("heard", f"ours {topic}", 1, SECONDS)[0] == MOVES[1:2]
    before, is_theirs, child, changed, copied = ours.call("what_they_saw", topic, TF, SECONDS)
    assert before == copied == MOVES[1]
    assert is_theirs
    assert child == "base"
    assert bytes.fromhex(changed) == bytes.fromhex(MOVES[1]).replace(
        b"\x04\0\0\0base", b"\x07\0\0\0changed"
    )


def test_services_and_types_that_are_not_known(ours: RospyChild, rospy_child: RospyChild) -> None:
    ours.call("our_service", "~tf2_frames", "base:\n  parent: map")
    answer = rospy_child.call("ask", "/mixed/tf2_frames", "tf2_msgs/FrameGraph")
    assert answer == ["ok", "base:\n  parent: map"]
    word, text = ours.call("error_of", "our_advertise", "/c", "none_msgs/None", False)
    assert word == "InvalidArgument"
    assert "none_msgs/None" in text


@pytest.mark.parametrize("whose", ["oo", "to", "ot"])
def test_the_first_buffer_of_a_node_offers_its_tree(
    rospy_child: RospyChild, new_our_child: Callable[[str], RospyChild], whose: str
) -> None:
    child = new_our_child(f"buffers_{whose}")
    assert child.call("buffers", whose) == [True, False]
    word, tree = rospy_child.call("ask", f"/buffers_{whose}/tf2_frames", "tf2_msgs/FrameGraph")
    assert word == "ok"
    assert f"{whose[0]}1" in tree
    assert f"{whose[1]}2" not in tree


def test_a_type_that_is_not_installed_is_received(
    ours: RospyChild, rospy_child: RospyChild
) -> None:
    rospy_child.call("advertise", "/d", TF, True, 1)
    rospy_child.call("send", "/d", MOVES[:1])
    ours.call("our_listen", "/d", "none_msgs/None")
    assert ours.call("heard", "ours /d", 1, SECONDS)[0] == MOVES[:1]


def test_simulated_time_and_the_end(
    rospy_child: RospyChild, new_our_child: Callable[[str], RospyChild]
) -> None:
    rospy_child.call("advertise", "/clock", "rosgraph_msgs/Clock", True, 1)
    rospy_child.call("set_parameter", "/use_sim_time", True)
    try:
        child = new_our_child("simulated_rospy")
        child.call("our_node")
    finally:
        rospy_child.call("delete_parameter", "/use_sim_time")
    assert child.call("our_clock") == [True, 0]
    for count, now in enumerate([5_000_000_007, 3_000_000_000], 1):
        rospy_child.call("send", "/clock", [clock(now).hex()])
        times, now_there = child.call("our_times", count, SECONDS)
        assert (times[-1], now_there) == (now, now)
    rospy_child.call("withdraw", "/clock")
    assert child.call("our_end") == ["the node /simulated_rospy is closed", True, 3]


@pytest.fixture
def new_our_child(master_uri: str) -> Iterator[Callable[[str], RospyChild]]:
    """Starts programs like `ours` that end with the test."""
    made = []

    def make(name: str) -> RospyChild:
        made.append(RospyChild(master_uri, name, sys.executable, SCRIPT))
        return made[-1]

    yield make
    for child in made:
        child.end()
