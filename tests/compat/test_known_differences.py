"""Intended differences from tf2, tested on both sides."""

from __future__ import annotations

import numpy as np
import pytest

import tfdb
from compat.tf2_oracle import Tf2Oracle, set_line

SECOND = 1_000_000_000
TURNED = np.array([1.0, 2.0, 3.0, 0.0, 0.6, 0.0, 0.8])
MOVED = np.array([5.0, 2.0, 3.0, 0.0, 0.6, 0.0, 0.8])


def store(buffer: tfdb.Buffer, parent: str, child: str, stamp: int, pose: np.ndarray) -> None:
    buffer.set_transform(parent, child, stamp, pose[:3], pose[3:])


def test_unknown_frame_against_itself(tf2: Tf2Oracle) -> None:
    """tf2: identity, no check at all. tfdb: UnknownFrame."""
    assert tf2.run(["get nowhere nowhere 5"])[0].word == "pose"
    with pytest.raises(tfdb.UnknownFrame):
        tfdb.Buffer().lookup_transform("nowhere", "nowhere", 5)


def test_same_stamp_again(tf2: Tf2Oracle) -> None:
    """tf2 keeps the first value and refuses the second. tfdb: the newer commit wins."""
    first = set_line("a", "b", SECOND, TURNED, static=False)
    second = set_line("a", "b", SECOND, MOVED, static=False)
    answers = tf2.run([first, second, f"get a b {SECOND}"])
    assert [answer.word for answer in answers] == ["ok", "refused", "pose"]
    assert answers[2].pose is not None
    assert answers[2].pose[0] == TURNED[0]

    buffer = tfdb.Buffer()
    store(buffer, "a", "b", SECOND, TURNED)
    with buffer.snapshot() as before:
        store(buffer, "a", "b", SECOND, MOVED)
        assert before.lookup_transform("a", "b", SECOND).translation[0] == TURNED[0]
    assert buffer.lookup_transform("a", "b", SECOND).translation[0] == MOVED[0]


def test_stamp_zero(tf2: Tf2Oracle) -> None:
    """tf2: 0 means latest, so what is stored at 0 cannot be asked for. tfdb: 0 is a stamp."""
    script = [set_line("a", "b", 0, TURNED, static=False)]
    script += [set_line("a", "b", SECOND, MOVED, static=False), "get a b 0"]
    answer = tf2.run(script)[2]
    assert answer.pose is not None
    assert answer.pose[0] == MOVED[0]

    buffer = tfdb.Buffer()
    store(buffer, "a", "b", 0, TURNED)
    store(buffer, "a", "b", SECOND, MOVED)
    assert buffer.lookup_transform("a", "b", 0).translation[0] == TURNED[0]


def test_loops(tf2: Tf2Oracle) -> None:
    """tf2 stores a loop without a word. tfdb: CycleError, and nothing is stored."""
    script = [set_line("a", "b", SECOND, TURNED, static=False)]
    script += [set_line("b", "a", SECOND, TURNED, static=False)]
    assert [answer.word for answer in tf2.run(script)] == ["ok", "ok"]

    buffer = tfdb.Buffer()
    store(buffer, "a", "b", SECOND, TURNED)
    commit = buffer.commit
    with pytest.raises(tfdb.errors.CycleError):
        store(buffer, "b", "a", SECOND, TURNED)
    assert buffer.commit == commit


def test_static_and_moving_mixed(tf2: Tf2Oracle) -> None:
    """tf2: a moving write silently overwrites the static value. tfdb: StaticConflict."""
    script = [set_line("a", "b", SECOND, TURNED, static=True)]
    script += [set_line("a", "b", 2 * SECOND, MOVED, static=False), f"get a b {50 * SECOND}"]
    answer = tf2.run(script)[2]
    assert answer.pose is not None
    assert answer.pose[0] == MOVED[0]

    buffer = tfdb.Buffer()
    buffer.set_static_transform("a", "b", TURNED[:3], TURNED[3:])
    with pytest.raises(tfdb.errors.StaticConflict):
        store(buffer, "a", "b", 2 * SECOND, MOVED)


