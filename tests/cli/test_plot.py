"""`tfdb plot`: formats, contents and errors."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import pytest

import tfdb
import tfdb.plot

pytest.importorskip("matplotlib")

if TYPE_CHECKING:
    from pathlib import Path

    from conftest import Tool

BEGINS = {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def drawn(path: Path) -> set[str]:
    """Return the texts of an SVG file, which precede the shapes of their letters."""
    text = path.read_text(encoding="utf-8")
    return {found.strip() for found in re.findall(r"<!-- (.*?) -->", text, re.DOTALL)}


def test_a_tree_is_drawn_without_a_word_more(tool: Tool, bag: Path, here: Path) -> None:
    assert "pr2_tree.png: the tree of" in tool("plot", bag).out
    assert (here / "pr2_tree.png").read_bytes().startswith(BEGINS["png"])


@pytest.mark.parametrize("kind", ["tree", "timeline"])
def test_formats_and_paths(tool: Tool, bag: Path, here: Path, kind: str) -> None:
    tool("plot", bag, kind, "--save", "svg", "--save", "PDF", "--save", here / "my.PNG")
    for name in (f"pr2_{kind}.svg", f"pr2_{kind}.pdf", "my.PNG"):
        assert (here / name).read_bytes().startswith(BEGINS[name[-3:].lower()]), name
    shown = drawn(here / f"pr2_{kind}.svg")
    assert {"base_footprint", "50 Hz", "torso_lift_link"} <= shown
    assert ("52 static edges" in shown) == (kind == "timeline")


def test_trajectories(tool: Tool, bag: Path, here: Path) -> None:
    frames = ("map", "base_link", "l_gripper_tool_frame")
    body = tool("plot", bag, "trajectory", *frames, "--save", "svg", "--json").json
    assert body["outputs"] == ["pr2_trajectory.svg"]
    assert body["kind"] == "trajectory"
    shown = drawn(here / "pr2_trajectory.svg")
    assert {"2 frames in map", "x in map [m]"} <= shown
    path = tfdb.load(bag).trajectory("map", "base_link").poses[:, :3]
    length = sum(((path[1:] - path[:-1]) ** 2).sum(axis=1) ** 0.5)
    assert f"base_link  {length:.2f} m" in shown
    tool("plot", bag, "trajectory", "map", "base_link", "--color", "speed", "--axes", "xyz")
    assert (here / "pr2_trajectory.png").exists()


def test_publishers_have_separate_rows(tool: Tool, here: Path) -> None:
    from tfdb.recordings import RecordingWriter

    with RecordingWriter(here / "two.bag") as writer:
        for i in range(20):
            stamp = 10_000_000_000 + i * 100_000_000
            one = tfdb.TransformStamped("odom", "base", stamp, (i, 0, 0), (0.0, 0.6, 0.0, 0.8))
            data = tfdb.encode_tf_message([one], writer.encoding)
            who = "/ekf" if i % 2 else "/wheels"
            writer.write(data, stamp, topic="/tf", static=False, authority=who)
    tool("plot", "two.bag", "timeline", "--prefix", "a/", "--save", "svg")
    shown = drawn(here / "two_timeline.svg")
    assert {"a/base", "by /ekf", "by /wheels", "10 Hz, 2 publishers"} <= shown


def test_folds_and_titles(tool: Tool, bag: Path, here: Path) -> None:
    tool("plot", bag, "--rows", "20", "--title", "A $title$", "--save", "svg")
    shown = drawn(here / "pr2_tree.svg")
    assert "A $title$" in shown
    assert any("frames are folded" in text for text in shown)


def test_trajectory_files_and_comparisons(tool: Tool, bag: Path, here: Path) -> None:
    tool("poses", bag, "map", "base_link", "--rate", "20", "-o", "a.tum")
    tool("poses", bag, "map", "base_link", "--rate", "13", "-o", "b.tum")
    assert "a_trajectory.svg" in tool("plot", "a.tum", "trajectory", "--save", "svg").out
    drawn_length = next(text for text in drawn(here / "a_trajectory.svg") if "travelled" in text)
    assert drawn_length.startswith("175 poses over 8.7 s, 4.1")
    assert "the comparison of a.tum" in tool("plot", "a.tum", "compare", "b.tum").out
    assert (here / "a_compare.png").exists()
    tool("plot", "a.tum", "compare", bag, "map", "base_link", "--save", "svg")
    assert any("APE" in text for text in drawn(here / "a_compare.svg"))


def test_comparisons_have_the_options_of_compare(tool: Tool, bag: Path, here: Path) -> None:
    frames = ("map", "base_link", "--estimate-frames", "odom", "base_link")
    more = ("--delta", "0.5", "--delta-unit", "m", "--align", "yaw", "--association", "nearest")
    tool("plot", bag, "compare", bag, *frames, *more, "--max-diff", "0.02", "--save", "svg")
    found = tfdb.compare(
        bag,
        bag,
        frames=("map", "base_link"),
        estimate_frames=("odom", "base_link"),
        delta=0.5,
        delta_unit="m",
        align="yaw",
        association="nearest",
        max_diff=0.02,
    )
    errors = f"APE {found.ape_translation.rmse:.4g} m rmse, {found.ape_translation.max:.4g} m"
    rest = f" at most; RPE {found.rpe_translation.rmse:.4g} m rmse"
    shown = drawn(here / "pr2_compare.svg")
    assert f"{len(found):,} poses; {errors}{rest}" in shown
    assert "base_link in odom against base_link in map" in shown
    said = tool("plot", bag, "compare", bag, "--overwrite", code=2).error
    assert "has many frames: name two after ESTIMATE: TARGET SOURCE" in said
    tool("poses", bag, "map", "base_link", "--rate", "20", "-o", "a.tum")
    tool("poses", bag, "map", "base_link", "--rate", "13", "-o", "b.tum")
    tool("plot", "a.tum", "compare", "b.tum", "--offset", "0.1", "--save", "svg")
    assert "b.tum against a.tum" in drawn(here / "a_compare.svg")
    said = tool("plot", "a.tum", "compare", "b.tum", "--keep", "5", code=2).error
    assert "do not apply to trajectory files" in said


def test_timelines_fold(tool: Tool, bag: Path, here: Path) -> None:
    tool("plot", bag, "timeline", "--rows", "8", "--save", "svg")
    folds = [text for text in drawn(here / "pr2_timeline.svg") if text.startswith("+ ")]
    assert folds
    assert all(re.fullmatch(r"\+ \d+ moving edges?", text) for text in folds)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("timeline", "--color", "speed"), "--color is valid with trajectory, not with timeline"),
        (("tree", "--max-gap", "3"), "--max-gap is valid with timeline, not with tree"),
        (("--align", "sim3"), "--align is valid with compare, not with tree"),
        (
            ("trajectory", "a", "b", "--rows", "9"),
            "--rows is valid with tree and timeline, not with",
        ),
        (("trajectory", "map"), "tfdb plot FILE trajectory TARGET SOURCE [SOURCE ...]"),
        (("trajectory",), "has 32 moving edges: name TARGET and SOURCE"),
        (("compare",), "tfdb plot FILE compare ESTIMATE"),
        (("tree", "map"), "tree takes no frames, got map; for two files use 'compare'"),
        (
            ("--save", "gif"),
            "'pdf' or a path that ends in one of them, got 'gif'",
        ),
        (("--save", "png", "--save", "png"), "twice"),
        (("trajectory", "map", "base_lnk"), "did you mean 'base_link'"),
        (("tree", "--save", "no/such/folder.png"), "the folder is missing"),
    ],
)
def test_refusals(
    tool: Tool, bag: Path, here: Path, arguments: tuple[str, ...], words: str
) -> None:
    assert words in tool("plot", bag, *arguments, code=2).error
    assert not list(here.iterdir())


def test_existing_files_are_kept(tool: Tool, bag: Path, here: Path) -> None:
    (here / "pr2_tree.png").write_text("mine")
    assert "--overwrite replaces it" in tool("plot", bag, code=2).error
    assert (here / "pr2_tree.png").read_text() == "mine"
    tool("plot", bag, "--overwrite")
    assert (here / "pr2_tree.png").read_bytes().startswith(BEGINS["png"])


def test_without_a_screen_no_window_opens(
    tool: Tool, bag: Path, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MPLBACKEND", "agg")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    error = tool("plot", bag, "--show", code=2).error
    assert "no window can be opened" in error
    assert "--save png" in error
    with pytest.raises(tfdb.InvalidArgument, match=r"a Figure of tfdb\.plot, got str"):
        tfdb.plot.show("tree")
