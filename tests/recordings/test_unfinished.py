"""Unfinished, renamed, compressed and cut recordings.

SQLite, zstandard and rosbags make them; a recorder is killed while it writes.
"""

from __future__ import annotations

import shutil
import signal
import sqlite3
import subprocess
import sys
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

import tfdb
from tfdb.recordings import Recording, follow_recording

from .conftest import drive

zstandard = pytest.importorskip("zstandard")

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from .conftest import Message

    Drive = Sequence[Message]

CASES = Path(__file__).parents[1] / "cases"


def state(folder: Path) -> dict[str, tuple[int, bytes]]:
    """Return names, times and bytes of the files in a folder."""
    return {
        each.name: (each.stat().st_mtime_ns, each.read_bytes())
        for each in folder.iterdir()
        if each.is_file()
    }


def all_of(path: Path, **options: Any) -> list[tuple[int, bytes]]:
    with Recording(path, **options) as recording:
        return [(received, data) for _, received, data in recording.messages()]


def quietly(path: Path, **options: Any) -> tuple[tfdb.Buffer, Any]:
    """Load with warnings as errors."""
    buffer = tfdb.Buffer(history=None)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return buffer, buffer.load(path, **options)


# -- renamed and packed ---------------------------------------------------------------------------


def check_case(buffer: tfdb.Buffer) -> None:
    stamps, poses, parents = buffer.samples("base_link")
    assert stamps.tolist() == [1_700_000_000_000_000_000 + i * 20_000_000 for i in range(50)]
    assert abs(poses[:, 0] - [i * 0.02 for i in range(50)]).max() < 1e-12
    assert set(parents) == {"odom"}
    assert buffer.frame_info("laser").is_static


@pytest.mark.parametrize("salvage", [False, True])
def test_a_renamed_database(salvage: bool) -> None:
    words = r"metadata.yaml names are missing: d_good.db3; other.db3 is read instead"
    buffer = tfdb.Buffer(history=None)
    with pytest.warns(tfdb.TfdbWarning, match=words):
        report = buffer.load(CASES / "d_renamed", salvage=salvage)
    assert (report.messages, report.lost, len(report.notes)) == (51, (), 1)
    check_case(buffer)


@pytest.mark.parametrize("name", ["d_fz_nometa", "d_fz_nometa/d_fz.db3.zstd"])
def test_a_packed_database_without_metadata(name: str) -> None:
    buffer, report = quietly(CASES / name)
    assert (report.messages, report.notes) == (51, ())
    check_case(buffer)


def test_a_folder_of_unpacked_or_packed_files(
    recorder: Any, messages: Drive, tmp_path: Path
) -> None:
    """A folder after `zstd -d` or `zstd`, with and without --rm, with the old metadata."""
    for plugin, end in (("sqlite3", "db3"), ("mcap", "mcap")):
        folder = recorder.folder(tmp_path / f"{end}1", messages, plugin, "file")
        packed = folder / f"{end}1.{end}.zstd"
        packed.with_suffix("").write_bytes(
            zstandard.ZstdDecompressor().stream_reader(packed.read_bytes()).read()
        )
        assert quietly(folder)[1].messages == len(messages)
        packed.unlink()
        with pytest.warns(tfdb.TfdbWarning, match=f"{end}1.{end} is read instead"):
            assert tfdb.load(folder).commit == len(messages)
        folder = recorder.folder(tmp_path / f"{end}2", messages, plugin)
        plain = folder / f"{end}2.{end}"
        whole = plain.read_bytes()
        (folder / f"{plain.name}.zstd").write_bytes(zstandard.compress(whole))
        (folder / "metadata.yaml").unlink()
        assert quietly(folder)[1].messages == len(messages), "not twice"
        plain.unlink()
        assert quietly(folder)[1].messages == len(messages)


