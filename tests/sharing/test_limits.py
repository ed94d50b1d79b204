"""Refused names, sizes, permissions and damaged files."""

from __future__ import annotations

import fcntl
import grp
import multiprocessing
import os
import pickle
import stat
import struct
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tfdb
from tfdb.store.shared import find_stores

from . import child
from .all_reads import RECORDING, TURN, fill
from .child import Child

SHM = Path("/dev/shm")


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        ("a/b", "has a slash"),
        ("", "is empty"),
        ("x" * 201, "is longer than 200 bytes"),
        (".x", "begins with a dot"),
        ("a\nb", "has a control character"),
        ("a\0b", "has a control character"),
        ("\udcff", "has a control character"),
    ],
)
def test_bad_names(bad: str, reason: str) -> None:
    for call in (tfdb.Buffer.open, tfdb.Buffer.unlink):
        with pytest.raises(tfdb.errors.InvalidName, match="a name is one word") as caught:
            call(bad)
        assert caught.value.reason == reason


@pytest.mark.parametrize("bad", [None, 3, b"x", ["x"]])
def test_invalid_names_are_refused(bad: Any) -> None:
    for call in (tfdb.Buffer.open, tfdb.Buffer.unlink):
        with pytest.raises(TypeError, match="a store's name is a str or a path"):
            call(bad)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"mode": "w"}, "mode must be 'r' or 'rw'"),
        ({"mode": "r", "create": True}, "create one with mode 'rw'"),
        ({"create": "no"}, "create must be True, False or None, got 'no'"),
        ({"clock": 5}, "clock must be a function"),
        ({"size": 100}, "for 65536 frames needs a size between"),
        ({"size": 1 << 50}, "for 65536 frames needs a size between"),
        ({"size": 1 << 24, "max_frames": 1 << 19}, "for 524288 frames needs a size between"),
        ({"size": -1}, "size must be an integer"),
        ({"max_frames": 0}, "max_frames must be an integer from 1"),
        ({"history": -1}, "history must be a number of seconds"),
        ({"history": 0}, "history must be positive"),
        ({"permissions": 0o1777}, "permissions must be an integer"),
        ({"group": "no such group"}, "the group 'no such group' does not exist"),
        ({"group": -1}, "group must be an integer"),
        ({"lock_timeout": -1}, "lock_timeout must be a number of seconds"),
        ({"lock_timeout": float("nan")}, "lock_timeout must be a number of seconds"),
    ],
)
def test_bad_options(name: str, options: dict[str, Any], said: str) -> None:
    with pytest.raises(tfdb.InvalidArgument, match=said):
        tfdb.Buffer.open(name, **options)
    assert not list(SHM.glob(f"tfdb.{name}*"))


def test_other_files_are_refused(name: str, tmp_path: Path) -> None:
    path = SHM / f"tfdb.{name}"
    try:
        os.mkfifo(path)
        for mode in ("r", "rw"):
            with pytest.raises(tfdb.errors.CorruptStore, match="not a store of tfdb"):
                tfdb.Buffer.open(name, mode=mode)
        with pytest.raises(tfdb.errors.CorruptStore, match="not a store of tfdb"):
            tfdb.Buffer.unlink(name)
        path.unlink()
        path.symlink_to(tmp_path / "nowhere")
        with pytest.raises(tfdb.errors.CorruptStore, match="a dangling link"):
            tfdb.Buffer.open(name)
    finally:
        path.unlink()
    assert not list(SHM.glob(f"tfdb.{name}*"))


def test_a_folder_that_is_missing_is_named(tmp_path: Path) -> None:
    with pytest.raises(
        tfdb.errors.NoSuchStore, match=r"none/store cannot be created.*create its folder first"
    ):
        tfdb.Buffer.open(tmp_path / "none" / "store", create=True)


