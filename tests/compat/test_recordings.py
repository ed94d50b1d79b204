"""Poses from recordings: what tfdb loads natively against tf2 fed with the same messages.

The messages reach tf2 through rosbags' own decoder, so this also judges our decoders of ROS 1 and
CDR. Recordings of real robots lie beside the repository, in ../shared/data.
"""

from __future__ import annotations

import itertools
import os
import random
from pathlib import Path

import numpy as np
import pytest

import tfdb
from compat.exact_poses import evaluate
from compat.tf2_oracle import Tf2Oracle, pose_difference, set_line, unavailable

TOLERANCE = 1e-12
TF2_SLOW = 1e-7  # where tf2 does not interpolate a turn of less than 1.5e-8 rad, metres away
SECOND = 1_000_000_000
FOR_EVER = 10**9 * SECOND
PAIRS, STAMPS = 80, 40
REPOSITORY = Path(__file__).resolve().parents[2]
EXAMPLES = REPOSITORY / "examples" / "data"
SHARED = Path(os.environ.get("TFDB_SHARED_DATA", REPOSITORY.parent / "shared" / "data"))
RECORDINGS = [
    EXAMPLES / "pr2.bag",
    EXAMPLES / "pr2.mcap",
    SHARED / "panda" / "rosbagFrankaPanda.bag",
    SHARED / "panda" / "ros2",
    SHARED / "turtlebot3" / "rosbag2_turtlebot3_tf",
    SHARED / "turtlebot_nav" / "tf_example.bag",
    SHARED / "turtlebot_nav" / "tf_example",
]

Sample = tuple[str, str, int, np.ndarray]


