"""The real tf2 as a judge: runs operations on it, by the program of measure/tf2/judge.cpp.

Where libtf2-dev is missing the tests that need it skip and say so; with CI=true they fail.
"""

from __future__ import annotations

import os
import subprocess
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tfdb_measure import programs

if TYPE_CHECKING:
    from pathlib import Path


def unavailable(reason: str) -> None:
    """Skips the test, or fails it where everything must be there (CI=true)."""
    if os.environ.get("CI") == "true":
        pytest.fail(f"{reason} (CI=true: nothing may be missing)")
    pytest.skip(reason)


def connect() -> Tf2Oracle:
    """The oracle, or a skip that says what to install."""
    return Tf2Oracle(program("tfdb_tf2_judge"))


def program(name: str) -> Path:
    """A program that needs the real tf2, or a skip that says what to install."""
    try:
        return programs.find(name)
    except programs.DriverMissing as missing:
        unavailable(str(missing))
        raise


@dataclass(frozen=True)
class Answer:
    """What tf2 said: a pose with its stamp, or a bare word, or the class and text of an error."""

    word: str
    stamp: int = 0
    pose: np.ndarray | None = None
    text: str = ""


class Tf2Oracle:
    """Runs a script of operations in a fresh tf2::BufferCore; one answer per operation."""

    def __init__(self, program: Path) -> None:
        self._program = program

    def run(self, script: list[str]) -> list[Answer]:
        """Executes the lines; see measure/tf2/judge.cpp for what they may say."""
        result = subprocess.run(
            [self._program],
            input="\n".join(script) + "\n",
            capture_output=True,
            text=True,
            check=True,
        )
        lines = result.stdout.splitlines()
        assert len(lines) == len(script)
        return [parse(line) for line in lines]


def parse(line: str) -> Answer:
    """Reads one line of the driver's output."""
    word, _, rest = line.partition(" ")
    if word == "pose":
        stamp, *numbers = rest.split()
        pose = np.array([float.fromhex(number) for number in numbers])
        return Answer("pose", stamp=int(stamp), pose=pose)
    if word == "error":
        kind, _, text = rest.partition(" ")
        return Answer(kind, text=text)
    if word == "stamp":
        return Answer("stamp", stamp=int(rest))
    return Answer(word, text=rest)


def set_line(parent: str, child: str, stamp: int, pose: np.ndarray, *, static: bool) -> str:
    """The operation that stores T[parent<-child]; pose is [x y z qx qy qz qw]."""
    numbers = " ".join(float(value).hex() for value in pose)
    return f"set {int(static)} {stamp} {parent} {child} {numbers}"


def pose_difference(ours: np.ndarray, theirs: np.ndarray) -> np.ndarray:
    """How far poses, (7,) or (N, 7), are apart: relative to large translations, q and -q alike."""
    ours, theirs = np.atleast_2d(ours), np.atleast_2d(theirs)
    scale = np.maximum(1.0, np.abs(theirs[:, :3]).max(axis=1))
    translation = np.abs(ours[:, :3] - theirs[:, :3]).max(axis=1) / scale
    same = np.abs(ours[:, 3:] - theirs[:, 3:]).max(axis=1)
    opposite = np.abs(ours[:, 3:] + theirs[:, 3:]).max(axis=1)
    return np.asarray(np.maximum(translation, np.minimum(same, opposite)))