def test_there_is_none_or_one_already(name: str) -> None:
    for call in (
        lambda: tfdb.Buffer.open(name, create=False),
        lambda: tfdb.Buffer.open(name, mode="r"),
        lambda: tfdb.Buffer.unlink(name),
    ):
        with pytest.raises(
            tfdb.errors.NoSuchStore,
            match=rf"^no shared store '{name}'; `tfdb shm ls` lists the existing ones$",
        ):
            call()
    with pytest.raises(
        tfdb.errors.NoSuchStore, match=r"no shared store /no/such/folder/x: No such file"
    ):
        tfdb.Buffer.open(Path("/no/such/folder/x"), create=False)
    child.move_arm(tfdb.Buffer.open(name, create=True), 1)
    with pytest.raises(tfdb.errors.StoreExists, match="already") as caught:
        tfdb.Buffer.open(name, create=True)
    assert caught.value.path == f"/dev/shm/tfdb.{name}"
    assert child.arm_in(tfdb.Buffer.open(name)) == 1


def test_other_systems_raise_not_supported(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "darwin")
    for call in (tfdb.Buffer.open, tfdb.Buffer.unlink):
        with pytest.raises(tfdb.errors.NotSupported, match="need Linux; this is darwin"):
            call(name)


def test_a_shared_store_is_pickled_by_its_name(name: str) -> None:
    with pytest.raises(TypeError, match="called on a list"):
        tfdb.Buffer.__reduce__([])
    buffer = tfdb.Buffer.open(name, lock_timeout=None)
    again = pickle.loads(pickle.dumps(buffer))
    assert type(buffer) is type(again) is tfdb.Buffer
    assert again.shared == buffer.shared
    pickled = pickle.dumps(buffer)
    tfdb.Buffer.unlink(name)
    with pytest.raises(tfdb.errors.NoSuchStore):
        pickle.loads(pickled)


def test_readers_write_nothing(name: str) -> None:
    fill(tfdb.Buffer.open(name, history=None))
    reader = tfdb.Buffer.open(name, mode="r")
    before = reader.commit
    message = tfdb.encode_tf_message([tfdb.TransformStamped("map", "base", 50, (1, 2, 3), TURN)])
    for write in (
        lambda: reader.set_transform("map", "base", 50, (1, 2, 3), TURN),
        lambda: reader.set_static_transform("base", "camera", (1, 2, 3), TURN),
        lambda: reader.set_transforms([tfdb.TransformStamped("map", "n", 5, (1, 2, 3), TURN)]),
        lambda: reader.ingest(message),
        lambda: reader.remove_frames("hand"),
        lambda: reader.remove_frames(["hand"]),
        reader.clear,
        lambda: reader.run(lambda tx: tx.set_transform("map", "n", 5, (1, 2, 3), TURN)),
    ):
        with pytest.raises(tfdb.errors.ReadOnly, match='open it with mode "rw"') as caught:
            write()
        assert caught.value.path == f"/dev/shm/tfdb.{name}"
    assert reader.commit == before
    assert reader.run(lambda tx: tx.lookup_transform("map", "base", 10).stamp) == 10
    with pytest.raises(tfdb.errors.ReadOnly):
        reader.load(RECORDING)
    with pytest.raises(tfdb.errors.ReadOnly):
        reader.ingest_many([message], encoding="cdr")


