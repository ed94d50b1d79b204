"""Numbered batches of a home, and the check of stores that have them.

A batch is a function of its number and of its home's tag. So the last batch of a state determines
the rest of the state.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

import tfdb
from tests.net.world import BrokenPromiseError
from tfdb.net.messages import NONE

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from tfdb.data.types import Epoch

UNIT = 50_000_000
"""Nanoseconds between two batches, so that a history of 10 s has 200."""
STILL = (0.0, 0.0, 0.6, 0.8)
KEPT = 10 * 10**9 // UNIT
"""Number of batches in a history of 10 s."""
MOVING = "base", "arm", "cup"
_SENSOR, _TOOL, _CUP = 7, 11, 5


def parent_of(frame: str, number: int) -> str:
    """Return the parent of a moving frame in a batch: one frame changes its parent."""
    if frame == "cup":
        return "arm" if number // _CUP % 2 else "map"
    return {"base": "map", "arm": "base"}[frame]


def still_frames(number: int) -> dict[str, int]:
    """Return the static frames after a batch, and the batch that wrote each."""
    found = {}
    if number >= _SENSOR:
        found["sensor"] = number - number % _SENSOR
    if number % _TOOL >= _TOOL // 2:
        found["tool"] = number - number % _TOOL + _TOOL // 2
    return found


def write_batch(buf: tfdb.Buffer, number: int, tag: int) -> None:
    """Commit a batch: moving edges, changed static edges, a removed or added frame."""

    def write(tx: tfdb.Transaction) -> None:
        tx.set_transforms(
            [
                tfdb.TransformStamped(
                    parent_of(frame, number), frame, number * UNIT, (number, tag, at), STILL
                )
                for at, frame in enumerate(MOVING)
            ]
        )
        for frame, written in still_frames(number).items():
            if written == number:
                tx.set_static_transform("base", frame, (number, tag, -1), STILL)
        if number % _TOOL == 0 and tx.frame_exists("tool"):
            tx.remove_frames("tool")

    buf.run(write)


def last_batch(buf: tfdb.Buffer | tfdb.Snapshot) -> tuple[int, int]:
    """Return the number and the tag of the last batch of a state; 0 and 0: it has none."""
    if not buf.frame_exists("base"):
        return 0, 0
    poses = np.asarray(buf.samples("base")[1])
    return (int(poses[-1][0]), int(poses[-1][1])) if len(poses) else (0, 0)


class Judge:
    """Knows which home wrote each batch. Threads: one."""

    def __init__(self) -> None:
        self.begins: dict[int, tuple[int, int]] = {0: (0, 0)}
        """By tag: the batch after which its home began, and the tag of that batch."""
        self.tag_of: dict[int, int] = {}
        """The tag of the home of an epoch, by its number."""
        self.distance: dict[tuple[Epoch, int], int] = {}
        """Difference between the numbers of batch and commit, by epoch and tag."""
        self.read_tags: Callable[[], object] = lambda: None
        """Reads the output of processes: a tag is printed before its first batch."""
        self.states = 0

    def tags(self, tag: int, numbers: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the tags of batches in a state whose last batch has a tag."""
        if tag not in self.begins:
            self.read_tags()
        if tag not in self.begins:
            raise BrokenPromiseError(f"no home has tag {tag}")
        found = np.full(len(numbers), tag)
        while tag:
            begin, tag = self.begins[tag]
            found[numbers <= begin] = tag
        return found

    def goes_on(self, before: tuple[int, int], after: tuple[int, int]) -> bool:
        """Whether a state includes the last batch of an earlier one."""
        number, tag = before
        return number <= after[0] and int(self.tags(after[1], np.array([number]))[0]) == tag

    def judge(self, snap: tfdb.Snapshot) -> tuple[int, int]:
        """Compare a whole state with the one that its last batch determines; return that batch."""
        self.states += 1
        number, tag = last_batch(snap)
        still = still_frames(number)
        if number == 0:
            if snap.frames():
                raise BrokenPromiseError(f"frames without a batch: {snap.frames()}")
            return 0, 0
        wanted = {"map", *MOVING, *still}
        if set(snap.frames()) != wanted:
            raise BrokenPromiseError(f"batch {number}: {snap.frames()}, not {sorted(wanted)}")
        for at, frame in enumerate(MOVING):
            stamps, poses, parents = snap.samples(frame)
            numbers = np.asarray(stamps) // UNIT
            begin = int(numbers[0])
            if begin > max(number - KEPT + 1, 1):
                raise BrokenPromiseError(f"{frame} at batch {number} lacks those before {begin}")
            said = np.arange(begin, number + 1)
            if not np.array_equal(numbers, said):
                raise BrokenPromiseError(f"{frame} at batch {number} has batches {numbers}")
            columns = np.stack([said, self.tags(tag, said), np.full(len(said), at)], axis=1)
            if not np.array_equal(np.asarray(poses)[:, :3], columns):
                raise BrokenPromiseError(f"{frame} at batch {number}, tag {tag}: {poses}")
            if parents != [parent_of(frame, int(each)) for each in said]:
                raise BrokenPromiseError(f"{frame} at batch {number} has parents {parents}")
        for frame, written in still.items():
            pose = tuple(np.asarray(snap.samples(frame)[1])[0][:3])
            if pose != (written, int(self.tags(tag, np.array([written]))[0]), -1):
                raise BrokenPromiseError(f"{frame} at batch {number}, tag {tag}: {pose}")
        return number, tag

    def compare(self, epoch: Epoch, commit: int, batch: tuple[int, int]) -> None:
        """Compare the position of a mirror with its state: one commit has one state."""
        number, tag = batch
        wanted = self.distance.setdefault((epoch, tag), number - commit)
        if number - commit != wanted:
            raise BrokenPromiseError(
                f"epoch {epoch}, commit {commit} was batch {commit + wanted}, and is {number}"
            )

    def compare_fork(self, later: int, last: tuple[int, int], alone: int) -> bool:
        """Compare the number of commits that only a fenced home has, as its event reports it, with
        the later home.

        Returns whether the later home is known: it may be killed before it prints its tag.
        """
        if later not in self.tag_of:
            return False
        # There may be homes between: the later one has what it began with of them.
        begin, parent = self.begins[self.tag_of[later]]
        numbers = np.arange(min(begin, last[0]) + 1)
        common = numbers[self.tags(parent, numbers) == self.tags(last[1], numbers)]
        if common[-1] != last[0] - alone:
            text = f"the later home has batch {common[-1]}, and the old one has {alone} behind it"
            raise BrokenPromiseError(f"{text} alone, up to {last[0]}")
        return True


