"""A leading slash: arguments are exact names; names in ROS messages lose one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from click.testing import CliRunner

import tfdb
from tfdb.cli.app import cli
from tfdb.recordings import RecordingWriter
from tfdb.tf2 import BufferCore, LookupException, msgs

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

TURNED = (0.0, 0.0, 0.6, 0.8)
POSE = (1.0, 2.0, 3.0, *TURNED)


def set_reparented(buf: tfdb.Buffer, parent: str, child: str) -> None:
    with buf.transaction() as tx:
        tx.reparent(child, parent, 5, (1, 2, 3), TURNED)


def set_in_transaction(buf: tfdb.Buffer, parent: str, child: str) -> None:
    with buf.transaction() as tx:
        tx.set_transform(parent, child, 5, (1, 2, 3), TURNED)


WRITES: list[Callable[[tfdb.Buffer, str, str], object]] = [
    lambda buf, a, b: buf.set_transform(a, b, 5, (1, 2, 3), TURNED),
    lambda buf, a, b: buf.set_static_transform(a, b, (1, 2, 3), TURNED),
    lambda buf, a, b: buf.set_transforms([tfdb.TransformStamped(a, b, 5, (1, 2, 3), TURNED)]),
    lambda buf, a, b: buf.set_transforms(tfdb.Columns(a, b, [5], [POSE])),
    lambda buf, a, b: buf.set_transforms(tfdb.Columns([a], [b], [5], [POSE])),
    set_in_transaction,
]


@pytest.mark.parametrize("write", WRITES)
def test_writes_keep_names_exactly(
    write: Callable[[tfdb.Buffer, str, str], object],
) -> None:
    buf = tfdb.Buffer()
    write(buf, "/map", "/base")
    write(buf, "map", "base")
    assert buf.frames() == ["/base", "/map", "base", "map"]
    set_reparented(buf, "/map", "/new")
    assert buf.parent_of("/new") == "/map"
    assert buf.lookup_transform("/map", "/base", 5).target == "/map"


def test_reads_use_names_exactly() -> None:
    buf = tfdb.Buffer()
    buf.set_transform("map", "base", 5, (1, 2, 3), TURNED)
    with buf.snapshot() as snapshot, buf.transaction() as tx:
        calls: list[Callable[[], object]] = [
            lambda: snapshot.lookup_transform("/map", "base", 5),
            lambda: snapshot.lookup_latest_transform("map", "/base"),
            lambda: snapshot.lookup_transforms("/map", "base", [5]),
            lambda: snapshot.transform_points("/map", "base", np.ones((1, 3)), 5),
            lambda: snapshot.lookup_transform_full("map", 5, "base", 5, "/map"),
            lambda: snapshot.lookup_velocity("/base", "map"),
            lambda: snapshot.latest_common_time("/map", "base"),
            lambda: snapshot.common_times("map", "/base"),
            lambda: snapshot.frame_info("/map"),
            lambda: snapshot.parent_of("/base"),
            lambda: snapshot.samples("/base"),
            lambda: snapshot.children("/map"),
            lambda: snapshot.descendants("/map"),
            lambda: snapshot.path("/map", "base"),
            lambda: snapshot.trajectory("/map", "base"),
            lambda: tx.lookup_transform("/map", "base", 5),
            lambda: tx.parent_of("/base"),
            lambda: tx.remove_frames("/base"),
        ]
        for call in calls:
            with pytest.raises(tfdb.UnknownFrame, match="'/"):
                call()
        assert not snapshot.can_transform("/map", "base", 5)
        assert not snapshot.frame_exists("/map")
        assert "/map" not in snapshot
        assert not tx.frame_exists("/map")
    with pytest.raises(tfdb.UnknownFrame):
        buf.remove_frames("/base")


def message(parent: str, child: str) -> msgs.TransformStamped:
    pose = msgs.Transform(msgs.Vector3(1, 2, 3), msgs.Quaternion(0, 0, 0.6, 0.8))
    return msgs.TransformStamped(msgs.Header(msgs.Time(0, 5), parent), child, pose)


def wire(parent: str, child: str) -> bytes:
    """The bytes of a message that says these names: what encoding writes keeps a slash."""
    data = tfdb.encode_tf_message([tfdb.TransformStamped("_" + parent, "_" + child, 5, (1, 2, 3))])
    return data.replace(b"_/", b"/_")


MESSAGES: list[Callable[[tfdb.Buffer], object]] = [
    lambda buf: buf.set_transforms([message("/map", "/base")]),
    lambda buf: buf.ingest(tfdb.encode_tf_message([message("/map", "/base")])),
    lambda buf: buf.ingest_many(
        [tfdb.encode_tf_message([message("/map", "/base")])], encoding="cdr"
    ),
]


@pytest.mark.parametrize("take", MESSAGES)
def test_names_in_messages_lose_one_slash(take: Callable[[tfdb.Buffer], object]) -> None:
    buf = tfdb.Buffer()
    take(buf)
    assert buf.frames() == ["base", "map"]
    buf = tfdb.Buffer()
    with buf.transaction() as tx:
        tx.set_transforms([message("//map", "/base")])
    assert buf.frames() == ["/map", "base"]


def test_bytes_of_messages_lose_one_slash() -> None:
    (read,) = tfdb.decode_tf_message(wire("/map", "/base"))
    assert (read.parent, read.child) == ("_map", "_base")
    # What was given by name comes back as it was, slash and all.
    given = tfdb.TransformStamped("/map", "base", 5, (1.0, 2.0, 3.0), TURNED)
    (read,) = tfdb.decode_tf_message(tfdb.encode_tf_message([given]))
    assert read == given
    buf = tfdb.Buffer()
    buf.ingest(wire("/map", "/base"))
    assert buf.frames() == ["_base", "_map"]


def test_recordings_and_commands(tmp_path: Path) -> None:
    own = tfdb.TransformStamped("/own", "_map", 5, (1, 2, 3), TURNED)
    with RecordingWriter(tmp_path / "drive.mcap") as writer:
        for data in (wire("/map", "/base"), tfdb.encode_tf_message([own], writer.encoding)):
            writer.write(data, 5, topic="/tf", static=False)
    loaded = tfdb.load(tmp_path / "drive.mcap")
    assert loaded.frames() == ["/own", "_base", "_map"]
    run = CliRunner().invoke
    for names in (["_map", "_base"], ["/_map", "/_base"], ["/own", "_map"]):
        done = run(cli, ["lookup", str(tmp_path / "drive.mcap"), *names])
        assert done.exit_code == 0, done.output
    done = run(cli, ["lookup", str(tmp_path / "drive.mcap"), "own", "_map"])
    assert done.exit_code != 0
    assert "'/own'" in done.output


def test_tf2_keeps_its_own_rules() -> None:
    core = BufferCore()
    core.set_transform(message("/map", "/base"), "")
    assert core.lookup_transform_core("map", "base", 0).child_frame_id == "base"
    with pytest.raises((LookupException, tfdb.TfdbError), match="/"):
        core.lookup_transform_core("/map", "base", 0)
