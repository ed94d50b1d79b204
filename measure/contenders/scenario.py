"""The moving chain that every contender stores: f0 <- f1 <- ... at 1 kHz, pure Python.

The epoch is small on purpose: Debian's tf2_py passes each stamp through a double, which is exact to
the nanosecond at 1,000 s and not at today's 1.8e9 s.
"""

from __future__ import annotations

import math
import random

START = 1_000 * 10**9
PERIOD = 1_000_000

Pose = tuple[float, float, float, float, float, float, float]


def moving_pose(edge: int, t: float) -> Pose:
    """T[parent<-child] of one edge as x y z qx qy qz qw: smooth, never an identity."""
    phase = 0.37 * edge
    angle = 0.6 + 0.9 * t + 0.3 * math.sin(0.5 * t + phase)  # never at rest
    tilt = 0.9 + 0.1 * edge
    s, c = math.sin(angle / 2), math.cos(angle / 2)
    return (
        0.3 + math.sin(t + phase),
        0.2 * edge + 0.5 * math.cos(0.7 * t),
        0.1 + 0.05 * t,
        s * math.sin(tilt),
        s * 0.6 * math.cos(tilt),
        s * 0.8 * math.cos(tilt),
        c,
    )


def names(chain: int) -> list[str]:
    """Frames of a chain, the root first."""
    return [f"frame_{i}" for i in range(chain + 1)]


def samples(count: int) -> list[int]:
    """Stamps of the stored samples."""
    return [START + i * PERIOD for i in range(count)]


NEAR = 1e-3
"""Metres and radians by which a path of few poses may be off."""

FEW = (1, 4, 16, 64)
"""Stamps in one call, where a call has few."""
SPANS = (("", 10_000), (", 0.1 s scan", 100))
"""Over how many of the newest samples stamps are spread."""


def poses(edge: int, first: int, count: int) -> list[Pose]:
    """Poses of the samples `first`, `first + 1`, ..."""
    return [moving_pose(edge, 1e-3 * i) for i in range(first, first + count)]


def mid_stamps(stored: int, count: int = 1_024) -> list[int]:
    """Stamps between two samples, about ten back from the newest one."""
    newest = START + (stored - 1) * PERIOD
    rng = random.Random(7)
    stamps = (newest - rng.randrange(8 * PERIOD, 12 * PERIOD) for _ in range(count))
    return [stamp + (stamp % PERIOD == 0) for stamp in stamps]


def spread_stamps(stored: int, count: int, *, span: int, is_sorted: bool) -> list[int]:
    """Random stamps over the newest `span` samples, or over all if there are fewer."""
    newest = START + (stored - 1) * PERIOD
    oldest = max(START, newest - span * PERIOD)
    rng = random.Random(11)
    stamps = [rng.randrange(oldest, newest) for _ in range(count)]
    return sorted(stamps) if is_sorted else stamps