@pytest.mark.parametrize("plugin", ["sqlite3", "mcap"])
@pytest.mark.parametrize("alone", [False, True])
def test_packed_messages_without_metadata(
    recorder: Any, messages: Drive, tmp_path: Path, plugin: str, alone: bool
) -> None:
    folder = recorder.folder(tmp_path / "a", messages, plugin, "message")
    plain = recorder.folder(tmp_path / "b", messages, plugin)
    (folder / "metadata.yaml").unlink()
    (file,) = folder.iterdir()
    path = file if alone else folder
    assert all_of(path) == all_of(path, salvage=True) == all_of(plain)
    buffer, report = quietly(path, start="+0.5")
    expected, _ = quietly(plain, start="+0.5")
    assert (report.messages, report.refused) == (len(messages), 0)
    assert buffer.samples("base")[1].tolist() == expected.samples("base")[1].tolist()
    if plugin == "mcap":
        followed = tfdb.Buffer(history=None)
        assert follow_recording(followed, file, timeout=5.0).refused == 0
        assert followed.samples("hand")[1].tolist() == tfdb.load(plain).samples("hand")[1].tolist()


def test_a_packed_message_that_is_damaged(recorder: Any, messages: Drive, tmp_path: Path) -> None:
    file = recorder.folder(tmp_path / "a", messages, "sqlite3", "message") / "a.db3"
    with sqlite3.connect(file) as database:
        database.execute("UPDATE messages SET data = substr(data, 1, 20) WHERE id = 7")
    database.close()
    buffer = tfdb.Buffer()
    with pytest.raises(
        tfdb.errors.RecordingError, match="its zstd data are damaged: they are not one complete"
    ):
        buffer.load(file)
    assert buffer.commit == 0


@pytest.mark.parametrize("kind", ["bag", "db3", "mcap"])
def test_every_recording_packed_by_hand(recorder: Any, tmp_path: Path, kind: str) -> None:
    messages = drive(1500)  # a cut loses a block of 128 KiB
    if kind == "bag":
        plain = recorder.bag(tmp_path / "a.bag", messages)
    else:
        plain = recorder.folder(tmp_path / "a", messages, {"db3": "sqlite3"}.get(kind, kind))
        plain = plain / f"a.{kind}"
    packed = tmp_path / f"b.{kind}.zst"
    packed.write_bytes(zstandard.compress(plain.read_bytes()))
    assert all_of(packed) == all_of(plain)
    assert quietly(packed)[1].files == (str(packed),)
    # A cut file is read as far as its compressed blocks are complete.
    packed.write_bytes(packed.read_bytes()[: int(packed.stat().st_size * 0.8)])
    with pytest.raises(
        tfdb.errors.RecordingError, match=r"its zstd data are damaged.*--salvage"
    ) as caught:
        tfdb.load(packed)
    assert caught.value.path == str(packed)
    saved = all_of(packed, salvage=True)
    assert 0.3 * len(messages) < len(saved) < len(messages)
    assert set(saved) < set(all_of(plain))
    with Recording(packed, salvage=True) as recording:
        assert {loss.path for loss in recording.losses} == {str(packed)}
        assert "its zstd data are damaged" in str(recording.losses[-1])


def test_other_packed_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.csv.zst"
    for content, words in (
        (b"", "the file is empty"),
        (b"1 2 3 4 5 6 7 8\n", "compressed with zstd, but not a recording"),
        (zstandard.compress(b"x"), "compressed with zstd, but not a recording"),
        (b"a text\n" * 9, "neither a ROS 1 bag|but not a recording"),
    ):
        path.write_bytes(zstandard.compress(content))
        with pytest.raises(tfdb.errors.RecordingError, match=words) as caught:
            tfdb.load(path)
        assert caught.value.path == str(path)
    assert not list(Path(tmp_path).glob("tfdb-*"))


