"""Pictures of trajectories: contents, scale and readability."""

from __future__ import annotations

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

import tfdb

plot = pytest.importorskip("tfdb.plot")
from .legible import assert_legible  # noqa: E402

MS = 1_000_000
HOSTILE = (
    "$x^2$ and $",
    "under_score__",
    "two\nlines\tand\\n",
    "größe_机器人_робот_\U0001f916",
    "<b>&amp;</b>",
    "%s {0}",
    "-" * 200,
    "é́" * 60,
)


# Frames cannot have the others, titles can.
NAMES = [name for name in HOSTILE if name.isprintable()]


def path(
    count: int = 50, reach: tuple[float, float, float] = (3, 1, 0.1), source: str = "base_link"
) -> tfdb.Trajectory:
    angle = np.linspace(0, 3, count)
    poses = np.zeros((count, 7))
    poses[:, :3] = np.stack([np.cos(angle), np.sin(2 * angle), np.sin(angle)], axis=1) * reach
    poses[:, 5], poses[:, 6] = np.sin(angle / 2), np.cos(angle / 2)
    stamps = 5_000_000_000 + np.arange(count) * 100 * MS
    return tfdb.Trajectory("map", source, stamps, poses)


def texts(figure: object) -> list[str]:
    from matplotlib.text import Text

    return [text.get_text() for text in figure.findobj(Text)]


def test_one_scale_in_both_directions() -> None:
    figure = plot.trajectory(path())
    top = figure.axes[0]
    box = top.get_position()
    width, height = figure.get_size_inches()
    span_x, span_y = np.diff(top.get_xlim())[0], np.diff(top.get_ylim())[0]
    assert span_x / (box.width * width) == pytest.approx(span_y / (box.height * height))
    assert "map" in top.get_xlabel()
    assert "5 s" in figure.axes[-1].get_xlabel()


@pytest.mark.parametrize(
    ("reach", "plane"), [((3, 1, 0.1), "xy"), ((3, 0.1, 1), "xz"), ((0.1, 2, 1), "yz")]
)
def test_the_two_widest_axes_are_chosen(reach: tuple[float, float, float], plane: str) -> None:
    made = path(reach=reach)
    top = plot.trajectory(made).axes[0]
    assert (top.get_xlabel()[0], top.get_ylabel()[0]) == tuple(plane)
    columns = ["xyz".index(name) for name in plane]
    assert np.array_equal(top.get_lines()[0].get_xydata(), made.poses[:, columns])
    asked = plot.trajectory(made, axes="xy").axes[0]
    assert (asked.get_xlabel()[0], asked.get_ylabel()[0]) == ("x", "y")


def test_every_coordinate_over_time() -> None:
    made = path()
    for axis, axes in enumerate(plot.trajectory(made).axes[1:]):
        (line,) = axes.get_lines()
        seconds, values = line.get_data()
        assert np.array_equal(values, made.poses[:, axis])
        assert np.allclose(seconds, (made.stamps - made.stamps[0]) / 1e9)


def test_several_paths_share_scale_origin_and_legend() -> None:
    late = path(source="camera")
    late = tfdb.Trajectory(
        "map", "camera", late.stamps + 1000 * MS, late.poses + 0.5 * (np.arange(7) < 3)
    )
    figure = plot.trajectory(path(), late)
    first, second = figure.axes[0].get_lines()
    assert first.get_color() != second.get_color()
    assert figure.axes[1].get_lines()[1].get_xdata()[0] == pytest.approx(1.0)
    said = [text.get_text() for text in figure.legends[0].get_texts()]
    assert said[0].startswith("base_link")
    assert said[1].startswith("camera")
    assert {"start", "end"} <= set(said)


