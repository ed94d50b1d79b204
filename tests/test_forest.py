"""Children, descendants and paths, against a dictionary of parents; notebook output."""

from __future__ import annotations

import itertools
import random
import re
from typing import Any

import numpy as np
import pytest

import tfdb

TURNED = (0.0, 0.0, 0.6, 0.8)
STEPS = (1000, 2000, 3000)


def grown(seed: int) -> tuple[tfdb.Buffer, dict[int, dict[str, str]]]:
    """Make a store whose moving frames change parents; return the parents at each step."""
    rng = random.Random(seed)
    names = [f"f{i:02}" for i in range(24)]
    rng.shuffle(names)
    buf = tfdb.Buffer(history=None)
    static: dict[str, str] = {}
    for i, name in enumerate(names[4:12], 4):
        static[name] = names[rng.randrange(2, i)]
        buf.set_static_transform(static[name], name, (1, 2, 3), TURNED)
    at = {}
    for step in STEPS:
        at[step] = dict(static)
        for i, name in enumerate(names[12:], 12):
            at[step][name] = names[rng.randrange(i)]
            buf.set_transform(at[step][name], name, step, (1, 2, 3), TURNED)
    return buf, at


def below(parents: dict[str, str], name: str) -> list[str]:
    found = []
    for child in sorted(each for each, parent in parents.items() if parent == name):
        found += [child, *below(parents, child)]
    return found


def chain(parents: dict[str, str], name: str) -> list[str]:
    return [name, *(chain(parents, parents[name]) if name in parents else [])]


@pytest.mark.parametrize("seed", range(4))
def test_the_forest_is_that_of_the_parents(seed: int) -> None:
    buf, at = grown(seed)
    frames = buf.frames()
    with buf.snapshot() as snapshot:
        for reads in (buf, snapshot):
            assert len(reads) == len(frames) == len(list(frames))
            assert all(name in reads for name in frames)
            for stamp in (*STEPS, None):
                parents = at[STEPS[-1] if stamp is None else stamp]
                for name in frames:
                    assert reads.parent_of(name, stamp) == parents.get(name)
                    expected = sorted(each for each, up in parents.items() if up == name)
                    assert reads.children(name, stamp) == expected
                    assert reads.descendants(name, stamp) == below(parents, name)


@pytest.mark.parametrize("seed", range(4))
def test_a_path_goes_through_the_lowest_common_ancestor(seed: int) -> None:
    buf, at = grown(seed)
    frames, joined, apart = buf.frames(), 0, 0
    for stamp in (*STEPS, None):
        parents = at[STEPS[-1] if stamp is None else stamp]
        for target in frames:
            for source in frames:
                up, down = chain(parents, target), chain(parents, source)
                if up[-1] != down[-1]:
                    apart += 1
                    with pytest.raises(tfdb.Disconnected) as error:
                        buf.path(target, source, stamp)
                    assert error.value.frames == (up[-1], down[-1])
                    continue
                joined += 1
                found = buf.path(target, source, stamp)
                assert (found[0], found[-1]) == (target, source)
                assert len(set(found)) == len(found)
                for a, b in itertools.pairwise(found):
                    assert parents.get(a) == b or parents.get(b) == a
                common = len([each for each in up if each in down])
                assert len(found) == len(up) + len(down) - 2 * common + 1
                assert buf.path(source, target, stamp) == found[::-1]
    assert joined > 100
    assert apart > 0


def test_path_is_the_path_of_the_lookup() -> None:
    buf, _ = grown(1)
    for source in buf.frames():
        try:
            report = buf.lookup_transform("f00", source, STEPS[1]).report
        except (tfdb.Disconnected, tfdb.Extrapolation):
            continue
        told = buf.path("f00", source, STEPS[1])
        edges = {frozenset((edge.child, edge.parent)) for edge in report.edges}
        assert edges == {frozenset(pair) for pair in itertools.pairwise(told)}


