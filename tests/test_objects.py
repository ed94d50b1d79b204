"""The package's objects as Python objects: references, cycles, pickles, subclasses."""

from __future__ import annotations

import copy
import gc
import itertools
import pickle
import sys
import weakref
from typing import TYPE_CHECKING

import numpy as np
import pytest

import tfdb
from oracle import quaternion
from robot import make_robot, stamp_of

if TYPE_CHECKING:
    from pathlib import Path

TURN = quaternion((1, -2, 0.5), 0.9)
BACK = quaternion((0, 1, 3), -1.4)


def test_nothing_keeps_references_that_it_does_not_need() -> None:
    names = ["".join(["frame", str(i)]) for i in range(2)]  # not interned, so not immortal
    buffer = tfdb.Buffer()
    buffer.set_transform(*names, 5, (1, 2, 3), TURN)
    for _ in range(3):
        buffer.lookup_transform(*names, 5)
    counts = [sys.getrefcount(name) for name in names]
    results = [buffer.lookup_transform(*names, 5) for _ in range(100)]
    assert [sys.getrefcount(name) for name in names] == [count + 100 for count in counts]
    del results
    assert [sys.getrefcount(name) for name in names] == counts
    for _ in range(100):
        with pytest.raises(tfdb.Extrapolation):
            buffer.lookup_transform(*names, 6)
    gc.collect()
    assert [sys.getrefcount(name) for name in names] == counts


def test_a_buffer_in_a_cycle_with_its_clock_is_collected() -> None:
    class Owner:
        def __init__(self) -> None:
            self.buffer = tfdb.Buffer(clock=self.now)

        def now(self) -> int:
            return 7

    owner = Owner()
    owner.buffer.set_transform("map", "base", 5, (1, 2, 3), TURN)
    alive = weakref.ref(owner)
    del owner
    gc.collect()
    assert alive() is None


def test_a_buffer_may_be_subclassed() -> None:
    class Mine(tfdb.Buffer):
        """With a name."""

        def __init__(self, name: str) -> None:
            super().__init__(history=None)
            self.name = name

    mine = Mine("mine")
    mine.set_transform("map", "base", 5, (1, 2, 3), TURN)
    assert mine.lookup_transform("map", "base").pose == pytest.approx([1, 2, 3, *TURN])
    with mine.snapshot() as snapshot:
        assert snapshot.can_transform("map", "base")


def test_every_store_that_tfdb_returns_is_an_object_of_its_classes(tmp_path: Path) -> None:
    made = tfdb.Buffer(history=None)
    made.set_transform("map", "base", 5, (1, 2, 3), TURN)
    made.freeze(tmp_path / "frozen.tfdb")
    frozen = tfdb.open(tmp_path / "frozen.tfdb")
    thawed = pickle.loads(pickle.dumps(made))
    for buffer in (made, frozen, thawed, tfdb.tf2.BufferCore().buffer):
        assert type(buffer) is tfdb.Buffer
        assert type(buffer.snapshot()) is tfdb.Snapshot
        assert type(buffer.transaction()) is tfdb.Transaction
    assert type(frozen.trajectory("map", "base")) is tfdb.Trajectory


def test_a_subclass_of_a_buffer_may_have_mixins_and_attributes() -> None:
    class Counted:
        """Counts its calls."""

        calls = 0

        def lookup_transform(self, *given: object) -> tfdb.Transform:
            self.calls += 1
            return super().lookup_transform(*given)  # type: ignore[misc, no-any-return]

    class Mine(Counted, tfdb.Buffer):
        itself: tfdb.Buffer

    mine = Mine(history=None)
    mine.set_transform("map", "base", 5, (1, 2, 3), TURN)
    assert mine.lookup_transform("map", "base").stamp == 5
    assert (mine.calls, mine.children("map"), len(mine)) == (1, ["base"], 2)
    mine.itself = mine
    alive = weakref.ref(mine)
    del mine
    gc.collect()
    assert alive() is None


def test_a_buffer_without_init_raises() -> None:
    raw = tfdb.Buffer.__new__(tfdb.Buffer)
    for call in (
        lambda: raw.lookup_transform("map", "base"),
        lambda: raw.set_transform("map", "base", 5, (1, 2, 3), TURN),
    ):
        with pytest.raises(TypeError, match="__init__"):
            call()