def test_two_trees_and_no_data(tf2: Tf2Oracle) -> None:
    """tf2 says extrapolation as soon as one walk ends early. tfdb says what is the matter."""
    script = [
        set_line("a", "b", SECOND, TURNED, static=False),
        set_line("c", "d", SECOND, TURNED, static=False),
        f"get b d {3 * SECOND}",
    ]
    assert tf2.run(script)[2].word == "extrapolation"

    buffer = tfdb.Buffer()
    store(buffer, "a", "b", SECOND, TURNED)
    store(buffer, "c", "d", SECOND, TURNED)
    with pytest.raises(tfdb.Disconnected):
        buffer.lookup_transform("b", "d", 3 * SECOND)


def test_parent_outside_of_the_data(tf2: Tf2Oracle) -> None:
    """tf2 knows no parent before the first sample or after the last. tfdb: the nearest sample's."""
    script = [set_line("a", "c", 5 * SECOND, TURNED, static=False)]
    script += [set_line("b", "c", 7 * SECOND, MOVED, static=False)]
    stamps = [4 * SECOND, 5 * SECOND, 7 * SECOND - 1, 7 * SECOND, 8 * SECOND]
    answers = tf2.run([*script, *(f"parent c {stamp}" for stamp in stamps), "parent nowhere 5"])
    assert [answer.text for answer in answers[2:]] == ["", "a", "a", "b", "", ""]
    assert [answer.word for answer in answers if not answer.text] == ["ok", "ok", *3 * ["none"]]

    buffer = tfdb.Buffer()
    store(buffer, "a", "c", 5 * SECOND, TURNED)
    store(buffer, "b", "c", 7 * SECOND, MOVED)
    assert [buffer.parent_of("c", stamp) for stamp in stamps] == ["a", "a", "a", "b", "b"]
    with pytest.raises(tfdb.UnknownFrame):
        buffer.parent_of("nowhere", 5)


def test_infinity(tf2: Tf2Oracle) -> None:
    """tf2 accepts infinite translations. tfdb: InvalidTransform."""
    infinite = TURNED.copy()
    infinite[0] = np.inf
    assert tf2.run([set_line("a", "b", SECOND, infinite, static=False)])[0].word == "ok"
    with pytest.raises(tfdb.errors.InvalidTransform):
        store(tfdb.Buffer(), "a", "b", SECOND, infinite)


def test_nearly_unit_quaternions(tf2: Tf2Oracle) -> None:
    """tf2 gives back 1.004 as it came. tfdb normalises what it accepts."""
    long = TURNED.copy()
    long[3:] *= 1.004
    answer = tf2.run([set_line("a", "b", SECOND, long, static=False), f"get a b {SECOND}"])[1]
    assert answer.pose is not None
    assert np.linalg.norm(answer.pose[3:]) > 1.003

    buffer = tfdb.Buffer()
    store(buffer, "a", "b", SECOND, long)
    rotation = buffer.lookup_transform("a", "b", SECOND).rotation
    assert np.linalg.norm(rotation) == pytest.approx(1.0, abs=1e-15)


def test_chain_deeper_than_a_thousand(tf2: Tf2Oracle) -> None:
    """tf2 takes a chain of 1,001 edges for a loop. tfdb has no such limit."""
    script = [set_line(f"f{i}", f"f{i + 1}", SECOND, TURNED, static=False) for i in range(1001)]
    answer = tf2.run([*script, f"get f0 f1001 {SECOND}"])[-1]
    assert answer.word == "lookup"
    assert "loop" in answer.text

    buffer = tfdb.Buffer()
    for i in range(1001):
        store(buffer, f"f{i}", f"f{i + 1}", SECOND, TURNED)
    assert buffer.lookup_transform("f0", "f1001", SECOND).stamp == SECOND