def test_no_frame_is_its_own_ancestor_before_its_first_sample() -> None:
    buf = tfdb.Buffer(history=None)
    buf.set_static_transform("map", "odom", (1, 2, 3), TURNED)
    buf.set_transform("base", "map", 1872, (1, 2, 3), TURNED)
    buf.set_transform("hand", "map", 2063, (1, 2, 3), TURNED)
    buf.set_transform("odom", "base", 2208, (1, 2, 3), TURNED)
    with buf.snapshot() as snapshot:
        for reads in (buf, snapshot):
            assert reads.descendants("base", 2036) == ["map", "odom"]
            assert reads.path("odom", "base", 2036) == ["odom", "map", "base"]
            assert reads.descendants("map", 2036) == ["odom"]
            assert reads.children("odom", 2036) == []
            assert reads.path("map", "base", 2208) == ["map", "odom", "base"]
            with pytest.raises(tfdb.Disconnected) as error:
                reads.path("map", "hand", 2036)
            assert error.value.frames == ("base", "hand")
            told = [(edge.parent, edge.child) for edge in reads.explain("map", "hand", 2036).edges]
            assert told == [("base", "map")]


def agrees_with_itself(buf: tfdb.Buffer, stamp: int) -> tuple[int, int]:
    """Check one tree; count the lookups along it, and the roots before their samples."""
    parents = {info.name: info.parent for info in buf.tree(stamp)}
    answered = early = 0
    for name, parent in parents.items():
        assert buf.parent_of(name, stamp) == parent
        up = [name]
        while (above := parents[up[-1]]) is not None:
            assert above not in up, f"{up} hangs under {above!r} at {stamp}"
            up.append(above)
        oldest = buf.frame_info(name).oldest
        early += oldest is not None and stamp < oldest and parent is None
    for target, source in itertools.permutations(parents, 2):
        try:
            report = buf.lookup_transform(target, source, stamp).report
        except (tfdb.Disconnected, tfdb.Extrapolation):
            continue
        answered += 1
        told = itertools.pairwise(buf.path(target, source, stamp))
        edges = {frozenset((edge.child, edge.parent)) for edge in report.edges}
        assert edges == {frozenset(pair) for pair in told}
    for policy in (tfdb.Interpolate(), tfdb.Previous(), tfdb.Nearest(), tfdb.Extrapolate(1e-5)):
        for target, source in itertools.combinations(parents, 2):
            there, back = (
                matrix_or_error(buf, *ends, stamp, policy)
                for ends in ((target, source), (source, target))
            )
            if isinstance(there, str) or isinstance(back, str):
                assert there == back
            else:
                np.testing.assert_allclose(there @ back, np.eye(4), atol=1e-9)
    return answered, early


def matrix_or_error(
    buf: tfdb.Buffer, target: str, source: str, stamp: int, policy: tfdb.types.Policy
) -> np.ndarray | str:
    try:
        return buf.lookup_transform(target, source, stamp, policy).matrix
    except (tfdb.Disconnected, tfdb.Extrapolation) as error:
        return type(error).__name__


def test_every_stamp_has_one_tree_and_lookups_go_its_way() -> None:
    """Frames appear at different times, often as children of later descendants."""
    names = ["map", "odom", "base", "arm", "hand", "cup"]
    answered = early = 0
    for seed in range(8):
        rng = random.Random(seed)
        buf, taken = tfdb.Buffer(history=3000), 0
        while taken < 60:
            parent, child = rng.sample(names, 2)
            try:
                where = (rng.random(), 2, 3)
                buf.set_transform(parent, child, rng.randrange(50) * 100, where, TURNED)
            except (tfdb.errors.CycleError, tfdb.errors.TooOld):
                continue
            taken += 1
            found = agrees_with_itself(buf, rng.randrange(5000))
            answered += found[0]
            early += found[1]
    assert answered > 1000
    assert early > 20