class Copy:
    """A checked store. Threads: one."""

    def __init__(self, buffer: tfdb.Buffer) -> None:
        self.buffer = buffer
        self.place: tuple[Epoch, int] = (NONE, 0)
        """The last checked position."""
        self.batch = 0, 0
        """The number and the tag of the last checked batch."""
        self.steps_back = 0
        self.own: set[Epoch] = set()
        """Epochs in which it was a home's store: its position stays that of the promotion."""
        self.commit = -1
        """The last checked commit of the store."""

    def look(self, judge: Judge) -> None:
        """Check the newest state, unless it was checked before."""
        if self.buffer.commit == self.commit:
            return
        before = self.buffer.positions()
        with self.buffer.snapshot() as snap:
            if self.buffer.positions() != before:
                return  # the state is checked again
            batch = judge.judge(snap)
            self.commit = snap.commit
        place = (before[0].epoch, before[0].commit) if before else (NONE, 0)
        if place < self.place:
            raise BrokenPromiseError(f"{self.place} is followed by {place}")
        if not judge.goes_on(self.batch, batch):
            if place[0] == self.place[0]:
                raise BrokenPromiseError(f"{self.batch} is followed by {batch} at {place}")
            self.steps_back += 1
        if before and place[0] not in self.own:
            judge.compare(*place, batch)
        self.place, self.batch = place, batch
