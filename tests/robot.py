"""A small robot for the tests: the same moving and static edges in a store and in the oracle."""

from __future__ import annotations

from dataclasses import dataclass

import tfdb
from oracle import Store, quaternion, wobble

SECOND = 1_000_000_000
PERIOD = SECOND // 10
START = 1_700_000_000 * SECOND
COUNT = 40

# child -> parent: two arms under a moving base; the sensors are bolted on.
MOVING = {
    "odom": "map",
    "base": "odom",
    "left_arm": "base",
    "left_hand": "left_arm",
    "right_arm": "base",
}
STATIC = {"camera": "left_hand", "lidar": "base"}


@dataclass
class Robot:
    """The same robot twice."""

    buffer: tfdb.Buffer
    oracle: Store


def stamp_of(index: float) -> int:
    """Stamp of a sample; halves lie between two."""
    return START + round(index * PERIOD)


def make_robot(history: float | None = None) -> Robot:
    """Fill a store and the oracle with `COUNT` samples of every moving edge."""
    robot = Robot(tfdb.Buffer(history=history), Store())
    for seed, (child, parent) in enumerate(STATIC.items()):
        pose = (0.1 + seed, -0.2, 0.3, *quaternion((1, 2, 3 + seed), 1.1 + seed))
        robot.buffer.set_static_transform(parent, child, pose[:3], pose[3:], authority="urdf")
        robot.oracle.add_static(parent, child, pose)
    for index in range(COUNT):
        batch = []
        for seed, (child, parent) in enumerate(MOVING.items()):
            pose = wobble(seed, index * PERIOD / SECOND)
            stamp = stamp_of(index)
            batch.append(tfdb.TransformStamped(parent, child, stamp, pose[:3], pose[3:]))
            robot.oracle.add(parent, child, stamp, pose)
        robot.buffer.set_transforms(batch, authority="joints")
    return robot
