"""Pickles for spawned workers of `multiprocessing`, such as a DataLoader's."""

from __future__ import annotations

import copy
import multiprocessing
import pickle
from pathlib import Path

import numpy as np
import pytest

import tfdb
from tests.stored import stored

BAG = Path(__file__).resolve().parents[2] / "examples" / "data" / "pr2.bag"


class Dataset:
    """What a user of torch writes: a store, a policy, what to look up."""

    def __init__(self, buffer: tfdb.Buffer, policy: tfdb.types.Policy, trajectory: object) -> None:
        self.buffer, self.policy, self.trajectory = buffer, policy, trajectory

    def __getitem__(self, stamp: int) -> tuple[object, object]:
        return self.buffer.lookup_transform("map", "base_link", stamp, self.policy), self.trajectory


@pytest.fixture(scope="module")
def loaded() -> tfdb.Buffer:
    return tfdb.load(BAG)


def everything(buffer: tfdb.Buffer) -> object:
    """All that a store says, but for its counters."""
    return buffer.commit, stored(buffer)


def test_spawned_workers_read_pickled_objects(loaded: tfdb.Buffer) -> None:
    path = loaded.trajectory("map", "base_link")
    data = Dataset(loaded, tfdb.Interpolate(max_gap=0.5), path)
    stamps = [int(stamp) for stamp in path.stamps[100:400:100]]
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        found = pool.map(data.__getitem__, stamps)
    for stamp, (transform, again) in zip(stamps, found, strict=True):
        assert transform == loaded.lookup_transform("map", "base_link", stamp)
        assert again == path


def test_a_private_store_arrives_whole_and_frozen(loaded: tfdb.Buffer) -> None:
    again = pickle.loads(pickle.dumps(loaded))
    assert everything(again) == everything(loaded)
    assert again.frozen is not None
    assert not Path(again.frozen.path).exists()
    with pytest.raises(tfdb.errors.ReadOnly):
        again.set_static_transform("map", "odom", (1, 2, 3))
    for copied in (pickle.loads(pickle.dumps(again)), copy.deepcopy(loaded)):
        assert everything(copied) == everything(loaded)


def test_a_pickle_holds_the_state_of_its_commit() -> None:
    buffer = tfdb.Buffer(history=None)
    buffer.set_transform("map", "base", 5, (1, 2, 3), (0, 0, 0.6, 0.8))
    pickled = pickle.dumps(buffer)
    buffer.set_transform("map", "base", 6, (3, 2, 1), (0, 0, 0.6, 0.8))
    again = pickle.loads(pickled)
    assert again.samples("base")[0].tolist() == [5]
    assert np.array_equal(again.lookup_transform("map", "base", 5).translation, (1, 2, 3))
    assert pickle.loads(pickle.dumps(tfdb.Buffer())).frames() == []


def test_closed_and_damaged_stores_are_not_pickled(loaded: tfdb.Buffer) -> None:
    closed = tfdb.Buffer()
    closed.close()
    with pytest.raises(tfdb.errors.BufferClosed):
        pickle.dumps(closed)
    pickled = bytearray(pickle.dumps(loaded))
    at = pickled.index(b"TFDBFRZ1")
    pickled[at + 100] ^= 255
    with pytest.raises(tfdb.errors.CorruptStore):
        pickle.loads(bytes(pickled))


@pytest.mark.parametrize(
    "value",
    [
        tfdb.Interpolate(max_gap=0.5),
        tfdb.Exact(),
        tfdb.Previous(max_age=2.0),
        tfdb.Nearest(tolerance=0.25),
        tfdb.Extrapolate(max=0.1),
    ],
    ids=repr,
)
def test_policies(value: tfdb.types.Policy) -> None:
    again = pickle.loads(pickle.dumps(value))
    assert again == value
    assert again != tfdb.Interpolate(max_gap=0.125)


def test_answers(loaded: tfdb.Buffer) -> None:
    transform = loaded.lookup_transform("map", "base_link")
    path = loaded.trajectory("map", "base_link")
    for value in (transform, path, transform.report):
        assert pickle.loads(pickle.dumps(value)) == value
