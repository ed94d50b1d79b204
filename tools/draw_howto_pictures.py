"""Draw the pictures of docs/howto/plots.md and compare_trajectories.md from examples/data.

Run it after a change of src/tfdb/plot: ``python tools/draw_howto_pictures.py [FOLDER]``.
"""

from __future__ import annotations

import io
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image

import tfdb
from tfdb import plot

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "docs" / "howto" / "plots"
RECORDING = ROOT / "examples" / "data" / "pr2.bag"
DPI = 95
COLOURS = 200


def spoiled(buf: tfdb.Buffer) -> Figure:
    """Draw three edges of the recording with a hole, late samples and a second publisher."""
    made = tfdb.Buffer(history=None)
    arrivals = {}
    for child in ("odom", "base_footprint", "torso_lift_link"):
        stamps, poses, parents = buf.samples(child)
        if child == "torso_lift_link":
            kept = np.abs(np.arange(len(stamps)) - 0.6 * len(stamps)) > 12
            stamps, poses = stamps[kept], poses[kept]
        made.set_transforms(tfdb.Columns(parents[0], child, stamps, poses))
        order = np.arange(len(stamps))
        who = ["/robot"] * len(stamps)
        if child == "odom":
            order[30:36] = order[30:36][::-1]
        if child == "base_footprint":
            who = ["/odometry" if i < 300 or i % 2 else "/ekf" for i in range(len(stamps))]
        arrivals[child] = plot.Arrivals(stamps[order], who)
    made.set_static_transform("base_footprint", "base_link", (0.0, 0.0, 0.05))
    return plot.timeline(made, arrivals=arrivals)


def pictures() -> dict[str, Figure]:
    """Return every picture by its name."""
    buf = tfdb.load(RECORDING)
    hands = ("base_footprint", "l_gripper_tool_frame", "r_gripper_tool_frame")
    return {
        "tree": plot.frame_tree(buf, rows=30),
        "timeline": plot.timeline(buf),
        "spoiled": spoiled(buf),
        "trajectory": plot.trajectory(*(buf.trajectory("map", frame) for frame in hands)),
        "speed": plot.trajectory(
            buf.trajectory("map", "l_gripper_tool_frame"), axes="xyz", color="speed"
        ),
        "compare": tfdb.compare(
            buf,
            buf,
            frames=("map", "base_link"),
            estimate_frames=("odom", "base_link"),
            delta=0.5,
            delta_unit="m",
        ).plot(),
    }


def main(folder: Path = FOLDER) -> None:
    """Write the pictures as small PNGs."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, figure in pictures().items():
        file = io.BytesIO()
        figure.savefig(file, format="png", dpi=DPI)
        whole = Image.open(file).convert("RGB")
        path = folder / f"{name}.png"
        whole.quantize(COLOURS, dither=Image.Dither.NONE).save(path, optimize=True)
        print(f"{path}: {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main(*(Path(given) for given in sys.argv[1:2]))