def test_speed_and_time_set_the_colour() -> None:
    count = 400
    poses = np.zeros((count, 7))
    poses[:, 6] = 1
    # 2 m/s, then 6 m/s.
    poses[:, 0] = np.cumsum(np.where(np.arange(count) < 200, 0.2, 0.6))
    stamps = np.arange(count) * 100 * MS
    made = tfdb.Trajectory("map", "base", stamps, poses)
    fast = plot.trajectory(made, color="speed").axes[0].collections[0]
    told = np.asarray(fast.get_array())
    assert told[:190] == pytest.approx(2.0)
    assert told[-190:] == pytest.approx(6.0)
    when = plot.trajectory(made, color="time").axes[0].collections[0]
    assert np.all(np.diff(np.asarray(when.get_array())) > 0)
    # No piece is missing: each ends where the next begins.
    pieces = when.get_segments()
    assert pieces[0][0][0] == poses[0, 0]
    assert pieces[-1][-1][0] == poses[-1, 0]
    for one, other in pairwise(pieces):
        assert np.array_equal(one[-1], other[0])


def test_three_dimensions() -> None:
    made = path()
    space = plot.trajectory(made, axes="xyz").axes[0]
    assert space.name == "3d"
    assert np.allclose(np.stack(space.get_lines()[0].get_data_3d(), axis=1), made.poses[:, :3])


@pytest.mark.parametrize("high", [0.3, 1.0, 3.0])
@pytest.mark.parametrize("far", [(0, 0, 0), (5e5, 5.4e6, 123456), (1e6, 1e6, 6378137.123)])
def test_wide_numbers_stay_beside_the_axes_of_space(
    far: tuple[float, float, float], high: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    turn = np.linspace(0, 6, 200)
    poses = np.zeros((200, 7))
    poses[:, :3] = np.stack([np.cos(turn), np.sin(turn), high * turn / 6], axis=1) + far
    poses[:, 6] = 1
    made = tfdb.Trajectory("map", "base", np.arange(200) * 50 * MS, poses)
    figure = plot.trajectory(made, axes="xyz")
    assert_legible(figure, monkeypatch)
    space = figure.axes[0]
    figure.draw_without_rendering()
    line = space.zaxis.line.get_window_extent()
    low, top = space.get_zlim()
    ticks = zip(space.zaxis.get_major_ticks(), space.zaxis.get_majorticklocs(), strict=True)
    boxes = [tick.label1.get_window_extent() for tick, at in ticks if low <= at <= top]
    assert boxes
    for box in boxes:
        assert box.x0 > line.x1  # it slants a little, to the right at its upper end
    for other in figure.axes[1:]:
        assert space.zaxis.label.get_window_extent().x1 < other.yaxis.label.get_window_extent().x0


def test_gaps_are_not_drawn() -> None:
    poses = path().poses.copy()
    poses[10:20] = np.nan
    holed = tfdb.Trajectory("map", "base_link", path().stamps, poses)
    figure = plot.trajectory(holed)
    assert any("40 poses" in text for text in texts(figure))
    assert np.isnan(figure.axes[0].get_lines()[0].get_xdata()[10:20]).all()
    coloured = plot.trajectory(holed, color="time").axes[0].collections[0]
    assert sum(np.isnan(piece.vertices).any() for piece in coloured.get_paths()) == 1


@pytest.mark.parametrize(("axes", "color"), [(None, "speed"), ("xyz", "time"), (None, None)])
def test_a_path_at_rest_is_drawn(axes: str | None, color: str | None) -> None:
    still = path()
    poses = still.poses.copy()
    poses[:, :3] = 7.0
    for made in (tfdb.Trajectory("a", "b", still.stamps, poses), path(1), path(2)):
        plot.trajectory(made, axes=axes, color=color)


@pytest.mark.parametrize(
    ("size", "color"), [((5, 4), None), ((5, 4), "speed"), ((9.6, 5.4), "time"), ((20, 8), None)]
)
def test_labels_stay_apart_at_every_size(
    size: tuple[float, float], color: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    paths = [path(source=name) for name in NAMES]
    shown = assert_legible(plot.trajectory(*paths, size=size, color=color), monkeypatch)
    assert any(text.startswith("$x^2$ and $") for text in shown)


def test_many_frames_at_large_coordinates(monkeypatch: pytest.MonkeyPatch) -> None:
    paths = []
    for i in range(40):
        poses = path().poses.copy()
        poses[:, :3] += (500_000 + i, 5_400_000, 300)
        paths.append(tfdb.Trajectory("utm", f"vehicle_{i}/sensor", path().stamps, poses))
    shown = assert_legible(plot.trajectory(*paths), monkeypatch)
    assert sum("vehicle_" in text for text in shown) == 40


def test_hostile_target_and_title(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in NAMES:
        made = tfdb.Trajectory(name, name, path().stamps, path().poses)
        assert_legible(plot.trajectory(made), monkeypatch)
    assert_legible(plot.trajectory(made, title=HOSTILE[2], axes="xyz"), monkeypatch)


def test_nothing_to_draw_is_refused() -> None:
    with pytest.raises(tfdb.InvalidArgument, match="at least one trajectory"):
        plot.trajectory()
    empty = SimpleNamespace(
        target="map", source="lidar", stamps=np.arange(3), poses=np.full((3, 7), np.nan)
    )
    with pytest.raises(tfdb.InvalidArgument, match="lidar in map has no valid pose"):
        plot.trajectory(path(), empty)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"axes": "zx"}, "axes must be 'xy', 'xz', 'yz' or 'xyz', got 'zx'"),
        ({"color": "rainbow"}, "color must be 'time' or 'speed'"),
        ({"labels": ["one", "two"]}, "labels must be 1 names"),
        ({"labels": "a"}, "labels must be 1 names"),
        ({"size": (1, 1)}, "from 5 and a height from 4"),
        ({"size": (1, 1, 1)}, "from 5 and a height from 4"),
        ({"size": 7}, "from 5 and a height from 4"),
        ({"size": ("9", "5")}, "from 5 and a height from 4"),
        ({"labels": 3}, "labels must be 1 names"),
    ],
)
def test_bad_options_are_refused(options: dict[str, object], words: str) -> None:
    with pytest.raises(tfdb.InvalidArgument, match=words):
        plot.trajectory(path(), **options)


