"""Pictures: what is on them, and that labels stay apart."""

from __future__ import annotations

from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest

import tfdb

matplotlib = pytest.importorskip("matplotlib")
agg = pytest.importorskip("matplotlib.backends.backend_agg")
plot = pytest.importorskip("tfdb.plot")

MS = 1_000_000
UNIT = (0.0, 0.0, 0.0, 1.0)


def path(count: int = 50) -> SimpleNamespace:
    angle = np.linspace(0, 3, count)
    poses = np.zeros((count, 7))
    poses[:, 0], poses[:, 1], poses[:, 6] = 3 * np.cos(angle), np.sin(angle), 1
    stamps = 5_000_000_000 + np.arange(count) * 100 * MS
    return SimpleNamespace(target="map", source="base_link", stamps=stamps, poses=poses)


def texts(figure: object) -> list[str]:
    return [text.get_text() for text in figure.findobj(matplotlib.text.Text)]


def robot(arms: int = 6, joints: int = 12) -> tfdb.Buffer:
    buf = tfdb.Buffer(history=None)
    for i in range(20):
        batch = [
            tfdb.TransformStamped("map", "a frame with a long name", i * 100 * MS, (i, 0, 0), UNIT)
        ]
        for arm in range(arms):
            parent = "a frame with a long name"
            for joint in range(joints):
                child = f"arm_{arm}_joint_{joint}" + "_link" * (joint % 4)
                batch.append(tfdb.TransformStamped(parent, child, i * 100 * MS, (0.1, 0, 0), UNIT))
                parent = child
        buf.set_transforms(batch)
    for i in range(8):
        buf.set_static_transform("map", f"wall_${i}$", (float(i), 0.0, 0.0))
    return buf


def test_labels_of_a_large_tree_do_not_overlap() -> None:
    buf = robot()
    figure = plot.frame_tree(buf)
    canvas = agg.FigureCanvasAgg(figure)
    canvas.draw()
    renderer = canvas.get_renderer()
    names = set(buf.frames())
    axes = figure.axes[0]
    shown = [text for text in axes.texts if text.get_text()]
    assert names <= {text.get_text() for text in shown}
    assert len(names) > 60
    boxes = [text.get_window_extent(renderer) for text in shown]
    for (one, a), (other, b) in combinations(zip(shown, boxes, strict=True), 2):
        apart = a.x1 <= b.x0 or b.x1 <= a.x0 or a.y1 <= b.y0 or b.y1 <= a.y0
        assert apart, f"{one.get_text()} and {other.get_text()} overlap"
    assert all(box.x0 >= 0 and box.x1 <= figure.bbox.x1 and box.y0 >= 0 for box in boxes)


def test_tree_takes_a_store_a_snapshot_or_a_list() -> None:
    buf = robot(1, 2)
    with buf.snapshot() as snap:
        counts = {len(plot.frame_tree(it).axes[0].texts) for it in (buf, snap, buf.tree())}
    assert len(counts) == 1


def test_tree_of_nothing() -> None:
    figure = plot.frame_tree([])
    figure.canvas.draw()
    assert any("0 frames" in text for text in texts(figure))


def test_timeline_has_a_row_for_each_edge() -> None:
    buf = robot(2, 3)
    figure = plot.timeline(buf)
    rows = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    assert sorted(rows) == sorted(info.name for info in buf.tree() if info.parent is not None)
    assert rows[-1].startswith("wall_")


def test_timeline_counts_gaps() -> None:
    buf = tfdb.Buffer(history=None)
    for i in [*range(600), *range(650, 1200)]:
        buf.set_transform("odom", "base", i * 10 * MS, (i, 0, 0), UNIT)
    figure = plot.timeline(buf)
    assert any("1 gap" in text for text in texts(figure))
    assert any("no gaps" in text for text in texts(plot.timeline(buf, max_gap=1.0)))


def test_timeline_of_nothing() -> None:
    plot.timeline(tfdb.Buffer()).canvas.draw()


def test_pictures_open_no_window_and_leave_no_state() -> None:
    import sys

    before = "matplotlib.pyplot" in sys.modules
    plot.trajectory(path())
    assert ("matplotlib.pyplot" in sys.modules) == before


def test_pictures_can_be_saved(tmp_path: object) -> None:
    for suffix in ("png", "svg", "pdf"):
        target = tmp_path / f"tree.{suffix}"
        plot.frame_tree(robot(1, 3)).savefig(target)
        assert target.stat().st_size > 1000
