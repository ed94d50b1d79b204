"""`tfdb check` finds each planted fault, and none in good data."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from tests.cli.growing_log import GrowingLog as Log

from tfdb.judging.doctor import KINDS, Finding, Limits, disconnected, examine
from tfdb.recordings import Recording

if TYPE_CHECKING:
    from pathlib import Path

    from conftest import Tool

MS = 1_000_000
S = 1_000_000_000
START = 1000 * S
STILL = np.array([0.0, 0, 0, 0, 0, 0, 1])


def pose(x: float, w: float = 1.0) -> np.ndarray:
    return np.array([x, 0, 0, 0, 0, 0, w])


def healthy() -> Log:
    """Make ten seconds of two edges at 10 Hz, with one publisher each, and of a static edge."""
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


def test_stamps_ahead_of_their_arrival() -> None:
    log = healthy()
    for i in range(100):
        add(log, i, parent="map", child="odom", shift=S)
    found = only(log, "ahead", Limits(coverage=10 * S))
    assert (found.frames, found.count) == (("odom",), 100)
    assert found.details == {"usual_ns": 995 * MS}
    assert found.severity == "warning"


@pytest.mark.parametrize("shift", [105 * MS, 5 * MS - 3000 * 86400 * S, 5 * MS + 400 * 86400 * S])
def test_stamps_that_are_late_or_of_another_clock_are_not_ahead(shift: int) -> None:
    log = Log()
    for i in range(100):
        add(log, i, shift=shift + 4000 * 86400 * S, late=4000 * 86400 * S)
    assert examine(log) == []


def test_a_few_stamps_ahead_are_no_habit() -> None:
    log = Log()
    for i in range(100):
        add(log, i, shift=300 * MS if i % 3 == 0 else 0, late=300 * MS)
    assert "ahead" not in {found.kind for found in examine(log)}


def moving(poses: np.ndarray, step: int = 20 * MS, parent: str = "odom") -> Log:
    """Make an edge with these poses, evenly spaced in time."""
    log = Log()
    for i, each in enumerate(poses):
        stamp = START + i * step
        rows = [(parent, "base", stamp, each)]
        log.add(rows, arrival=stamp + MS, publisher="", static=False)
    return log


def kinds(poses: np.ndarray, step: int = 20 * MS) -> list[str]:
    return [found.kind for found in examine(moving(poses, step))]


def walk(count: int, speed: float, step: float = 0.02) -> np.ndarray:
    """Make poses that move along x and rotate slowly."""
    poses = np.zeros((count, 7))
    poses[:, 0] = np.arange(count) * speed * step
    poses[:, 5] = np.sin(np.arange(count) * 0.001)
    poses[:, 6] = np.cos(np.arange(count) * 0.001)
    return poses


def turned(poses: np.ndarray, degrees: float) -> np.ndarray:
    """Rotate poses about x."""
    half = np.radians(degrees) / 2
    made = poses.copy()
    z, w = poses[:, 5], poses[:, 6]
    made[:, 3], made[:, 4] = w * np.sin(half), z * np.sin(half)
    made[:, 5], made[:, 6] = z * np.cos(half), w * np.cos(half)
    return made


@pytest.mark.parametrize("speed", [0.0, 1.0, 90.0])
def test_a_pose_that_jumps(speed: float) -> None:
    poses = walk(100, speed)
    poses[60:, 1] += 1000
    found = only(moving(poses), "pose-jump")
    assert (found.count, found.stamp) == (1, START + 59 * 20 * MS)
    assert found.details["furthest_m"] == pytest.approx(1000, abs=2)
    assert (found.details["from_ns"], found.details["to_ns"]) == (
        START + 59 * 20 * MS,
        START + 60 * 20 * MS,
    )
    poses[61:, 1] -= 1000
    assert only(moving(poses), "pose-jump").count == 2


def test_a_jump_of_a_late_sample_is_found_by_its_stamp() -> None:
    poses = walk(100, 1)
    poses[60:, 1] += 1000
    log = Log()
    for i in [*range(58), 61, 58, 59, 60, *range(62, 100)]:
        rows = [("odom", "base", START + i * 20 * MS, poses[i])]
        log.add(rows, arrival=START + max(i, 61) * 20 * MS, publisher="", static=False)
    assert [f.kind for f in examine(log)].count("pose-jump") == 1
    (found,) = (f for f in examine(log) if f.kind == "pose-jump")
    assert found.count == 1


@pytest.mark.parametrize(
    "poses",
    [
        walk(200, 2000),
        np.concatenate([walk(100, 1), walk(100, 1) + np.eye(7)[0] * 5]),
        np.repeat(walk(50, 1), 4, axis=0),
    ],
    ids=["rocket", "correction", "standing"],
)
def test_fast_motion_and_corrections_are_not_jumps(poses: np.ndarray) -> None:
    assert kinds(poses) == []


def test_another_parent_is_not_a_jump() -> None:
    log = moving(walk(50, 1))
    for i in range(50, 100):
        rows = [("map", "base", START + i * 20 * MS, pose(5000 + 0.02 * i))]
        log.add(rows, arrival=START + i * 20 * MS + MS, publisher="", static=False)
    assert [found.kind for found in examine(log)] == ["reparented"]


@pytest.mark.parametrize("pattern", ["AB", "AAAAAB", "AB" * 10 + "A" * 40])
@pytest.mark.parametrize("off", [(3.0, 0), (0.2, 0), (0, 20.0)], ids=["3 m", "0.2 m", "20 deg"])
def test_two_publishers_in_turns(pattern: str, off: tuple[float, float]) -> None:
    poses = walk(600, 0.2)
    second = turned(poses, off[1])
    second[:, 1] += off[0]
    who = np.array(list(pattern * 600))[:600] == "B"
    poses[who] = second[who]
    found = only(moving(poses), "there-and-back")
    assert found.frames == ("base",)
    assert found.count >= who.sum() * 0.9
    assert (f"{off[0]:.3g} m" if off[0] else "20 deg") in found.message


def test_two_publishers_of_one_stamp_and_pose_are_none() -> None:
    assert kinds(np.repeat(walk(200, 1), 2, axis=0), 10 * MS) == []


@pytest.mark.parametrize("scale", [0.001, 0.2, 5.0])
@pytest.mark.parametrize("axes", [1, 2, 3])
def test_noise_does_not_jump_there_and_back(scale: float, axes: int) -> None:
    rng = np.random.default_rng(5)
    poses = walk(5000, 0.5)
    poses[:, :axes] += rng.normal(scale=scale, size=(5000, axes))
    angles = rng.normal(scale=0.3, size=5000) / 2
    poses[:, 5], poses[:, 6] = np.sin(angles), np.cos(angles)
    assert kinds(poses, 100 * MS) == []


@pytest.mark.parametrize("turns", [0.02, 0.24, 0.49, 0.5, 0.51, 0.98])
def test_a_wheel_does_not_jump_there_and_back(turns: float) -> None:
    angles = np.cumsum(np.full(2000, 2 * np.pi * turns)) / 2
    poses = np.zeros((2000, 7))
    poses[:, 4], poses[:, 6] = np.sin(angles), np.cos(angles)
    assert kinds(poses) == []


def test_a_leg_that_swings_does_not_jump_there_and_back() -> None:
    poses = walk(3000, 1)
    for period in np.linspace(2.5, 30, 40):
        poses[:, 2] = 0.3 * np.sin(2 * np.pi * np.arange(3000) / period)
        assert kinds(poses, 50 * MS) == [], period


@pytest.mark.parametrize(("back", "found"), [(0.15, ["there-and-back"]), (0.5, [])])
def test_poses_that_return_by_half_do_not_jump_there_and_back(
    back: float, found: list[str]
) -> None:
    x = np.zeros(120)
    x[100::2] = 1 + back * np.arange(10)
    x[101::2] = back * np.arange(1, 11)
    assert kinds(np.array([pose(each) for each in x])) == found


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
def test_stalled_delivery_is_not_a_jump(lost: int) -> None:
    """After five seconds without arrivals, all messages arrive at once, or all but the oldest."""
    log = Log()
    for i in range(200):
        arrival = START + i * 100 * MS
        if 50 <= i < 100:
            arrival = START + 100 * 100 * MS + i  # delayed, then one after the other
        if not 50 <= i < 50 + lost:
            rows = [("odom", "base", START + i * 100 * MS, pose(i))]
            log.add(rows, arrival=arrival, publisher="", static=False)
    assert [finding.kind for finding in examine(log)] == (["gap"] if lost else [])


def test_stamps_that_run_backwards_jump() -> None:
    log = Log()
    for i in range(60):
        rows = [("odom", "base", 2 * START - i * 600 * MS, pose(0))]
        log.add(rows, arrival=2 * START + i * 600 * MS, publisher="", static=False)
    assert only(log, "time-jump").details["jumps"] == 59


def test_two_clocks_have_the_first_and_last_stamp_of_their_edges() -> None:
    log, years = Log(), 2 * 365 * 86400 * S
    for i in range(60):
        add(log, i, shift=years, late=years)
        add(log, i, parent="map", child="odom", shift=years + S, late=years + S)
        add(log, i, parent="base", child="arm", late=years)
        add(log, i, parent="arm", child="hand", shift=-S, late=years)
        add(log, i, parent="hand", child="tool", shift=S, late=years)
    clocks = [each for each in examine(log) if each.kind == "two-clocks"]
    assert [(each.frames, each.stamp, each.count) for each in clocks] == [
        (("base", "odom"), START + years, 2)
    ]
    assert "arm, hand, tool from 999 s to 1006.9 s" in clocks[0].message


def test_a_clock_that_is_set_forth() -> None:
    log = Log()
    for i in range(60):
        add(log, i, shift=7 * S if i >= 30 else 0)
    found = examine(log)
    assert [finding.kind for finding in found] == ["time-jump"]
    assert found[0].details["to_ns"] - found[0].details["from_ns"] == 7100 * MS


def test_a_jump_of_the_last_sample() -> None:
    log = Log()
    for i in range(60):
        add(log, i, shift=7 * S if i == 59 else 0)
    found = only(log, "time-jump", Limits(gap=20 * S))
    assert found.details == {
        "from_ns": START + 5800 * MS,
        "to_ns": START + 12_900 * MS,
        "arrival_ns": START + 5905 * MS,
        "jumps": 1,
    }
    assert found.message.endswith("(+7.1 s) while 100 ms passed")


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
    assert {finding.kind for finding in examine(log)} == {"late", "there-and-back"}


def _by_arrival(log: Log) -> Log:
    made = Log()
    (base,) = (edge for edge in log.edges() if edge.name == "base")
    for row in np.argsort(base.arrivals, kind="stable"):
        transform = ("odom", "base", int(base.stamps[row]), base.poses[row])
        arrival = int(base.arrivals[row])
        made.add([transform], arrival=arrival, publisher="", static=False)
    return made


def test_many_jumps_are_one_line_and_hide_nothing() -> None:
    """A bag loops forty times, with a gap and a late sample in each round."""
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


def test_a_simulation_at_a_tenth_of_its_speed_is_not_a_jump() -> None:
    log = Log()
    for i in range(60):  # one sample per second, received each ten seconds
        rows = [("odom", "base", START + i * S, pose(i))]
        log.add(rows, arrival=START + i * 10 * S, publisher="", static=False)
    assert examine(log) == []


def test_a_simulation_at_twenty_times_its_speed_is_not_a_jump() -> None:
    log = Log()
    for i in range(100):
        rows = [("odom", "base", START + i * 2 * S, pose(i))]
        arrival = 2 * START + i * 100 * MS
        log.add(rows, arrival=arrival, publisher="", static=False)
    assert examine(log) == []


def test_slow_simulation_is_not_a_jump() -> None:
    log = Log()
    for i in range(60):  # arrives ten times slower than its stamps
        rows = [("odom", "base", START + i * 100 * MS, pose(i))]
        log.add(rows, arrival=START + i * 1000 * MS, publisher="", static=False)
    assert examine(log) == []


def test_delayed_delivery_of_two_publishers_is_not_a_jump() -> None:
    """Stamps are a millisecond apart, arrivals a microsecond, with delays of up to 20 ms."""
    rng = np.random.default_rng(5)
    log = Log()
    for i, delay in enumerate(rng.integers(0, 20 * MS, 900).tolist()):
        for k in range(2):
            rows = [("odom", "base", START + i * 10 * MS + k * MS, pose(0.01 * i + 3 * k))]
            log.add(
                rows, arrival=START + i * 10 * MS + delay + k * 1000, publisher="", static=False
            )
    found = examine(_by_arrival(log))
    assert {finding.kind for finding in found} == {"there-and-back", "late", "gap"}


@pytest.mark.parametrize("pace", [1, 3])
@pytest.mark.parametrize("jump", [0, -2, 100])
def test_bursts_are_no_jump_and_hide_none(pace: int, jump: int) -> None:
    """The samples of one second arrive within 2 ms; the clock may jump in the middle."""
    log = Log()
    for i in range(2000):
        stamp = START + i * 10 * MS + (jump * S if i >= 1010 else 0)
        arrival = START + (i // 100 * S + i % 100 * MS // 50) // pace
        log.add(
            [("odom", "base", stamp, pose(0.01 * i))], arrival=arrival, publisher="", static=False
        )
    found = [finding for finding in examine(log) if finding.kind == "time-jump"]
    assert len(found) == (jump != 0)
    for each in found:
        assert (each.details["from_ns"], each.details["jumps"]) == (START + 1009 * 10 * MS, 1)


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


@pytest.mark.parametrize("command", [("check",), ("gaps",), ("monitor",)], ids=str)
def test_a_recording_is_read_once(
    tool: Tool, bag: Path, command: tuple[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    reads: list[Path] = []
    read = Recording.read

    def counted(self: Recording, *arguments: Any) -> Any:
        reads.append(self.path)
        return read(self, *arguments)

    monkeypatch.setattr(Recording, "read", counted)
    tool(*command, bag, "--json")
    assert reads == [bag]