def test_nothing_unpacked_stays(
    recorder: Any, messages: Drive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The decompressed file is unlinked before its first message is read."""
    work = tmp_path / "work"
    work.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(work))
    for plugin in ("sqlite3", "mcap"):
        folder = recorder.folder(tmp_path / plugin, messages, plugin, "file")
        with Recording(folder) as recording:
            assert list(work.iterdir()) == []
            assert len(list(recording.messages())) == len(messages)


# -- folders --------------------------------------------------------------------------------------


def test_an_error_lists_the_contents_of_a_folder(
    recorder: Any, messages: Drive, tmp_path: Path
) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    words = "a folder without .db3 or .mcap files; it holds "
    with pytest.raises(tfdb.errors.RecordingError, match=f"{words}nothing$"):
        tfdb.load(folder)
    recorder.bag(folder / "a.bag", messages[:3])
    recorder.folder(folder / "b", messages[:3])
    with pytest.raises(tfdb.errors.RecordingError, match=f"{words}a.bag, b/$"):
        tfdb.load(folder)
    with pytest.raises(
        tfdb.errors.RecordingError, match="the metadata of a bag folder: give the folder"
    ):
        tfdb.load(folder / "b/metadata.yaml")


def test_a_missing_file_is_not_replaced_by_another_recording(
    recorder: Any, messages: Drive, tmp_path: Path
) -> None:
    folder = recorder.folder(tmp_path / "a", messages, "sqlite3")
    (folder / "a.db3").unlink()
    early = [type(m)(m.topic, m.received - 10**15, m.transforms, m.callerid) for m in messages]
    other = recorder.folder(tmp_path / "b", early, "sqlite3")
    shutil.copy(other / "b.db3", folder / "b.db3")
    with pytest.raises(tfdb.errors.RecordingError, match=r"names are missing: a.db3; salvage=True"):
        tfdb.load(folder)
    with pytest.raises(tfdb.errors.RecordingError, match=r"names are missing: a.db3$"):
        tfdb.load(folder, salvage=True)
    # With --salvage a part of the folder is a recording.
    part = recorder.folder(tmp_path / "c", messages[:200], "sqlite3")
    shutil.copy(part / "c.db3", folder / "c.db3")
    with pytest.raises(
        tfdb.errors.RecordingError, match=r"a.db3; c.db3 may replace them; salvage=True"
    ):
        tfdb.load(folder)
    report = tfdb.Buffer(history=None).load(folder, salvage=True)
    assert (report.messages, sum(loss.messages for loss in report.lost)) == (200, 401)


# -- databases whose recorder did not finish ------------------------------------------------------

RECORDER = """
import os, signal, sqlite3, sys
source, target, mode, every = sys.argv[1:]
given = sqlite3.connect(source)
made = sqlite3.connect(target, isolation_level=None)
made.execute(f"PRAGMA journal_mode={mode}")
made.execute(f"PRAGMA wal_autocheckpoint={every}")
made.execute("PRAGMA cache_size=5")
for (text,) in given.execute("SELECT sql FROM sqlite_master WHERE sql IS NOT NULL").fetchall():
    made.execute(text)
for row in given.execute("SELECT * FROM topics").fetchall():
    made.execute("INSERT INTO topics VALUES (?,?,?,?,?,?)", row)
rows = given.execute("SELECT * FROM messages ORDER BY id").fetchall()
for start in range(0, 400, 50):
    made.execute("BEGIN")
    made.executemany("INSERT INTO messages VALUES (?,?,?,?)", rows[start : start + 50])
    made.execute("COMMIT")
made.execute("BEGIN")
made.executemany("INSERT INTO messages VALUES (?,?,?,?)", rows[400:])
print("recording", flush=True)
sys.stdin.read()
"""


@pytest.fixture
def whole(recorder: Any, messages: Drive, tmp_path: Path) -> Path:
    path: Path = recorder.folder(tmp_path / "whole", messages, "sqlite3") / "whole.db3"
    return path


class Running:
    """A recorder in another process that has committed 400 messages and holds 201 more."""

    def __init__(self, whole: Path, path: Path, mode: str, every: int) -> None:
        command = [sys.executable, "-c", RECORDER, str(whole), str(path), mode, str(every)]
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        assert self.process.stdout is not None
        assert self.process.stdout.readline() == "recording\n"

    def kill(self) -> None:
        self.process.send_signal(signal.SIGKILL)
        self.end()

    def end(self) -> None:
        """End the recorder without its last messages. A second call does nothing."""
        for stream in (self.process.stdin, self.process.stdout):
            assert stream is not None
            stream.close()
        self.process.wait()


@pytest.fixture
def running(whole: Path, tmp_path: Path, request: Any) -> Iterator[tuple[Running, Path]]:
    folder = tmp_path / "run"
    folder.mkdir()
    mode, every = request.param
    made = Running(whole, folder / "run.db3", mode, every)
    try:
        yield made, folder
    finally:
        made.kill()


LOGS = [("wal", 20), ("wal", 100_000), ("delete", 0)]


@pytest.mark.parametrize("running", LOGS, indirect=True, ids=["some", "all", "journal"])
@pytest.mark.parametrize("shared", [True, False])
@pytest.mark.parametrize("as_folder", [True, False])
def test_a_recorder_that_was_killed(
    running: tuple[Running, Path], whole: Path, shared: bool, as_folder: bool
) -> None:
    """Its committed messages are read with a warning, and no file is changed."""
    recorder, folder = running
    recorder.kill()
    log = next(each for each in folder.iterdir() if each.name.endswith(("-wal", "-journal")))
    assert log.stat().st_size
    if not shared:
        (folder / "run.db3-shm").unlink(missing_ok=True)
    before = state(folder)
    path = folder if as_folder else folder / "run.db3"
    expected = all_of(whole)[:400]
    assert all_of(path) == expected
    assert all_of(path, salvage=True) == expected
    buffer = tfdb.Buffer(history=None)
    with pytest.warns(tfdb.TfdbWarning, match="did not finish; what it committed to run.db3-") as w:
        report = buffer.load(path)
    assert len(w) == 1
    assert (report.messages, report.lost) == (400, ())
    assert state(folder) == before


@pytest.mark.parametrize("running", LOGS[:2], indirect=True)
def test_a_recorder_that_is_running(running: tuple[Running, Path], whole: Path) -> None:
    """It is not disturbed, and its committed messages are read in one state."""
    recorder, folder = running
    with Recording(folder / "run.db3") as recording:
        recorder.end()
        assert [(at, data) for _, at, data in recording.messages()] == all_of(whole)[:400]


def test_a_folder_that_cannot_be_written_to(whole: Path, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    made = Running(whole, folder / "run.db3", "wal", 20)
    made.kill()
    (folder / "run.db3-shm").unlink()
    folder.chmod(0o500)
    try:
        assert all_of(folder / "run.db3") == all_of(whole)[:400]
    finally:
        folder.chmod(0o700)


def test_a_database_that_is_linked_to(whole: Path, tmp_path: Path) -> None:
    """Its logs are beside the file, not beside the link."""
    folder = tmp_path / "run"
    folder.mkdir()
    Running(whole, folder / "run.db3", "wal", 20).kill()
    link = tmp_path / "link.db3"
    link.symlink_to(folder / "run.db3")
    assert all_of(link) == all_of(whole)[:400]
    (folder / "run.db3-shm").unlink()
    assert all_of(link) == all_of(whole)[:400]


@pytest.mark.filterwarnings("ignore:.*did not finish:tfdb.TfdbWarning")
def test_a_cache_depends_on_the_log(whole: Path, tmp_path: Path) -> None:
    path = tmp_path / "run.db3"
    Running(whole, path, "wal", 100_000).kill()
    log = path.with_name("run.db3-wal")
    content = log.read_bytes()
    log.write_bytes(content[: len(content) // 2])
    first = tfdb.load(path, cache=True).commit
    log.write_bytes(content)
    assert first < tfdb.load(path, cache=True).commit == 400


def test_a_damaged_log(whole: Path) -> None:
    log = whole.with_name("whole.db3-wal")
    for content in (b"x", b"x" * 100, bytes.fromhex("377f0682") + bytes(60)):
        log.write_bytes(content)
        with pytest.raises(
            tfdb.errors.RecordingError, match=r"log whole.db3-wal is damaged or cut short"
        ):
            tfdb.load(whole)
        report = tfdb.Buffer(history=None).load(whole, salvage=True)
        assert (report.messages, report.notes) == (601, ())
        (loss,) = report.lost
        assert (loss.bytes, loss.path) == (len(content), str(whole))
    log.write_bytes(b"")
    assert quietly(whole)[1].messages == 601


@pytest.mark.parametrize("running", LOGS[1:], indirect=True)
def test_the_log_given_for_the_database(running: tuple[Running, Path]) -> None:
    log = next(each for each in running[1].iterdir() if each.name.endswith(("-wal", "-journal")))
    with pytest.raises(tfdb.errors.RecordingError, match=r"the log of a .db3: give the .db3"):
        tfdb.load(log)


# -- cut and damaged databases --------------------------------------------------------------------


@pytest.mark.parametrize("metadata", [True, False])
@pytest.mark.parametrize("share", [0.4, 0.6, 0.9])
def test_a_cut_database_in_a_folder(whole: Path, metadata: bool, share: float) -> None:
    expected = all_of(whole)
    whole.write_bytes(whole.read_bytes()[: int(whole.stat().st_size * share)])
    folder = whole.parent
    if not metadata:
        (folder / "metadata.yaml").unlink()
    with pytest.raises(
        tfdb.errors.RecordingError, match=r"damaged or cut short: .*--salvage"
    ) as caught:
        tfdb.load(folder)
    assert caught.value.path == str(whole)
    saved = all_of(folder, salvage=True)
    assert saved == expected[: len(saved)]
    assert len(saved) > (share - 0.3) * len(expected)
    with Recording(folder, salvage=True) as recording:
        if metadata:
            assert sum(loss.messages for loss in recording.losses) == len(expected) - len(saved)
        assert "cut short, its end is missing" in str(recording.losses[0])


def test_a_database_of_which_nothing_is_left(whole: Path) -> None:
    whole.write_bytes(whole.read_bytes()[:3000])
    for options in ({}, {"salvage": True}):
        words = r"whole.db3: damaged or cut short.*`sqlite3 whole.db3 .recover` may save more"
        with pytest.raises(tfdb.errors.RecordingError, match=words) as caught:
            tfdb.load(whole.parent, **options)
        assert ("salvage=True" in str(caught.value)) == (not options)


def test_a_database_that_is_cut_before_its_messages(whole: Path) -> None:
    """The error describes the loss."""
    whole.write_bytes(whole.read_bytes()[:29_000])
    words = "have no transform; .*: lost at least .* bytes: cut short, its end"
    for path in (whole, whole.parent):
        with pytest.raises(tfdb.errors.RecordingError, match=words):
            tfdb.load(path, salvage=True)


def test_pages_in_the_middle_are_damaged(whole: Path) -> None:
    """Only the messages in these pages are lost."""
    expected = all_of(whole)
    raw = bytearray(whole.read_bytes())
    page = int.from_bytes(raw[16:18], "big")
    pages = [raw.index(data) // page for _, data in expected]
    damaged = {pages[number] for number in (300, 330, 500)}
    for number in damaged:
        raw[number * page : (number + 1) * page] = bytes(page)
    whole.write_bytes(raw)
    with pytest.raises(tfdb.errors.RecordingError, match="damaged or cut short"):
        tfdb.load(whole)
    saved = all_of(whole, salvage=True)
    assert saved == [each for each, at in zip(expected, pages, strict=True) if at not in damaged]
    report = tfdb.Buffer(history=None).load(whole.parent, salvage=True)
    assert sum(loss.messages for loss in report.lost) == len(expected) - len(saved)


@pytest.mark.parametrize("time", ["-5", "1.5", "'x'", "NULL"])
def test_a_message_with_a_wrong_time(whole: Path, time: str) -> None:
    expected = all_of(whole)
    with sqlite3.connect(whole) as database:
        database.execute("PRAGMA writable_schema=ON")
        database.execute("UPDATE sqlite_master SET sql = replace(sql, 'NOT NULL', '')")
    database.close()
    with sqlite3.connect(whole) as database:
        database.execute(f"UPDATE messages SET timestamp = {time} WHERE id = 9")
    database.close()
    with pytest.raises(tfdb.errors.RecordingError, match=r"damaged or cut short: a row"):
        tfdb.load(whole)
    saved = all_of(whole, salvage=True)
    assert (len(saved), set(saved) <= set(expected)) == (600, True)


def test_a_damaged_index_loses_nothing(whole: Path) -> None:
    expected = all_of(whole)
    with sqlite3.connect(whole) as database:
        query = "SELECT rootpage FROM sqlite_master WHERE name = 'timestamp_idx'"
        ((root,),) = database.execute(query).fetchall()
    database.close()
    raw = bytearray(whole.read_bytes())
    page = int.from_bytes(raw[16:18], "big")
    raw[(root - 1) * page : root * page] = bytes(page)
    whole.write_bytes(raw)
    with pytest.raises(tfdb.errors.RecordingError, match="damaged or cut short"):
        tfdb.load(whole)
    assert all_of(whole, salvage=True) == expected
