"""Expectations: their file, its faults with their lines, and the proposal."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tfdb
from tfdb.errors import ExpectationError, InvalidArgument
from tfdb.judging.arrivals import Arrivals
from tfdb.judging.doctor import Log
from tfdb.judging.expectations import (
    AuthorityExpectation,
    Expectation,
    Expectations,
    edge_limits,
    limits_of_authority,
)
from tfdb.judging.judge import Judge, Rows
from tfdb.judging.proposing import (
    broken_expectations,
    judge_recording,
    propose,
    propose_for,
    recorded_arrivals,
    rows_of,
    span_of,
)

DATA = Path(__file__).resolve().parents[2] / "examples" / "data"
TEXT = """\
version = 1
clock = "stamps"                 # or "arrival"
[default]
deadline = 0.5
[[edge]]
parent = "odom"
child = "base"
deadline = "50ms"
max_turn = "90 deg"
authority = ["ekf", "wheels"]
severity = { deadline = "error" }
[[edge]]
parent = "*"
child = "wheel_*"
lifespan = "2 s"
max_speed = "36 km/h"
[[authority]]
name = "ekf"
liveliness = 1.0
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "expectations.toml"


def test_a_file_is_read(file: Path) -> None:
    file.write_text(TEXT)
    found = tfdb.Expectations.read(file)
    base = edge_limits(found)("odom", "base")
    assert (base.deadline, base.lifespan, base.max_turn) == (0.05, None, math.pi / 2)
    assert base.authority == ("ekf", "wheels")
    assert base.severity == {"deadline": "error"}
    wheel = edge_limits(found)("base", "wheel_left")
    assert (wheel.deadline, wheel.lifespan, wheel.max_speed) == (0.5, 2.0, 10.0)
    assert edge_limits(found)("base", "camera").deadline == 0.5
    alive = limits_of_authority(found, "ekf")
    assert alive is not None
    assert alive.liveliness == 1.0
    assert limits_of_authority(found, "wheels") is None


def test_a_written_file_is_read_back(file: Path) -> None:
    odd = 'a"b\\c é\u2028'
    made = Expectations(
        [Expectation(odd, "*", 0.1, 2.0, 3.0, (odd, "b"), 1.0, 2.0, 3.0, 4.0, {"late": "ok"})],
        [AuthorityExpectation(odd, 1e-9, {"liveliness": "warning"})],
        Expectation(deadline=1e8),
        "arrival",
    )
    made.write(file)
    assert Expectations.read(file) == made
    with pytest.raises(ExpectationError, match="exists already"):
        made.write(file)
    Expectations().write(file, overwrite=True)
    assert Expectations.read(file) == Expectations()


def test_an_exact_name_comes_before_a_pattern() -> None:
    made = Expectations(
        [
            Expectation("*", "base", deadline=1, lifespan=1),
            Expectation("odom", "base", deadline=2),
            Expectation("*", "*", max_step=3, lifespan=3),
        ],
        default=Expectation(max_step=4, max_late=4),
    )
    found = edge_limits(made)("odom", "base")
    limits = (found.deadline, found.lifespan, found.max_step, found.max_late)
    assert limits == (2, 1, 3, 4)
    names = [AuthorityExpectation("*", 1.0), AuthorityExpectation("ekf", 0.2)]
    found = limits_of_authority(Expectations((), names), "ekf")
    assert found == AuthorityExpectation("ekf", 0.2)
    assert edge_limits(Expectations([Expectation("a.c", "[x]", 1)]))("abc", "x").deadline is None


