"""`Buffer.run` retries until it commits, within documented limits."""

from __future__ import annotations

import functools
import inspect
import threading
import typing
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import tfdb
import tfdb.store.transactions
import tfdb.types
from another_thread import in_another_thread
from oracle import quaternion

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable, Iterator

TURN = quaternion((1, -2, 0.5), 0.9)


@pytest.fixture
def buffer() -> tfdb.Buffer:
    made = tfdb.Buffer(history=None)
    made.set_static_transform("map", "counter", (0, 1, 2), TURN)
    return made


def value(reads: Any) -> float:
    return float(reads.lookup_transform("map", "counter").translation[0])


def add(tx: tfdb.Transaction) -> float:
    x = value(tx) + 1
    tx.set_static_transform("map", "counter", (x, 1, 2), TURN)
    return x


def interfere(buffer: tfdb.Buffer) -> None:
    """Change the data that `add` has read, in another thread."""
    in_another_thread(
        lambda: buffer.set_static_transform("map", "counter", (value(buffer), 1, 2), TURN)
    )


def test_run_returns_the_functions_result(buffer: tfdb.Buffer) -> None:
    assert buffer.run(add) == 1
    assert buffer.run(add) == 2
    assert value(buffer) == 2
    assert buffer.commit == 3
    marker = object()
    assert buffer.run(lambda tx: marker) is marker
    assert buffer.commit == 3


def test_run_retries_until_no_commit_conflicts(buffer: tfdb.Buffer) -> None:
    calls: list[tfdb.Transaction] = []

    def contested(tx: tfdb.Transaction) -> float:
        calls.append(tx)
        x = add(tx)
        if len(calls) <= 3:
            interfere(buffer)
        return x

    assert buffer.run(contested) == 1
    assert len(calls) == 4
    assert len({tx._age for tx in calls}) == 1
    assert [tx.commit for tx in calls] == [None, None, None, buffer.commit]
    assert buffer.counters().conflicts == buffer.counters().aborts == 3


class Adversary:
    """Starts a conflicting commit on request; the commit may have to wait."""

    def __init__(self, buffer: tfdb.Buffer) -> None:
        self.commits: list[int] = []
        self.go = threading.Semaphore(0)
        self.done = threading.Semaphore(0)
        self._buffer = buffer
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while True:
            self.go.acquire()
            number = self._buffer.set_static_transform("map", "counter", (100, 1, 2), TURN)
            self.commits.append(number)
            self.done.release()


@pytest.mark.parametrize("engine", ["snapshot", "silo"])
def test_after_eight_lost_attempts_it_runs_alone(engine: Any) -> None:
    """The bound on starvation: the ninth attempt commits beside any other commits.

    In these engines another commit can come first; in the others it waits for the transaction.
    """
    buffer = tfdb.Buffer(history=None, concurrency=engine)
    buffer.set_static_transform("map", "counter", (0, 1, 2), TURN)
    adversary = Adversary(buffer)
    calls: list[tfdb.Transaction] = []

    def contested(tx: tfdb.Transaction) -> int:
        calls.append(tx)
        add(tx)
        adversary.go.release()
        if len(calls) <= tfdb.store.transactions.LOST_BEFORE_ALONE:
            adversary.done.acquire()
        else:  # its commit waits for this transaction, and cannot come first
            assert len(calls) == 9
            for _ in range(100_000):
                pass
            assert len(adversary.commits) == 8
        return len(calls)

    assert buffer.run(contested) == 9
    adversary.done.acquire()
    assert len(calls) == 9
    assert calls[-1].commit is not None
    assert adversary.commits[-1] > calls[-1].commit > adversary.commits[-2]
    assert buffer.counters().conflicts == 8


def test_lookups_go_on_while_one_runs_alone(buffer: tfdb.Buffer) -> None:
    with buffer._attempt(0, True, 0) as tx:
        add(tx)
        assert in_another_thread(lambda: value(buffer)) == 0
        with in_another_thread(buffer.snapshot) as snapshot:
            assert value(snapshot) == 0
    assert value(buffer) == 1