@pytest.mark.parametrize("given", [None, 7, "map", np.zeros((3, 7))])
def test_other_types_are_refused(given: object) -> None:
    with pytest.raises(tfdb.InvalidArgument, match=r"must be a tfdb\.Trajectory"):
        plot.trajectory(given)


@pytest.mark.parametrize("period", [1, 10**15])
def test_times_of_all_lengths_lie_apart(period: int, monkeypatch: pytest.MonkeyPatch) -> None:
    made = path()
    stamps = 2**60 + np.arange(len(made)) * period
    made = tfdb.Trajectory("a", "b", stamps, made.poses)
    assert_legible(plot.trajectory(made), monkeypatch)


@pytest.mark.parametrize(
    ("reach", "away"), [((30, 0, 0.3), 0.0), ((0, 30, 0.3), 400_000.0), ((1, 0.2, 30), 400_000.0)]
)
def test_flat_boxes_in_three_dimensions(
    reach: tuple[float, ...], away: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    turns = np.linspace(0, 18, 200)
    poses = np.tile([0.0, 0, 0, 0, 0.6, 0, 0.8], (200, 1))
    poses[:, :3] = (
        np.stack((np.cos(turns), np.sin(turns), np.cos(turns / 3)), axis=1) * reach + away
    )
    made = tfdb.Trajectory("map", "base", np.arange(200) * 10**8, poses)
    figure = plot.trajectory(made, made, axes="xyz", color="speed")
    assert_legible(figure, monkeypatch)
    # The name of the third axis is right beside its numbers.
    axis = figure.axes[0].zaxis
    low, high = figure.axes[0].get_zlim()
    ticks = zip(axis.get_major_ticks(), axis.get_majorticklocs(), strict=True)
    numbers = max(tick.label1.get_window_extent().x1 for tick, at in ticks if low <= at <= high)
    between = (axis.label.get_window_extent().x0 - numbers) / figure.dpi * 72
    assert 3 <= between <= 9


def test_huge_coordinates_are_refused() -> None:
    poses = [[1e90, 0, 0, 0, 0, 0, 1], [-1e90, 3, 0, 0, 0, 0, 1]]
    plot.trajectory(tfdb.Trajectory("map", "base", [0, 1], poses)).canvas.draw()
    poses[0][0] = 1e307
    with pytest.raises(tfdb.InvalidArgument, match="base in map reaches 1e"):
        plot.trajectory(tfdb.Trajectory("map", "base", [0, 1], poses))
