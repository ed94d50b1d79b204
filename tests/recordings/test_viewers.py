"""Files of `to_rerun` and `to_foxglove`, read by the viewers' own libraries."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tfdb

MS = 1_000_000
START = 1_795_240_381_202_673_751


@pytest.fixture
def store() -> tfdb.Buffer:
    """Two moving edges of different rates, an edge that changes its parent, a static edge."""
    rng = np.random.default_rng(7)
    buf = tfdb.Buffer(history=None)

    def poses(count: int) -> np.ndarray:
        made = rng.normal(size=(count, 7))
        made[:, 3:] /= np.linalg.norm(made[:, 3:], axis=1, keepdims=True)
        return made

    stamps = START + np.arange(20) * 100 * MS
    buf.set_transforms(tfdb.Columns("map", "base $x$/1", stamps, poses(20)))
    buf.set_transforms(tfdb.Columns("base $x$/1", "arm", stamps[::2], poses(10)))
    buf.set_transforms(tfdb.Columns("map", "cup", stamps[:5], poses(5)))
    buf.set_transforms(tfdb.Columns("arm", "cup", stamps[5:], poses(15)))
    (fixed,) = poses(1)
    buf.set_static_transform("arm", "größe_机器人", fixed[:3], fixed[3:])
    return buf


def samples(buf: tfdb.Buffer) -> dict[tuple[str, int], tuple[str, np.ndarray]]:
    """Return (child, stamp) -> (parent, pose); static edges have stamp -1."""
    found = {}
    for info in buf.tree():
        stamps, poses, parents = buf.samples(info.name)
        for stamp, pose, parent in zip(stamps.tolist(), poses, parents, strict=True):
            found[info.name, -1 if info.is_static else stamp] = (parent, pose)
    return found


def read_rrd(path: Path) -> dict[tuple[str, int], tuple[str, np.ndarray]]:
    chunk = pytest.importorskip("rerun.chunk")
    found = {}
    for part in chunk.RrdReader(str(path)).stream().to_chunks():
        batch = part.to_record_batch()
        columns = {name.rsplit(":", 1)[-1]: batch.column(name) for name in batch.schema.names}
        if "translation" not in columns:
            continue
        stamps = (
            [-1] * batch.num_rows if part.is_static else columns["stamp"].cast("int64").to_pylist()
        )
        for row, stamp in enumerate(stamps):
            one = {name: column[row].as_py() for name, column in columns.items()}
            pose = np.array([*one["translation"][0], *one["quaternion"][0]])
            found[one["child_frame"][0], stamp] = (one["parent_frame"][0], pose)
    return found


def read_mcap(path: Path) -> dict[tuple[str, int], tuple[str, np.ndarray]]:
    """Read an MCAP file by its own schemas."""
    from mcap.reader import make_reader

    decoder = pytest.importorskip("mcap_protobuf.decoder").DecoderFactory()
    found = {}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[decoder])
        for schema, channel, message, body in reader.iter_decoded_messages():
            assert channel.message_encoding == "protobuf"
            if schema.name != "foxglove.FrameTransforms":
                continue
            for one in body.transforms:
                stamp = one.timestamp.ToNanoseconds()
                assert message.log_time == stamp
                t, r = one.translation, one.rotation
                pose = np.array([t.x, t.y, t.z, r.x, r.y, r.z, r.w])
                stamp = -1 if channel.topic.endswith("_static") else stamp
                found[one.child_frame_id, stamp] = (one.parent_frame_id, pose)
    return found


def assert_same(found: Any, expected: Any, tolerance: float) -> None:
    assert found.keys() == expected.keys()
    for key, (parent, pose) in expected.items():
        assert found[key][0] == parent, key
        np.testing.assert_allclose(found[key][1], pose, atol=tolerance, rtol=0, err_msg=str(key))


def test_rerun_has_every_pose(store: tfdb.Buffer, tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    path = tmp_path / "drive.rrd"
    assert tfdb.to_rerun(store, path) == 51
    assert_same(read_rrd(path), samples(store), 1e-6)  # single precision
    with store.snapshot() as snap:
        assert tfdb.to_rerun(snap, path, overwrite=True) == 51


def test_foxglove_has_every_pose(store: tfdb.Buffer, tmp_path: Path) -> None:
    pytest.importorskip("foxglove")
    path = tmp_path / "drive.mcap"
    assert tfdb.to_foxglove(store, path) == 51
    assert_same(read_mcap(path), samples(store), 0.0)


@pytest.mark.parametrize(("name", "end"), [("to_rerun", "rrd"), ("to_foxglove", "mcap")])
def test_trajectories(store: tfdb.Buffer, tmp_path: Path, name: str, end: str) -> None:
    pytest.importorskip("rerun" if end == "rrd" else "foxglove")
    paths = [store.trajectory("map", frame, missing="nan") for frame in ("arm", "cup")]
    holed = paths[0].poses.copy()
    holed[3] = np.nan
    paths[0] = tfdb.Trajectory("map", "arm", paths[0].stamps, holed)
    target = tmp_path / f"path.{end}"
    count = sum(int(np.isfinite(path.poses).all(axis=1).sum()) for path in paths)
    assert getattr(tfdb, name)(paths, target) == count
    found = read_rrd(target) if end == "rrd" else read_mcap(target)
    assert len(found) == count
    for path in paths:
        for stamp, pose in zip(path.stamps.tolist(), path.poses, strict=True):
            if np.isfinite(pose).all():
                parent, written = found[path.source, stamp]
                assert parent == "map"
                np.testing.assert_allclose(written, pose, atol=1e-6)
    getattr(tfdb, name)(paths[0], target, overwrite=True)


def test_rerun_logs_into_a_recording(store: tfdb.Buffer, tmp_path: Path) -> None:
    rerun = pytest.importorskip("rerun")
    path = tmp_path / "own.rrd"
    recording = rerun.RecordingStream("mine")
    recording.save(path)
    assert tfdb.to_rerun(store, recording=recording, entity="robot", axes=0) == 51
    recording.disconnect()
    assert_same(read_rrd(path), samples(store), 1e-6)
    with pytest.raises(tfdb.InvalidArgument, match="Rerun has no active recording"):
        tfdb.to_rerun(store)
    with pytest.raises(tfdb.InvalidArgument, match="not both"):
        tfdb.to_rerun(store, tmp_path / "a.rrd", recording=recording)


@pytest.mark.parametrize("name", ["to_rerun", "to_foxglove"])
def test_wrong_arguments_are_refused(store: tfdb.Buffer, tmp_path: Path, name: str) -> None:
    pytest.importorskip("rerun" if name == "to_rerun" else "foxglove")
    export = getattr(tfdb, name)
    path = tmp_path / "out"
    path.write_text("mine")
    with pytest.raises(tfdb.InvalidArgument, match="exists already"):
        export(store, path)
    assert path.read_text() == "mine"
    for wrong in (None, 7, "map", [store], np.zeros((3, 7))):
        with pytest.raises(tfdb.InvalidArgument, match="takes a Buffer, a Snapshot"):
            export(wrong, tmp_path / "new")
    with pytest.raises(tfdb.InvalidArgument, match="the list is empty"):
        export([], tmp_path / "new")
    once = store.trajectory("map", "arm")
    with pytest.raises(tfdb.InvalidArgument, match="two trajectories have the source frame 'arm'"):
        export([once, once], tmp_path / "new")
    for path in ("", 7):
        with pytest.raises(tfdb.InvalidArgument, match="path"):
            export(store, path)
    assert not (tmp_path / "new").exists()


def test_bad_options(store: tfdb.Buffer, tmp_path: Path) -> None:
    for options in ({"entity": ""}, {"entity": 3}, {"axes": -1}, {"axes": "x"}):
        with pytest.raises(tfdb.InvalidArgument, match=r"entity must be|axes must be"):
            tfdb.to_rerun(store, tmp_path / "new", **options)
    for topic in ("", "/", 3):
        with pytest.raises(tfdb.InvalidArgument, match="topic must be"):
            tfdb.to_foxglove(store, tmp_path / "new", topic=topic)


@pytest.mark.parametrize(
    ("name", "module", "remedy"),
    [
        ("to_rerun", "rerun", "pip install 'tfdb[rerun]'"),
        ("to_foxglove", "foxglove", "pip install 'tfdb[foxglove]'"),
    ],
)
def test_a_missing_library_is_named(
    store: tfdb.Buffer, tmp_path: Path, name: str, module: str, remedy: str, monkeypatch: Any
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    for writer in ("rerun_writer", "foxglove_writer"):
        monkeypatch.delitem(sys.modules, f"tfdb.viewers.{writer}", raising=False)
        monkeypatch.delattr(f"tfdb.viewers.{writer}", raising=False)
    with pytest.raises(tfdb.errors.NotSupported) as caught:
        getattr(tfdb, name)(store, tmp_path / "new")
    assert remedy in str(caught.value)


def test_they_are_imported_when_used() -> None:
    program = (
        "import sys, tfdb; tfdb.to_rerun, tfdb.to_foxglove;"
        "assert not {'rerun', 'foxglove', 'pyarrow', 'numpy'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


def test_convert_writes_for_viewers(tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    pytest.importorskip("foxglove")
    bag = Path(__file__).parents[2] / "examples/data/pr2.bag"
    expected = samples(tfdb.load(bag))
    for read, *arguments in ((read_rrd, "a.rrd"), (read_mcap, "a.mcap", "--foxglove")):
        command = [sys.executable, "-m", "tfdb.cli", "convert", str(bag), *arguments]
        said = subprocess.run(command, cwd=tmp_path, check=True, capture_output=True, text=True)
        assert f"{arguments[0]}: {len(expected):,} transforms" in said.stdout
        assert_same(read(tmp_path / arguments[0]), expected, 1e-6)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("a.rrd", "--compress"), "--compress is valid for recordings"),
        (("a.bag", "--foxglove"), "--foxglove writes .mcap"),
        (("a.rrd", "--frames", "map", "odom"), "--frames TARGET SOURCE is valid for"),
        (("a.tum",), "'a.tum' is a trajectory: name its --frames TARGET SOURCE"),
    ],
)
def test_convert_refuses(arguments: tuple[str, ...], words: str, tmp_path: Path) -> None:
    bag = Path(__file__).parents[2] / "examples/data/pr2.bag"
    command = [sys.executable, "-m", "tfdb.cli", "convert", str(bag), *arguments]
    done = subprocess.run(command, check=False, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 2
    assert words in done.stderr


def test_rerun_refuses_poses_beyond_single_precision(tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    far = tfdb.Trajectory("map", "comet", [5], [[1e39, 2, 3, 0, 0.6, 0, 0.8]])
    with pytest.raises(tfdb.InvalidArgument, match="frame 'comet' is 1e\\+39 m from its parent"):
        tfdb.to_rerun(far, tmp_path / "far.rrd")
    assert not list(tmp_path.iterdir())
