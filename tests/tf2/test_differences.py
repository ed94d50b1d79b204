"""Every difference from tf2 that is meant, on both sides; ROS 1's on the real tf2.

`tfdb.tf2.differences` says in words what is shown here.
"""

from __future__ import annotations

import logging
import math
import subprocess
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import pytest

from compat.tf2_oracle import unavailable
from tf2 import (
    real_tf2,
    test_exports,
    test_real_conversions,
    test_tf1,
    test_wrong_arguments,
)
from tf2.ours import Ours, Records, message
from tfdb import tf2
from tfdb.tf2.differences import DIFFERENCES

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

SECOND = 1_000_000_000
TODAY = 1_700_000_000_123_456_789
TURNED = [1.0, 2.0, 3.0, 0.0, 0.6, 0.0, 0.8]
LONG = [1.0, 2.0, 3.0, 0.0, 0.6 * 1.004, 0.0, 0.8 * 1.004]
Answer = tuple[str, Any]


def stored(parent: str, child: str, stamp: int, pose: list[float] = TURNED) -> list[Any]:
    """The operation that stores T[parent<-child]."""
    return ["set", False, parent, child, stamp, pose, "me"]


def norm(answer: Answer) -> float:
    """Length of a found quaternion."""
    return math.hypot(*answer[1][3][3:])


@dataclass(frozen=True)
class Case:
    """Operations, and what the last one answers on both sides."""

    operations: list[list[Any]]
    theirs: Callable[[Answer], bool]
    ours: Callable[[Answer], bool]


CASES = {
    "same_frame": Case(
        [["get", "zz", "zz", SECOND]],
        lambda answer: answer[0] == "ok",
        lambda answer: answer[0] == "LookupException",
    ),
    "loops": Case(
        [stored("a", "b", SECOND), stored("b", "a", SECOND)],
        lambda answer: answer == ("ok", ""),
        lambda answer: answer[1].startswith("TF_LOOP"),
    ),
    "infinite": Case(
        [stored("a", "b", SECOND, [math.inf, *TURNED[1:]])],
        lambda answer: answer == ("ok", ""),
        lambda answer: answer[1].startswith("TF_NAN_INPUT"),
    ),
    "quaternion": Case(
        [stored("a", "b", SECOND, LONG), ["get", "a", "b", SECOND]],
        lambda answer: norm(answer) > 1.003,
        lambda answer: abs(norm(answer) - 1) < 1e-15,
    ),
    "names": Case(
        [stored("a", "tab\t", SECOND)],
        lambda answer: answer == ("ok", ""),
        lambda answer: answer[1].startswith("TF_BAD_FRAME_ID"),
    ),
    "late_stamps": Case(
        [stored("a", "b", 2_400_000_000 * SECOND)],
        lambda answer: answer == ("ok", ""),
        lambda answer: answer[1].startswith("TF_BAD_STAMP"),
    ),
    "stamp_zero": Case(
        [stored("a", "b", 0), stored("b", "c", 0), stored("b", "c", SECOND), ["get", "a", "c", 0]],
        lambda answer: answer[0] == "ExtrapolationException",
        lambda answer: answer[0] == "ok" and answer[1][2] == 0,
    ),
    "refused_parent": Case(
        [stored("a", "b", 50 * SECOND), stored("zz", "b", SECOND), ["exists", "zz"]],
        lambda answer: answer == ("ok", True),
        lambda answer: answer == ("ok", False),
    ),
    "repeated_parent": Case(
        [stored("a", "b", SECOND), stored("zz", "b", SECOND), ["exists", "zz"]],
        lambda answer: answer == ("ok", True),
        lambda answer: answer == ("ok", False),
    ),
    "can_says_first": Case(
        [["can", "p", "q", SECOND]],
        lambda answer: answer[1][1].count("does not exist") == 2,
        lambda answer: answer[1][1].count("does not exist") == 1,
    ),
    "sign": Case(
        [
            stored("a", "b", SECOND, [1.0, 2.0, 3.0, 0.0, 0.0, -math.sin(1.6), math.cos(1.6)]),
            ["set", True, "a", "s", SECOND, [0.0] * 6 + [1.0], "me"],
            ["full", "s", SECOND, "b", SECOND, "a"],
        ],
        lambda answer: answer[1][3][6] > 0,
        lambda answer: answer[1][3][6] < 0,
    ),
    "can_says_why": Case(
        [stored("a", "b", SECOND), ["can", "a", "", SECOND]],
        lambda answer: answer == ("ok", [0, ""]),
        lambda answer: "source_frame in tf2 frame_ids cannot be empty" in answer[1][1],
    ),
    "latest_common_time": Case(
        [stored("a", "b", SECOND), stored("q", "r", SECOND), ["latest", "b", "r"]],
        lambda answer: answer[0] == "TransformException",
        lambda answer: answer[0] == "ConnectivityException",
    ),
    "chain": Case(
        [stored("a", "b", SECOND), ["chain", "zz", SECOND, "zz", SECOND, "zz"]],
        lambda answer: answer == ("ok", []),
        lambda answer: answer[0] == "LookupException",
    ),
    "listings": Case(
        [stored("par'ent", "b", SECOND), ["yaml"]],
        lambda answer: "parent: 'par'ent'\n" in answer[1],
        lambda answer: "parent: 'par''ent'\n" in answer[1],
    ),
    "nanoseconds": Case(
        [stored("a", "b", TODAY), ["get", "a", "b", TODAY]],
        lambda answer: 0 < abs(answer[1][2] - TODAY) < 240,
        lambda answer: answer[1][2] == TODAY,
    ),
    "cache_time": Case(
        [["new", -SECOND]],
        lambda answer: answer[0] == "ok",
        lambda answer: answer[0] == "InvalidArgumentException",
    ),
}
OF_ROS2 = {"same_stamp", "stamps", "pruning"}
OF_FUTURES = {"future_result", "future_before", "future_loop"}
"""Shown in tests/ros/in_ros2/future_cases.py and test_buffer.py."""
OF_CLOCKS = {"clock_back"}
CLOCK_BACK = """
import itertools, threading
import rospy, tf2_ros
from rospy import rostime

rostime.set_rostime_initialized(True)
rostime._set_rostime(rospy.Time(100))
ended = threading.Event()

def go_back():
    for step in itertools.count(1):
        if ended.is_set():
            return
        rostime._set_rostime(rospy.Time(100) - rospy.Duration(0, step))

threading.Thread(target=go_back).start()
try:
    tf2_ros.Buffer(debug=False).can_transform("map", "base", rospy.Time(1), rospy.Duration(5))
except rospy.ROSInterruptException as error:
    print(type(error).__name__)
finally:
    ended.set()
"""


