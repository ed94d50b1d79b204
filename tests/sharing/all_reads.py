"""A store filled in every way, and the results of every kind of read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import tfdb
from tests.oracle import quaternion

TURN = quaternion((1, -2, 0.5), 0.9)
BACK = quaternion((0, 1, 3), -1.4)
RECORDING = Path(__file__).resolve().parents[2] / "examples" / "data" / "pr2.mcap"
POLICIES = (
    None,
    tfdb.Exact(),
    tfdb.Previous(),
    tfdb.Nearest(),
    tfdb.Extrapolate(1.0),
    tfdb.Interpolate(max_gap=1e-9),
)
STAMPS = [5, 10, 14, 20, 25, 30, 31]


def fill(buffer: tfdb.Buffer) -> None:
    """Write in every way that there is."""
    random = np.random.default_rng(3)
    for stamp in (10, 30, 20):  # the last one comes late
        buffer.set_transform("map", "base", stamp, (stamp, 1, 2), TURN, authority="ekf")
    buffer.set_static_transform("base", "camera", (0, 0.5, 1), BACK, authority="urdf")
    stamps = np.arange(10, 40, dtype=np.int64)
    poses = random.normal(size=(30, 7))
    poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
    buffer.set_transforms(tfdb.Columns("base", "arm", stamps, poses), authority="arm")
    hand = [tfdb.TransformStamped("arm", "hand", t, (t, 0, 1), BACK) for t in (10, 20, 30)]
    buffer.set_transforms(hand)
    buffer.ingest(tfdb.encode_tf_message(hand[:2]), authority="wire")
    for parent, stamp in (("map", 12), ("base", 22)):
        buffer.set_transform(parent, "cart", stamp, (stamp, 3, 1), TURN)
    with buffer.transaction() as tx:
        seen = tx.lookup_transform("map", "hand", 20)
        tx.set_transform("map", "seen", 20, seen.translation, seen.rotation)
    buffer.run(lambda tx: tx.set_transform("seen", "beyond", 20, (1, 2, 3), TURN))
    buffer.set_transform("map", "gone", 20, (1, 2, 3), TURN)
    buffer.remove_frames("gone")
    buffer.set_static_transform("map", "dock", (1, 2, 3), TURN)
    buffer.set_transform("map", "dock", 20, (3, 2, 1), BACK, change_kind=True)


def said(ask: Any) -> str:
    """An answer or an error, to the last bit."""
    try:
        found = ask()
    except tfdb.TfdbError as error:
        fields = {key: value for key, value in vars(error).items() if not key.startswith("_")}
        return f"{type(error).__name__}: {error} {fields}"
    return plain(found)


def plain(found: Any) -> str:
    if isinstance(found, np.ndarray):
        return f"{found.dtype} {found.shape} {found.tobytes().hex()}"
    if isinstance(found, tuple | list):
        return repr([plain(part) for part in found])
    if isinstance(found, tfdb.Transform):
        return f"{found.stamp} {found.target} {found.source} {plain(found.pose)} {found.report}"
    if isinstance(found, tfdb.Trajectory):
        return plain([found.stamps, found.poses])
    return str(found)


def answers(buffer: tfdb.Buffer) -> dict[str, str]:
    """Every kind of read, of the store, of a snapshot and of a transaction."""
    told = {}
    with buffer.snapshot() as snapshot:
        for kind, reads in (("buffer", buffer), ("snapshot", snapshot)):
            told |= {f"{kind} {key}": text for key, text in _reads(reads).items()}
    with buffer.transaction() as tx:
        told |= {f"transaction {key}": text for key, text in _lookups(tx).items()}
        tx.abort()
    told["commit"] = plain(buffer.commit)
    told["history"] = plain(buffer.history)
    return told


def _lookups(reads: tfdb._core.StoreReader | tfdb.Transaction) -> dict[str, str]:
    told = {}
    for target, source in (("map", "hand"), ("camera", "hand"), ("seen", "cart"), ("map", "x")):
        for policy in POLICIES:
            key = f"{target} {source} {policy}"
            for stamp in (None, *STAMPS):
                told[f"lookup {key} {stamp}"] = said(
                    lambda p=(target, source, stamp, policy): reads.lookup_transform(*p)
                )
            told[f"rows {key}"] = said(
                lambda p=(target, source, STAMPS, policy): reads.lookup_transforms(
                    *p, missing="nan"
                )
            )
        told[f"common {target} {source}"] = said(lambda p=(target, source): reads.common_times(*p))
    return told


def _reads(reads: tfdb._core.StoreReader) -> dict[str, str]:
    told = _lookups(reads)
    points = np.linspace(-3.0, 4.0, 9).reshape(3, 3)
    asked = {
        "points": lambda: reads.transform_points("map", "hand", points, 20),
        "scan": lambda: reads.transform_points("camera", "hand", points, [10, 14, 20]),
        "latest": lambda: reads.lookup_latest_transform("map", "hand"),
        "full": lambda: reads.lookup_transform_full("base", 14, "hand", 20, "map"),
        "velocity": lambda: reads.lookup_velocity("hand", "map", 20, 4e-9),
        "trajectory": lambda: reads.trajectory("map", "hand"),
        "rate": lambda: reads.trajectory("map", "hand", rate=5e8),
        "explain": lambda: reads.explain("map", "hand", 14),
        "explain none": lambda: reads.explain("map", "hand", 99),
        "tree": reads.tree,
        "tree then": lambda: reads.tree(12),
        "frames": lambda: sorted(reads.frames()),
        "can": lambda: [reads.can_transform("map", "hand", stamp) for stamp in STAMPS],
        "parents": lambda: [reads.parent_of("cart", stamp) for stamp in (12, 15, 22)],
        "gone": lambda: reads.frame_info("gone"),
    }
    for frame in reads.frames():
        asked[f"samples {frame}"] = lambda frame=frame: reads.samples(frame)
        asked[f"info {frame}"] = lambda frame=frame: reads.frame_info(frame)
    return told | {key: said(ask) for key, ask in asked.items()}