def recorded(path: Path) -> tuple[list[Sample], list[Sample]]:
    """All static and all moving transforms of a recording, in its order, through rosbags."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    # One store for both worlds: what the files do not define themselves is read by these.
    store = get_typestore(Stores.ROS1_NOETIC if path.suffix == ".bag" else Stores.ROS2_JAZZY)
    definition = "geometry_msgs/TransformStamped[] transforms"
    for name in ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"):
        if name not in store.types:
            store.register(get_types_from_msg(definition, name))
    samples: tuple[list[Sample], list[Sample]] = ([], [])
    with AnyReader([path], default_typestore=store) as reader:
        wanted = [c for c in reader.connections if c.topic in {"/tf", "/tf_static"}]
        for connection, _, raw in reader.messages(wanted):
            for transform in reader.deserialize(raw, connection.msgtype).transforms:
                samples[connection.topic == "/tf"].append(plain(transform))
    return samples


def plain(message: object) -> Sample:
    """Parent, child, stamp in ns and pose of one message; one leading slash goes, as in tf2."""
    header, move = message.header, message.transform  # type: ignore[attr-defined]
    t, q = move.translation, move.rotation
    pose = np.array([t.x, t.y, t.z, q.x, q.y, q.z, q.w])
    child = message.child_frame_id  # type: ignore[attr-defined]
    stamp = header.stamp.sec * SECOND + header.stamp.nanosec
    return header.frame_id.removeprefix("/"), child.removeprefix("/"), stamp, pose


def tf2_script(static: list[Sample], moving: list[Sample]) -> list[str]:
    """The same data for tf2. Of a stamp sent twice it would keep the first; tfdb keeps the last."""
    last = {(child, stamp): (parent, child, stamp, pose) for parent, child, stamp, pose in moving}
    script = [f"reset {FOR_EVER}"]
    script += [set_line(p, c, s, pose, static=True) for p, c, s, pose in static]
    script += [set_line(p, c, s, pose, static=False) for p, c, s, pose in last.values()]
    return script


def questions(
    rng: random.Random, frames: list[str], moving: list[Sample]
) -> list[tuple[str, str, int]]:
    """Pairs of frames at stored stamps, between them, and a little outside."""
    stored = sorted({stamp for _, _, stamp, _ in moving})
    first, last = stored[0], stored[-1]
    pairs = list(itertools.permutations(frames, 2))
    asked = []
    for target, source in rng.sample(pairs, min(PAIRS, len(pairs))):
        for _ in range(STAMPS):
            anywhere = rng.randrange(first - SECOND // 10, last + SECOND // 10)
            asked.append((target, source, rng.choice([anywhere, rng.choice(stored)])))
    return asked


@pytest.mark.parametrize("path", RECORDINGS, ids=lambda path: f"{path.parent.name}-{path.name}")
def test_poses_agree_with_tf2(tf2: Tf2Oracle, path: Path) -> None:
    pytest.importorskip("rosbags")
    if not path.exists():
        unavailable(f"the recording {path.name} is not there")
    static, moving = recorded(path)
    buffer = tfdb.load(path)
    script = tf2_script(static, moving)
    # A number that names the recording, the same in every run: str hashes are salted.
    asked = questions(random.Random(len(moving)), buffer.frames(), moving)
    answers = tf2.run(script + [f"get {t} {s} {stamp}" for t, s, stamp in asked])
    assert all(answer.word == "ok" for answer in answers[: len(script)])

    found = slow = 0
    by_name = {c: pose for _, c, _, pose in static}, {(c, t): pose for _, c, t, pose in moving}
    for (target, source, stamp), theirs in zip(asked, answers[len(script) :], strict=True):
        where = f"{target} <- {source} at {stamp}: {theirs}"
        if theirs.pose is None:
            with pytest.raises((tfdb.Extrapolation, tfdb.Disconnected)):
                buffer.lookup_transform(target, source, stamp)
            continue
        found += 1
        ours = buffer.lookup_transform(target, source, stamp)
        assert ours.stamp == theirs.stamp, where
        exact, blind = evaluate(ours, *by_name)
        slow += blind
        assert pose_difference(ours.pose, exact)[0] <= TOLERANCE, where
        assert pose_difference(ours.pose, theirs.pose)[0] <= (TF2_SLOW if blind else TOLERANCE), (
            where
        )
    print(f"{found} poses of {len(asked)} questions agree, {slow} where tf2 misses a slow turn")
    assert found > len(asked) // 4


@pytest.mark.parametrize("path", RECORDINGS, ids=lambda path: f"{path.parent.name}-{path.name}")
def test_batches_agree_with_tf2(tf2: Tf2Oracle, path: Path) -> None:
    """Whole trajectories: every stored stamp of the busiest edge, asked in one batch."""
    pytest.importorskip("rosbags")
    if not path.exists():
        unavailable(f"the recording {path.name} is not there")
    static, moving = recorded(path)
    buffer = tfdb.load(path)
    children = [child for _, child, _, _ in moving]
    child = max(set(children), key=children.count)
    parent = next(p for p, c, _, _ in moving if c == child)
    stamps = np.array(sorted({stamp for _, c, stamp, _ in moving if c == child}), dtype=np.int64)
    stamps = np.sort(np.concatenate([stamps, (stamps[:-1] + stamps[1:]) // 2]))
    script = tf2_script(static, moving)
    answers = tf2.run(script + [f"get {parent} {child} {stamp}" for stamp in stamps])
    theirs = np.array([answer.pose for answer in answers[len(script) :]])
    ours = buffer.lookup_transforms(parent, child, stamps)
    by_name = {c: pose for _, c, _, pose in static}, {(c, t): pose for _, c, t, pose in moving}
    singles = (buffer.lookup_transform(parent, child, stamp) for stamp in stamps)
    exact, blind = zip(*(evaluate(single, *by_name) for single in singles), strict=True)
    assert pose_difference(ours, np.array(exact)).max() <= TOLERANCE
    allowed = np.where(blind, TF2_SLOW, TOLERANCE)
    assert (pose_difference(ours, theirs) <= allowed).all()