@pytest.mark.parametrize("retries", [0, 1, 3])
def test_retries_are_counted(buffer: tfdb.Buffer, retries: int) -> None:
    calls = 0

    def contested(tx: tfdb.Transaction) -> None:
        nonlocal calls
        calls += 1
        add(tx)
        interfere(buffer)

    with pytest.raises(tfdb.Conflict) as caught:
        buffer.run(contested, retries=retries)
    assert calls == caught.value.attempts == retries + 1
    assert caught.value.edge == "counter"
    assert value(buffer) == 0
    assert ("once" if retries == 0 else f"{retries + 1} times") in str(caught.value)


def test_the_time_is_limited(buffer: tfdb.Buffer, monkeypatch: pytest.MonkeyPatch) -> None:
    """If the clock advances by a second per attempt, 2.5 s allow three attempts."""
    now = 0.0

    def contested(tx: tfdb.Transaction) -> None:
        nonlocal now
        now += 1.0
        add(tx)
        interfere(buffer)

    monkeypatch.setattr(tfdb.store.transactions.time, "monotonic", lambda: now)
    with pytest.raises(tfdb.Conflict) as caught:
        buffer.run(contested, timeout=2.5)
    assert caught.value.attempts == 3
    with pytest.raises(tfdb.Conflict) as caught:
        buffer.run(contested, timeout=0)
    assert caught.value.attempts == 1


@pytest.fixture
def waits(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[tuple[float, float, float]]]:
    """(least, most, slept) of each wait."""
    seen: list[tuple[float, float, float]] = []
    bounds: list[tuple[float, float]] = []
    uniform = tfdb.store.transactions.random.uniform

    def draw(low: float, high: float) -> float:
        bounds.append((low, high))
        return uniform(low, high)

    monkeypatch.setattr(tfdb.store.transactions.random, "uniform", draw)
    monkeypatch.setattr(
        tfdb.store.transactions.time, "sleep", lambda seconds: seen.append((*bounds[-1], seconds))
    )
    return seen


def test_the_wait_is_bounded_and_jittered(
    buffer: tfdb.Buffer, waits: list[tuple[float, float, float]]
) -> None:
    calls = 0

    def contested(tx: tfdb.Transaction) -> None:
        nonlocal calls
        calls += 1
        add(tx)
        if calls <= 8:
            interfere(buffer)

    buffer.run(contested)
    assert [(low, high) for low, high, _ in waits] == [
        (0, pytest.approx(seconds))
        for seconds in (1e-4, 2e-4, 4e-4, 8e-4, 1.6e-3, 3.2e-3, 6.4e-3, 1e-2)
    ]
    assert all(low <= slept <= high for low, high, slept in waits)
    assert len({slept for *_, slept in waits}) == 8


class SurpriseError(Exception):
    """An error that is not tfdb's."""


@pytest.mark.parametrize(
    "error", [SurpriseError, KeyboardInterrupt, tfdb.UnknownFrame, tfdb.Conflict]
)
def test_errors_of_the_function_come_out_at_once(
    buffer: tfdb.Buffer, error: type[BaseException]
) -> None:
    """Also a Conflict of another transaction."""
    calls = 0

    def fail(tx: tfdb.Transaction) -> None:
        nonlocal calls
        calls += 1
        add(tx)
        raise error("mine")

    with pytest.raises(error, match="mine") as caught:
        buffer.run(fail)
    assert calls == 1
    assert getattr(caught.value, "attempts", None) is None
    assert value(buffer) == 0
    assert buffer.commit == 1


def test_errors_of_the_commit_come_out_at_once(buffer: tfdb.Buffer) -> None:
    calls = 0

    def close(tx: tfdb.Transaction) -> None:
        nonlocal calls
        calls += 1
        tx.set_static_transform("counter", "tip", (1, 2, 3), TURN)
        tx.set_static_transform("tip", "map", (1, 2, 3), TURN)

    with pytest.raises(tfdb.errors.CycleError):
        buffer.run(close)
    assert calls == 1
    assert buffer.frames() == ["counter", "map"]


