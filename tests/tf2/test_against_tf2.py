"""Random operations on tfdb.tf2 and on Debian's real tf2_py, answer by answer.

Values agree to 1e-12; success, the class of an error and its text agree, and what a refused write
logs. What differs on purpose is told by its name in `tfdb.tf2.differences`.
"""

from __future__ import annotations

import logging
import math
import random
import re
from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from compat.tf2_oracle import pose_difference
from tf2 import real_tf2
from tf2.ours import Ours, Records
from tfdb.tf2.differences import DIFFERENCES

TOLERANCE = 1e-12
SECOND = 1_000_000_000
# The real one passes times through floats of seconds: near 100 s they hold each nanosecond.
START = 100 * SECOND
SEEDS = range(60)
OPERATIONS = 600
EVERY = 100  # operations are followed by
LOOKUPS = 280  # lookups of the state that they made
CACHE_TIMES = [10 * SECOND, 10 * SECOND, 2 * SECOND, 0]
FRAMES = [f"f{i}" for i in range(9)]
ODD_NAMES = ["nowhere", "", "/f1"]
SUBCLASS = re.compile("^(Forward|Backward|NoDataFor)(?=Extrapolation)")


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
        self.seed = seed
        self.rng = random.Random(seed)
        self.turns_over = seed % 4 == 3  # a frame's child may become its parent later
        self.ours = Ours("ros1", records)
        self.now = START
        self.operations: list[list[Any]] = []
        self.answers: list[tuple[str, Any]] = []
        self.note(["new", CACHE_TIMES[seed % len(CACHE_TIMES)]])

    def note(self, operation: list[Any]) -> None:
        self.answers.append(self.ours.answer(operation))
        self.operations.append(operation)

    def look_up(self) -> None:
        """Ask many things of one state."""
        drawn, self.rng = self.rng, random.Random(f"{self.seed} {len(self.operations)}")
        for _ in range(LOOKUPS):
            if self.rng.random() < 0.6:
                self.note([self.rng.choice(["get", "get", "can"]), *self.names(2), self.time()])
            else:
                target, source, fixed = self.names(3)
                verb = self.rng.choice(["full", "full", "canfull"])
                self.note([verb, target, self.time(), source, self.time(), fixed])
        self.rng = drawn

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


@dataclass(frozen=True)
class Row:
    """One operation with both answers."""

    seed: int
    number: int
    operation: list[Any]
    ours: tuple[str, Any]
    theirs: tuple[str, Any]

    def __str__(self) -> str:
        where = f"operation {self.number} of seed {self.seed}: {self.operation}"
        return f"{where}\nours   {self.ours}\ntheirs {self.theirs}"


def same(row: Row) -> bool:
    """Whether two answers agree: the class, and the text or the value."""
    ours, theirs = row.ours, row.theirs
    # tf2's Python knows one class of these.
    if SUBCLASS.sub("", ours[0]) != theirs[0]:
        return False
    if row.operation[0] in {"get", "full"} and theirs[0] == "ok":
        poses = np.array(ours[1][3]), np.array(theirs[1][3])
        close = pose_difference(*poses)[0] <= TOLERANCE
        return ours[1][:3] == theirs[1][:3] and bool(close)
    return bool(ours[1] == theirs[1])


def difference(row: Row) -> str | None:
    """Name of the difference that two answers show; None: it is a defect."""
    ours, theirs = row.ours, row.theirs
    verb, *arguments = row.operation
    names = [each for each in arguments if isinstance(each, str)]
    if verb == "latest" and ours[1] == theirs[1]:
        classes = ours[0], theirs[0]
        named = classes == ("ConnectivityException", "TransformException")
        return "latest_common_time" if named else None
    if verb not in {"get", "full", "can", "canfull"}:
        return None
    can = verb.startswith("can")
    ours_text, theirs_text = (each[1][1] if can else each[1] for each in (ours, theirs))
    if not re.search("does not exist|cannot be empty|cannot start with", str(ours_text)):
        return None
    if theirs[0] == "ok" and (not can or theirs[1][0]):
        return "same_frame" if len(set(names)) < len(names) else None
    # Of the simple form the reason is that of tf2, or its beginning, unless tf2 gives none.
    if can and (verb == "canfull" or not theirs_text or theirs_text.startswith(ours_text)):
        return "can_says_why"
    return None


@pytest.fixture(scope="module")
def rows() -> list[Row]:
    """All sequences, each from a new store on, in one process of tf2."""
    handler, logger = Records(), logging.getLogger("tfdb.tf2")
    logger.addHandler(handler)
    logger.propagate = False
    try:
        sequences = [Sequence(seed, handler) for seed in SEEDS]
        for sequence in sequences:
            for number in range(1, OPERATIONS + 1):
                sequence.step()
                if number % EVERY == 0:
                    sequence.look_up()
    finally:
        logger.propagate = True
        logger.removeHandler(handler)
    theirs = iter(real_tf2.run([each for sequence in sequences for each in sequence.operations]))
    return [
        Row(seed, number, operation, our, next(theirs))
        for seed, sequence in zip(SEEDS, sequences, strict=True)
        for number, (operation, our) in enumerate(
            zip(sequence.operations, sequence.answers, strict=True)
        )
    ]


def test_every_answer_agrees_or_differs_by_name(rows: list[Row]) -> None:
    print(f"seeds {SEEDS}, {len(rows)} operations")
    for row in rows:
        if not same(row):
            assert difference(row) in DIFFERENCES, str(row)
    asked = Counter(row.operation[0] for row in rows)
    print(asked)
    assert sum(asked[verb] for verb in ("get", "full", "can", "canfull")) >= 100_000
    assert sum(row.ours[0] == "ok" for row in rows if row.operation[0] in {"get", "full"}) > 10_000


def test_every_kind_of_answer_is_reached(rows: list[Row]) -> None:
    """The sequences are worth something: all answers occur often, and nearly all of them agree."""
    words = Counter(row.ours[0] for row in rows)
    logged = Counter(
        row.ours[1].split()[0].rstrip(":")
        for row in rows
        if row.operation[0] == "set" and row.ours[1]
    )
    named = Counter(difference(row) for row in rows if not same(row))
    print(words, logged, named, sep="\n")
    for word in (
        "ok",
        "ConnectivityException",
        "LookupException",
        "InvalidArgumentException",
        "NoDataForExtrapolationException",
        "ForwardExtrapolationException",
        "BackwardExtrapolationException",
    ):
        assert words[word] > 100, word
    for word in (
        "TF_OLD_DATA",
        "TF_REPEATED_DATA",
        "TF_SELF_TRANSFORM",
        "TF_NO_FRAME_ID",
        "TF_NO_CHILD_FRAME_ID",
        "TF_NAN_INPUT",
        "TF_DENORMALIZED_QUATERNION",
    ):
        assert logged[word] > 20, word
    empty = ", when looking up transform"
    assert sum(str(row.ours[1]).startswith(empty) for row in rows) > 20
    assert named.total() < 0.05 * len(rows)
