"""Load a recording, and get thousands of poses as numpy arrays in one call."""

from pathlib import Path

import numpy as np

import tfdb

DATA = Path(__file__).resolve().parent / "data"

buf = tfdb.Buffer(history=None)  # None keeps everything
report = buf.load(DATA / "pr2.mcap")
print(report.messages, "messages,", report.transforms, "transforms,", len(buf.frames()), "frames")

info = buf.frame_info("base_footprint")
print(f"{info.parent} <- {info.name}: {info.samples} samples, {info.rate:.1f} Hz")

# Evenly spaced poses of the base in the map, while all edges between them have data.
path = buf.trajectory("map", "base_link", rate=100.0)
print(path.stamps.shape, path.poses.shape)  # (N,) int64 and (N, 7): x y z qx qy qz qw

# Poses at your own stamps, sorted or not, all from one snapshot.
rng = np.random.default_rng(1)
stamps = rng.integers(path.stamps[0], path.stamps[-1], 5_000)
poses = buf.lookup_transforms("map", "l_gripper_tool_frame", stamps)
single = buf.lookup_transform("map", "l_gripper_tool_frame", int(stamps[17]))
assert np.allclose(poses[17], single.pose, atol=1e-12)
matrices = buf.lookup_transforms("map", "l_gripper_tool_frame", stamps, layout="matrix")
print(poses.shape, matrices.shape)

# A stamp without a pose raises an error, or gives NaN with missing="nan".
early = path.stamps[:5] - 60_000_000_000
print(np.isnan(buf.lookup_transforms("map", "base_link", early, missing="nan")).all())