def test_a_snapshot_keeps_its_forest() -> None:
    buf = tfdb.Buffer()
    buf.set_transform("map", "base", 5, (1, 2, 3), TURNED)
    with buf.snapshot() as snapshot:
        buf.set_transform("odom", "base", 6, (1, 2, 3), TURNED)
        assert snapshot.children("map") == ["base"]
        assert (len(snapshot), "odom" in snapshot) == (2, False)
        assert buf.children("map") == []
        assert buf.children("map", 5) == buf.children("odom", 6) == ["base"]
        assert (len(buf), "odom" in buf) == (3, True)
    with pytest.raises(tfdb.errors.SnapshotClosed):
        snapshot.children("map")


def test_unknown_frames_and_wrong_types() -> None:
    buf = tfdb.Buffer()
    buf.set_transform("map", "base", 5, (1, 2, 3), TURNED)
    wrong: Any = 5
    for call in (buf.children, buf.descendants):
        with pytest.raises(tfdb.UnknownFrame, match="'nowhere'") as error:
            call("nowhere")
        assert error.value.frame == "nowhere"
        with pytest.raises(TypeError):
            call(wrong)
        with pytest.raises(tfdb.InvalidStamp):
            call("map", -5)
    with pytest.raises(tfdb.UnknownFrame, match="'nowhere'"):
        buf.path("map", "nowhere")
    with pytest.raises(tfdb.UnknownFrame, match="'nowhere'"):
        buf.path("nowhere", "map", 5)
    assert wrong not in buf
    assert None not in buf
    with buf.transaction(), pytest.raises(tfdb.errors.TransactionActive):
        buf.children("map")


def test_an_empty_buffer_is_true() -> None:
    buf = tfdb.Buffer()
    assert (len(buf), bool(buf), bool(buf.snapshot())) == (0, True, True)


def test_repr_counts_the_contents() -> None:
    buf = tfdb.Buffer(history=None)
    assert repr(buf) == "<tfdb.Buffer at commit 0, history unlimited: 0 frames, 0 edges (0 static)>"
    buf.set_transform("map", "base", 2_000_000_000, (1, 2, 3), TURNED)
    buf.set_transform("map", "base", 3_500_000_000, (1, 2, 3), TURNED)
    buf.set_static_transform("base", "lidar", (1, 2, 3))
    told = "3 frames, 2 edges (1 static), 1.5 s from 2 s"
    assert repr(buf) == f"<tfdb.Buffer at commit 3, history unlimited: {told}>"
    with buf.transaction():
        assert repr(buf) == "<tfdb.Buffer at commit 3, history unlimited>"
    buf.close()
    assert repr(buf) == "<tfdb.Buffer at commit 3, history unlimited, closed>"


def cells(html: str) -> list[list[str]]:
    """Return the text of a table's body."""
    rows = re.findall("<tr>(.*?)</tr>", html.split("<tbody>")[1], re.DOTALL)
    return [re.findall("<td>(.*?)</td>", row) for row in rows]


def test_a_frame_info_shows_all_its_fields() -> None:
    buf = tfdb.Buffer(history=None)
    for stamp in (1_000_000_000, 1_500_000_000, 3_000_000_000):
        buf.set_transform("map", "base", stamp, (1, 2, 3), TURNED, authority="drive")
    buf.set_static_transform("base", "lidar", (1, 2, 3))
    assert cells(buf.frame_info("base")._repr_html_()) == [
        ["base", "map", "moving", "3", "1", "1 s", "3 s", "1.5 s", "0", "drive"]
    ]
    assert cells(buf.frame_info("lidar")._repr_html_()) == [
        ["lidar", "base", "static", "1", "", "", "", "", "0", ""]
    ]
    assert cells(buf.frame_info("map")._repr_html_())[0][:3] == ["map", "", "root"]


