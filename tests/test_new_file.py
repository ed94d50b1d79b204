"""Files of tfdb appear completely or not at all, and replace other files only on request."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import Any

import pytest

import tfdb
from tfdb.data.new_file import is_one_of, new_file


def write(path: Path, text: str = "new", **options: Any) -> None:
    with new_file(path, **options) as made:
        made.write_text(text)


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_a_new_file(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    with new_file(path) as made:
        made.write_text("new")
        assert not path.exists()
        assert made.suffix == ".txt"
    assert path.read_text() == "new"
    assert names(tmp_path) == ["a.txt"]


@pytest.mark.parametrize("dangling", [False, True])
def test_an_existing_name_stays(tmp_path: Path, dangling: bool) -> None:
    path = tmp_path / "a"
    if dangling:
        path.symlink_to(tmp_path / "nowhere")
    else:
        path.write_text("old")
    with pytest.raises(tfdb.InvalidArgument, match="exists already; pass overwrite=True"):
        write(path)
    assert names(tmp_path) == ["a"]
    assert path.is_symlink() == dangling
    write(path, overwrite=True)
    assert path.read_text() == "new"
    assert path.is_symlink() == dangling
    assert names(tmp_path) == (["a", "nowhere"] if dangling else ["a"])


@pytest.mark.parametrize("links", [True, False])
@pytest.mark.parametrize("dangling", [False, True])
def test_a_name_that_is_taken_meanwhile(
    tmp_path: Path, links: bool, dangling: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_links(*_: object) -> None:
        raise OSError(errno.EPERM, "no hard links here")

    if not links:
        monkeypatch.setattr(os, "link", no_links)
    path = tmp_path / "a"

    def race() -> None:
        with new_file(path) as made:
            made.write_text("new")
            if dangling:
                path.symlink_to(tmp_path / "nowhere")
            else:
                path.write_text("theirs")

    with pytest.raises(tfdb.InvalidArgument, match="exists already"):
        race()
    assert names(tmp_path) == ["a"]
    if dangling:
        assert path.is_symlink()
        path.unlink()
    else:
        assert path.read_text() == "theirs"
    write(tmp_path / "b")
    assert (tmp_path / "b").read_text() == "new"


def test_a_link_stays_one(tmp_path: Path) -> None:
    (tmp_path / "runs").mkdir()
    old = tmp_path / "runs" / "5.bin"
    old.write_text("old")
    old.chmod(0o640)
    link = tmp_path / "latest.txt"
    link.symlink_to("runs/5.bin")
    write(link, overwrite=True)
    assert link.is_symlink()
    assert old.read_text() == "new"
    assert old.stat().st_mode & 0o777 == 0o640
    assert (names(tmp_path), names(tmp_path / "runs")) == (["latest.txt", "runs"], ["5.bin"])


def test_only_regular_files_are_replaced(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    link = tmp_path / "link"
    link.symlink_to("/dev/null")
    for path in (pipe, link, tmp_path, Path("/dev/null")):
        with pytest.raises(tfdb.InvalidArgument, match="is not a regular file") as caught:
            write(path, overwrite=True)
        assert caught.value.path == str(path)
    assert names(tmp_path) == ["link", "pipe"]


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError, MemoryError, SystemExit])
@pytest.mark.parametrize("overwrite", [False, True])
def test_an_exception_leaves_all_files_unchanged(
    tmp_path: Path, error: type[BaseException], overwrite: bool
) -> None:
    path = tmp_path / "a"
    if overwrite:
        path.write_text("old")

    def stop() -> None:
        with new_file(path, overwrite=overwrite) as made:
            made.write_text("ne")
            raise error

    with pytest.raises(error):
        stop()
    assert names(tmp_path) == (["a"] if overwrite else [])
    assert not overwrite or path.read_text() == "old"


def test_errors_name_the_requested_path(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError) as missing:
        write(tmp_path / "none" / "a")
    assert missing.value.filename == str(tmp_path / "none" / "a")
    assert missing.value.strerror == f"missing folder {tmp_path / 'none'}"

    def forgotten() -> None:
        with new_file(tmp_path / "a"):
            pass

    with pytest.raises(FileNotFoundError) as caught:
        forgotten()
    assert caught.value.filename == str(tmp_path / "a")

    def other() -> None:
        with new_file(tmp_path / "a"):
            (tmp_path / "other").read_text()

    with pytest.raises(FileNotFoundError) as elsewhere:
        other()
    assert elsewhere.value.filename == str(tmp_path / "other")
    assert names(tmp_path) == []


def test_relative_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write(Path("a"))
    write(Path("a"), "newer", overwrite=True)
    assert Path("a").read_text() == "newer"
    with pytest.raises(FileNotFoundError) as missing:
        write(Path("none/a"))
    assert missing.value.filename == "none/a"


def test_an_output_that_is_an_input(tmp_path: Path) -> None:
    folder = tmp_path / "bag"
    folder.mkdir()
    part = folder / "bag_0.db3"
    part.write_text("data")
    (tmp_path / "door").symlink_to(folder)
    hard, soft, other = tmp_path / "hard", tmp_path / "soft", tmp_path / "other"
    os.link(part, hard)
    soft.symlink_to(part)
    other.write_text("data")
    for path in (part, hard, soft, tmp_path / "door" / "bag_0.db3", folder / ".." / "hard"):
        assert is_one_of(path, [folder])
        assert is_one_of(path, [other, part])
        assert not is_one_of(path, [other])
    assert not is_one_of(tmp_path / "none", [folder, tmp_path / "nor-this"])
