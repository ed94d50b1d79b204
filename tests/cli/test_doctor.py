"""The doctor finds each fault that is planted, and nothing in healthy data."""

from __future__ import annotations

import numpy as np
import pytest

from tfdb.cli.doctor import KINDS, Finding, Limits, Log, disconnected, examine

MS = 1_000_000
S = 1_000_000_000
START = 1000 * S
STILL = np.array([0.0, 0, 0, 0, 0, 0, 1])


def pose(x: float, w: float = 1.0) -> np.ndarray:
    return np.array([x, 0, 0, 0, 0, 0, w])


def healthy() -> Log:
    """Ten seconds of two edges at 10 Hz from one publisher each, and a static one."""
    log = Log()
    log.add([("base", "lidar", START, STILL)], arrival=START, publisher="/urdf", static=True)
    for i in range(100):
        add(log, i)
    return log


def add(
    log: Log,
    i: int,
    *,
    parent: str = "odom",
    child: str = "base",
    publisher: str = "/ekf",
    shift: int = 0,
    late: int = 0,
    at: np.ndarray | None = None,
) -> None:
    stamp = START + i * 100 * MS
    moved = pose(0.1 * i) if at is None else at
    rows = [(parent, child, stamp + shift, moved)]
    log.add(rows, arrival=stamp + 5 * MS + late, publisher=publisher, static=False)


def only(log: Log, kind: str, limits: Limits = Limits()) -> Finding:  # noqa: B008
    found = examine(log, limits)
    assert [finding.kind for finding in found] == [kind]
    return found[0]


def test_healthy_data_has_no_findings() -> None:
    assert examine(healthy()) == []


def test_nothing_at_all_has_no_findings() -> None:
    assert examine(Log()) == []


def test_gap() -> None:
    log = Log()
    for i in [*range(50), *range(70, 100)]:
        add(log, i)
    found = only(log, "gap")
    assert found.frames == ("base",)
    assert found.stamp == START + 49 * 100 * MS
    assert found.details["longest_ns"] == 2100 * MS
    assert found.details["period_ns"] == 100 * MS
    assert examine(log, Limits(gap=3 * S)) == []


def test_late() -> None:
    log = Log()
    order = [*range(50), 52, 50, 51, *range(53, 100)]
    for arrival, i in enumerate(order):
        add(log, i, late=(arrival - i) * 100 * MS)
    found = only(log, "late")
    assert found.count == 2
    assert found.details["worst_ns"] == 200 * MS


def test_two_publishers() -> None:
    log = healthy()
    for i in range(0, 100, 10):
        add(log, i, shift=50 * MS, late=50 * MS, publisher="/amcl", at=pose(0.1 * i + 0.05))
    kinds = {finding.kind for finding in examine(log)}
    assert "two-publishers" in kinds
    found = next(f for f in examine(log) if f.kind == "two-publishers")
    assert found.details["publishers"] == ["/ekf", "/amcl"]
    assert "/amcl (10)" in found.message


def test_unknown_publishers_are_not_counted() -> None:
    log = Log()
    for i in range(20):
        add(log, i, publisher="")
    assert examine(log) == []


def test_clock_that_jumps_back_is_one_finding_for_all_edges() -> None:
    log = Log()
    for i in range(60):
        shift = -4 * S if i >= 30 else 0
        for child in ("base", "arm"):
            add(log, i, child=child, shift=shift)
    found = only(log, "time-jump")
    assert found.frames == ("arm", "base")
    assert found.details["to_ns"] - found.details["from_ns"] == -3900 * MS
    assert "-3.9 s" in found.message


def test_jump_below_the_limit_is_late_data() -> None:
    log = Log()
    for i in range(60):
        add(log, i, shift=-4 * S if i >= 30 else 0)
    kinds = {finding.kind for finding in examine(log, Limits(jump=10 * S))}
    assert "time-jump" not in kinds
    assert "late" in kinds


@pytest.mark.parametrize("lost", [0, 20])
def test_stalled_delivery_is_no_jump(lost: int) -> None:
    """Five seconds in which nothing arrives, then all at once, or all but the oldest of it."""
    log = Log()
    for i in range(200):
        arrival = START + i * 100 * MS
        if 50 <= i < 100:
            arrival = START + 100 * 100 * MS + i  # kept back, then one after the other
        if not 50 <= i < 50 + lost:
            rows = [("odom", "base", START + i * 100 * MS, pose(i))]
            log.add(rows, arrival=arrival, publisher="", static=False)
    assert [finding.kind for finding in examine(log)] == (["gap"] if lost else [])


def test_a_clock_that_is_set_forth() -> None:
    log = Log()
    for i in range(60):
        add(log, i, shift=7 * S if i >= 30 else 0)
    found = examine(log)
    assert [finding.kind for finding in found] == ["time-jump"]
    assert found[0].details["to_ns"] - found[0].details["from_ns"] == 7100 * MS


