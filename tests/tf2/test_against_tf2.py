"""Random operations on tfdb.tf2 and on Debian's real tf2_py, answer by answer.

Values agree to 1e-12; success, the class of an error and its text agree, and what a refused write
logs. What differs on purpose is told by its name in `tfdb.tf2.differences`.
"""

from __future__ import annotations

import logging
import math
import random
from collections import Counter
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from compat.tf2_oracle import pose_difference
from tf2 import real_tf2
from tf2.ours import Ours, Records
from tfdb.tf2.differences import DIFFERENCES

if TYPE_CHECKING:
    from collections.abc import Iterator

TOLERANCE = 1e-12
SECOND = 1_000_000_000
# The real one passes times through floats of seconds: near 100 s they hold each nanosecond.
START = 100 * SECOND
SEEDS = range(40)
OPERATIONS = 600
CACHE_TIMES = [10 * SECOND, 10 * SECOND, 2 * SECOND, 0]
FRAMES = [f"f{i}" for i in range(9)]
ODD_NAMES = ["nowhere", "", "/f1"]


@pytest.fixture
def records() -> Iterator[Records]:
    """What `tfdb.tf2` logs; none of it is printed."""
    handler, logger = Records(), logging.getLogger("tfdb.tf2")
    logger.addHandler(handler)
    yield handler
    logger.removeHandler(handler)


def random_pose(rng: random.Random) -> list[float]:
    """Some metres and any rotation; sometimes what both refuse."""
    quaternion = np.array([rng.gauss(0, 1) for _ in range(4)])
    quaternion /= np.linalg.norm(quaternion)
    pose = [rng.uniform(-8, 8) for _ in range(3)] + quaternion.tolist()
    if rng.random() < 0.02:
        pose[rng.randrange(7)] = math.nan
    elif rng.random() < 0.02:
        factor = rng.choice([0.0, 0.9, 1.1])
        pose[3:] = [factor * value for value in pose[3:]]
    return pose


class Sequence:
    """Operations, as they are made up, with our answers."""

    def __init__(self, seed: int, records: Records) -> None:
        self.rng = random.Random(seed)
        self.turns_over = seed % 8 == 7  # a frame's child may become its parent later
        self.ours = Ours("ros1", records)
        self.now = START
        self.operations: list[list[Any]] = []
        self.answers: list[tuple[str, Any]] = []
        self.note(["new", CACHE_TIMES[seed % len(CACHE_TIMES)]])

    def note(self, operation: list[Any]) -> None:
        self.answers.append(self.ours.answer(operation))
        self.operations.append(operation)

    def stamp(self) -> int:
        """On a grid of 0.1 s, so that stamps are hit and repeated, or anywhere between."""
        offset = self.rng.uniform(-self.rng.choice([3, 12, 20]), 1.0)
        grid = round(offset * 10) * (SECOND // 10)
        return self.now + (grid if self.rng.random() < 0.5 else int(offset * SECOND))

    def time(self) -> int:
        return 0 if self.rng.random() < 0.25 else self.stamp()

    def names(self, count: int) -> list[str]:
        odd = ODD_NAMES if self.rng.random() < 0.1 else []
        return [self.rng.choice([*FRAMES, *odd]) for _ in range(count)]

    def write(self) -> None:
        rng = self.rng
        self.now += rng.choice([0, 0, SECOND // 10, SECOND // 2])
        parent, child = rng.choice(FRAMES), rng.choice(FRAMES)
        if not self.turns_over:
            parent, child = sorted((parent, child))
        if rng.random() < 0.05:
            parent = rng.choice(["", f"/{parent}"])
        if rng.random() < 0.05:
            child = rng.choice(["", f"/{child}"])
        static = rng.random() < (0.6 if child in {"f2", "f5"} else 0.05)
        known = self.ours.core.buffer.frame_exists(parent.removeprefix("/"))
        write = ["set", static, parent, child, self.stamp(), random_pose(rng), rng.choice("abc")]
        answer = self.ours.answer(write)
        if "TF_LOOP" in answer[1]:
            assert "loops" in DIFFERENCES
            return
        if "TF_OLD_DATA" in answer[1] and not known:
            assert "refused_parent" in DIFFERENCES
            return
        self.operations.append(write)
        self.answers.append(answer)

    def step(self) -> None:
        rng, chance = self.rng, self.rng.random()
        if chance < 0.004:
            self.note(["clear"])
        elif chance < 0.4:
            self.write()
        elif chance < 0.7:
            self.note([rng.choice(["get", "can"]), *self.names(2), self.time()])
        elif chance < 0.9:
            target, source, fixed = self.names(3)
            times = self.time(), self.time()
            verb = rng.choice(["full", "canfull"])
            self.note([verb, target, times[0], source, times[1], fixed])
        elif chance < 0.96:
            self.note(["latest", *self.names(2)])
        else:
            self.note(rng.choice([["exists", *self.names(1)], ["frames"]]))


def same(ours: tuple[str, Any], theirs: tuple[str, Any]) -> bool:
    """Whether two answers agree: the class, and the text or the value."""
    kinds = {"NoDataFor": "", "Forward": "", "Backward": ""}
    word = ours[0]
    for prefix, nothing in kinds.items():
        word = word.replace(prefix + "Extrapolation", nothing + "Extrapolation")
    if word != theirs[0]:
        return False
    if isinstance(ours[1], list) and len(ours[1]) == 4:
        poses = np.array(ours[1][3]), np.array(theirs[1][3])
        close = pose_difference(*poses)[0] <= TOLERANCE
        return ours[1][:3] == theirs[1][:3] and bool(close)
    return bool(ours[1] == theirs[1])


def difference(
    operation: list[Any], ours: tuple[str, Any], theirs: tuple[str, Any], *, turns_over: bool
) -> str | None:
    """Name of the difference that two answers show; None: it is a defect."""
    verb, *arguments = operation
    names = [each for each in arguments if isinstance(each, str)]
    odd = any(name in ODD_NAMES for name in names) or ours[0] == "LookupException"
    ours_fails = ours[0] != "ok" or (verb in {"can", "canfull"} and not ours[1][0])
    theirs_fails = theirs[0] != "ok" or (verb in {"can", "canfull"} and not theirs[1][0])
    unknown = ours_fails and "does not exist" in str(ours[1])
    if ours_fails and not theirs_fails:
        if odd or unknown:
            return "same_frame" if len(set(names)) < len(names) else None
        return "backwards" if turns_over else None
    if verb in {"can", "canfull"} and ours_fails and theirs_fails and (odd or unknown):
        return "can_says_why"
    if verb == "latest" and ours[0] == "ConnectivityException" and ours[1] == theirs[1]:
        return "latest_common_time" if theirs[0] == "TransformException" else None
    return "backwards" if turns_over and ours_fails and theirs_fails else None


@pytest.mark.parametrize("seed", SEEDS)
def test_random_sequence(seed: int, records: Records) -> None:
    print(f"seed {seed}")
    sequence = Sequence(seed, records)
    for _ in range(OPERATIONS):
        sequence.step()
    theirs = real_tf2.run(sequence.operations)
    rows = zip(sequence.operations, sequence.answers, theirs, strict=True)
    for number, (operation, our, their) in enumerate(rows):
        if not same(our, their):
            named = difference(operation, our, their, turns_over=sequence.turns_over)
            assert named in DIFFERENCES, (
                f"operation {number} of seed {seed}: {operation}\nours   {our}\ntheirs {their}"
            )
