"""Unreadable recordings raise a typed error with path and reason, and change no store."""

from __future__ import annotations

import sqlite3
import subprocess
import sys
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import tfdb
from tfdb.recordings import Recording, write_transforms

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

Drive = list[Any]


def refuse(path: Path | list[Path], reason: str, **arguments: Any) -> tfdb.errors.RecordingError:
    """Check that loading raises, the message starts with the path, and nothing is stored."""
    buffer = tfdb.Buffer(history=None)
    buffer.set_static_transform("map", "odom", (1, 2, 3))
    with pytest.raises(tfdb.errors.RecordingError) as caught:
        buffer.load(path, **arguments)
    named = ", ".join(map(str, path)) if isinstance(path, list) else str(path)
    assert caught.value.path == named
    assert reason in str(caught.value.reason)
    assert str(caught.value) == f"{named}: {caught.value.reason}"
    assert buffer.commit == 1
    assert buffer.frames() == ["map", "odom"]
    return caught.value


@pytest.mark.parametrize("name", ["a.bag", "a.db3", "a.mcap", "a"])
def test_no_recording(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(b"")
    refuse(path, "the file is empty")
    path.write_text("This is a text about bags, databases and MCAP files.\n")
    refuse(path, "neither a ROS 1 bag, nor a ROS 2 database (.db3), nor an MCAP file")
    refuse(path, "a trajectory ends in .tum, .txt, .csv, .npz or .parquet")
    path.write_bytes(b"#ROSBAG V1.2\n")
    refuse(path, "old version 1")


def test_a_robot_model_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text('<robot name="arm"><link name="base"/></robot>\n')
    refuse(path, "a robot model, not a recording: give it beside a recording with joint states")


def test_missing_files(tmp_path: Path) -> None:
    buffer = tfdb.Buffer()
    with pytest.raises(FileNotFoundError) as caught:
        buffer.load(tmp_path / "none.bag")
    assert caught.value.filename == str(tmp_path / "none.bag")
    with pytest.raises(tfdb.InvalidArgument, match="paths is empty"):
        buffer.load([])
    assert buffer.commit == 0


def test_folders_without_files(tmp_path: Path) -> None:
    refuse(tmp_path, "a folder without .db3 or .mcap files")


@pytest.mark.parametrize("compression", [None, "lz4", "bz2"])
@pytest.mark.parametrize("share", [0.01, 0.3, 0.9, 0.99, 0.9999])
def test_bags_cut_short(
    recorder: Any, messages: Drive, tmp_path: Path, compression: str | None, share: float
) -> None:
    path = recorder.bag(tmp_path / "a.bag", messages, compression)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * share)])
    error = refuse(path, "damaged or cut short")
    assert "rosbag reindex" in str(error)


def test_bags_without_an_index(recorder: Any, messages: Drive, tmp_path: Path) -> None:
    path = recorder.bag(tmp_path / "a.bag", messages)
    raw = bytearray(path.read_bytes())
    at = raw.index(b"index_pos=") + len(b"index_pos=")
    raw[at : at + 8] = bytes(8)
    path.write_bytes(raw)
    refuse(path, "not indexed")


@pytest.mark.parametrize("share", [0.01, 0.3, 0.9, 0.99, 0.9999])
def test_mcap_cut_short(recorder: Any, messages: Drive, tmp_path: Path, share: float) -> None:
    folder = recorder.folder(tmp_path / "a", messages, "mcap")
    whole = (folder / "a.mcap").read_bytes()
    path = tmp_path / "cut.mcap"
    path.write_bytes(whole[: int(len(whole) * share)])
    refuse(path, "cut short, its end is missing: `mcap recover`")


def test_databases_cut_short(recorder: Any, messages: Drive, tmp_path: Path) -> None:
    folder = recorder.folder(tmp_path / "a", messages, "sqlite3")
    whole = (folder / "a.db3").read_bytes()
    path = tmp_path / "cut.db3"
    for share in (0.01, 0.3, 0.9):
        path.write_bytes(whole[: int(len(whole) * share)])
        refuse(path, "damaged or cut short")


CONTAINERS = ["bag", "bag-lz4", "bag-bz2", "mcap", "mcap-zstd", "db3"]