FAULTS = [
    ("deadline = 0.5", "dedline = 0.5", 4, "'dedline' is not one of .* did you mean 'deadline'"),
    ("version = 1", "version = 2", 1, "version is 2; this tfdb reads version 1"),
    ("version = 1", "# none", 1, "version is missing; write version = 1"),
    ("version = 1", "verion = 1\nversion = 1", 1, "did you mean 'version'"),
    ('clock = "stamps"', 'clock = "stamp"', 2, "did you mean 'stamps'"),
    ("[default]", "[defaults]", 3, "did you mean 'default'"),
    ("deadline = 0.5", "deadline = 0", 4, "must be positive"),
    ("deadline = 0.5", "deadline = -1", 4, "must be positive"),
    ("deadline = 0.5", "deadline = nan", 4, "must be positive"),
    ("deadline = 0.5", "deadline = inf", 4, "must be positive and below 1e9"),
    ("deadline = 0.5", "deadline = true", 4, "give a number or text"),
    ("deadline = 0.5", "deadline = 1e-12", 4, "the shortest is 1 ns"),
    ("deadline = 0.5", "deadline = 0.5\ndeadline = 0.6", 5, "give TOML"),
    ("deadline = 0.5", "deadline =", 4, "give TOML"),
    ("deadline = 0.5", 'parent = "map"', 4, "'parent' is not one of"),
    ('"50ms"', '"50 parsec"', 8, "one of the units s, ms, us, ns, min"),
    ('"50ms"', '"ms"', 8, "one of the units"),
    ('"50ms"', '"1e400s"', 8, "must be positive and below 1e9"),
    ('"90 deg"', '"90 s"', 9, "one of the units rad, deg"),
    ('["ekf", "wheels"]', '["ekf", "ekf"]', 10, "'ekf' twice"),
    ('["ekf", "wheels"]', "[3]", 10, "give a name"),
    ('["ekf", "wheels"]', "3", 10, "give a name, or a list of names"),
    ('deadline = "error"', 'dedline = "error"', 11, "did you mean 'deadline'"),
    ('deadline = "error"', 'deadline = "fatal"', 11, "severity must be 'ok'.* got 'fatal'"),
    ('{ deadline = "error" }', '"error"', 11, "give a table of kinds"),
    ('child = "wheel_*"\n', "", 12, "lacks child"),
    ('child = "wheel_*"', 'child = ""', 14, "give a name"),
    ('parent = "*"\nchild = "wheel_*"', 'parent = "odom"\nchild = "base"', 12, "combine them"),
    ('parent = "*"\nchild = "wheel_*"', 'parent = "map"\nchild = "base"', 12, "has one parent"),
    ("liveliness = 1.0", "", 17, "lacks liveliness"),
    (
        "liveliness = 1.0",
        'liveliness = 1.0\n[[authority]]\nname = "ekf"\nliveliness = 2',
        20,
        "combine them",
    ),
    ("[[authority]]", "[authority]", 17, r"write \[\[authority\]\]"),
    ("[default]", "[[default]]", 3, r"write \[default\]"),
    ("deadline = 0.5", "deadline = 1e9", 4, "must be positive and below 1e9"),
    ('parent = "odom"', 'parent = "base"', 6, "parent and child are both 'base'"),
    ('deadline = "error"', 'time-jump = "ok"', 5, "set its severity in the default"),
]


@pytest.mark.parametrize(("old", "new", "line", "reason"), FAULTS)
def test_a_fault_is_refused_with_its_line(
    file: Path, old: str, new: str, line: int, reason: str
) -> None:
    assert old in TEXT
    file.write_text(TEXT.replace(old, new, 1))
    with pytest.raises(ExpectationError, match=reason) as caught:
        Expectations.read(file)
    assert caught.value.line == line
    assert str(caught.value).startswith(f"{file}:{line}: ")


def test_a_file_that_is_missing_or_binary_is_refused(file: Path) -> None:
    with pytest.raises(ExpectationError, match="No such file"):
        Expectations.read(file)
    file.write_bytes(b"\xff")
    with pytest.raises(ExpectationError, match="UTF-8"):
        Expectations.read(file)


@pytest.mark.parametrize(
    "wrong", [{"parent": ""}, {"deadline": "x"}, {"max_step": [1]}, {"severity": {"late": "bad"}}]
)
def test_wrong_arguments_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(InvalidArgument):
        Expectation(**wrong)


@pytest.mark.parametrize("name", ["", 3])
def test_an_authority_without_a_name_is_refused(name: Any) -> None:
    with pytest.raises(InvalidArgument, match=r"name is .*; give a name") as caught:
        AuthorityExpectation(name, 1.0)
    assert caught.value.value == name