def test_a_clock_that_is_set_back_and_forth_again() -> None:
    log = Log()
    for i in range(90):
        add(log, i, shift=-4 * S if 30 <= i < 60 else 0)
    found = only(log, "time-jump")
    assert found.details["jumps"] == 2
    assert "jump 2 times, first from" in found.message


def test_late_samples_are_no_jumps() -> None:
    """A second publisher whose clock lags by two seconds."""
    log = healthy()
    for i in range(0, 100, 2):
        add(log, i, shift=-2 * S + 50 * MS, late=50 * MS)
    log = _by_arrival(log)
    assert {finding.kind for finding in examine(log)} == {"late"}


def _by_arrival(log: Log) -> Log:
    made = Log()
    (base,) = (edge for edge in log.edges() if edge.name == "base")
    for row in np.argsort(base.arrivals, kind="stable"):
        transform = ("odom", "base", int(base.stamps[row]), base.poses[row])
        arrival = int(base.arrivals[row])
        made.add([transform], arrival=arrival, publisher="", static=False)
    return made


def test_many_jumps_are_one_line_and_hide_nothing() -> None:
    """A bag that loops forty times, with a hole and a late sample in each round."""
    log = Log()
    arrival = START
    for _ in range(40):
        for i in [*range(20), 40, *range(39, 38, -1), *range(41, 60)]:
            arrival += 100 * MS
            rows = [("odom", child, START + i * 100 * MS, pose(i)) for child in ("base", "arm")]
            log.add(rows, arrival=arrival, publisher="", static=False)
    found = examine(log, Limits(jump=3 * S))
    assert [(finding.kind, finding.frames) for finding in found] == [
        ("time-jump", ("arm", "base")),
        ("late", ("arm",)),
        ("gap", ("arm",)),
        ("late", ("base",)),
        ("gap", ("base",)),
    ]
    assert found[0].details["jumps"] == 39
    assert {finding.count for finding in found[1:]} == {40}


def test_a_simulation_at_a_tenth_of_its_speed_is_no_jump() -> None:
    log = Log()
    for i in range(60):  # one sample a second, which takes ten
        rows = [("odom", "base", START + i * S, pose(i))]
        log.add(rows, arrival=START + i * 10 * S, publisher="", static=False)
    assert examine(log) == []


def test_slow_simulation_is_no_jump() -> None:
    log = Log()
    for i in range(60):  # arrives ten times slower than its stamps say
        rows = [("odom", "base", START + i * 100 * MS, pose(i))]
        log.add(rows, arrival=START + i * 1000 * MS, publisher="", static=False)
    assert examine(log) == []


def test_reparented() -> None:
    log = Log()
    for i in range(100):
        add(log, i, parent="odom" if i < 60 else "map")
    found = only(log, "reparented")
    assert found.count == 1
    assert found.stamp == START + 6 * S
    assert found.details["parents"] == ["odom", "map"]


def test_repeated_stamp_with_another_pose() -> None:
    log = healthy()
    add(log, 99, at=pose(77.0))
    found = only(log, "repeated")
    assert found.stamp == START + 9900 * MS
    same = healthy()
    add(same, 99)
    assert examine(same) == []


@pytest.mark.parametrize(("w", "bad"), [(1.0, False), (1.00001, False), (1.001, True), (0.0, True)])
def test_quaternion(w: float, bad: bool) -> None:
    log = healthy()
    add(log, 100, at=pose(10.0, w))
    assert [finding.kind for finding in examine(log)] == (["quaternion"] if bad else [])


def test_nan_quaternion_is_found() -> None:
    log = healthy()
    add(log, 100, at=pose(10.0, float("nan")))
    found = only(log, "quaternion")
    assert "inf" in found.message


def test_static_and_moving() -> None:
    log = healthy()
    rows = [("odom", "base", START, STILL)]
    log.add(rows, arrival=START, publisher="/ekf", static=True)
    found = only(log, "static-and-moving")
    assert found.count == 1


def test_static_revised() -> None:
    log = healthy()
    for x in (0.0, 0.0, 1.0):
        rows = [("base", "lidar", START, pose(x))]
        log.add(rows, arrival=START + S, publisher="/urdf", static=True)
    found = only(log, "static-revised")
    assert found.count == 1


def test_coverage() -> None:
    log = healthy()
    for i in range(40, 70):
        add(log, i, child="arm")
    found = only(log, "coverage")
    assert found.frames == ("arm",)
    assert "starts 4 s after" in found.message
    assert "stops 3 s before" in found.message
    assert examine(log, Limits(coverage=10 * S)) == []


def test_disconnected() -> None:
    assert disconnected([("map", 12)]) == []
    (found,) = disconnected([("map", 12), ("cart", 1)])
    assert found.frames == ("map", "cart")
    assert "map (12 frames), cart (1 frame)" in found.message


def test_every_kind_has_a_severity() -> None:
    assert {severity for severity, _ in KINDS.values()} == {"error", "warning"}
