"""Each option of loading, compared with a separate filter over the messages."""

from __future__ import annotations

import fnmatch
import re
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pytest

import tfdb
from tfdb.recordings import Recording

if TYPE_CHECKING:
    from collections.abc import Callable

BAG = Path(__file__).resolve().parents[2] / "examples" / "data" / "pr2.bag"
MCAP = BAG.with_suffix(".mcap")


class Sample(NamedTuple):
    parent: str
    child: str
    stamp: int
    pose: tuple[float, ...]
    static: bool
    topic: str
    authority: str


def samples_of(path: Path) -> list[Sample]:
    """Return all transforms of a recording, message by message."""
    found = []
    with Recording(path) as recording:
        for source, _, data in recording.messages():
            static = source.topic.endswith("tf_static")
            for each in tfdb.decode_tf_message(data, source.encoding):
                pose = (*each.translation, *each.rotation)
                names = each.parent.lstrip("/"), each.child.lstrip("/")
                found.append(
                    Sample(*names, each.stamp, pose, static, source.topic, source.authority)
                )
    return found


@pytest.fixture(scope="module")
def samples() -> list[Sample]:
    return samples_of(BAG)


def check(buffer: tfdb.Buffer, expected: list[Sample]) -> None:
    """Check that the store has exactly these samples; of those with one stamp, the last."""
    edges: dict[str, dict[int, tuple[str, tuple[float, ...]]]] = {}
    for each in expected:
        stamp = 0 if each.static else each.stamp
        edges.setdefault(each.child, {})[stamp] = each.parent, each.pose
    assert set(buffer.frames()) == {each.parent for each in expected} | edges.keys()
    for child, by_stamp in edges.items():
        stamps, poses, parents = buffer.samples(child)
        order = sorted(by_stamp)
        assert stamps.tolist() == order
        assert parents == [by_stamp[stamp][0] for stamp in order]
        assert np.abs(poses - [by_stamp[stamp][1] for stamp in order]).max() < 1e-12


S = 1_000_000_000
FIRST = 1795240381220679283


def date_of(stamp: int) -> str:
    """Write a stamp as a date in UTC, to the nanosecond."""
    return f"{datetime.fromtimestamp(stamp // S, UTC):%Y-%m-%dT%H:%M:%S}.{stamp % S:09}"


def first_and_last(samples: list[Sample]) -> tuple[int, int]:
    moving = [each.stamp for each in samples if not each.static]
    return min(moving), max(moving)


def between(first: int, last: int) -> Callable[[Sample], bool]:
    return lambda each: each.static or first <= each.stamp <= last