def test_objects_of_other_types_are_refused() -> None:
    with pytest.raises(TypeError, match="must contain only Expectation, got"):
        Expectations([AuthorityExpectation("a", 1)])  # type: ignore[list-item]
    with pytest.raises(TypeError, match="severity must map"):
        Expectation(severity=["late"])  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="authority must be a name or several, got None"):
        Expectation(authority=None)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="default must be an Expectation"):
        Expectations(default={"deadline": 1})  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["pr2.bag", "pr2.mcap"])
def test_a_recording_meets_its_proposal(name: str, file: Path) -> None:
    arrivals = recorded_arrivals([DATA / name])
    proposed = propose(DATA / name)
    assert judge_recording(arrivals, proposed) == []
    assert len(proposed.edges) == 84
    base = next(each for each in proposed.edges if each.child == "base_footprint")
    assert base.deadline == 0.042
    assert str(proposed) == str(Expectations(**vars(proposed)))
    # It does not meet half of each.
    tight = Expectation("*", base.child, base.deadline and base.deadline / 2, max_step=0.01)
    kinds = {event.kind for event in judge_recording(arrivals, Expectations([tight]))}
    assert kinds == {"deadline", "step"}


def test_a_proposal_is_twice_the_largest_value_rounded_up() -> None:
    judge = Judge(Expectations(), 0)
    seconds = np.array([100, 101, 102, 104, 105])
    poses = np.zeros((5, 7))
    poses[:, 0] = [0, 1, 1.25, 1.25, 9]  # the last sample is late, so no motion ends there
    angles = np.array([0, 0.75, 0.75, 0.75, 0])
    poses[:, 3], poses[:, 6] = np.sin(angles / 2), np.cos(angles / 2)
    rows = Rows(
        seconds * 10**9,
        judge.number_edges(["odom"] * 5, ["base"] * 5),
        judge.number_authorities(["ekf"] * 5),
        np.array([100_000, 101_000, 102_000, 104_000, 103_500]) * 10**6,
        poses,
        np.zeros(5, dtype=bool),
    )
    found = propose_for(Arrivals(Log.of_rows(rows, judge), publishers_known=True))
    assert found.clock == "stamps"
    assert list(found.edges) == [
        Expectation(
            "odom",
            "base",
            deadline=4.0,  # twice the percentile: 2 * 1.996 s
            lifespan=4.1,
            authority=["ekf"],
            max_step=2.1,
            max_speed=2.1,
            max_turn=1.6,
            max_late=1.1,
        )
    ]
    assert list(found.authorities) == [AuthorityExpectation("ekf", 4.0)]
    rows.stamps[:] -= 9 * 10**9
    assert propose_for(Arrivals(Log.of_rows(rows, judge), publishers_known=True)).clock == "stamps"
    # More than 10 s away: another clock. Ages count from the arrival of the newest stamp.
    rows.stamps[:] -= 2 * 10**9
    rows.authorities[:] = judge.number_authorities(["ekf", "ekf", "ekf", "wheels", "wheels"])
    found = propose_for(Arrivals(Log.of_rows(rows, judge), publishers_known=True))
    (edge,) = found.edges
    assert (found.clock, edge.lifespan, edge.authority) == ("arrival", 4.1, ())
    assert [each.name for each in found.authorities] == ["ekf", "wheels"]


def test_a_finding_has_the_worst_of_its_events() -> None:
    expected = Expectations([Expectation("odom", "base", deadline=0.5, authority="ekf")])
    judge = Judge(expected, 0)
    seconds = np.array([0, 3, 4, 5])
    rows = Rows(
        seconds * 10**9,
        judge.number_edges(["odom"] * 4, ["base"] * 4),
        judge.number_authorities(["ekf", "ekf", "ekf", "wheels"]),
        seconds * 10**9,
        np.array([[0.0, 0, 0, 0, 0, 0, 1]] * 4),
        np.zeros(4, dtype=bool),
    )
    events = judge.feed(rows) + judge.advance(7 * 10**9)
    silent, foreign = broken_expectations(events)
    text = "3 s (limit 500 ms) of odom -> base, 4 times, until the end"
    assert (silent.kind, silent.frames, silent.message) == ("deadline", ("base",), text)
    assert (silent.stamp, silent.count, silent.severity) == (500_000_000, 4, "warning")
    assert silent.details == {
        "parent": "odom",
        "authority": "",
        "value": 3.0,
        "limit": 0.5,
        "times_ns": [
            [begin * 10**9 + 500_000_000, end * 10**9] for begin, end in ((0, 3), (3, 4), (4, 5))
        ],
    }
    assert foreign.message.endswith(" of odom -> base by wheels, once")
    assert foreign.details["times_ns"] == [[5 * 10**9, 6 * 10**9]]


