"""A recording from end to end: tree, one lookup, a trajectory, a scan, pictures.

    python examples/demo.py [RECORDING] [--target FRAME] [--source FRAME] [--out FOLDER]

`make demo` runs it on the recording that ships; `make demo BAG=my.bag` on your own.
"""

from __future__ import annotations

import argparse
import time
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.image import imsave

import tfdb
import tfdb.plot
from tfdb.cli import layout
from tfdb.cli.tree import print_tree
from tfdb.store.summary import longest_moving_chain

if TYPE_CHECKING:
    from collections.abc import Iterator

    from matplotlib.figure import Figure

HERE = Path(__file__).resolve().parent
STAMPS = 10_000
SCAN_POINTS = 20_000
SWEEP_NS = 100_000_000
FEW_FRAMES = 32  # in the tree beside the trajectory

took: list[tuple[str, float]] = []


@contextmanager
def step(name: str) -> Iterator[None]:
    """Print a heading and remember how long the block took."""
    print(f"\n== {name}")
    start = time.perf_counter()
    yield
    took.append((name, time.perf_counter() - start))


@contextmanager
def clock(name: str) -> Iterator[None]:
    """Print how long the block alone took: printing and drawing are not in it."""
    start = time.perf_counter()
    yield
    seconds = time.perf_counter() - start
    print(f"   {name}: {duration(seconds)}")


def duration(seconds: float) -> str:
    if seconds < 1e-3:
        return f"{seconds * 1e6:.1f} us"
    return f"{seconds * 1e3:.1f} ms" if seconds < 1 else f"{seconds:.2f} s"


def scan_frame(buf: tfdb.Buffer, target: str, otherwise: str) -> str:
    """A frame that sounds like a lidar and that moves in the target, if there is one."""
    names = sorted(buf.frames(), key=lambda name: ("lidar" not in name, name))
    for name in names:
        if any(word in name.lower() for word in ("lidar", "laser", "velodyne", "scan")):
            found = buf.explain(target, name)
            if found.ok and len(found.edges) > 1:
                return name
    return otherwise


def synthetic_scan(frame_start: int) -> tuple[np.ndarray, np.ndarray]:
    """One turn of a spinning lidar: points on a cylinder, and the stamp of each point."""
    turn = np.linspace(0.0, 1.0, SCAN_POINTS, endpoint=False)
    angle = 2 * np.pi * turn
    height = np.tile(np.linspace(-0.5, 1.5, 16), SCAN_POINTS // 16 + 1)[:SCAN_POINTS]
    points = np.stack([8 * np.cos(angle), 8 * np.sin(angle), height], axis=1)
    stamps = frame_start + (turn * SWEEP_NS).astype(np.int64)
    return points, stamps


def choose_frames(buf: tfdb.Buffer, target: str | None, source: str | None) -> tuple[str, str]:
    """What the user asked for; for the rest, the ends of the longest moving chain."""
    if target and source:
        return target, source
    chain = longest_moving_chain(buf.tree())
    if chain is None:
        raise SystemExit("nothing moves in this recording: choose --target and --source")
    return target or chain[0], source or chain[1]


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Look at a recording of transforms.")
    default = HERE / "data" / "pr2.bag"
    parser.add_argument("recording", nargs="?", default=default, type=Path)
    parser.add_argument("--target", help="frame to express poses in")
    parser.add_argument("--source", help="frame whose poses are wanted")
    parser.add_argument("--out", default=Path("out"), type=Path, help="folder for the pictures")
    return parser.parse_args()


def main() -> None:
    asked = arguments()
    with step(f"Load {asked.recording.name}"):
        buf = tfdb.Buffer(history=None)
        with clock("reading and storing"):
            report = buf.load(asked.recording)
        print(f"   {report.messages:,} messages, {report.transforms:,} transforms")

    with step("Frame tree"):
        print_tree(buf)

    target, source = choose_frames(buf, asked.target, asked.source)
    with step(f"One transform: {source} in {target}"):
        path = buf.trajectory(target, source)
        first, last = int(path.stamps[0]), int(path.stamps[-1])
        middle = (first + last) // 2
        with clock("lookup_transform"):
            found = buf.lookup_transform(target, source, middle)
        print(f"   translation {np.array2string(found.translation, precision=4)} m")
        print(f"   rotation    {np.array2string(found.rotation, precision=4)} x y z w")
        for edge in found.report.edges:
            gap = f", gap {duration(edge.gap / 1e9)}" if edge.gap else ""
            text = f"   {edge.child} in {edge.parent}: {edge.used}{gap}"
            print(layout.wrap(layout.words(text, edge.child, edge.parent), " " * 6))

    with step(f"A trajectory: {STAMPS:,} stamps in one call"):
        stamps = first + np.linspace(0, last - first, STAMPS).astype(np.int64)
        with clock(f"lookup_transforms, {len(stamps):,} poses"):
            poses = buf.lookup_transforms(target, source, stamps)
        way = np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1)
        turn = 1 - np.abs(np.sum(poses[1:, 3:] * poses[:-1, 3:], axis=1))
        busiest = int(stamps[np.argmax(way + turn)])
        print(f"   {source} travels {way.sum():.2f} m in {target} in {(last - first) / 1e9:.1f} s")

    sensor = asked.source or scan_frame(buf, target, source)
    with step(f"A scan of {SCAN_POINTS:,} points from {sensor}, each at its own stamp"):
        points, when = synthetic_scan(min(busiest, max(first, last - SWEEP_NS)))
        when = when.clip(first, last)
        with clock("transform_points"):
            straight = buf.transform_points(target, sensor, points, when)
        at_once = buf.transform_points(target, sensor, points, int(when[0]))
        off = np.linalg.norm(straight - at_once, axis=1).max()
        print(f"   with one stamp for all, points would be off by up to {off * 100:.1f} cm")

    with step(f"Pictures in {asked.out}/"):
        draw(buf, path, asked.out)

    print("\n== Time of each step, printing and drawing included")
    for name, seconds in took:
        print(f"   {duration(seconds):>9}  {name}")


def draw(buf: tfdb.Buffer, path: tfdb.Trajectory, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    pictures = {
        "trajectory.png": lambda: tfdb.plot.trajectory(path),
        "frame_tree.png": lambda: tfdb.plot.frame_tree(buf),
        "timeline.png": lambda: tfdb.plot.timeline(buf),
    }
    for name, make in pictures.items():
        with clock(str(folder / name)):
            make().savefig(folder / name)
    with clock(str(folder / "robot.png")):
        few = tfdb.plot.frame_tree(buf, rows=FEW_FRAMES)
        imsave(folder / "robot.png", side_by_side(few, tfdb.plot.trajectory(path)))


def side_by_side(*figures: Figure) -> np.ndarray:
    """Pixels of several figures in one picture."""
    pictures = []
    for figure in figures:
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        pictures.append(np.asarray(canvas.buffer_rgba()))
    tallest = max(len(picture) for picture in pictures)
    middle = [(tallest - len(picture)) // 2 for picture in pictures]
    return np.hstack(
        [
            np.pad(
                picture,
                ((above, tallest - len(picture) - above), (0, 0), (0, 0)),
                constant_values=255,
            )
            for picture, above in zip(pictures, middle, strict=True)
        ]
    )


if __name__ == "__main__":
    main()