def test_it_may_give_up_by_itself(buffer: tfdb.Buffer) -> None:
    def decide(tx: tfdb.Transaction) -> str:
        add(tx)
        tx.abort()
        return "no"

    assert buffer.run(decide) == "no"
    assert value(buffer) == 0


@pytest.mark.parametrize("priority", [0, 3, 7])
def test_priorities_are_taken(buffer: tfdb.Buffer, priority: int) -> None:
    assert buffer.run(add, priority=priority, timeout=10, retries=5) == 1


@pytest.mark.parametrize(
    "options",
    [
        {"retries": -1},
        {"retries": 1.5},
        {"retries": True},
        {"retries": "3"},
        {"retries": None},
        {"timeout": -1},
        {"timeout": float("nan")},
        {"timeout": True},
        {"timeout": "3"},
        {"priority": -1},
        {"priority": 8},
        {"priority": True},
        {"priority": 1.0},
        {"priority": "high"},
        {"priority": None},
    ],
)
def test_options_that_cannot_be(buffer: tfdb.Buffer, options: dict[str, Any]) -> None:
    calls: list[object] = []
    with pytest.raises(tfdb.InvalidArgument) as caught:
        buffer.run(calls.append, **options)
    ((name, given),) = options.items()
    assert name in str(caught.value)
    assert caught.value.value is given
    assert calls == []
    assert buffer.commit == 1


def test_the_default_is_enough_to_win(buffer: tfdb.Buffer) -> None:
    """At most nine calls: the last of the eight default retries runs alone."""
    calls = 0

    def contested(tx: tfdb.Transaction) -> int:
        nonlocal calls
        calls += 1
        add(tx)
        if calls <= tfdb.store.transactions.LOST_BEFORE_ALONE:
            interfere(buffer)
        return calls

    default = inspect.signature(tfdb.Buffer.run).parameters["retries"].default
    assert buffer.run(contested) == default + 1 == 9


async def later(tx: tfdb.Transaction) -> None:
    add(tx)


def piecemeal(tx: tfdb.Transaction) -> Iterator[float]:
    yield add(tx)


async def piecemeal_later(tx: tfdb.Transaction) -> AsyncIterator[float]:
    yield add(tx)


def disguised(tx: tfdb.Transaction) -> Any:
    add(tx)
    return later(tx)


@pytest.mark.parametrize(
    "function",
    [
        later,
        piecemeal,
        piecemeal_later,
        disguised,
        functools.partial(later),
    ],
    ids=["async", "generator", "async generator", "plain", "partial"],
)
def test_a_function_that_works_later_is_refused(buffer: tfdb.Buffer, function: Any) -> None:
    with pytest.raises(TypeError, match="has not done its work yet"):
        buffer.run(function)
    assert buffer.commit == 1
    assert buffer.run(add) == 1


@pytest.mark.parametrize("engine", typing.get_args(tfdb.types.Concurrency))
@pytest.mark.parametrize(
    "read",
    [
        lambda buf: buf.lookup_transform("map", "counter"),
        lambda buf: buf.lookup_latest_transform("map", "counter"),
        lambda buf: buf.can_transform("map", "counter"),
        lambda buf: buf.lookup_transforms("map", "counter", [5]),
        lambda buf: buf.transform_points("map", "counter", np.zeros((1, 3)), 5),
        lambda buf: buf.lookup_transform_full("map", 5, "counter", 6, "map"),
        lambda buf: buf.can_transform_full("map", 5, "counter", 6, "map"),
        lambda buf: buf.lookup_velocity("map", "counter"),
        lambda buf: buf.latest_common_time("map", "counter"),
        lambda buf: buf.trajectory("map", "counter", 1.0, 0, 10**9),
        lambda buf: buf.explain("map", "counter"),
        lambda buf: buf.frame_exists("map"),
        lambda buf: buf.frame_info("map"),
        lambda buf: buf.samples("counter"),
        lambda buf: buf.frames(),
        lambda buf: buf.tree(),
        lambda buf: buf.snapshot(),
    ],
)
def test_reads_outside_the_transaction_are_refused(engine: Any, read: Any) -> None:
    """Like writes, because no commit would check these reads."""
    buffer = tfdb.Buffer(history=None, concurrency=engine)
    buffer.set_static_transform("map", "counter", (0, 1, 2), TURN)
    other = tfdb.Buffer()
    other.set_static_transform("map", "counter", (7, 1, 2), TURN)

    def decide(tx: tfdb.Transaction) -> None:
        assert value(other) == 7  # another store is not affected
        add(tx)
        read(buffer)

    with pytest.raises(tfdb.errors.TransactionActive, match="use the transaction's methods"):
        buffer.run(decide)
    assert value(buffer) == 0
    read(buffer)
    with buffer.transaction() as tx:
        add(tx)
        if engine == "snapshot":
            in_another_thread(lambda: read(buffer))
    assert value(buffer) == 1


