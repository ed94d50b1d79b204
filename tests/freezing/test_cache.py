"""`tfdb.load(cache=True)`: a valid cache is used, a stale one is replaced."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import pytest

import tfdb
from tests.sharing.all_reads import RECORDING
from tfdb.recordings import load, write_recording


@pytest.fixture
def recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))
    folder = tmp_path / "drives"
    folder.mkdir()
    return Path(shutil.copy(RECORDING, folder / "drive.mcap"))


@pytest.fixture
def loads(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """One entry for each time that a recording is loaded."""
    counted: list[int] = []
    original = load.load_into

    def count(*args: object, **kwargs: object) -> object:
        counted.append(1)
        return original(*args, **kwargs)  # type: ignore[arg-type]

    monkeypatch.setattr(load, "load_into", count)
    return counted


def beside(recording: Path) -> list[str]:
    return sorted(file.name for file in recording.parent.iterdir())


def file_of(buffer: tfdb.Buffer) -> Path:
    assert buffer.frozen is not None
    return Path(buffer.frozen.path)


def test_it_is_loaded_once(recording: Path, loads: list[int]) -> None:
    expected = tfdb.load(recording).tree()
    loads.clear()
    for _ in range(3):
        buffer = tfdb.load(recording, cache=True)
        assert file_of(buffer) == recording.with_name("drive.mcap.tfdb")
        assert buffer.tree() == expected
        assert buffer.history is None
    assert len(loads) == 1
    assert beside(recording) == ["drive.mcap", "drive.mcap.tfdb"]
    assert json.loads(tfdb.open(file_of(buffer)).frozen.origin)["tfdb"] == tfdb.__version__  # type: ignore[union-attr]


def test_one_that_was_touched_is_compared(recording: Path, loads: list[int]) -> None:
    tfdb.load(recording, cache=True)
    os.utime(recording, ns=(10**18, 10**18))
    kept = file_of(tfdb.load(recording, cache=True))
    assert len(loads) == 1
    # It is known by its new time from now on.
    assert json.loads(tfdb.open(kept).frozen.origin)["times"] == [10**18]  # type: ignore[union-attr]


def write(path: Path, number: float) -> None:
    """A recording whose length says nothing of what is in it."""
    buffer = tfdb.Buffer(history=None)
    buffer.set_transform("map", "base", 10**9, (number, 2, 3), (0, 0.6, 0, 0.8))
    write_recording(path, buffer, overwrite=True)


def test_other_content_is_loaded(recording: Path, loads: list[int]) -> None:
    tfdb.load(recording, cache=True)
    for number in (1, 2):
        write(recording, number)
        for _ in range(2):
            buffer = tfdb.load(recording, cache=True)
            assert buffer.lookup_transform("map", "base").translation[0] == number
        assert len(loads) == 1 + number
    status = recording.stat()
    write(recording, 3)
    assert recording.stat().st_size == status.st_size
    assert tfdb.load(recording, cache=True).lookup_transform("map", "base").translation[0] == 3


@pytest.mark.parametrize("damage", ["flip", "header", "cut"])
def test_damaged_ones_are_made_anew(recording: Path, loads: list[int], damage: str) -> None:
    kept = file_of(tfdb.load(recording, cache=True))
    content = bytearray(kept.read_bytes())
    if damage == "flip":
        content[-100] ^= 1
    elif damage == "cut":
        content = content[:-640]
    else:
        content[96] ^= 1  # as if another version had written it
    kept.write_bytes(content)
    assert file_of(tfdb.load(recording, cache=True)) == kept
    assert len(loads) == 2
    tfdb.open(kept, verify=True)


@pytest.mark.parametrize("content", ["frozen", "damaged", "text", "none"])
def test_foreign_files_are_not_replaced(recording: Path, loads: list[int], content: str) -> None:
    write(recording, 1)
    taken = recording.with_name("drive.mcap.tfdb")
    if content in {"frozen", "damaged"}:
        buffer = tfdb.Buffer()
        buffer.set_transform("map", "base", 10**9, (1, 2, 3), (0, 0.6, 0, 0.8))
        buffer.freeze(taken)
        if content == "damaged":
            taken.write_bytes(taken.read_bytes()[:-64])
    else:
        taken.write_bytes(b"hello" if content == "text" else b"")
    before = taken.read_bytes()
    with pytest.raises(
        tfdb.errors.StoreExists, match="move it away, or load without cache"
    ) as caught:
        tfdb.load(recording, cache=True)
    assert caught.value.path == str(taken)
    assert taken.read_bytes() == before
    assert not loads
    assert beside(recording) == ["drive.mcap", "drive.mcap.tfdb"]
    taken.rename(taken.with_name("mine.tfdb"))
    assert file_of(tfdb.load(recording, cache=True)) == taken


def test_other_options_have_separate_caches(recording: Path, loads: list[int]) -> None:
    other = Path(shutil.copy(recording, recording.with_name("other.mcap")))
    ways = (
        {"path": recording},
        {"path": recording, "topics": ["/tf"]},
        {"path": recording, "topics": {"/tf": "tf", "/tf_static": "tf_static"}},
        {"path": recording, "salvage": True},
    )
    made = {file_of(tfdb.load(**way, cache=True)) for way in ways}  # type: ignore[arg-type]
    assert len(made) == len(ways) == len(loads)
    for way in ways:
        assert file_of(tfdb.load(**way, cache=True)) in made  # type: ignore[arg-type]
    assert file_of(tfdb.load(recording, topics=iter(["/tf"]), cache=True)) in made
    assert len(loads) == len(ways)
    assert file_of(tfdb.load(other, cache=True)).name == "other.mcap.tfdb"


def test_where_the_folder_cannot_be_written(
    recording: Path, loads: list[int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    beside = recording.with_name("drive.mcap.tfdb")
    beside.mkdir()  # so that no file can take its place
    for _ in range(2):
        kept = file_of(tfdb.load(recording, cache=True))
        assert kept.parent == tmp_path / "home" / "tfdb"
    assert len(loads) == 1
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    with pytest.warns(tfdb.TfdbWarning, match="the cache is not written"):
        buffer = tfdb.load(recording, cache=True)
    assert buffer.frozen is None
    assert buffer.tree() == tfdb.load(recording).tree()


def test_failed_loads_are_not_cached(recording: Path) -> None:
    with pytest.raises(FileNotFoundError):
        tfdb.load(recording.with_name("none.mcap"), cache=True)
    recording.write_bytes(b"hello")
    with pytest.raises(tfdb.errors.RecordingError):
        tfdb.load(recording, cache=True)
    with pytest.raises(tfdb.InvalidArgument):
        tfdb.load([], cache=True)
    assert beside(recording) == ["drive.mcap"]
