"""Pictures: their contents, and labels without overlaps."""

from __future__ import annotations

import subprocess
import sys
from itertools import pairwise

import pytest

import tfdb

matplotlib = pytest.importorskip("matplotlib")
plot = pytest.importorskip("tfdb.plot")
from .legible import assert_legible  # noqa: E402

MS = 1_000_000
UNIT = (0.0, 0.0, 0.0, 1.0)


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


def big_robot(frames: int = 300) -> tfdb.Buffer:
    """A robot of many arms: every third joint moves, and each has a static part."""
    buf = tfdb.Buffer(history=None)
    moving, static = [], []
    for i in range(frames // 2):
        parent = "base" if i % 10 == 0 else f"arm_{i // 10}/joint_{i % 10 - 1}"
        child = f"arm_{i // 10}/joint_{i % 10}"
        (moving if i % 3 else static).append((parent, child))
        static.append((child, f"{child}/mesh_$x^2$"))
    for tick in range(30):
        buf.set_transforms(
            [
                tfdb.TransformStamped(parent, child, tick * 100 * MS, (0.1, 0, 0), UNIT)
                for parent, child in moving
            ]
        )
    for parent, child in static:
        buf.set_static_transform(parent, child, (0.0, 0.1, 0.0))
    return buf


def test_every_frame_of_a_tree_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    buf = robot()
    shown = assert_legible(plot.frame_tree(buf), monkeypatch)
    assert set(buf.frames()) <= set(shown)
    assert shown.count("10 Hz") == 1 + 6 * 12


def test_a_child_stands_below_and_right_of_its_parent() -> None:
    buf = robot(2, 3)
    at = {text.get_text(): text.get_position() for text in plot.frame_tree(buf).axes[0].texts}
    for info in buf.tree():
        if info.parent is not None:
            assert at[info.name][0] > at[info.parent][0]
            assert at[info.name][1] > at[info.parent][1]


@pytest.mark.parametrize("rows", [4, 20, 60, 100])
def test_big_trees_are_folded(rows: int, monkeypatch: pytest.MonkeyPatch) -> None:
    buf = big_robot()
    frames = len(buf.frames())
    assert frames > 300
    shown = assert_legible(plot.frame_tree(buf, rows=rows), monkeypatch)
    folds = [text for text in shown if text.startswith("+ ")]
    drawn = [text for text in shown if text in set(buf.frames())]
    assert folds
    assert len(drawn) + len(folds) <= rows
    # Every frame is drawn or counted, none twice.
    folded = sum(int(text.split()[1]) for text in folds)
    assert len(drawn) + folded == frames
    assert any(f"{folded} frames are folded" in text for text in shown)


def deep_statics() -> tfdb.Buffer:
    """An arm that moves, and cameras whose static parts hang below one another, two abreast."""
    buf = tfdb.Buffer(history=None)
    for joint in range(6):
        buf.set_transform(f"joint_{joint}", f"joint_{joint + 1}", 0, (1, 0, 0), UNIT)
    for camera in range(3):
        parent = f"joint_{2 * camera}"
        for level in range(4):
            child = f"camera_{camera}/{level}"
            buf.set_static_transform(parent, child, (1, 0, 0))
            buf.set_static_transform(parent, f"{child}_optical", (1, 0, 0))
            parent = child
    return buf


def test_no_more_rows_than_asked_for_are_drawn() -> None:
    buf = deep_statics()
    names = set(buf.frames())
    for rows in range(1, len(names)):
        shown = texts(plot.frame_tree(buf, rows=rows))
        folds = [int(text.split()[1]) for text in shown if text.startswith("+ ")]
        drawn = len(names.intersection(shown))
        # Of a root alone all is folded, into one row more.
        assert drawn + len(folds) <= max(rows, 2)
        assert drawn + sum(folds) == len(names)
        assert any(text.endswith(f"; {sum(folds)} frames are folded") for text in shown)


def test_static_subtrees_are_folded_first() -> None:
    buf = robot()
    shown = texts(plot.frame_tree(buf, rows=80))
    assert set(buf.frames()) - set(shown) == {f"wall_${i}$" for i in range(8)}
    assert "+ 8 static frames" in shown


def test_nothing_is_folded_unless_need_be() -> None:
    buf = big_robot()
    assert set(buf.frames()) <= set(texts(plot.frame_tree(buf, rows=None)))
    assert not [text for text in texts(plot.frame_tree(robot(1, 3))) if text.startswith("+ ")]


@pytest.mark.parametrize("rows", [0, -3, 2.5, "10", True])
def test_bad_numbers_of_rows(rows: object) -> None:
    with pytest.raises(tfdb.InvalidArgument, match="rows must be an integer of at least 1"):
        plot.frame_tree([], rows=rows)
    with pytest.raises(tfdb.InvalidArgument, match="rows must be an integer of at least 1"):
        plot.timeline(tfdb.Buffer(), rows=rows)


@pytest.mark.parametrize("given", [None, 7, ["map"], "map"])
def test_objects_without_frames_are_refused(given: object) -> None:
    with pytest.raises(tfdb.InvalidArgument, match="must be a"):
        plot.frame_tree(given)
    with pytest.raises(tfdb.InvalidArgument, match="must be a"):
        plot.timeline(given)


def test_tree_takes_a_store_a_snapshot_or_a_list() -> None:
    buf = robot(1, 2)
    with buf.snapshot() as snap:
        counts = {len(plot.frame_tree(it).axes[0].texts) for it in (buf, snap, buf.tree())}
    assert len(counts) == 1


def test_tree_of_nothing() -> None:
    figure = plot.frame_tree([])
    figure.canvas.draw()
    assert any("0 frames" in text for text in texts(figure))


def test_deep_chains_stay_in_the_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    buf = tfdb.Buffer(history=None)
    for i in range(120):
        buf.set_static_transform(f"link_{i}", f"link_{i + 1}", (0.1, 0, 0))
    figure = plot.frame_tree(buf, rows=None)
    assert_legible(figure, monkeypatch)
    assert figure.get_figwidth() < 10


def test_timeline_is_sorted_as_the_tree_and_folds_statics() -> None:
    buf = robot(2, 3)
    buf.set_transform("map", "zebra", 100 * MS, (1, 0, 0), UNIT)
    shown = texts(plot.timeline(buf))
    rows = [text for text in shown if text in set(buf.frames())]
    long = "a frame with a long name"
    arms = [name for arm in range(2) for name in sorted(n for n in rows if n[:5] == f"arm_{arm}")]
    assert rows == [long, *arms, "zebra"]
    assert "8 static edges" in shown
    assert not [text for text in shown if text.startswith("wall_")]


def test_timeline_counts_gaps() -> None:
    buf = tfdb.Buffer(history=None)
    for i in [*range(600), *range(650, 1200)]:
        buf.set_transform("odom", "base", i * 10 * MS, (i, 0, 0), UNIT)
    figure = plot.timeline(buf)
    assert any("1 gap" in text for text in texts(figure))
    # In seconds, as of Interpolate.
    assert any("no gaps" in text for text in texts(plot.timeline(buf, max_gap=1.0)))
    assert any("1 gap" in text for text in texts(plot.timeline(buf, max_gap=0.4)))
    with pytest.raises(tfdb.InvalidArgument, match="max_gap"):
        plot.timeline(buf, max_gap=-1.0)


def test_timeline_marks_late_data_and_publishers(monkeypatch: pytest.MonkeyPatch) -> None:
    buf = tfdb.Buffer(history=None)
    order = [0, 1, 2, 5, 3, 4, 6, 7, 8, 9]
    for i in order:
        buf.set_transform("odom", "base_$x$", i * 100 * MS, (i, 0, 0), UNIT)
    buf.set_static_transform("base_$x$", "camera", (1, 0, 0))
    assert "10 Hz, 2 late" in texts(plot.timeline(buf))  # the store knows so much
    who = ["/amcl", "/ekf"] * 5
    came = plot.Arrivals([i * 100 * MS for i in order], who)
    figure = plot.timeline(buf, arrivals={"base_$x$": came})
    shown = assert_legible(figure, monkeypatch)
    assert {"10 Hz, 2 late, 2 publishers", "by /amcl", "by /ekf", "came late"} <= set(shown)
    axes = figure.axes[0]
    (marks,) = [line for line in axes.get_lines() if line.get_marker() == "v"]
    assert marks.get_xdata().tolist() == pytest.approx([0.3, 0.4])
    strokes = [
        {round(float(piece[0][0]), 6) for piece in lines.get_segments()}
        for lines in axes.collections
        if len(lines.get_segments())
    ]
    for name in ("/amcl", "/ekf"):
        sent = {i / 10 for i, by in zip(order, who, strict=True) if by == name}
        assert sent in strokes


@pytest.mark.parametrize("rows", [1, 7, 40, 100])
def test_timelines_of_many_edges_are_folded(rows: int, monkeypatch: pytest.MonkeyPatch) -> None:
    buf = big_robot()
    shown = assert_legible(plot.timeline(buf, rows=rows), monkeypatch)
    moving = {info.name for info in buf.tree() if info.parent and not info.is_static}
    folds = [int(text.split()[1]) for text in shown if text.startswith("+ ")]
    drawn = [text for text in shown if text in moving]
    assert folds
    assert len(drawn) + len(folds) + 1 <= max(rows, 2)
    # Every edge is drawn or counted, none twice.
    assert len(drawn) + sum(folds) == len(moving) == 100
    assert any(f"{sum(folds)} are folded" in text for text in shown)
    assert f"{sum(info.is_static for info in buf.tree())} static edges" in shown


def test_a_folded_row_has_the_samples_gaps_and_late_data_of_all() -> None:
    buf = tfdb.Buffer(history=None)
    # Two edges that take turns: together without a hole, but for 500 to 900 ms.
    ticks = {"left": [0, 200, 400, 1000, 1200], "right": [100, 300, 500, 900, 1100]}
    for child, order in ticks.items():
        for ms in [*order[:2], order[3], order[2], order[4]]:
            buf.set_transform("base", child, ms * MS, (1, 0, 0), (0.0, 0.6, 0.0, 0.8))
    sent = [ms * MS for ms in (0, 200, 1000, 400, 1200)]
    came = {"left": plot.Arrivals(sent, ["/a", "/b", "/a", "/b", "/a"])}
    figure = plot.timeline(buf, rows=1, max_gap=0.35, arrivals=came)
    shown = texts(figure)
    assert "+ 2 moving edges" in shown
    assert "2 gaps, 2 late, 1 with several publishers" in shown
    strokes, holes = (lines.get_segments() for lines in figure.axes[0].collections)
    assert [round(float(piece[0][0]), 6) for piece in strokes] == [
        ms / 1000 for ms in sorted(ticks["left"] + ticks["right"])
    ]
    assert [piece[:, 0].round(6).tolist() for piece in holes] == [[0.5, 0.9]]


def test_publishers_count_as_rows() -> None:
    buf = robot(2, 3)
    who = [f"/node_{i}" for i in range(20)]
    came = {"arm_0_joint_2_link_link": plot.Arrivals([i * 100 * MS for i in range(20)], who)}
    assert (
        sum(text.startswith("by /node") for text in texts(plot.timeline(buf, arrivals=came))) == 20
    )
    shown = texts(plot.timeline(buf, arrivals=came, rows=10))
    assert not [text for text in shown if text.startswith("by ")]
    assert "1 with several publishers" in shown


@pytest.mark.parametrize("rows", [1, 4, 10, 100])
def test_static_edges_of_several_publishers_are_drawn_or_counted(rows: int) -> None:
    buf = deep_statics()
    still = [info.name for info in buf.tree() if info.is_static]
    came = {name: plot.Arrivals([0, 0], ["/a", "/b"]) for name in still}
    shown = texts(plot.timeline(buf, arrivals=came, rows=rows))
    drawn = len(set(still).intersection(shown))
    assert drawn == (len(still) if rows == 100 else 0)
    assert (f"{len(still)} static edges" in shown) == (drawn == 0)
    figure = plot.timeline(buf, arrivals=came, rows=rows)
    rows_drawn = round(figure.axes[0].get_ylim()[0] + 0.4)
    assert rows_drawn <= max(rows, 2)


def test_a_deep_edge_stands_right_of_the_one_above_it(monkeypatch: pytest.MonkeyPatch) -> None:
    buf = tfdb.Buffer(history=None)
    for i in range(40):
        buf.set_transform(f"link_{i}", f"link_{i + 1}", 0, (1, 0, 0), UNIT)
    for width in (5, 10):
        figure = plot.timeline(buf, width=width)
        assert_legible(figure, monkeypatch)
        at = {text.get_text(): text.get_position()[0] for text in figure.texts}
        steps = [at[f"link_{i + 1}"] - at[f"link_{i}"] for i in range(1, 40)]
        assert steps == pytest.approx([steps[0]] * 39)
        assert steps[0] > 0


def test_bad_arrivals_are_refused() -> None:
    buf = robot(1, 1)
    for given in ([1], {"a": 3}, 7, {"a": plot.Arrivals(["x"], ["y"])}):
        with pytest.raises(tfdb.InvalidArgument, match=r"must map child frames"):
            plot.timeline(buf, arrivals=given)
    with pytest.raises(tfdb.InvalidArgument, match="1 publishers for 2 stamps"):
        plot.timeline(buf, arrivals={"a": plot.Arrivals([1, 2], ["y"])})
    for width in (1, 1000, "wide", None):
        with pytest.raises(tfdb.InvalidArgument, match="width must be 5 to 100"):
            plot.timeline(buf, width=width)


@pytest.mark.parametrize("width", [5, 10, 24])
def test_timeline_of_many_edges_at_every_width(
    width: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown = assert_legible(plot.timeline(big_robot(), width=width, rows=None), monkeypatch)
    assert sum(text.startswith("arm_") for text in shown) == 100


def test_long_and_hostile_names(monkeypatch: pytest.MonkeyPatch) -> None:
    buf = tfdb.Buffer(history=None)
    names = ["$\\alpha$", "_" * 100, "x" * 1000, "größe_机器人", "<&>", "a b  c"]
    for parent, child in pairwise(["map", *names]):
        for i in range(3):
            buf.set_transform(parent, child, i * 100 * MS, (i, 0, 0), UNIT, authority="$%")
    for figure in (plot.frame_tree(buf), plot.timeline(buf), plot.timeline(buf, width=5)):
        shown = assert_legible(figure, monkeypatch)
        assert {"$\\alpha$", "<&>", "a b  c"} <= set(shown)
        assert any(text.startswith("xxx") and "…" in text for text in shown)


def test_timeline_of_nothing() -> None:
    figure = plot.timeline(tfdb.Buffer())
    figure.canvas.draw()
    assert any("0 moving and 0 static edges" in text for text in texts(figure))


def test_pictures_open_no_window() -> None:
    script = """
import sys, tfdb
from tfdb import plot
buf = tfdb.Buffer()
buf.set_transform("map", "base", 1, (1, 2, 3))
plot.frame_tree(buf).canvas.draw()
plot.timeline(buf).canvas.draw()
assert "matplotlib.pyplot" not in sys.modules, "pyplot opens windows and keeps figures"
"""
    subprocess.run([sys.executable, "-c", script], check=True)


def test_pictures_can_be_saved(tmp_path: object) -> None:
    for suffix in ("png", "svg", "pdf"):
        target = tmp_path / f"tree.{suffix}"
        plot.frame_tree(robot(1, 3)).savefig(target)
        assert target.stat().st_size > 1000


def test_a_window_shows_the_picture_and_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    from matplotlib import pyplot as plt

    from . import fake_window

    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    before = matplotlib.get_backend()
    plt.switch_backend(f"module://{fake_window.__name__}")
    try:
        figure = plot.frame_tree(robot(1, 2))
        plot.show(figure)
    finally:
        plt.switch_backend(before)
    ((shown, size),) = fake_window.seen
    assert shown is figure
    assert size == tuple(int(side) for side in figure.get_size_inches() * figure.dpi)
    assert not plt.get_fignums()
