"""Functions that tests run in other processes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import tfdb

from .all_reads import TURN, answers
from .wait_cycles import wait_cycles

if TYPE_CHECKING:
    from collections.abc import Callable
    from multiprocessing.connection import Connection
    from multiprocessing.synchronize import Barrier

ROOT = Path(__file__).resolve().parents[2]


class Child:
    """A process that runs a module of this folder with these arguments; it ends with the block."""

    def __init__(self, work: str, *arguments: object, module: str = "child") -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", f"tests.sharing.{module}", work, *map(str, arguments)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=ROOT,
        )
        self.pid = self._process.pid

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.communicate()

    def says(self) -> str:
        """The next line that it prints; empty where it has ended."""
        assert self._process.stdout is not None
        return self._process.stdout.readline().strip()

    def tell(self, line: str) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(f"{line}\n")
        self._process.stdin.flush()

    def send(self, number: signal.Signals) -> None:
        self._process.send_signal(number)

    def end(self) -> int:
        """Wait for it; its exit status, or minus the signal that ended it."""
        return self._process.wait(60)

    def wait_until_stopped(self) -> None:
        _, status = os.waitpid(self.pid, os.WUNTRACED)
        assert os.WIFSTOPPED(status)

    def wait_until_asleep(self) -> None:
        state = "R"
        while state != "S":
            state = Path(f"/proc/{self.pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
            assert state in "RSD", "it has ended"


def say(*words: object) -> None:
    print(*words, flush=True)


def pose_of(number: float) -> dict[str, Any]:
    return {"translation": (number, 2 * number, 1.0), "rotation": TURN}


def move_arm(buffer: tfdb.Buffer, number: int) -> None:
    """Two joints that every commit moves together."""
    buffer.set_transforms(
        [
            tfdb.TransformStamped("map", "base", 1000 * number, **pose_of(number)),
            tfdb.TransformStamped("base", "hand", 1000 * number, **pose_of(number)),
        ]
    )


def arm_in(reads: tfdb._core.StoreReader) -> int:
    """What both joints say, in one state."""
    if isinstance(reads, tfdb.Buffer):
        with reads.snapshot() as snapshot:
            return arm_in(snapshot)
    first = reads.lookup_transform("map", "base")
    second = reads.lookup_transform("base", "hand")
    assert first.stamp == second.stamp
    assert first.translation[0] == second.translation[0] == first.stamp / 1000
    return int(first.translation[0])


def exchange(buffer: tfdb.Buffer, pipe: Connection) -> None:
    """Answer what is in the store, then write to it."""
    pipe.send((answers(buffer), buffer.shared))
    buffer.set_transform("map", "from_child", 5, (1, 2, 3), TURN, authority="child")


def read_number(buffer: tfdb.Buffer) -> int:
    return arm_in(buffer)


def open_at_once(name: str, create: bool | None, start: Barrier, pipe: Connection) -> None:
    """Open when all others do, and leave a frame of one's own."""
    start.wait()
    try:
        buffer = tfdb.Buffer.open(name, create=create, size=1 << 25, max_frames=100)
    except tfdb.TfdbError as error:
        pipe.send(type(error).__name__)
        return
    buffer.set_transform("map", f"child{os.getpid()}", 5, (1, 2, 3), TURN)
    pipe.send("opened")


def follow(name: str, last: str) -> None:
    """Read without an end until the arm is at `last`; every answer is checked."""
    buffer = tfdb.Buffer.open(name, create=False, mode="r")
    say("ready")
    number, reads = 0, 0
    while number < int(last):
        with buffer.snapshot() as snapshot:
            seen = arm_in(snapshot)
        assert seen >= number
        number, reads = seen, reads + 1
    say("read", number)


def sleep_until(name: str, stamp: str) -> None:
    """Sleep by the store's clock, and say what it shows then."""
    clock = tfdb.Buffer.open(name, create=False, mode="r").clock
    say("sleeps")
    clock.sleep_until(int(stamp))
    say("woke", clock.now())


def set_clock(name: str) -> None:
    """Set the clock again and again, to times of which all digits are the same."""
    clock = tfdb.Buffer.open(name, create=False).clock
    clock.pause()
    say("sets")
    while True:
        for digit in range(1, 10):
            clock.seek(int(str(digit) * 18))


def write_on(name: str) -> None:
    """Move the arm until somebody ends it."""
    buffer = tfdb.Buffer.open(name, create=False)
    number = arm_in(buffer)
    while True:
        number += 1
        move_arm(buffer, number)