@pytest.mark.filterwarnings("ignore::tfdb.TfdbWarning")  # a flipped stamp is of another clock
@pytest.mark.parametrize("container", CONTAINERS)
def test_flipped_bytes(recorder: Any, messages: Drive, tmp_path: Path, container: str) -> None:
    """For any damage, the file loads with refusals, or a typed error stores nothing."""
    kind, _, option = container.partition("-")
    if kind == "bag":
        path = recorder.bag(tmp_path / "a.bag", messages[:60], option or None)
    else:
        plugin = "mcap" if kind == "mcap" else "sqlite3"
        folder = recorder.folder(
            tmp_path / "a", messages[:60], plugin, "storage" if option else "none"
        )
        path = next(folder.glob(f"*.{kind}"))
    whole = path.read_bytes()
    rng = np.random.default_rng(5)
    loaded = 0
    for _ in range(80):
        raw = bytearray(whole)
        # After the first bytes, which identify the format.
        raw[int(rng.integers(16, len(raw)))] ^= int(rng.integers(1, 256))
        path.write_bytes(raw)
        buffer = tfdb.Buffer(history=None)
        try:
            report = buffer.load(path)
        except tfdb.errors.RecordingError as error:
            assert error.path == str(path)
            assert buffer.commit == 0
        else:
            assert buffer.commit == report.commits == report.messages - report.refused
            loaded += 1
    print(f"{loaded} of 80 loaded")


def test_databases_without_the_tables(tmp_path: Path) -> None:
    path = tmp_path / "a.db3"
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE songs (name TEXT)")
    database.close()
    refuse(path, "missing tables")


def other_type(recorder: Any, path: Path) -> Path:
    from rosbags.rosbag2 import StoragePlugin, Writer

    with Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection("/chat", "std_msgs/msg/String", typestore=recorder.ros2)
        types = recorder.ros2.types
        data = recorder.ros2.serialize_cdr(
            types["std_msgs/msg/String"](data="hi"), "std_msgs/msg/String"
        )
        writer.write(connection, 5, data)
    return path


def test_no_topic_with_transforms(recorder: Any, tmp_path: Path) -> None:
    folder = other_type(recorder, tmp_path / "a")
    for path in (folder, folder / "a.db3"):
        refuse(path, "no topic with transforms; its topics: /chat (std_msgs/msg/String)")
        refuse(path, "topic '/chat' holds std_msgs/msg/String, not transforms", topics=["/chat"])
        refuse(path, "no topic '/tf'; its topics: /chat", topics={"/tf": "tf"})


def test_missing_topics(recorder: Any, messages: Drive, tmp_path: Path) -> None:
    path = recorder.bag(tmp_path / "a.bag", messages)
    error = refuse(path, "no topic '/robot2/tf'", topics=["/tf", "/robot2/tf"])
    assert "/tf (tf2_msgs/msg/TFMessage), /tf_static" in str(error)


