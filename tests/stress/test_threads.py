"""Python threads on one store: with a GIL that switches often, and in earnest where there is none.

Every thread does a fixed amount of work and checks each answer; nothing here depends on time.
"""

from __future__ import annotations

import itertools
import os
import sys
import threading
from typing import TYPE_CHECKING

import numpy as np
import pytest

import tfdb

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

SECOND = 1_000_000_000
ROUNDS = int(os.environ.get("TFDB_STRESS_ROUNDS", "4000"))
TOLERANCE = 1e-12


@pytest.fixture(autouse=True)
def _switch_often() -> Iterator[None]:
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    yield
    sys.setswitchinterval(before)


def together(*works: Callable[[], None]) -> None:
    """Run each in a thread of its own, started at once; the first failure is raised."""
    barrier = threading.Barrier(len(works))
    failures: list[BaseException] = []

    def run(work: Callable[[], None]) -> None:
        barrier.wait()
        try:
            work()
        except BaseException as error:
            failures.append(error)

    threads = [threading.Thread(target=run, args=(work,)) for work in works]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if failures:
        raise failures[0]


def rotation(angle: float) -> tuple[float, float, float, float]:
    """Quaternion of a turn about an axis that is no axis of the frame."""
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    x, y, z = axis * np.sin(angle / 2)
    return float(x), float(y), float(z), float(np.cos(angle / 2))


def chain(buffer: tfdb.Buffer, samples: int) -> list[str]:
    """Four moving edges, `samples` samples each at 10 Hz; returns the frames from the root down."""
    names = ["map", "odom", "base", "mast", "camera"]
    for index in range(samples):
        for depth, (parent, child) in enumerate(itertools.pairwise(names)):
            angle = 0.1 * index + depth
            buffer.set_transform(
                parent, child, SECOND + index * SECOND // 10, (index, depth, -1.5), rotation(angle)
            )
    return names


def fresh(name: str) -> str:
    """Return an equal string that is another object: caches by identity must not be fooled."""
    return "".join(list(name))


def test_two_edges_revised_as_one_are_never_seen_half() -> None:
    buffer = tfdb.Buffer()
    fixed = tfdb.TransformStamped("b", "c", 0, (0.3, -2.0, 5.0), rotation(0.7))

    def pair(k: int) -> list[tfdb.TransformStamped]:
        # T[a<-b](k) and T[b<-c](k) differ for every k, but the first undoes what the second adds.
        turn = rotation(0.001 * k)
        back = (-turn[0], -turn[1], -turn[2], turn[3])
        return [
            tfdb.TransformStamped("a", "b", 0, (0.0, 0.0, 0.0), turn),
            tfdb.TransformStamped("b", "undo", 0, (0.0, 0.0, 0.0), back),
        ]

    buffer.set_transforms(pair(0), static=True)
    buffer.set_static_transform("undo", "c", fixed.translation, fixed.rotation)
    expected = buffer.lookup_transform("a", "c").pose.copy()

    def write() -> None:
        for k in range(ROUNDS):
            buffer.set_transforms(pair(k), static=True)

    def read() -> None:
        for _ in range(2 * ROUNDS):
            found = buffer.lookup_transform("a", "c").pose
            assert np.abs(found - expected).max() < TOLERANCE

    together(write, write, read, read)


def test_names_that_are_equal_but_not_the_same_object() -> None:
    buffer = tfdb.Buffer(history=None)
    names = chain(buffer, 20)
    stamp = SECOND + 3 * SECOND // 20
    expected = {
        (a, b): buffer.lookup_transform(a, b, stamp).pose.copy() for a in names for b in names
    }

    def read(seed: int) -> Callable[[], None]:
        def work() -> None:
            random = np.random.default_rng(seed)
            for i, j in random.integers(0, len(names), size=(ROUNDS, 2)):
                a, b = names[i], names[j]
                found = buffer.lookup_transform(fresh(a), fresh(b), stamp)
                assert np.array_equal(found.pose, expected[a, b])
                assert (found.target, found.source) == (a, b)

        return work

    together(*(read(seed) for seed in range(4)))


def test_frames_come_and_go_beside_readers() -> None:
    buffer = tfdb.Buffer()
    buffer.set_static_transform("map", "base", (1.0, 2.0, 3.0), rotation(0.4))

    def write() -> None:
        for k in range(ROUNDS):
            buffer.set_transform("base", "tool", SECOND + k, (float(k), 0.0, 1.0), rotation(1.0))
            buffer.remove_frame("tool")

    def read() -> None:
        seen = 0
        for _ in range(ROUNDS):
            try:
                found = buffer.lookup_transform("base", "tool")
            except (tfdb.UnknownFrame, tfdb.Disconnected):
                continue
            # The translation names the stamp: a mixture of two lives of the frame would not fit.
            assert found.translation[0] == found.stamp - SECOND
            seen += 1
        assert seen <= ROUNDS

    together(write, read, read)
    assert buffer.frames() == ["base", "map"]


def test_commits_of_many_threads_are_numbered_without_gaps() -> None:
    buffer = tfdb.Buffer(history=None)
    numbers: list[list[int]] = [[] for _ in range(4)]

    def write(thread: int) -> Callable[[], None]:
        def work() -> None:
            for k in range(ROUNDS // 2):
                commit = buffer.set_transform(
                    "map", f"robot{thread}", SECOND + k, (thread, k, 1.0), rotation(0.1)
                )
                numbers[thread].append(commit)

        return work

    together(*(write(thread) for thread in range(4)))
    assert all(own == sorted(own) for own in numbers)
    assert sorted(itertools.chain(*numbers)) == list(range(1, 4 * (ROUNDS // 2) + 1))
    assert buffer.commit == 4 * (ROUNDS // 2)
    assert sum(info.samples for info in buffer.tree()) == buffer.commit


def test_a_snapshot_shared_by_threads_stands_still() -> None:
    buffer = tfdb.Buffer(history=None)
    names = chain(buffer, 50)
    stamps = SECOND + np.arange(0, 4 * SECOND, SECOND // 25)

    with buffer.snapshot() as snapshot:
        expected = snapshot.lookup_transforms(names[0], names[-1], stamps)

        def write() -> None:
            for k in range(ROUNDS):
                # The same stamps again, with other poses: the newer commit wins, for newer readers.
                stamp = SECOND + (k % 50) * SECOND // 10
                buffer.set_transform(names[1], names[2], stamp, (k, k, k), rotation(0.01 * k))

        def read() -> None:
            for _ in range(ROUNDS // 20):
                found = snapshot.lookup_transforms(names[0], names[-1], stamps)
                assert np.array_equal(found, expected)

        together(write, read, read)
        assert not np.array_equal(buffer.lookup_transforms(names[0], names[-1], stamps), expected)


def test_one_answer_read_by_many_threads() -> None:
    buffer = tfdb.Buffer(history=None)
    names = chain(buffer, 10)
    answers = [buffer.lookup_transform(names[0], names[-1], SECOND + k) for k in range(200)]
    expected = [repr(buffer.lookup_transform(names[0], names[-1], SECOND + k)) for k in range(200)]

    def read() -> None:
        for answer, text in zip(answers, expected, strict=True):
            assert repr(answer) == text
            assert len(answer.report.edges) == 4
            back = (answer @ answer.inverse()).matrix
            assert np.abs(back - np.eye(4)).max() < TOLERANCE

    together(read, read, read, read)