@pytest.mark.parametrize("function", [None, 7, "add"])
def test_functions_that_are_none(buffer: tfdb.Buffer, function: Any) -> None:
    with pytest.raises(TypeError, match="callable"):
        buffer.run(function)


def test_one_within_another_is_refused(buffer: tfdb.Buffer) -> None:
    def outer(tx: tfdb.Transaction) -> None:
        with pytest.raises(tfdb.errors.TransactionActive):
            buffer.run(add)
        add(tx)

    buffer.run(outer)
    assert value(buffer) == 1


def nothing(tx: tfdb.Transaction) -> None:
    pass


@pytest.mark.parametrize("call", [nothing, lambda tx: tx.abort()])
def test_the_thread_is_free_afterwards(buffer: tfdb.Buffer, call: Callable[[Any], None]) -> None:
    buffer.run(call)
    assert buffer.set_transform("map", "base", 5, (1, 2, 3), TURN) == 2


@pytest.mark.parametrize("goes_on", ["writes", "returns"])
def test_run_tries_again_if_the_function_caught_the_conflict(
    goes_on: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    buffer = tfdb.Buffer(history=None, concurrency="2pl-wound-wait")
    buffer.set_transforms(
        [tfdb.TransformStamped("map", "base", stamp, (1, 2, 3), TURN) for stamp in (10, 30)]
    )
    has_begun, has_read = threading.Event(), threading.Event()

    def older() -> None:
        with buffer.transaction() as tx:
            tx.lookup_transform("map", "base", 10)
            has_begun.set()
            has_read.wait()
            tx.set_transform("map", "base", 20, (4, 5, 6), TURN)

    calls: list[float] = []

    def younger(tx: tfdb.Transaction) -> float:
        calls.append(tx.lookup_transform("map", "base", 20).translation[0])
        has_read.set()
        while len(calls) == 1:
            try:
                tx.lookup_transform("map", "base", 20)
            except tfdb.TfdbError:
                break
        if goes_on == "writes":
            tx.set_transform("map", "cup", 20, (1, 2, 3), TURN)
        return calls[-1]

    thread = threading.Thread(target=older)
    # Between two attempts: an older one may run alone, and would wait for an open attempt.
    monkeypatch.setattr(tfdb.store.transactions.time, "sleep", lambda seconds: thread.join())
    thread.start()
    has_begun.wait()
    try:
        assert buffer.run(younger) == 4
    finally:
        has_read.set()
        thread.join()
    assert len(calls) == 2
    assert buffer.frame_exists("cup") == (goes_on == "writes")


def test_a_transaction_that_the_function_ended_is_not_tried_again(buffer: tfdb.Buffer) -> None:
    calls = []

    def ends(tx: tfdb.Transaction) -> float:
        calls.append(tx)
        tx.abort()
        return value(tx)

    with pytest.raises(tfdb.errors.TransactionClosed, match="aborted"):
        buffer.run(ends)
    assert len(calls) == 1