def test_files_are_for_their_user_alone(name: str) -> None:
    tfdb.Buffer.open(name)
    modes = [stat.S_IMODE(path.stat().st_mode) for path in SHM.glob(f"tfdb.{name}*")]
    assert modes == [0o600, 0o600]
    old = os.umask(0o077)
    try:
        tfdb.Buffer.open(f"{name}-group", permissions=0o660, group=os.getegid())
    finally:
        os.umask(old)
    found = [path.stat() for path in SHM.glob(f"tfdb.{name}-group*")]
    tfdb.Buffer.unlink(f"{name}-group")
    assert [stat.S_IMODE(status.st_mode) for status in found] == [0o660, 0o660]
    assert {status.st_gid for status in found} == {os.getegid()}


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become somebody else")
@pytest.mark.parametrize(
    ("permissions", "expected"),
    [
        (0o600, {"rw": "ReadOnly", "r": "ReadOnly"}),
        (0o640, {"rw": "ReadOnly", "r": "1 0"}),
        (0o660, {"rw": "1 2", "r": "1 2"}),
    ],
)
def test_permissions_of_a_group(name: str, permissions: int, expected: dict[str, str]) -> None:
    group = next(entry for entry in grp.getgrall() if entry.gr_gid != 0)
    buffer = tfdb.Buffer.open(name, permissions=permissions, group=group.gr_name)
    child.move_arm(buffer, 1)
    for mode, said in expected.items():
        with Child("open_as", group.gr_gid, name, mode) as other:
            assert other.says() == said
            assert other.end() == 0


@pytest.mark.parametrize("create", [None, True, False])
def test_eight_open_at_once(name: str, create: bool | None) -> None:
    context = multiprocessing.get_context("fork")
    barrier = context.Barrier(8)
    pipes, processes = [], []
    for _ in range(8):
        here, there = context.Pipe()
        process = context.Process(target=child.open_at_once, args=(name, create, barrier, there))
        process.start()
        pipes.append(here)
        processes.append(process)
    said = sorted(pipe.recv() for pipe in pipes)
    for process in processes:
        process.join()
    expected = {
        None: ["opened"] * 8,
        True: ["StoreExists"] * 7 + ["opened"],
        False: ["NoSuchStore"] * 8,
    }[create]
    assert said == expected
    if "opened" in said:
        frames = tfdb.Buffer.open(name, create=False).frames()
        assert len(frames) == 1 + said.count("opened")


def test_a_full_store_raises_and_keeps_its_data(name: str) -> None:
    buffer = tfdb.Buffer.open(name, history=None, max_frames=100, size=12 << 20)
    poses = np.tile([1.0, 2.0, 3.0, *TURN], (1000, 1))
    number = 0

    def store() -> None:
        stamps = np.arange(1000, dtype=np.int64) + 1000 * number
        buffer.set_transforms(tfdb.Columns("map", "base", stamps, poses))

    with suppress(tfdb.errors.CapacityExceeded):
        while True:
            store()
            number += 1
    with pytest.raises(tfdb.errors.CapacityExceeded, match=r"12582912|limit|size"):
        store()
    assert number > 50
    for reads in (buffer, tfdb.Buffer.open(name, mode="r")):
        assert len(reads.samples("base")[0]) == 1000 * number
        assert reads.lookup_transform("map", "base").stamp == 1000 * number - 1
    assert buffer.commit == number


def test_frames_up_to_the_limit(name: str) -> None:
    buffer = tfdb.Buffer.open(name, max_frames=10)
    for number in range(9):
        buffer.set_static_transform("map", f"f{number}", (1, 2, 3), TURN)
    with pytest.raises(tfdb.errors.CapacityExceeded, match="10"):
        buffer.set_static_transform("map", "one too many", (1, 2, 3), TURN)
    assert len(tfdb.Buffer.open(name, mode="r").frames()) == 10


def test_damaged_and_foreign_files(name: str, tmp_path: Path) -> None:
    foreign = tmp_path / "foreign"
    foreign.write_bytes(b"no store" * 1000)
    for path in (foreign, tmp_path, Path("/dev/null"), tmp_path / ("x" * 300)):
        for call in (
            lambda path=path: tfdb.Buffer.open(path),
            lambda path=path: tfdb.Buffer.unlink(path),
        ):
            with pytest.raises(tfdb.errors.CorruptStore, match="not a store of tfdb"):
                call()
    assert foreign.exists()
    for bad in (Path(), Path("a\0b")):
        with pytest.raises(tfdb.TfdbError):
            tfdb.Buffer.open(bad)
    store = SHM / f"tfdb.{name}"
    child.move_arm(tfdb.Buffer.open(name), 1)
    os.truncate(store, 4096)
    for mode in ("r", "rw"):
        with pytest.raises(tfdb.errors.CorruptStore, match="4096 bytes instead of 1073741824"):
            tfdb.Buffer.open(name, mode=mode)
    tfdb.Buffer.unlink(name)
    tfdb.Buffer.open(name)
    with store.open("r+b") as file:
        file.seek(8 * 12)
        file.write(b"\1" * 8)
    with pytest.raises(tfdb.errors.CorruptStore, match="it is from another version of tfdb"):
        tfdb.Buffer.open(name)