def test_a_cycle_that_a_store_refuses_has_not_arrived(tmp_path: Path) -> None:
    path = tmp_path / "a.bag"
    with tfdb.recordings.RecordingWriter(path) as writer:
        for second, names in enumerate([("a", "b"), ("b", "a"), ("a", "b")], 1):
            stamp = second * 10**9
            moved = tfdb.TransformStamped(*names, stamp, (1, 0, 0), (0, 0, 0, 1))
            data = tfdb.encode_tf_message([moved], writer.encoding)
            writer.write(data, stamp, topic="/tf", static=False, authority="/x")
    with pytest.warns(tfdb.TfdbWarning, match="CycleError"):
        (edge,) = recorded_arrivals([path]).log.edges()
    assert (edge.name, edge.stamps.tolist()) == ("b", [10**9, 3 * 10**9])


def test_a_recording_without_publishers_has_no_liveliness(tmp_path: Path) -> None:
    buf = tfdb.Buffer()
    with tfdb.Recorder(buf, tmp_path / "drive.mcap") as recorder:
        for second in range(5):
            buf.set_transform("odom", "base", second * 10**9, (0, 0, 0), authority="ekf")
            recorder.flush()
    expected = Expectations(authorities=[AuthorityExpectation("ekf", 1e-9)], clock="arrival")
    arrivals = recorded_arrivals([tmp_path / "drive.mcap"])
    assert judge_recording(arrivals, expected) == []
    named = dataclasses.replace(arrivals, publishers_known=True)
    assert [each.kind for each in judge_recording(named, expected)] == ["liveliness"]


def test_a_watched_store_is_judged_until_the_end_of_the_watch() -> None:
    arrivals = recorded_arrivals([DATA / "pr2.bag"])
    _, last = span_of(arrivals)
    watched = dataclasses.replace(arrivals, watched=(0, last + 5 * 10**9))
    expected = Expectations([Expectation("odom", "base_footprint", deadline=2)])
    assert judge_recording(arrivals, expected) == []
    (event,) = judge_recording(watched, expected)
    assert (event.kind, last < event.time - 10**9 <= last + 10**9) == ("deadline", True)


def test_an_edge_of_a_recording_without_motion_is_not_missing() -> None:
    log = Log()
    stamps, poses = np.array([1000 * 10**9]), np.array([[1.0, 0, 0, 0, 0, 0, 1]])
    log.add_edge("camera", stamps, poses, ["base"], publisher="urdf", static=True)
    (edge,) = log.edges()
    edge.arrivals[:] = 1000 * 10**9
    expected = Expectations([Expectation("base", "camera"), Expectation("base", "lidar")])
    assert judge_recording(Arrivals(log, publishers_known=True), expected) == []


def test_a_recording_fed_row_by_row_gives_the_same_events() -> None:
    arrivals = recorded_arrivals([DATA / "pr2.bag"])
    limits = {"deadline": 0.03, "lifespan": 0.03, "max_step": 0.01, "max_turn": 0.01}
    expected = Expectations(default=Expectation(**limits, liveliness=0.05))  # type: ignore[arg-type]
    whole = judge_recording(arrivals, expected)
    assert len(whole) > 200
    rows = rows_of(arrivals, Judge(expected, 0))
    judge, found = Judge(expected, int(rows.arrivals[0])), []
    rows = rows_of(arrivals, judge)
    for i in range(len(rows)):
        found += judge.feed(rows.at(slice(i, i + 1)))
    assert found == whole