def test_velocities_are_shown() -> None:
    one = tfdb.types.Twist(np.array([1.0, 2, 3]), np.array([0, 0, -0.25]))
    assert cells(one._repr_html_()) == [
        ["linear [m/s]", "1", "2", "3"],
        ["angular [rad/s]", "0", "0", "-0.25"],
    ]
    many = tfdb.types.Twist(np.arange(36.0).reshape(12, 3), np.zeros((12, 3)))
    rows = cells(many._repr_html_())
    assert len(rows) == 11
    assert rows[4] == ["4", "12", "13", "14", "0", "0", "0"]
    assert rows[5] == ["\u22ee"] * 7
    assert rows[6] == ["7", "21", "22", "23", "0", "0", "0"]


@pytest.mark.parametrize("stamps", [[5, 10**9, "?"], np.array([5, 10**9, 7]), None])
def test_columns_with_any_stamps_are_shown(stamps: Any) -> None:
    poses = np.tile([1.0, 2, 3, 0, 0, 0.6, 0.8], (3, 1))
    rows = cells(tfdb.Columns("map", ["a", "b", "c"], stamps, poses)._repr_html_())
    assert [row[:2] for row in rows] == [["map", "a"], ["map", "b"], ["map", "c"]]
    assert rows[0][3:] == ["1", "2", "3", "0", "0", "0.6", "0.8"]
    told = ["all times"] * 2 if stamps is None else ["0.000000005", "1"]
    assert [row[2] for row in rows[:2]] == told
    assert cells(tfdb.Columns("map", "a", [], np.zeros((0, 7)))._repr_html_()) == []


def test_changes_are_shown_with_their_frames() -> None:
    buf = tfdb.Buffer(history=None)
    with buf.transaction() as tx:
        for i in range(12):
            tx.set_transform("map", f"part{i:02}", 5, (1, 2, 3), TURNED)
        tx.set_static_transform("map", "lamp", (1, 2, 3))
    buf.remove_frames("lamp")
    made, removed = buf.changes(0)
    first = "part00, part01, part02, part03, part04, part05, part06, part07, part08, part09"
    rows = {row[0]: row[1:] for row in cells(made._repr_html_())}
    assert rows["stored"] == ["12", f"{first} and 2 more"]
    assert rows["made"][0] == "14"
    assert rows["gone"] == ["1", "lamp"]
    assert cells(removed._repr_html_()) == [["removed", "1", "lamp"]]
    assert "changes of commit 2" in removed._repr_html_()


def test_notebooks_show_tables_of_escaped_names() -> None:
    buf = tfdb.Buffer(history=None)
    hostile = "</td><script>alert('&\")</script>"
    buf.set_transform(hostile, "base", 5, (1, 2, 3), TURNED)
    buf.set_transform("elsewhere", "<b>", 5, (1, 2, 3), TURNED)
    explained = buf.explain(hostile, "<b>")
    found = buf.lookup_transform(hostile, "base")
    columns = tfdb.Columns([hostile, "<b>"], ["<b>", hostile], [5, 6], [found, found])
    changes = buf.changes(0)
    records = (buf.frame_info("base"), columns, changes[0])
    for shown in (buf, buf.snapshot(), found, found.report, explained, *records):
        html = shown._repr_html_()  # type: ignore[attr-defined]
        assert "<script" not in html
        assert "<b>" not in html
        assert "&lt;script&gt;" in html
        for tag in ("table", "tr", "td", "pre", "caption"):
            assert html.count(f"<{tag}>") == html.count(f"</{tag}>")
    for i in range(200):
        buf.set_static_transform("base", f"part{i}", (1, 2, 3))
    assert "elsewhere, &lt;b&gt;" in changes[1]._repr_html_()
    assert buf._repr_html_().count("<tr>") == 62
    assert "and 144 more" in buf._repr_html_()
    buf.close()
    assert "closed" in buf._repr_html_()