def hold_lock(name: str) -> None:
    """Stop with the lock for writers in hand: the ninth attempt of a transaction runs alone."""
    buffer = tfdb.Buffer.open(name, create=False)
    other = tfdb.Buffer.open(name, create=False)
    attempts = 0

    def lose(tx: tfdb.Transaction) -> None:
        nonlocal attempts
        attempts += 1
        number = int(tx.lookup_transform("map", "base").translation[0])
        if attempts == 9:
            os.kill(os.getpid(), signal.SIGSTOP)
        else:
            move_arm(other, number + 1)
        tx.set_transform("map", "mark", 1000 * number, **pose_of(number))

    buffer.run(lose)
    say("committed")


def write_when_free(name: str) -> None:
    """Wait for ever, until Ctrl-C."""
    buffer = tfdb.Buffer.open(name, create=False, lock_timeout=None)
    say("ready")
    try:
        move_arm(buffer, 10**6)
    except KeyboardInterrupt:
        say("interrupted")


def commit_when_free(name: str) -> None:
    """Wait for ever to commit a transaction, until Ctrl-C; handlers may not end it otherwise."""
    buffer = tfdb.Buffer.open(name, create=False, lock_timeout=None)
    refused: list[str] = []

    def handle(_number: int, _frame: object) -> None:
        calls: tuple[Callable[[], object], ...] = (
            tx.abort,
            lambda: tx.lookup_transform("map", "hand"),
            tx.__enter__,
            lambda: tx.__exit__(None, None, None),
            buffer.transaction().__enter__,
        )
        for call in calls:
            try:
                call()
            except tfdb.errors.TransactionActive as error:
                refused.append(str(error))
        raise KeyboardInterrupt

    signal.signal(signal.SIGINT, handle)
    tx = buffer.transaction()
    try:
        with tx:
            tx.set_transform("map", "interrupted", 5, **pose_of(1))
            say("ready")
    except KeyboardInterrupt:
        say("interrupted", "committed" if tx.commit else "aborted", len(refused))
    signal.signal(signal.SIGINT, signal.default_int_handler)
    say("ready")
    try:
        with buffer._attempt(0, alone=True, age=0) as alone:
            alone.set_transform("map", "never", 5, **pose_of(1))
    except KeyboardInterrupt:
        say("interrupted")


def wait_for(name: str, count: str) -> None:
    """Wait for one stamp after the other."""
    buffer = tfdb.Buffer.open(name, create=False, mode="r")
    try:
        for stamp in range(int(count)):
            say("waits for", stamp)
            found = buffer.wait_for_transform("map", "a", stamp)
            assert found.stamp == stamp
            say("has", stamp)
    except tfdb.errors.NoSuchStore as error:
        say("NoSuchStore", error.path)


def wait_often(name: str, rounds: str, seed: str) -> None:
    say(wait_cycles(name, int(rounds), int(seed)).total())


def hold_snapshot(name: str) -> None:
    buffer = tfdb.Buffer.open(name, create=False, mode="r")
    with buffer.snapshot() as snapshot:
        say(arm_in(snapshot))
        sys.stdin.readline()
        say(arm_in(snapshot))


def become(user: str) -> None:
    """Become somebody else, of the group of that number too."""
    private = tfdb.Buffer()  # what this imports may be another's to read
    move_arm(private, 1)
    assert (arm_in(private), tfdb.types.Shared.__name__) == (1, "Shared")
    os.setgroups([])
    os.setgid(int(user))
    os.setuid(int(user))


def wait_as(user: str, name: str) -> None:
    """Wait where it cannot be said."""
    become(user)
    buffer = tfdb.Buffer.open(name, create=False, mode="r")
    say(buffer.lookup_transform("map", "a", timeout=1).stamp)
    try:
        buffer.wait_for_commit(buffer.commit)
    except tfdb.errors.NotSupported as error:
        say("NotSupported", error.path)


def open_as(user: str, name: str, mode: str) -> None:
    become(user)
    try:
        buffer = tfdb.Buffer.open(name, create=False, mode="rw" if mode == "rw" else "r")
    except tfdb.TfdbError as error:
        say(type(error).__name__)
        return
    assert buffer.shared is not None
    say(arm_in(buffer), buffer.shared.processes)


if __name__ == "__main__":
    {
        work.__name__: work
        for work in (
            follow,
            write_on,
            hold_lock,
            sleep_until,
            set_clock,
            write_when_free,
            commit_when_free,
            wait_for,
            wait_as,
            wait_often,
            hold_snapshot,
            open_as,
        )
    }[sys.argv[1]](*sys.argv[2:])
