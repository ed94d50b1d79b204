"""The picture of a comparison is complete and readable."""

from __future__ import annotations

import numpy as np
import pytest

import tfdb

pytest.importorskip("matplotlib")
collections = pytest.importorskip("matplotlib.collections")
text = pytest.importorskip("matplotlib.text")
from .legible import assert_legible  # noqa: E402


def compared(
    *, count: int = 300, name: str = "base", target: str = "map", turn: int = 0
) -> tfdb.Comparison:
    rng = np.random.default_rng(2)
    seconds = np.arange(count) / 10
    poses = np.zeros((count, 7))
    poses[:, 6] = 1
    poses[:, turn % 3] = 30 * np.sin(0.13 * seconds)
    poses[:, (turn + 1) % 3] = 10 * np.sin(0.37 * seconds)
    poses[:, (turn + 2) % 3] = np.sin(seconds)
    stamps = (1_700_000_000 * 10**9 + seconds * 1e9).astype(np.int64)
    path = tfdb.Trajectory(target, name, stamps, poses)
    kept = np.r_[0 : count // 3, count // 2 : count]
    noisy = poses[kept].copy()
    noisy[:, :3] += rng.normal(0, 0.1, (len(kept), 3))
    return tfdb.compare(path, tfdb.Trajectory("odom", f"{name} by slam", stamps[kept], noisy))


NAMES = ("base", "$x^2$ and $", "機器人_робот", "-" * 200, "é" * 120)


@pytest.mark.parametrize("name", NAMES)
def test_texts_lie_apart_and_inside(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    shown = assert_legible(compared(name=name, target=name).plot(), monkeypatch)
    assert {"APE", "RPE", "reference", "estimate, aligned", "rotation [deg]"} <= set(shown)


@pytest.mark.parametrize(("turn", "axes"), [(0, "xy"), (1, "yz"), (2, "xz")])
def test_the_two_widest_axes_and_one_scale(turn: int, axes: str) -> None:
    figure = compared(turn=turn).plot()
    paths = figure.axes[0]
    assert paths.get_xlabel() == f"{axes[0]} in map [m]"
    assert paths.get_ylabel() == f"{axes[1]} in map [m]"
    assert paths.get_aspect() == 1.0


def test_colours_are_the_errors_and_gaps_stay() -> None:
    found = compared()
    figure = found.plot(title="a title")
    assert any(t.get_text() == "a title" for t in figure.findobj(text.Text))
    reference, estimate = figure.axes[0].findobj(collections.LineCollection)
    assert len(reference.get_segments()) == len(estimate.get_segments()) == len(found) - 2
    values = found.ape_translation.values
    assert estimate.get_clim() == (values.min(), values.max())
    middle = (values[:-1] + values[1:]) / 2
    assert set(estimate.get_array()) <= set(middle)
    above = next(axes for axes in figure.axes if axes.get_ylabel() == "translation [m]")
    ape, rpe, rmse = above.get_lines()
    assert rmse.get_zorder() > ape.get_zorder() > rpe.get_zorder()
    assert np.isnan(ape.get_ydata()).sum() == np.isnan(rpe.get_ydata()).sum() == 1
    assert np.nanmax(ape.get_ydata()) == found.ape_translation.max
    assert rmse.get_ydata()[0] == found.ape_translation.rmse
    below = next(axes for axes in figure.axes if axes.get_ylabel() == "rotation [deg]")
    assert np.nanmax(below.get_lines()[0].get_ydata()) == np.rad2deg(found.ape_rotation.max)


def test_an_estimate_that_is_left_where_it_is_is_not_called_aligned() -> None:
    path = compared().reference
    for align, name in (("none", "estimate"), ("origin", "estimate, aligned")):
        (legend,) = tfdb.compare(path, path, align=align).plot().legends
        assert [t.get_text() for t in legend.get_texts()] == ["reference", name]


def test_equal_errors_are_drawn() -> None:
    path = compared().reference
    still = tfdb.Trajectory("map", "base", path.stamps, np.tile(path.poses[:1], (len(path), 1)))
    tfdb.plot.comparison(tfdb.compare(still, still, align="none")).canvas.draw()
    two = tfdb.Trajectory("map", "base", path.stamps[:2], path.poses[:2])
    tfdb.compare(two, two, align="none").plot().canvas.draw()


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e60])
@pytest.mark.parametrize("away", [0.0, 5_400_000.0])
def test_numbers_of_all_sizes_lie_apart(
    scale: float, away: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = compared()
    paths = []
    for one in (found.reference, found.estimate):
        poses = one.poses.copy()
        poses[:, :3] = poses[:, :3] * scale + away
        paths.append(tfdb.Trajectory("map", "base", one.stamps, poses))
    assert_legible(tfdb.compare(*paths, align="none").plot(), monkeypatch)


def test_errors_that_are_the_same_have_one_colour(monkeypatch: pytest.MonkeyPatch) -> None:
    one = compared().reference
    other = tfdb.Transform("odom", "map", (0.1, 0.1, 0.1)) @ one
    figure = tfdb.compare(one, other, align="none").plot()
    assert_legible(figure, monkeypatch)
    _, estimate = figure.axes[0].findobj(collections.LineCollection)
    low, high = estimate.get_clim()
    assert low == 0
    assert high == pytest.approx(0.03**0.5)


def test_ticks_are_plain_and_distinct() -> None:
    from tfdb.plot.axis_ticks import TickFormatter, number

    for given, texts in (
        ([5_400_000.0, 5_400_002.5], ["5400000.0", "5400002.5"]),
        ([-0.0, 0.25, -0.5], ["0.00", "0.25", "\N{MINUS SIGN}0.50"]),
        ([0, 5e7, 1e8], ["0", "5e7", "1e8"]),
        ([1e-10, 1.5e-10], ["1.0e-10".replace("-", "\N{MINUS SIGN}"), "1.5e\N{MINUS SIGN}10"]),
        ([3.0], ["3"]),
        ([], []),
    ):
        assert TickFormatter().format_ticks(given) == texts
    assert number(1234.567) == "1,234.57"
    assert number(7.66e51) == "7.66e+51"