def leave_over(name: str, number: int) -> list[Path]:
    """Files as a maker of that store leaves them that is killed."""
    control = SHM / f"tfdb.{name}.control-{number:016x}"
    data = control.with_name(f"{control.name}.new")
    for path in (control, data):
        path.write_bytes(bytes(4096))
    return [control, data]


@pytest.mark.parametrize("call", ["open", "create", "find", "unlink"])
def test_files_of_a_killed_maker_are_removed(name: str, call: str) -> None:
    left = leave_over(name, 7)
    at_work = leave_over(name, 8)
    other = SHM / f"tfdb.{name}.control-of-mine"
    other.touch()
    with at_work[0].open("r+b") as maker:
        # One byte behind those of the slots, as makers have it.
        lock = struct.pack("hhqqi4x", fcntl.F_WRLCK, os.SEEK_SET, 2048, 1, 0)
        fcntl.fcntl(maker, fcntl.F_OFD_SETLK, lock)
        if call == "create":
            tfdb.Buffer.open(name, create=True)
        elif call == "find":
            assert name not in find_stores()
        else:
            with pytest.raises(tfdb.errors.NoSuchStore):
                tfdb.Buffer.open(name, mode="r") if call == "open" else tfdb.Buffer.unlink(name)
        assert not any(path.exists() for path in left)
        assert all(path.exists() for path in at_work)
    if call == "create":  # its own files are none of those
        child.move_arm(tfdb.Buffer.open(name), 1)
        tfdb.Buffer.unlink(name)
    with pytest.raises(tfdb.errors.NoSuchStore):
        tfdb.Buffer.unlink(name)
    assert [path.name for path in SHM.glob(f"tfdb.{name}*")] == [other.name]
    other.unlink()


def test_a_store_by_another_path(name: str, tmp_path: Path) -> None:
    """A link to its file, or a descriptor that was handed over: its control file is found."""
    buffer = tfdb.Buffer.open(name)
    child.move_arm(buffer, 1)
    link = tmp_path / "link"
    link.symlink_to(SHM / f"tfdb.{name}")
    with (SHM / f"tfdb.{name}").open("rb") as file:
        for path in (link, Path(f"/proc/self/fd/{file.fileno()}")):
            reader = tfdb.Buffer.open(path, mode="r")
            assert child.arm_in(reader) == 1
            assert reader.shared is not None
            assert reader.shared.path == f"/dev/shm/tfdb.{name}"
    memory = os.memfd_create("store")
    os.truncate(memory, 1 << 20)
    for options in ({"mode": "r"}, {"create": True}, {}):
        with pytest.raises(tfdb.TfdbError, match=r"not a store of tfdb|already"):
            tfdb.Buffer.open(Path(f"/proc/self/fd/{memory}"), **options)
    os.close(memory)


def test_a_store_without_its_control_file(name: str) -> None:
    tfdb.Buffer.open(name)
    (control,) = SHM.glob(f"tfdb.{name}.control-*")
    control.unlink()
    for create in (None, False):
        with pytest.raises(tfdb.errors.CorruptStore, match="its control file is missing"):
            tfdb.Buffer.open(name, create=create)
    tfdb.Buffer.unlink(name)
    child.move_arm(tfdb.Buffer.open(name), 1)