@pytest.fixture(autouse=True)
def quiet() -> Iterator[None]:
    """Refusals are read by the tests; they are not printed."""
    logger = logging.getLogger("tfdb.tf2")
    logger.propagate = False
    yield
    logger.propagate = True


@pytest.fixture(scope="module")
def theirs() -> dict[str, Answer]:
    """What the real tf2 answers to the last operation of each case."""
    script: list[list[Any]] = []
    last = {}
    for name, case in CASES.items():
        script += [["new", 10 * SECOND], *case.operations]
        last[name] = len(script) - 1
    answers = real_tf2.run(script)
    return {name: answers[index] for name, index in last.items()}


@pytest.mark.parametrize("name", CASES)
def test_of_ros1(name: str, theirs: dict[str, Answer]) -> None:
    case, records = CASES[name], Records()
    logger = logging.getLogger("tfdb.tf2")
    logger.addHandler(records)
    try:
        ours = Ours("ros1", records)
        answers = [ours.answer(operation) for operation in case.operations]
    finally:
        logger.removeHandler(records)
    assert case.theirs(theirs[name]), theirs[name]
    assert case.ours(answers[-1]), answers[-1]


def test_no_longest_chain() -> None:
    """tf2 takes 1001 edges for a loop."""
    links = [stored(f"f{i}", f"f{i + 1}", SECOND) for i in range(1001)]
    script = [["new", 10 * SECOND], *links, ["get", "f0", "f1001", SECOND]]
    found = real_tf2.run(script)[-1]
    assert found[0] == "LookupException"
    assert found[1].startswith("The tf tree is invalid because it contains a loop.")
    ours = Ours("ros1", Records())
    assert [ours.answer(operation) for operation in script][-1][0] == "ok"


def test_of_ros2() -> None:
    """Its tf2 keeps all values of a stamp, negative stamps, and one write too long."""
    core = tf2.BufferCore(flavor="ros2")
    for pose in (TURNED, [7.0, *TURNED[1:]]):
        core.set_transform(message("a", "b", SECOND, pose), "me")
    for stamp in (0, SECOND):
        found = core.lookup_transform_core("a", "b", stamp)
        assert found.transform.translation.x == 7.0
    commit = core.buffer.commit
    core.set_transform(message("a", "b", -SECOND, TURNED), "me")
    assert core.buffer.commit == commit
    for stamp in (2 * SECOND, 30 * SECOND):
        core.set_transform(message("a", "b", stamp, TURNED), "me")
    assert core.can_transform_core("a", "b", 16 * SECOND)[0] == 0


def test_clock_back() -> None:
    """test_buffer.py shows that a wait of tfdb continues, or ends as at its timeout."""
    if real_tf2.missing():
        unavailable(f"no real tf2: {real_tf2.missing()}; apt-get install python3-tf2-ros")
    command = [real_tf2.PYTHON, "-c", CLOCK_BACK]
    done = subprocess.run(
        command, env=real_tf2.ENVIRONMENT, capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout == "ROSTimeMovedBackwardsException\n"


def test_every_listed_difference_is_shown() -> None:
    modules = (test_exports, test_real_conversions, test_tf1, test_wrong_arguments)
    shown = (module.SHOWN for module in modules)
    assert set(DIFFERENCES) == {*CASES, *OF_ROS2, *OF_FUTURES, *OF_CLOCKS}.union(*shown)
    for name, each in DIFFERENCES.items():
        assert all((each.tf2, each.ours, each.reason)), name
