"""Every read of a snapshot works in a transaction, own writes included."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import tfdb
from another_thread import in_another_thread
from oracle import quaternion

if TYPE_CHECKING:
    from collections.abc import Callable

ENGINES = ["snapshot", "giant", "2pl-no-wait", "2pl-wait-die", "2pl-wound-wait", "silo", "fine"]
NAMES = [f"f{i}" for i in range(8)]
POINTS = np.random.default_rng(3).uniform(-5, 5, (4, 3))
STAMPS = (None, 0, 5, 17, 30, 41, 60)


def turn(rng: random.Random) -> Any:
    return quaternion((rng.uniform(-1, 1), 1, rng.uniform(-1, 1)), rng.uniform(-3, 3))


def write(rng: random.Random, writes: Any) -> None:
    """Do one random thing; what is refused changes nothing."""
    parent, child = sorted(rng.sample(NAMES, 2))  # so no circle arises
    place = (rng.uniform(-2, 2), rng.uniform(-2, 2), 1)
    try:
        match rng.randrange(8):
            case 0:
                writes.set_static_transform(parent, child, place, turn(rng), authority="fixed")
            case 1:
                writes.remove_frames(child, recursive=rng.random() < 0.5)
            case _:
                stamp = rng.randrange(60)
                writes.set_transform(parent, child, stamp, place, turn(rng), authority="who")
    except tfdb.TfdbError:
        pass


def grown(seed: int, history: float | None, engine: str = "snapshot") -> tfdb.Buffer:
    rng = random.Random(seed)
    made: Any = tfdb.Buffer(history, concurrency=engine)  # type: ignore[arg-type]
    for _ in range(60):
        write(rng, made)
    return made


def told(ask: Callable[[], Any]) -> Any:
    """The answer in a form that compares; of an error its class and what it is about."""
    try:
        answer = ask()
    except tfdb.TfdbError as error:
        return type(error), error.frame, error.edge, error.stamp, error.index, error.reason
    if isinstance(answer, tfdb.Transform):
        return answer.pose.tolist(), answer.stamp, [str(edge) for edge in answer.report.edges]
    if isinstance(answer, tfdb.types.Twist):
        return answer.linear.tolist(), answer.angular.tolist()
    if isinstance(answer, tfdb.Trajectory):
        return answer.stamps.tolist(), repr(answer.poses.tolist())
    if isinstance(answer, tfdb.types.Explanation):
        return answer.ok, [(edge.child, edge.parent, edge.ok, edge.text) for edge in answer.edges]
    if isinstance(answer, np.ndarray):
        return repr(answer.tolist())  # NaN is like NaN
    if isinstance(answer, tuple):
        return [told(lambda part=part: part) for part in answer]
    if isinstance(answer, list):
        return [told(lambda part=part: part) for part in answer]
    return answer


def questions() -> dict[str, Callable[[Any], Any]]:
    """Calls of every read."""
    calls: dict[str, Callable[[Any], Any]] = {
        "frames": lambda r: r.frames(),
        "length": len,
        "true": bool,
    }
    for at in STAMPS:
        calls[f"tree {at}"] = lambda r, at=at: r.tree(at)
    for name in [*NAMES, "nowhere"]:
        calls |= {
            f"info {name}": lambda r, n=name: r.frame_info(n),
            f"samples {name}": lambda r, n=name: r.samples(n),
            f"in {name}": lambda r, n=name: (n in r, r.frame_exists(n)),
            f"children {name}": lambda r, n=name: (r.children(n), r.children(n, 17)),
            f"descendants {name}": lambda r, n=name: (r.descendants(n), r.descendants(n, 17)),
            f"parent {name}": lambda r, n=name: (r.parent_of(n), r.parent_of(n, 17)),
        }
    rng = random.Random(5)
    for _ in range(14):
        a, b = rng.choices([*NAMES, "nowhere"], k=2)
        frames = f"{a} {b}"
        calls |= {
            f"stamps {frames}": lambda r, a=a, b=b: r._path_stamps(a, b, None, None),
            f"trajectory {frames}": lambda r, a=a, b=b: r.trajectory(a, b),
            f"nan {frames}": lambda r, a=a, b=b: r.trajectory(a, b, 1e8, 0, 60, missing="nan"),
            f"times {frames}": lambda r, a=a, b=b: (
                r.latest_common_time(a, b),
                r.common_times(a, b),
            ),
            f"latest {frames}": lambda r, a=a, b=b: r.lookup_latest_transform(a, b),
            f"many {frames}": lambda r, a=a, b=b: r.lookup_transforms(a, b, [5, 17, 30]),
            f"full {frames}": lambda r, a=a, b=b: r.lookup_transform_full(a, 17, b, 30, NAMES[0]),
        }
        for at in STAMPS:
            calls |= {
                f"lookup {frames} {at}": lambda r, a=a, b=b, at=at: r.lookup_transform(a, b, at),
                f"can {frames} {at}": lambda r, a=a, b=b, at=at: r.can_transform(a, b, at),
                f"explain {frames} {at}": lambda r, a=a, b=b, at=at: r.explain(a, b, at),
                f"path {frames} {at}": lambda r, a=a, b=b, at=at: r.path(a, b, at),
                f"velocity {frames} {at}": lambda r, a=a, b=b, at=at: r.lookup_velocity(
                    a, b, at, 2e-8, point=(1, 2, 3), reference=NAMES[0]
                ),
                f"points {frames} {at}": lambda r, a=a, b=b, at=at: r.transform_points(
                    a, b, POINTS, at or 0, missing="nan"
                ),
            }
    return calls


QUESTIONS = questions()


def test_a_transaction_has_every_read_of_a_snapshot() -> None:
    reads = {name for name in dir(tfdb.Snapshot) if not name.startswith("_")}
    assert reads - set(dir(tfdb.Transaction)) == {
        "at",
        "close",
        "freeze",
        "state_bytes",
    }


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("history", [None, 3e-8])
@pytest.mark.parametrize("seed", range(3))
def test_buffer_snapshot_and_transaction_agree(
    seed: int, history: float | None, engine: str
) -> None:
    buffer = grown(seed, history, engine)
    with buffer.snapshot() as snapshot:
        for name, ask in QUESTIONS.items():
            expected = told(lambda ask=ask: ask(buffer))
            assert told(lambda ask=ask: ask(snapshot)) == expected, name
            with buffer.transaction() as tx:
                assert told(lambda ask=ask: ask(tx)) == expected, name


@pytest.mark.parametrize("engine", ["snapshot", "2pl-no-wait", "silo"])
@pytest.mark.parametrize("history", [None, 3e-8])
@pytest.mark.parametrize("seed", range(6))
def test_a_transaction_sees_the_state_that_it_commits(
    seed: int, history: float | None, engine: str
) -> None:
    buffer = grown(seed, history, engine)
    rng = random.Random(seed + 100)
    with buffer.transaction() as tx:
        for _ in range(12):
            write(rng, tx)
        seen = {name: told(lambda ask=ask: ask(tx)) for name, ask in QUESTIONS.items()}
    for name, ask in QUESTIONS.items():
        assert told(lambda ask=ask: ask(buffer)) == seen[name], name


def test_one_pose_by_every_road() -> None:
    buffer = tfdb.Buffer(history=None)
    for stamp in (10, 20):
        buffer.set_transform("f0", "f1", stamp, (stamp, 2, 3), (0, 0, 0.6, 0.8))
    with buffer.snapshot() as snapshot, buffer.transaction() as tx:
        one = snapshot.lookup_transform("f0", "f1", 17)
        for reads in (snapshot, tx):
            assert reads.lookup_transform("f0", "f1", 17) == one
            rows = reads.lookup_transforms("f0", "f1", [17])
            assert rows[0].tolist() == one.pose.tolist()
            sampled = reads.trajectory("f0", "f1", 1, start=17, end=17)
            assert sampled.poses.tolist() == rows.tolist()
            for dtype in (np.float64, np.float32):
                points = POINTS.astype(dtype)
                moved = reads.transform_points("f0", "f1", points, 17)
                assert moved.dtype == dtype
                np.testing.assert_array_equal(moved, one.apply(points))
                many = reads.transform_points("f0", "f1", points, [17] * len(points))
                np.testing.assert_array_equal(many, moved)
                assert reads.transform_points("f0", "f1", points, 17, out=points) is points
                np.testing.assert_array_equal(points, moved)


def new_frame(buffer: tfdb.Buffer) -> None:
    buffer.set_static_transform("map", "new", (1, 2, 3))


def new_sample(buffer: tfdb.Buffer) -> None:
    buffer.set_transform("map", "base", 50, (1, 2, 3))


def late_sample(buffer: tfdb.Buffer) -> None:
    buffer.set_transform("map", "base", 15, (1, 2, 3))


@pytest.mark.parametrize(
    ("ask", "change", "reason"),
    [
        (lambda tx: tx.frames(), new_frame, "a new frame of that name"),
        (len, new_frame, "a new frame of that name"),
        (lambda tx: tx.tree(), new_frame, "a new frame of that name"),
        (lambda tx: tx.children("map"), new_frame, "a new frame of that name"),
        (lambda tx: tx.frames(), lambda buf: buf.remove_frames("eye"), "removed"),
        (lambda tx: tx.tree(), new_sample, "a newer sample"),
        (lambda tx: tx.frame_info("base"), new_sample, "a newer sample"),
        (lambda tx: tx.samples("base"), late_sample, "a late sample"),
        (lambda tx: tx.trajectory("map", "base"), late_sample, "a late sample"),
        (lambda tx: tx.lookup_velocity("map", "base", 15, 4e-9), late_sample, "a late sample"),
        (lambda tx: tx.transform_points("map", "base", POINTS, 15), late_sample, "a late sample"),
        (lambda tx: tx.frames(), new_sample, None),
        (lambda tx: tx.frame_info("eye"), new_sample, None),
        (lambda tx: tx.lookup_velocity("map", "base", 15, 4e-9), new_sample, "a newer sample"),
        (lambda tx: tx.transform_points("map", "base", POINTS, 15), new_sample, None),
    ],
)
def test_conflicts_of_each_read(
    ask: Callable[[tfdb.Transaction], Any],
    change: Callable[[tfdb.Buffer], Any],
    reason: str | None,
) -> None:
    buffer = tfdb.Buffer(history=None)
    for stamp in (10, 20, 30):
        buffer.set_transform("map", "base", stamp, (stamp, 2, 3))
    buffer.set_static_transform("base", "eye", (1, 2, 3))

    def attempt() -> None:
        with buffer.transaction() as tx:
            ask(tx)
            in_another_thread(lambda: change(buffer))
            tx.set_static_transform("map", "seen", (1, 2, 3))

    if reason is None:
        attempt()
        assert buffer.frame_exists("seen")
    else:
        with pytest.raises(tfdb.Conflict) as caught:
            attempt()
        assert str(caught.value.reason).startswith(reason)
        assert not buffer.frame_exists("seen")


def test_frames_after_a_removal_conflict_with_nothing() -> None:
    buffer = grown(2, None)
    with buffer.transaction() as tx:
        tx.remove_frames("f0", recursive=True)
        left = tx.frames()
        tx.set_static_transform("map", "new", (1, 2, 3))
    assert buffer.frames() == sorted({*left, "map", "new"})


def test_reads_end_with_the_transaction() -> None:
    buffer = grown(3, None)
    with buffer.transaction() as tx:
        frame = tx.frames()[0]
    for ask in (
        tx.frames,
        tx.tree,
        lambda: tx.frame_info(frame),
        lambda: tx.samples(frame),
        lambda: len(tx),
        lambda: frame in tx,
        lambda: tx.children(frame),
        lambda: tx.trajectory(frame, frame, 1, 0, 1),
        lambda: tx.lookup_velocity(frame, frame),
        lambda: tx.transform_points(frame, frame, POINTS, 5),
        lambda: tx.explain(frame, frame),
    ):
        with pytest.raises(tfdb.errors.TransactionClosed):
            ask()
    assert "Transaction" in tx._repr_html_()