def test_transforms_are_values() -> None:
    robot = make_robot()
    found = robot.buffer.lookup_transform("map", "camera", stamp_of(3.5))
    for twin in (pickle.loads(pickle.dumps(found)), copy.copy(found), copy.deepcopy(found)):
        assert twin == found
        assert hash(twin) == hash(found)
        assert twin.report == found.report
        assert (twin.commit, twin.stamp) == (found.commit, found.stamp)
    assert pickle.loads(pickle.dumps(found.inverse())).report == found.inverse().report
    assert found != robot.buffer.lookup_transform("map", "camera", stamp_of(3.6))
    assert found != "T"
    with pytest.raises(AttributeError):
        found.stamp = 5


@pytest.mark.parametrize(
    "policy",
    [
        tfdb.Interpolate(),
        tfdb.Interpolate(0.25),
        tfdb.Exact(),
        tfdb.Previous(max_age_ns=7),
        tfdb.Nearest(0.1),
        tfdb.Extrapolate(2),
    ],
)
def test_policies_are_values(policy: tfdb.types.Policy) -> None:
    twin = pickle.loads(pickle.dumps(policy))
    assert twin == policy
    assert hash(twin) == hash(policy)
    assert eval(repr(policy), {**vars(tfdb)}) == policy
    assert policy != tfdb.Previous(123.0)


def test_policies_keep_nanoseconds() -> None:
    assert tfdb.Interpolate(0.1).limit_ns == 100_000_000
    assert tfdb.Previous(max_age_ns=3).max_age == 3e-9
    assert tfdb.Nearest().tolerance is None
    assert tfdb.Extrapolate(max=0.5).max == 0.5


def test_errors_are_pickled_with_their_fields() -> None:
    buffer = make_robot().buffer
    with pytest.raises(tfdb.Extrapolation) as caught:
        buffer.lookup_transform("map", "camera", 5)
    twin = pickle.loads(pickle.dumps(caught.value))
    assert type(twin) is tfdb.Extrapolation
    assert str(twin) == str(caught.value)
    assert vars(twin) == vars(caught.value)
    assert type(twin).__module__ == "tfdb"


def test_a_transform_in_the_memory_of_one_that_was_dropped() -> None:
    """Nothing of it is left: neither its names, nor its numbers, nor its report."""
    buf = tfdb.Buffer()
    names = [f"f{i}" for i in range(5)]
    for parent, child in itertools.pairwise(names):
        buf.set_transform(parent, child, 5, (1, 2, 3), (0, 0, 0, 1))
    kept: list[tfdb.Transform] = []
    for turn in range(64):
        edges = turn % 5
        for _ in range(1 + turn % 3):  # the last one lives, those before it do not
            found = buf.lookup_transform("f0", names[edges], 5)
        assert (found.target, found.source) == ("f0", names[edges])
        assert found.translation.tolist() == [edges, 2 * edges, 3 * edges]
        assert [edge.child for edge in found.report.edges] == names[edges:0:-1]
        if turn % 2:
            kept.append(found)
    for turn, found in zip(range(1, 64, 2), kept, strict=True):
        assert found == buf.lookup_transform("f0", names[turn % 5], 5)


def test_twists_compare() -> None:
    ahead, turning = np.array([1.0, 2.0, np.nan]), np.array([0.1, 0.0, -0.2])
    twist = tfdb.types.Twist(ahead, turning)
    assert twist == tfdb.types.Twist(ahead.copy(), turning.copy())
    assert twist != tfdb.types.Twist(turning, ahead)
    assert twist != "a twist"
    with pytest.raises(TypeError):
        hash(twist)


def test_a_load_report_is_a_table_in_notebooks(tmp_path: Path) -> None:
    name = tmp_path / "a&b.mcap"
    bad = tfdb.TransformStamped("map", "map", 5, (1, 2, 3))
    with tfdb.recordings.RecordingWriter(name) as writer:
        good = tfdb.TransformStamped("map", "base", 5, (1, 2, 3))
        for stamp, one in enumerate((good, bad)):
            writer.write(tfdb.encode_tf_message([one]), stamp, topic="/tf", static=False)
    with pytest.warns(tfdb.TfdbWarning, match="1 transform of frame 'map' was refused"):
        shown = tfdb.Buffer().load(name)._repr_html_()
    assert "a&amp;b.mcap: 2 messages, 1 transforms, 1 commits, 1 refused" in shown
    assert "<td>/tf</td><td>2</td><td>moving</td>" in shown
    assert "<td>map</td><td>InvalidTransform</td><td>1</td>" in shown
