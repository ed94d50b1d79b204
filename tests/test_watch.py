"""Watches: which commits touched what, from threads, processes and after signals."""

from __future__ import annotations

import subprocess
import sys
import textwrap
import threading
from typing import TYPE_CHECKING

import pytest

import tfdb
from tfdb import errors
from tfdb.types import Touched

if TYPE_CHECKING:
    from pathlib import Path

LONG = 60.0


def put(buffer: tfdb.Buffer, parent: str, child: str, stamp: int) -> int:
    return buffer.set_transform(parent, child, stamp, (1.0, 2.0, 3.0), (0.6, 0, 0, 0.8))


def test_records_name_frames_and_pairs_as_they_were_given() -> None:
    buffer = tfdb.Buffer()
    with buffer.watch(frames=("arm", "camera", "arm"), pairs=[["map", "hand"]]) as watch:
        assert (watch.frames, watch.pairs) == (("arm", "camera"), (("map", "hand"),))
        put(buffer, "map", "arm", 1)
        put(buffer, "arm", "hand", 1)
        put(buffer, "map", "other", 1)
        put(buffer, "map", "arm", 2)
        assert watch.next(0) == [
            Touched(1, ("arm",)),
            Touched(2, (("map", "hand"),)),
            Touched(4, ("arm", ("map", "hand"))),
        ]
        seen = 0
        for commit, what in watch.next(2):
            assert what == ("arm", ("map", "hand"))
            seen = commit
        assert watch.next(seen, timeout=0) == []
        assert repr(watch) == "<tfdb.Watch of 2 frames and 1 pairs>"
    assert watch.closed
    with pytest.raises(errors.WatchClosed, match="make another"):
        watch.next(seen)
    with pytest.raises(errors.WatchClosed):
        watch.__enter__()
    watch.close()


def test_one_name_is_one_frame() -> None:
    buffer = tfdb.Buffer()
    watch = buffer.watch("arm")
    put(buffer, "map", "arm", 1)
    assert watch.next(0) == [(1, ("arm",))]


def test_a_commit_wakes_the_thread_that_waits() -> None:
    buffer = tfdb.Buffer()
    watch = buffer.watch(["arm"])
    found: list[Touched] = []
    thread = threading.Thread(target=lambda: found.extend(watch.next(0, LONG)))
    thread.start()
    for stamp in range(1, 200):
        put(buffer, "map", "other", stamp)
    last = put(buffer, "map", "arm", 1)
    thread.join()
    assert found == [(last, ("arm",))]


def test_a_pair_follows_its_path() -> None:
    buffer = tfdb.Buffer()
    put(buffer, "map", "base", 1)
    put(buffer, "base", "cup", 1)
    watch = buffer.watch(pairs=[("map", "cup")])
    seen = buffer.commit
    buffer.remove_frames("cup")
    put(buffer, "map", "other", 2)
    made = put(buffer, "map", "cup", 2)
    put(buffer, "map", "base", 2)  # of the former path
    assert [commit for commit, _ in watch.next(seen)] == [seen + 1, made]


def test_closing_ends_next() -> None:
    buffer = tfdb.Buffer()
    for end, expected in (("watch", errors.WatchClosed), ("buffer", errors.BufferClosed)):
        watch = buffer.watch("arm")
        raised: list[type] = []

        def wait(watch: tfdb.Watch = watch, raised: list[type] = raised) -> None:
            try:
                watch.next(0)
            except tfdb.TfdbError as error:
                raised.append(type(error))

        thread = threading.Thread(target=wait)
        thread.start()
        (watch if end == "watch" else buffer).close()
        thread.join()
        assert raised == [expected]
    with pytest.raises(errors.BufferClosed):
        watch.next(0)
    with pytest.raises(errors.BufferClosed):
        buffer.watch("arm")


def test_bad_arguments_are_named() -> None:
    buffer = tfdb.Buffer()
    with pytest.raises(tfdb.InvalidArgument, match="at least one frame"):
        buffer.watch()
    with pytest.raises(errors.InvalidName, match="'' is empty"):
        buffer.watch([""])
    with pytest.raises(TypeError, match="a frame must be a str, got int"):
        buffer.watch([1])  # type: ignore[list-item]
    with pytest.raises(TypeError, match=r"pairs must be a tuple .*, got 3 items"):
        buffer.watch(pairs=[("a", "b", "c")])  # type: ignore[list-item]
    with pytest.raises(TypeError, match=r"pairs must be a tuple .*, got str"):
        buffer.watch(pairs=["ab"])  # type: ignore[list-item]
    watch = buffer.watch("arm")
    with pytest.raises(tfdb.InvalidArgument, match="no commit 3 yet: the newest is 0"):
        watch.next(3)
    with pytest.raises(tfdb.InvalidArgument, match="after"):
        watch.next(-1)
    with pytest.raises(tfdb.InvalidArgument, match="timeout"):
        watch.next(0, -1.0)
    with pytest.raises(TypeError, match=r"Buffer\.watch"):
        tfdb.Watch()
    with buffer.transaction(), pytest.raises(errors.TransactionActive):
        watch.next(0)


@pytest.mark.parametrize("concurrency", ["giant", "silo"])
def test_other_engines_have_none(concurrency: tfdb.types.Concurrency) -> None:
    with pytest.raises(errors.NotSupported, match=concurrency):
        tfdb.Buffer(concurrency=concurrency).watch("arm")


def test_a_frozen_store_has_none(tmp_path: Path) -> None:
    buffer = tfdb.Buffer()
    put(buffer, "map", "arm", 1)
    buffer.freeze(tmp_path / "a.tfdb")
    with tfdb.open(tmp_path / "a.tfdb") as frozen, pytest.raises(errors.NotSupported):
        frozen.watch("arm")


def test_a_watch_keeps_its_buffer() -> None:
    watch = tfdb.Buffer().watch("arm")
    assert watch.next(0, 0) == []


INTERRUPTED = """
import signal, threading, tfdb
buffer = tfdb.Buffer()
watch = buffer.watch(["arm"])
caught = []
for interval in (0.05, 0.0):
    signal.signal(signal.SIGINT, signal.default_int_handler)
    main = threading.main_thread().ident
    timer = threading.Timer(interval, lambda: signal.pthread_kill(main, signal.SIGINT))
    try:
        timer.start()
        watch.next(0)
    except KeyboardInterrupt:
        caught.append(True)
    timer.join()
buffer.set_transform("map", "arm", 1, (0, 0, 1), (0, 0, 0, 1))
print(caught, watch.next(0))
"""


def test_a_signal_interrupts_next() -> None:
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(INTERRUPTED)],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    assert done.stdout == "[True, True] [Touched(commit=1, what=('arm',))]\n"