def test_topics_without_messages(recorder: Any, tmp_path: Path) -> None:
    from rosbags.rosbag2 import StoragePlugin, Writer

    with Writer(tmp_path / "a", version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        writer.add_connection("/tf", "tf2_msgs/msg/TFMessage", typestore=recorder.ros2)
    refuse(tmp_path / "a" / "a.db3", "have no transform")


def test_nothing_but_refusals(recorder: Any, messages: Drive, tmp_path: Path) -> None:
    cls = type(messages[0])
    bad = [cls("/tf", n, [("a", "b", 5, (0, 0, 0, 0, 0, 0, 0))]) for n in (5, 6)]
    path = recorder.bag(tmp_path / "a.bag", bad)
    refuse(
        path, "all messages were refused; 2 transforms of frame 'b' were refused with InvalidTrans"
    )


def test_one_bad_file_of_several(recorder: Any, messages: Drive, tmp_path: Path) -> None:
    good = recorder.bag(tmp_path / "good.bag", messages)
    bad = recorder.bag(tmp_path / "bad.bag", messages, "bz2")
    raw = bytearray(bad.read_bytes())
    at = raw.index(b"BZh9", len(raw) // 2)
    raw[at + 20 : at + 40] = bytes(20)
    bad.write_bytes(raw)
    buffer = tfdb.Buffer(history=None)
    with pytest.raises(tfdb.errors.RecordingError, match="damaged or cut short") as caught:
        buffer.load([good, bad])
    assert caught.value.path == str(bad)
    assert buffer.commit == 0


def test_a_recorder_that_did_not_finish(recorder: Any, messages: Drive, tmp_path: Path) -> None:
    path = recorder.folder(tmp_path / "a", messages, "sqlite3") / "a.db3"
    path.with_name("a.db3-wal").write_bytes(b"x" * 100)
    refuse(path, "its write-ahead log a.db3-wal is damaged or cut short")


def test_payloads_of_another_encoding(recorder: Any, messages: Drive, tmp_path: Path) -> None:
    from mcap.writer import Writer

    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="", library="test")
        schema = writer.register_schema("tf2_msgs/msg/TFMessage", "jsonschema", b"{}")
        channel = writer.register_channel("/tf", "json", schema)
        writer.add_message(channel, 5, b"{}", 5)
        writer.finish()
    refuse(path, "topic '/tf' is encoded as 'json', not as cdr or ros1")


@pytest.mark.parametrize("missing", ["rosbags", "lz4", "backports", "ruamel"])
def test_missing_libraries(
    recorder: Any, messages: Drive, tmp_path: Path, missing: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Uncompressed files need no library."""
    packed = {
        "lz4": recorder.bag(tmp_path / "b.bag", messages, "lz4"),
        "backports": recorder.folder(tmp_path / "c", messages, mode="storage") / "c.mcap",
        "ruamel": recorder.folder(tmp_path / "d", messages),
    }
    bag = recorder.bag(tmp_path / "a.bag", messages)
    mcap = recorder.folder(tmp_path / "b", messages) / "b.mcap"
    db3 = recorder.folder(tmp_path / "e", messages, "sqlite3") / "e.db3"
    for name in [name for name in sys.modules if name.split(".")[0] == missing]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, missing, None)
    for path in (bag, mcap, db3):
        assert tfdb.load(path).commit == len(messages)
    for name, path in packed.items():
        if name == missing:
            error = refuse(path, "which comes with tfdb, but is missing: pip install tfdb")
            assert f"needs {missing}" in error.reason
        else:
            assert tfdb.load(path).commit == len(messages)


def test_the_libraries_are_imported_late() -> None:
    names = {"rosbags", "lz4", "backports", "ruamel"}
    code = f"import sys, tfdb, tfdb.recordings; print({names} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


def test_reading_after_damage(recorder: Any, messages: Drive, tmp_path: Path) -> None:
    """A reader of single messages gets the error when it reaches the damage."""
    path = recorder.bag(tmp_path / "a.bag", messages, "bz2")
    raw = bytearray(path.read_bytes())
    at = raw.index(b"BZh9", len(raw) // 2)
    raw[at + 20 : at + 40] = bytes(20)
    path.write_bytes(raw)
    found = []
    read: Callable[[], None] = lambda: found.extend(recording.messages())  # noqa: E731
    with Recording(path) as recording, pytest.raises(tfdb.errors.RecordingError):
        read()
    assert 0 < len(found) < len(messages)


@pytest.mark.parametrize("name", ["a\0b.bag", "\ud800.bag"])
def test_names_that_no_file_can_have(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    with pytest.raises(tfdb.errors.RecordingError, match="no file can have this name"):
        tfdb.load(path)
    with pytest.raises(tfdb.errors.TrajectoryError, match="no file can have this name"):
        tfdb.Trajectory.read(path)
    with pytest.raises(tfdb.errors.RecordingError, match="no file can have this name"):
        write_transforms(path, [tfdb.TransformStamped("a", "b", 5, (1, 2, 3))])


@pytest.mark.parametrize("kind", ["bag", "mcap", "db3", "folder"])
@pytest.mark.parametrize("error", [AttributeError, TypeError, KeyError, ValueError, RuntimeError])
def test_bugs_are_not_reported_as_damage(
    recorder: Any,
    messages: Drive,
    tmp_path: Path,
    kind: str,
    error: type[Exception],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A failing call during the reading of a good file is not reported as damage."""
    from tfdb.recordings import bag_folder, bag_reader, db3_reader, mcap_index

    def fail(*_: object, **__: object) -> None:
        raise error("a fault of the program")

    path, module, name = {
        "bag": lambda: (recorder.bag(tmp_path / "a.bag", messages), bag_reader, "_messages_in"),
        "mcap": lambda: (
            recorder.folder(tmp_path / "a", messages) / "a.mcap",
            mcap_index.Index,
            "learn",
        ),
        "db3": lambda: (
            recorder.folder(tmp_path / "a", messages, "sqlite3") / "a.db3",
            db3_reader,
            "_is",
        ),
        "folder": lambda: (recorder.folder(tmp_path / "a", messages), bag_folder, "_get"),
    }[kind]()
    monkeypatch.setattr(module, name, fail)
    for salvage in (False, True):
        with pytest.raises(error, match="a fault of the program"):
            tfdb.load(path, salvage=salvage)


def test_a_wrong_call_of_sqlite_is_not_damage(
    recorder: Any, messages: Drive, tmp_path: Path
) -> None:
    path = recorder.folder(tmp_path / "a", messages, "sqlite3") / "a.db3"
    recording = Recording(path)
    recording.close()
    with pytest.raises(sqlite3.ProgrammingError):
        list(recording.messages())


def test_versions_of_the_library_that_writes() -> None:
    """The version is below the limit in pyproject.toml; raise it if newer ones pass the tests."""
    from importlib.metadata import requires, version

    (wanted,) = (each for each in requires("tfdb") or () if each.startswith("rosbags"))
    assert "<0.12" in wanted
    assert version("rosbags").split(".")[:2] == ["0", "11"]