@pytest.mark.parametrize(
    ("options", "window"),
    [
        ({"start": "+3"}, lambda a, b: (a + 3 * S, b)),
        ({"end": "+2.5"}, lambda a, b: (a, a + 5 * S // 2)),
        ({"start": "-1.25"}, lambda a, b: (b - 5 * S // 4, b)),
        ({"start": FIRST + S, "end": FIRST + 2 * S}, lambda a, b: (FIRST + S, FIRST + 2 * S)),
        ({"start": f"{FIRST + S}ns"}, lambda a, b: (FIRST + S, b)),
        ({"start": date_of(FIRST + S)}, lambda a, b: (FIRST + S, b)),
        ({"end": date_of(FIRST + S) + "Z"}, lambda a, b: (a, FIRST + S)),
        ({"end": np.datetime64(FIRST + S, "ns")}, lambda a, b: (a, FIRST + S)),
        ({"keep": 2}, lambda a, b: (b - 2 * S, b)),
        ({"keep": np.float32(2)}, lambda a, b: (b - 2 * S, b)),
        ({"keep": 2.5, "end": "-1"}, lambda a, b: (b - 7 * S // 2, b - S)),
        ({"keep": 100.0, "start": "+1"}, lambda a, b: (a + S, b)),
    ],
)
def test_times(options: dict[str, Any], window: Any, samples: list[Sample]) -> None:
    expected = list(filter(between(*window(*first_and_last(samples))), samples))
    assert 0 < len(expected) < len(samples)
    check(tfdb.load(BAG, **options), expected)
    buffer = tfdb.Buffer(history=None)
    report = buffer.load(BAG, **options)
    assert (report.transforms, report.left_out) == (len(expected), len(samples) - len(expected))
    assert report.messages == 750
    assert report.commits < 750


def test_bounds_are_inclusive(samples: list[Sample]) -> None:
    stamp = sorted(each.stamp for each in samples if not each.static)[1000]
    expected = [each for each in samples if each.static or each.stamp == stamp]
    assert any(not each.static for each in expected)
    check(tfdb.load(BAG, start=stamp, end=stamp), expected)


def path_between(parents: dict[str, str], a: str, b: str) -> set[str]:
    """Return the children of the edges on the path, found by walking up from both ends."""

    def up(frame: str) -> list[str]:
        found = [frame]
        while found[-1] in parents:
            found.append(parents[found[-1]])
        return found

    return set(up(a)[:-1]) ^ set(up(b)[:-1])


def test_frames(samples: list[Sample]) -> None:
    parents = {each.child: each.parent for each in samples}
    wanted = {"map", "l_gripper_tool_frame", "r_elbow_flex_link"}
    names = sorted(wanted)
    edges = set().union(*(path_between(parents, a, b) for a in names for b in names))
    assert 10 < len(edges) < 40
    expected = [each for each in samples if each.child in edges]
    check(tfdb.load(BAG, frames=wanted), expected)
    arm = {"l_gripper_tool_frame", "r_elbow_flex_link"}
    edges = path_between(parents, *arm)
    assert "base_footprint" not in edges
    check(tfdb.load(BAG, frames=arm), [each for each in samples if each.child in edges])


def test_one_frame_is_loaded_with_its_way_to_the_root(samples: list[Sample]) -> None:
    parents = {each.child: each.parent for each in samples}
    edges = path_between(parents, "/base_link".strip("/"), "map")
    assert len(edges) == 3
    for one in ("/base_link", np.array("base_link")):
        check(tfdb.load(BAG, frames=one), [each for each in samples if each.child in edges])


@pytest.mark.parametrize(
    "exclude",
    [
        "l_*",
        ["/l_?houlder_*", "odom"],
        "/localization",
        "tf_static",
        ["*_link", "/tf_static"],
    ],
)
def test_exclude(exclude: str | list[str], samples: list[Sample]) -> None:
    entries = [exclude] if isinstance(exclude, str) else exclude

    def is_out(name: str) -> bool:
        return any(fnmatch.fnmatchcase(name.lstrip("/"), entry.lstrip("/")) for entry in entries)

    expected = [
        each
        for each in samples
        if not any(map(is_out, (each.parent, each.child, each.topic, each.authority)))
    ]
    assert 0 < len(expected) < len(samples)
    check(tfdb.load(BAG, exclude=exclude), expected)


def test_names(samples: list[Sample]) -> None:
    new = {"map": "world", "odom": "map", "/base_link": "base"}
    plain = {old.lstrip("/"): name for old, name in new.items()}

    def name(frame: str) -> str:
        return "robot1/" + plain.get(frame, frame)

    expected = [each._replace(parent=name(each.parent), child=name(each.child)) for each in samples]
    check(tfdb.load(BAG, rename=new, prefix="robot1/"), expected)


def test_all_together(samples: list[Sample]) -> None:
    first, last = first_and_last([each for each in samples if each.child == "odom"])
    expected = [
        each._replace(parent="a/w", child=f"a/{each.child}")
        for each in samples
        if each.child == "odom" and first + S <= each.stamp <= last - S
    ]
    made = tfdb.load(
        MCAP,
        start=first + S,
        end=last - S,
        frames=["map", "odom"],
        exclude="/tf_static",
        rename={"map": "w"},
        prefix="a/",
    )
    check(made, expected)


def test_two_robots_in_one_store(samples: list[Sample]) -> None:
    buffer = tfdb.Buffer(history=None)
    for robot in ("a", "b"):
        buffer.load(BAG, prefix=f"{robot}/", keep=1)
    assert len(buffer.frames()) == 2 * 85
    a, b = (buffer.lookup_transform(f"{each}/map", f"{each}/base_link") for each in "ab")
    assert np.array_equal(a.translation, b.translation)


def test_parents_that_change_are_kept_on_every_way(tmp_path: Path) -> None:
    """The parent of a box is the table first, and the hand after the box is picked up."""
    path = tmp_path / "box.mcap"
    still = (0.0, 0.0, 0.0, 1.0)
    tfdb.recordings.write_transforms(
        path,
        [
            tfdb.TransformStamped("table", "box", S, (1, 2, 3), still),
            tfdb.TransformStamped("map", "hand", 2 * S, (3, 2, 1), still),
            tfdb.TransformStamped("hand", "box", 3 * S, (1, 1, 1), still),
        ],
        [tfdb.TransformStamped("map", "table", 0, (5, 0, 0), still)],
    )
    part = tfdb.load(path, frames={"table", "box"})
    assert set(part.frames()) == {"table", "box", "hand", "map"}
    # Then its path to the table goes over the map.
    at, policy = 3 * S, tfdb.Previous()
    found = part.lookup_transform("table", "box", at, policy)
    assert found == tfdb.load(path).lookup_transform("table", "box", at, policy)
    assert set(tfdb.load(path, frames={"hand", "map"}).frames()) == {"hand", "map"}


def test_a_limited_history_counts_selected_samples() -> None:
    buffer = tfdb.Buffer(history=1.0)
    with pytest.warns(tfdb.TfdbWarning, match="samples are not kept"):
        all_of_it = buffer.load(BAG).forgotten
    buffer = tfdb.Buffer(history=1.0)
    assert buffer.load(BAG, keep=0.9).forgotten == 0
    assert all_of_it > 1000


def test_damaged_messages_are_refused_as_without_options(tmp_path: Path) -> None:
    path = tmp_path / "bad.bag"
    good = tfdb.TransformStamped("a", "b", S, (1, 2, 3), (0, 0, 0, 1))
    bad = tfdb.TransformStamped("a", "b", 2 * S, (1, 2, 3), (0, 0, 0, 2))
    with tfdb.recordings.RecordingWriter(path) as writer:
        for number, each in enumerate((good, bad)):
            data = tfdb.encode_tf_message([each], "ros1")
            writer.write(data, number + 1, topic="/tf")
        writer.write(b"\x05\0\0\0broken", 3, topic="/tf")
    with pytest.warns(
        tfdb.TfdbWarning, match="1 (message|transform of frame '(r/)?b') was refused with"
    ):
        plain = tfdb.Buffer(history=None).load(path)
    with pytest.warns(
        tfdb.TfdbWarning, match="1 (message|transform of frame '(r/)?b') was refused with"
    ):
        chosen = tfdb.Buffer(history=None).load(path, prefix="r/", start=0)
    assert dict(chosen.reasons) == dict(plain.reasons)
    assert set(plain.reasons) == {"InvalidTransform", "CorruptMessage"}


def test_the_cache_keeps_choices_apart(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(MCAP.read_bytes())
    whole = tfdb.load(path, cache=True)
    part = tfdb.load(path, cache=True, frames={"map", "base_link"}, prefix="r/")
    again = tfdb.load(path, cache=True, frames=["base_link", "map"], prefix="r/")
    assert (len(whole.frames()), len(part.frames()), len(again.frames())) == (85, 4, 4)
    assert len(list(tmp_path.glob("*.tfdb"))) == 2


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        (
            {"start": "soon"},
            tfdb.InvalidArgument,
            "start: 'soon' is not .*: write",
        ),
        ({"end": "latest"}, tfdb.InvalidArgument, "end: 'latest' is not"),
        ({"start": -1}, tfdb.InvalidStamp, "stamp -1"),
        ({"start": 1.5}, tfdb.InvalidStamp, "1.5"),
        (
            {"start": 20, "end": 10},
            tfdb.InvalidArgument,
            "end \\(0.00000001 s\\) is before start",
        ),
        ({"frames": []}, tfdb.InvalidArgument, "frames is empty: name frames"),
        ({"frames": {"map", "base_lnk"}}, tfdb.UnknownFrame, "did you mean 'base_link'"),
        ({"frames": "nothing like it"}, tfdb.UnknownFrame, "the frames are 'base_footprint'"),
        ({"mix": "no"}, tfdb.InvalidArgument, "mix must be True or False, got 'no'"),
        ({"by_namespace": ""}, tfdb.InvalidArgument, "by_namespace must be True or False, got ''"),
        (
            {"frames": ["odom", "map"], "exclude": "ma*"},
            tfdb.UnknownFrame,
            r"frames: frame 'map' is left out by exclude=\['ma\*'\]",
        ),
        ({"frames": 3}, tfdb.InvalidArgument, "frames must be frame names, got 3"),
        ({"exclude": [b"map"]}, tfdb.InvalidArgument, "exclude must be frame names, got b'map'"),
        ({"exclude": ""}, tfdb.InvalidArgument, "exclude must be frame names, got ''"),
        (
            {"exclude": "*"},
            tfdb.errors.RecordingError,
            "all 7,180 transforms are left out by exclude=",
        ),
        ({"keep": 0}, tfdb.InvalidArgument, "keep must be a positive number of seconds .* got 0"),
        ({"keep": float("nan")}, tfdb.InvalidArgument, "got nan"),
        ({"keep": True}, tfdb.InvalidArgument, "got True"),
        (
            {"keep": 1e-12},
            tfdb.InvalidArgument,
            "keep must be a positive number of seconds .* got 1e-12",
        ),
        (
            {"start": "+99", "frames": ["map", "odom"]},
            tfdb.errors.RecordingError,
            r"by start=\+99, frames",
        ),
        ({"pose_topics": b"/odom"}, tfdb.InvalidArgument, "got bytes"),
        ({"topics": b"/tf"}, tfdb.InvalidArgument, "got bytes"),
        ({"exclude": b"map"}, tfdb.InvalidArgument, "exclude must be frame names, got b'map'"),
        ({"rename": "map"}, tfdb.InvalidArgument, "rename must map names to names, got 'map'"),
        ({"rename": {"map": 1}}, tfdb.InvalidArgument, "rename must be frame names, got 1"),
        ({"rename": {"map": "odom"}}, tfdb.InvalidArgument, "would both be called 'odom'"),
        ({"prefix": 1}, tfdb.InvalidArgument, "prefix must be a str, got int"),
    ],
)
def test_bad_options_leave_nothing(
    options: dict[str, Any], error: type[tfdb.TfdbError], words: str
) -> None:
    buffer = tfdb.Buffer(history=None)
    with pytest.raises(error, match=words):
        buffer.load(BAG, **options)
    assert buffer.commit == 0


def test_an_offset_where_nothing_moves(tmp_path: Path) -> None:
    path = tmp_path / "still.mcap"
    still = tfdb.TransformStamped("a", "b", 0, (1, 2, 3), (0, 0, 0, 1))
    tfdb.recordings.write_transforms(path, [], [still])
    for options in ({"start": "+1"}, {"keep": 1}):
        with pytest.raises(tfdb.InvalidArgument, match="no moving transform"):
            tfdb.load(path, **options)
    assert tfdb.load(path, start=5).frames() == ["a", "b"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"exclude": ["maap", "odom"]}, "exclude: no frame, topic or node of .* matches 'maap'"),
        ({"rename": {"odom": "o"}, "exclude": "odom"}, "'odom' of .* is left out by exclude"),
        ({"rename": {"maap": "world"}}, "rename: no frame of .* is called 'maap'"),
        ({"start": "+60"}, r"no moving transform from \S+ s; the stamps run from \S+ s to"),
    ],
)
def test_options_that_do_nothing_warn(options: dict[str, Any], words: str) -> None:
    with pytest.warns(tfdb.TfdbWarning, match=words) as caught:
        tfdb.load(BAG, **options)
    assert [Path(each.filename).name for each in caught] == ["test_choice.py"]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("suffix", [".bag", ".tum"])
@pytest.mark.parametrize(
    "options",
    [
        {"exclude": ["map", "odom"]},
        {"exclude": ["/tf", "/localization"]},
        {"exclude": ["/tf", "map"]},
        {"exclude": ["/tf", "/tf:odom"]},
        {"frames": ["base", "cam"], "exclude": ["map"]},
    ],
)
def test_names_that_are_left_out_by_another_option_do_not_warn(
    tmp_path: Path, suffix: str, options: dict[str, Any]
) -> None:
    path = tmp_path / "a.bag"
    still = tfdb.TransformStamped("base", "cam", 0, (1, 2, 3), (0, 0.6, 0, 0.8))
    moving = tfdb.TransformStamped("map", "odom", 10**9, (1, 2, 3), (0, 0.6, 0, 0.8))
    with tfdb.recordings.RecordingWriter(path) as writer:
        for one, topic in ((still, "/tf_static"), (moving, "/tf")):
            data = tfdb.encode_tf_message([one], writer.encoding)
            writer.write(data, 10**9, topic=topic, authority="/localization" * (one is moving))
    files = [path]
    if suffix == ".tum":  # decoded one by one
        files.append(tmp_path / "b.tum")
        files[1].write_text("1 1 2 3 0 0.6 0 0.8\n")
    assert "cam" in tfdb.load(files, **options).frames()


CASES = Path(__file__).resolve().parents[1] / "cases"


@pytest.mark.parametrize(
    "entry",
    ["/tf_static:base_link", "/tf_static:/base_link", "tf_static:base_*", "*_static:base_link"],
)
def test_the_edge_of_one_topic_is_left_out(entry: str) -> None:
    buffer = tfdb.load(CASES / "static_and_dyn.mcap", exclude=entry)
    assert buffer.frame_info("base_link").samples == 50
    found = buffer.lookup_transform("odom", "base_link", 1_700_000_000_500_000_000)
    assert found.translation[0] == pytest.approx(0.5)


def test_the_moving_samples_of_a_static_edge_can_be_left_out() -> None:
    buffer = tfdb.load(CASES / "static_and_dyn.mcap", exclude="/tf:base_link")
    assert buffer.frame_info("base_link").is_static


def test_an_edge_that_no_topic_has_is_named() -> None:
    with pytest.warns(tfdb.TfdbWarning, match="'/tf_static:base_lin'.*did you mean"):
        tfdb.load(BAG, exclude="/tf_static:base_lin")


def test_an_entry_without_a_topic_is_about_names_alone(samples: list[Sample]) -> None:
    """`tf*link` does not match an edge on a topic `tf...` of a frame `...link`."""
    child = next(each.child for each in samples if each.child.endswith("link"))
    with pytest.warns(tfdb.TfdbWarning, match="matches 'tf\\*link'"):
        buffer = tfdb.load(BAG, exclude="tf*link")
    assert buffer.frame_exists(child)


@pytest.mark.parametrize("options", [{}, {"prefix": "a/"}, {"rename": {"base_link": "base"}}])
def test_an_edge_that_is_static_and_moves_names_a_way_on(options: dict[str, Any]) -> None:
    """Each option in the warning loads the samples that the warning states."""
    path = CASES / "static_and_dyn.mcap"
    with pytest.warns(tfdb.TfdbWarning, match="StaticConflict") as caught:
        buffer = tfdb.load(path, **options)
    (text,) = {str(each.message) for each in caught}
    assert "change_kind" not in text
    assert "remove frame" not in text
    assert re.search(r"is moving, but the stored edge of '\S+' is static; exclude=", text)
    ways = {
        kept: entry
        for entry, again, kept in re.findall(
            r"exclude='(\S+)' \(--exclude '(\S+)'\) loads what is (\w+)", text
        )
        if entry == again
    }
    assert ways == {"moving": "/tf_static:base_link", "static": "/tf:base_link"}
    (child,) = (info.name for info in buffer.tree() if info.parent is not None)
    moving = tfdb.load(path, exclude=ways["moving"], **options)
    assert moving.frame_info(child).samples == 50
    static = tfdb.load(path, exclude=ways["static"], **options)
    assert static.frame_info(child).is_static
