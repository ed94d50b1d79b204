"""Several files, or two spellings of a topic, that agree or disagree on an edge."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

import tfdb
from tfdb.recordings import follow_recording

from .conftest import Message, drive
from .test_groups import START, STEP, TURN, driven, fixed

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from .conftest import Recorder

HALF = STEP // 2


def files(recorder: Recorder, folder: Path, *parts: Sequence[Message]) -> list[Path]:
    """Write a bag for each part, sorted by receive time."""
    return [
        recorder.bag(folder / f"{name}.bag", sorted(part, key=lambda one: one.received))
        for name, part in zip("abcdefgh", parts, strict=False)
    ]


@pytest.mark.parametrize(
    ("one", "other", "frame"),
    [
        (driven("/tf"), driven("/tf", x=50), "base"),
        (driven("/tf"), driven("/tf", x=50, later=HALF), "base"),
        (driven("/tf"), driven("/tf", x=50, rows=range(40, 90)), "base"),
        (driven("/tf"), driven("/tf", x=50, rows=range(49, 50)), "base"),
        (driven("/tf"), [*driven("/tf")[:49], *driven("/tf", x=1)[49:]], "base"),
        (driven("/tf"), driven("/tf", parent="map"), "base"),
        (driven("/tf"), driven("/tf", parent="map", later=HALF), "base"),
        (driven("/tf"), driven("/tf", turn=(0.0, 0.8, 0.0, 0.6), later=HALF), "base"),
        (fixed("/tf_static"), fixed("/tf_static", 2), "laser"),
        ([*driven("/tf"), *fixed("/tf_static")], fixed("/tf_static", 2), "laser"),
        (driven("/tf_old"), driven("/tf_old", x=50), "base"),
    ],
    ids=[
        "same stamps",
        "between the stamps",
        "tail",
        "one sample",
        "last sample",
        "parent",
        "parent between the stamps",
        "rotation",
        "static",
        "static during the other",
        "another topic",
    ],
)  # fmt: skip
def test_files_that_contradict_are_refused(
    one: list[Message], other: list[Message], frame: str, recorder: Recorder, tmp_path: Path
) -> None:
    paths = files(recorder, tmp_path, one, other)
    buffer = tfdb.Buffer(history=None)
    with pytest.raises(tfdb.errors.MixedSources, match=frame) as caught:
        buffer.load(paths)
    error = caught.value
    assert buffer.commit == 0
    assert error.frames == (frame,)
    assert list(error.groups or ()) == [str(path) for path in paths]
    for way in ("Load one file", "prefix=", "--prefix", "mix=True", "--mix"):
        assert way in str(error)
    with pytest.raises(tfdb.errors.MixedSources):
        tfdb.load(paths, topics=other[0].topic)
    with pytest.raises(tfdb.errors.MixedSources):
        tfdb.load(paths, by_namespace=True)


def test_each_way_on_leads_to_its_answer(recorder: Recorder, tmp_path: Path) -> None:
    paths = files(recorder, tmp_path, driven("/tf"), driven("/tf", x=50))
    at = START + 5 * STEP
    for path, x in zip(paths, (0.5, 50.5), strict=True):
        assert tfdb.load(path).lookup_transform("odom", "base", at).translation[0] == x
    buffer = tfdb.Buffer(history=None)
    for path, prefix in zip(paths, ("one/", "two/"), strict=True):
        buffer.load(path, prefix=prefix)
    assert buffer.lookup_transform("two/odom", "two/base", at).translation[0] == 50.5
    mixed = tfdb.load(paths, mix=True)
    assert mixed.lookup_transform("odom", "base", at).translation[0] == 50.5


@pytest.mark.parametrize(
    ("one", "other", "samples"),
    [
        (driven("/tf"), driven("/tf", rows=range(50, 90)), 90),
        (driven("/tf"), driven("/tf", rows=range(40, 90)), 90),
        (driven("/tf"), driven("/tf"), 50),
        (driven("/tf")[::3], driven("/tf")[1:], 50),
        ([*driven("/tf")[:20], *driven("/tf")[30:]], driven("/tf")[20:30], 50),
        (driven("/tf")[::2], driven("/tf")[1::2], 50),
        ([*driven("/tf")[:24], driven("/tf")[25]], [driven("/tf")[24], *driven("/tf")[26:]], 50),
        (driven("/tf"), driven("/tf", rows=range(500, 550), x=80), 100),
        (driven("/tf"), driven("/tf", turn=[-part for part in TURN]), 50),
        (driven("/tf"), driven("/tf", x=1e-9, rows=range(40, 90)), 90),
        (driven("/tf"), driven("/robot2/tf", child="robot2/base", x=50), 50),
    ],
    ids=[
        "consecutive",
        "overlapping",
        "same",
        "drops",
        "hole",
        "every other",
        "late at the seam",
        "another day",
        "other sign",
        "nearly",
        "another frame",
    ],
)
def test_parts_of_a_recording_agree(
    one: list[Message], other: list[Message], samples: int, recorder: Recorder, tmp_path: Path
) -> None:
    static = fixed("/tf_static")
    paths = files(recorder, tmp_path, [*one, *static], [*other, *static])
    buffer = tfdb.load(paths)
    assert buffer.frame_info("base").samples == samples
    assert tfdb.load(paths[::-1]).frame_info("base").samples == samples


def test_a_static_transform_that_changes_from_one_recording_to_the_next_contradicts(
    recorder: Recorder, tmp_path: Path
) -> None:
    """A static transform holds at all times, including those of the other file."""
    later = replace(fixed("/tf_static", 2)[0], received=START + 60 * STEP)
    first = [*driven("/tf"), *fixed("/tf_static")]
    paths = files(recorder, tmp_path, first, [*driven("/tf", rows=range(60, 90)), later])
    with pytest.raises(tfdb.errors.MixedSources, match="laser"):
        tfdb.load(paths)
    mixed = tfdb.load(paths, mix=True)
    assert mixed.lookup_transform("base", "laser", START).translation[0] == 2


def test_a_static_edge_of_one_file_that_moves_in_another_contradicts(
    recorder: Recorder, tmp_path: Path
) -> None:
    static = [replace(each, topic="/tf_static") for each in driven("/tf", x=3, rows=range(90, 91))]
    paths = files(recorder, tmp_path, driven("/tf"), static)
    with pytest.raises(tfdb.errors.MixedSources, match="base"):
        tfdb.load(paths)
    with pytest.warns(tfdb.TfdbWarning, match="StaticConflict"):
        assert tfdb.load(paths, mix=True).frame_info("base").samples == 50


def test_recordings_of_two_runs_of_a_simulation_contradict(
    recorder: Recorder, tmp_path: Path
) -> None:
    """Their stamps start again from the beginning, their receive times do not."""
    again = [
        replace(one, received=one.received + 100 * STEP) for one in driven("/tf", x=3, later=7)
    ]
    paths = files(recorder, tmp_path, driven("/tf"), again)
    with pytest.raises(tfdb.errors.MixedSources):
        tfdb.load(paths)


def test_noisy_samples_of_one_source_may_be_split_anywhere(
    recorder: Recorder, tmp_path: Path
) -> None:
    messages = drive(200)
    rng = np.random.default_rng(5)
    late = [replace(one, received=one.received + int(rng.integers(60_000_000))) for one in messages]
    late.sort(key=lambda one: one.received)
    for cut in range(20, 380, 40):
        paths = files(recorder, tmp_path, late[:cut], late[cut:])
        assert tfdb.load(paths).frame_info("base").samples == 200
        for path in paths:
            path.unlink()


def test_every_file_that_contradicts_is_named(recorder: Recorder, tmp_path: Path) -> None:
    parts = [driven("/tf"), driven("/tf", child="arm"), driven("/tf", x=4), driven("/tf", x=5)]
    paths = files(recorder, tmp_path, *parts)
    with pytest.raises(tfdb.errors.MixedSources, match="3 files") as caught:
        tfdb.load(paths)
    assert caught.value.groups == {str(paths[at]): ("/tf",) for at in (0, 2, 3)}


def test_the_topics_of_a_file_are_sorted(recorder: Recorder, tmp_path: Path) -> None:
    topics = ["/tf", "/tf_static", *(f"/tf_{number}" for number in range(2, 8))]
    parts = [
        [one for topic in topics for one in driven(topic, child=topic[1:], x=x)] for x in (1, 2)
    ]
    paths = files(recorder, tmp_path, *parts)
    with pytest.raises(tfdb.errors.MixedSources) as caught:
        tfdb.load(paths)
    assert caught.value.groups == {str(path): tuple(sorted(topics)) for path in paths}


def test_excluded_samples_do_not_contradict(recorder: Recorder, tmp_path: Path) -> None:
    paths = files(recorder, tmp_path, driven("/tf"), driven("/tf", x=9, rows=range(40, 60)))
    assert tfdb.load(paths, end=START + 39 * STEP).frame_info("base").samples == 40
    with pytest.raises(tfdb.errors.RecordingError, match="left out"):
        tfdb.load(paths, exclude="base")


def test_folders_of_equal_recordings_agree(recorder: Recorder, tmp_path: Path) -> None:
    folders = [recorder.folder(tmp_path / name, driven("/tf")) for name in ("one", "two")]
    assert tfdb.load(folders).frame_info("base").samples == 50


def test_trajectories_of_two_runs_contradict(tmp_path: Path) -> None:
    paths = []
    for name, y in (("one", 0), ("two", 3)):
        paths.append(tmp_path / f"{name}.tum")
        rows = [f"{100 + row * 0.1:.1f} {row} {y} 1 0.6 0 0 0.8" for row in range(20)]
        paths[-1].write_text("\n".join(rows) + "\n")
    with pytest.raises(tfdb.errors.MixedSources, match="body"):
        tfdb.load(paths)
    assert tfdb.load(paths, mix=True).frame_info("body").samples == 20


def test_two_spellings_of_a_topic_may_not_contradict(recorder: Recorder, tmp_path: Path) -> None:
    contradicting = [*driven("/tf"), *driven("tf", x=50)]
    (path,) = files(recorder, tmp_path, contradicting)
    with pytest.raises(tfdb.errors.MixedSources, match="are one topic") as caught:
        tfdb.load(path)
    assert caught.value.groups == {"/tf": ("/tf",), "tf": ("tf",)}
    assert "--mix" in str(caught.value)
    assert tfdb.load(path, mix=True).frame_info("base").samples == 50
    path.unlink()
    (path,) = files(recorder, tmp_path, [*driven("/tf"), *driven("tf", rows=range(40, 90))])
    assert tfdb.load(path).frame_info("base").samples == 90


def test_two_spellings_of_a_growing_topic_may_not_contradict(
    recorder: Recorder, tmp_path: Path
) -> None:
    for name, x in (("agree", 0), ("contradict", 50)):
        parts = [*driven("/tf"), *driven("tf", x=x)]
        folder = recorder.folder(tmp_path / name, sorted(parts, key=lambda one: one.received))
        (path,) = folder.glob("*.mcap")
        buffer = tfdb.Buffer(history=None)
        if x:
            with pytest.raises(tfdb.errors.MixedSources, match="are one topic"):
                follow_recording(buffer, path)
        else:
            follow_recording(buffer, path)
            assert buffer.frame_info("base").samples == 50
