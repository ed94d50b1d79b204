"""The end of a thread aborts its open transaction, and no other thread gets it or waits."""

from __future__ import annotations

import gc
import os
import sys
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

import tfdb

from .child import printed_by
from .test_closing import ENGINES, TURNED, filled

if TYPE_CHECKING:
    from collections.abc import Callable


def in_thread(work: Callable[[], None]) -> int:
    """Run it in a thread of its own, to the end; return the thread's id."""
    wrong: list[BaseException] = []
    ids: list[int] = []

    def guarded() -> None:
        ids.append(threading.get_ident())
        try:
            work()
        except BaseException as error:
            wrong.append(error)

    thread = threading.Thread(target=guarded)
    thread.start()
    native = thread.native_id
    thread.join()
    # Python calls a thread joined a little before the system has ended it.
    while Path(f"/proc/self/task/{native}").exists():
        os.sched_yield()
    assert wrong == []
    return ids[0]


@pytest.mark.parametrize("concurrency", [name for name in ENGINES if name != "fine"])
@pytest.mark.parametrize("alone", [False, True])
def test_an_open_transaction_ends_with_its_thread(concurrency: str, alone: bool) -> None:
    buf = filled(concurrency)
    before = buf.lookup_transform("map", "arm", 300)
    left: list[tfdb.Transaction] = []
    used: list[int] = []

    def leave() -> None:
        tx = buf._attempt(0, alone, 0)
        left.append(tx)
        tx.__enter__()
        tx.lookup_transform("map", "arm", 150)
        tx.set_transform("base", "arm", 300, (9, 9, 9), TURNED)

    def come_after() -> None:
        for tx in left:
            with pytest.raises(tfdb.errors.WrongThread):
                tx.lookup_transform("map", "arm", 150)
            with pytest.raises(tfdb.errors.WrongThread):
                tx.__exit__(None, None, None)
            with pytest.raises(tfdb.errors.WrongThread):
                tx.abort()
        with buf.transaction() as tx:
            tx.lookup_transform("map", "arm", 150)
            tx.set_transform("base", "arm", 150, (1, 1, 1), TURNED)
        assert buf.run(lambda tx: tx.frame_exists("arm"))

    for _ in range(20):
        used.append(in_thread(leave))
        used.append(in_thread(come_after))
    assert len(set(used)) < len(used)  # ids came again
    assert buf.lookup_transform("map", "arm", 300) == before
    assert all(tx.closed and tx.commit is None for tx in left)
    buf.set_transform("base", "arm", 300, (1, 1, 1), TURNED)
    in_thread(left.clear)
    gc.collect()
    buf.set_transform("base", "arm", 300, (2, 2, 2), TURNED)
    assert buf.counters().aborts == 20


def test_threads_end_while_others_free_their_transactions() -> None:
    buf = filled("2pl-wait-die")
    for _ in range(300):
        held: list[Any] = []
        begun = threading.Event()

        def leave(held: list[Any] = held, begun: threading.Event = begun) -> None:
            held.append(buf.transaction())
            held[0].__enter__()
            held[0].set_transform("base", "arm", 300, (9, 9, 9), TURNED)
            begun.set()

        thread = threading.Thread(target=leave)
        thread.start()
        begun.wait()
        del thread, leave
        held.clear()
    buf.set_transform("base", "arm", 300, (1, 1, 1), TURNED)
    assert buf.lookup_transform("base", "arm", 300).pose[0] == 1.0


PROGRAM = """
import os, sys, threading
import tfdb
buf = tfdb.Buffer(concurrency=sys.argv[1])
buf.set_static_transform("map", "base", (1, 2, 3))

class Last:
    def __del__(self, buf=buf, write=os.write):
        buf.set_static_transform("map", "base", (3, 2, 1))
        write(1, b"written")

sys.last = Last()  # goes when the threads have been stopped
begun = threading.Event()

def alone():
    with buf._attempt(0, True, 0) as tx:
        begun.set()
        while True:
            tx.lookup_transforms("map", "base", [5] * 10_000)

threading.Thread(target=alone, daemon=True).start()
begun.wait()
"""


@pytest.mark.skipif(sys.version_info >= (3, 14), reason="Python itself puts such threads to sleep")
@pytest.mark.parametrize("concurrency", ["snapshot", "giant"])
def test_exit_does_not_wait_for_stopped_threads(concurrency: str) -> None:
    assert printed_by("-c", PROGRAM, concurrency) == "written"
