"""De-skew a lidar scan: transform each point by the pose at its own stamp."""

from pathlib import Path

import numpy as np

import tfdb

buf = tfdb.load(Path(__file__).resolve().parent / "data" / "pr2.mcap")
path = buf.trajectory("map", "lidar")

# One revolution takes 100 ms: 16 rings of 1800 points around the sensor.
turn = np.repeat(np.linspace(0.0, 1.0, 1800, endpoint=False), 16)
height = np.tile(np.linspace(-0.5, 1.5, 16), 1800)
points = np.stack([8 * np.cos(2 * np.pi * turn), 8 * np.sin(2 * np.pi * turn), height], axis=1)
stamps = path.stamps[len(path.stamps) // 2] + (turn * 100_000_000).astype(np.int64)

straight = buf.transform_points("map", "lidar", points, stamps)
bent = buf.transform_points("map", "lidar", points, int(stamps[0]))
error = np.linalg.norm(straight - bent, axis=1)
print(f"{len(points)} points; with one pose for all, errors up to {error.max() * 100:.1f} cm")

# The same in place, in float32; poses are still computed in float64.
cloud = points.astype(np.float32)
buf.transform_points("map", "lidar", cloud, stamps, out=cloud)
print("float32 differs by", f"{np.abs(cloud - straight).max():.1e}", "m")

# Transform to the sensor's frame at the end of the revolution.
deskewed = buf.lookup_transform("lidar", "map", int(stamps[-1])).apply(straight)
print("the last point is unchanged:", np.allclose(deskewed[-1], points[-1], atol=1e-9))
