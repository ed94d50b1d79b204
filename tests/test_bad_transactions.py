"""Wrong use of transactions raises a typed error and leaves the store unchanged."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

import pytest

import tfdb
from another_thread import Call, in_another_thread
from oracle import quaternion
from refused_calls import refused
from robot import COUNT, make_robot, stamp_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

TURN = quaternion((1, -2, 0.5), 0.9)
NAN = float("nan")

USES: dict[str, Callable[[Any], object]] = {
    "lookup": lambda tx: tx.lookup_transform("map", "camera"),
    "latest": lambda tx: tx.lookup_latest_transform("map", "camera"),
    "many": lambda tx: tx.lookup_transforms("map", "camera", [stamp_of(1)]),
    "can": lambda tx: tx.can_transform("map", "camera"),
    "common": lambda tx: tx.latest_common_time("map", "camera"),
    "exists": lambda tx: tx.frame_exists("map"),
    "set": lambda tx: tx.set_transform("map", "odom", stamp_of(50), (1, 2, 3), TURN),
    "static": lambda tx: tx.set_static_transform("base", "lidar", (1, 2, 3)),
    "batch": lambda tx: tx.set_transforms(
        [tfdb.TransformStamped("map", "odom", stamp_of(50), (1, 2, 3), TURN)]
    ),
    "empty": lambda tx: tx.set_transforms([]),
    "remove": lambda tx: tx.remove_frames("camera"),
    "reparent": lambda tx: tx.reparent("camera", "base"),
}
uses = pytest.mark.parametrize("use", USES.values(), ids=USES.keys())


@pytest.fixture
def buffer() -> tfdb.Buffer:
    return make_robot().buffer


# -- engines and priorities ------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["", "Snapshot", "2pl", "mvcc", "silo ", "\ud800", None, 7, True])
def test_engines_that_there_are_not(name: Any) -> None:
    with pytest.raises(tfdb.InvalidArgument) as caught:
        tfdb.Buffer(concurrency=name)
    assert type(caught.value) is tfdb.InvalidArgument
    for known in ("snapshot", "giant", "fine", "2pl-no-wait", "2pl-wait-die", "silo"):
        assert known in str(caught.value)


def test_the_engine_is_named_by_keyword() -> None:
    with pytest.raises(TypeError):
        tfdb.Buffer(10.0, "silo")  # type: ignore[misc]


@pytest.mark.parametrize("priority", ["high", "1", 1.0, True, None, -1, 8, 2**70, [1]])
def test_priorities_that_are_none(buffer: tfdb.Buffer, priority: Any) -> None:
    with refused(buffer, tfdb.InvalidArgument) as caught:
        buffer.transaction(priority)
    assert "from 0 " in str(caught.value)
    assert "to 7 " in str(caught.value)
    assert caught.value.value is priority


# -- before and after ------------------------------------------------------------------------------


@uses
def test_one_that_has_not_begun(buffer: tfdb.Buffer, use: Callable[[Any], object]) -> None:
    tx = buffer.transaction()
    with refused(buffer, tfdb.errors.TransactionClosed) as caught:
        use(tx)
    assert caught.value.reason == "not begun"
    assert "with" in str(caught.value)
    with refused(buffer, tfdb.errors.TransactionClosed):
        tx.abort()
    with refused(buffer, tfdb.errors.TransactionClosed):
        tx.__exit__(None, None, None)
    with tx:
        use(tx)
        tx.abort()


def committed(buffer: tfdb.Buffer) -> tfdb.Transaction:
    with buffer.transaction() as tx:
        tx.set_transform("map", "odom", stamp_of(60), (1, 2, 3), TURN)
    return tx


def aborted(buffer: tfdb.Buffer) -> tfdb.Transaction:
    with buffer.transaction() as tx:
        tx.abort()
    return tx


def failed(buffer: tfdb.Buffer) -> tfdb.Transaction:
    tx = buffer.transaction()

    def work() -> None:
        with tx:
            raise LookupError

    with pytest.raises(LookupError):
        work()
    return tx


def lost(buffer: tfdb.Buffer) -> tfdb.Transaction:
    tx = buffer.transaction()

    def work() -> None:
        with tx:
            tx.lookup_transform("map", "odom")
            tx.set_static_transform("base", "mark", (1, 2, 3))
            in_another_thread(
                lambda: buffer.set_transform("map", "odom", stamp_of(61), (1, 2, 3), TURN)
            )

    with pytest.raises(tfdb.Conflict):
        work()
    return tx


def refused_at_commit(buffer: tfdb.Buffer) -> tfdb.Transaction:
    tx = buffer.transaction()

    def work() -> None:
        with tx:
            tx.set_transform("camera", "map", stamp_of(62), (1, 2, 3), TURN)

    with pytest.raises(tfdb.errors.CycleError):
        work()
    return tx


@pytest.mark.parametrize(
    ("end", "reason"),
    [
        (committed, "committed"),
        (aborted, "aborted"),
        (failed, "aborted"),
        (lost, "lost"),
        (refused_at_commit, "refused"),
    ],
)
@uses
def test_one_that_has_ended(
    buffer: tfdb.Buffer,
    end: Callable[[tfdb.Buffer], tfdb.Transaction],
    reason: str,
    use: Callable[[Any], object],
) -> None:
    tx = end(buffer)
    assert tx.closed
    with refused(buffer, tfdb.errors.TransactionClosed) as caught:
        use(tx)
    assert caught.value.reason == reason
    assert "Buffer.transaction()" in str(caught.value)
    with refused(buffer, tfdb.errors.TransactionClosed):
        tx.__enter__()


@pytest.mark.parametrize("end", [aborted, failed, lost, refused_at_commit])
def test_abort_does_nothing_after_an_end_without_a_commit(
    buffer: tfdb.Buffer, end: Callable[[tfdb.Buffer], tfdb.Transaction]
) -> None:
    tx = end(buffer)
    before = repr(tx), buffer.counters().aborts, buffer.commit
    tx.abort()
    tx.abort()
    assert (repr(tx), buffer.counters().aborts, buffer.commit) == before


def test_a_committed_transaction_cannot_be_aborted(buffer: tfdb.Buffer) -> None:
    tx = committed(buffer)
    with refused(buffer, tfdb.errors.TransactionClosed) as caught:
        tx.abort()
    assert f"commit {tx.commit}" in str(caught.value)


# -- threads ---------------------------------------------------------------------------------------


@uses
def test_another_thread_may_not_use_it(buffer: tfdb.Buffer, use: Callable[[Any], object]) -> None:
    commit = buffer.commit
    with buffer.transaction() as tx:
        with pytest.raises(tfdb.errors.WrongThread, match="the thread that began it"):
            in_another_thread(lambda: use(tx))
        with pytest.raises(tfdb.errors.WrongThread):
            in_another_thread(tx.abort)
        with pytest.raises(tfdb.errors.WrongThread):
            in_another_thread(lambda: tx.__exit__(None, None, None))
        with pytest.raises(tfdb.errors.WrongThread):
            in_another_thread(lambda: tx.__exit__(ValueError, ValueError(), None))
        assert not tx.closed
        tx.lookup_transform("map", "camera")
    assert buffer.commit == tx.commit == commit
    with refused(buffer, tfdb.errors.WrongThread):
        in_another_thread(lambda: use(tx))


WRITES: dict[str, Callable[[tfdb.Buffer], object]] = {
    "set": lambda b: b.set_transform("map", "odom", stamp_of(50), (1, 2, 3), TURN),
    "static": lambda b: b.set_static_transform("base", "lidar", (1, 2, 3)),
    "batch": lambda b: b.set_transforms(
        [tfdb.TransformStamped("map", "odom", stamp_of(50), (1, 2, 3), TURN)]
    ),
    "long batch": lambda b: b.set_transforms(
        [tfdb.TransformStamped("map", "odom", stamp_of(50), (1, 2, 3), TURN)] * 5000
    ),
    "partial": lambda b: b.set_transforms(
        [tfdb.TransformStamped("map", "odom", stamp_of(50), (1, 2, 3), TURN)], partial=True
    ),
    "remove": lambda b: b.remove_frames("camera"),
    "remove many": lambda b: b.remove_frames(["camera", "lidar"]),
    "clear": lambda b: b.clear(),
    "ingest": lambda b: b.ingest(
        tfdb.encode_tf_message([tfdb.TransformStamped("map", "odom", stamp_of(50), (1, 2, 3))])
    ),
}


@pytest.mark.parametrize("write", WRITES.values(), ids=WRITES.keys())
def test_its_thread_writes_through_it(
    buffer: tfdb.Buffer, write: Callable[[tfdb.Buffer], object]
) -> None:
    commit = buffer.commit
    with buffer.transaction() as tx:
        with pytest.raises(tfdb.errors.TransactionActive) as caught:
            write(buffer)
        assert "transaction" in str(caught.value)
        assert not tx.closed
        assert buffer.commit == commit
        in_another_thread(lambda: write(buffer))
        tx.lookup_transform("map", "lidar", stamp_of(3))
    write_again = WRITES["set"]
    write_again(buffer)


def test_one_within_another(buffer: tfdb.Buffer) -> None:
    commit = buffer.commit
    with buffer.transaction() as tx:
        with pytest.raises(tfdb.errors.TransactionActive):
            buffer.transaction().__enter__()
        with pytest.raises(tfdb.errors.TransactionActive):
            buffer._attempt(0, True, 0).__enter__()
        with pytest.raises(tfdb.errors.TransactionActive):
            tx.__enter__()
        with pytest.raises(tfdb.errors.TransactionActive):
            buffer.run(lambda _: None)
        assert not tx.closed
        tx.set_transform("map", "odom", stamp_of(50), (1, 2, 3), TURN)
    assert buffer.commit == commit + 1
    assert buffer.counters().aborts == 0


@pytest.mark.parametrize("engine", ["snapshot", "giant"])
def test_one_that_many_threads_begin(engine: str) -> None:
    """It is the first one's, also while that one still waits for its turn."""
    buffer = tfdb.Buffer(concurrency=engine)
    buffer.set_static_transform("map", "base", (1, 2, 3), TURN)
    tx = buffer._attempt(0, True, 0)

    def use() -> str:
        try:
            with tx:
                tx.set_static_transform("map", "base", (4, 5, 6), TURN)
        except tfdb.errors.WrongThread:
            return "wrong"
        return "committed"

    with buffer._attempt(0, True, 0):
        calls = [Call(use) for _ in range(4)]
    assert sorted(call.result() for call in calls) == ["committed", *["wrong"] * 3]
    assert tx.commit == buffer.commit == 2


def test_its_thread_may_read_older_snapshots_of_the_default_store(buffer: tfdb.Buffer) -> None:
    with buffer.snapshot() as before, buffer.transaction() as tx:
        tx.set_transform("map", "odom", stamp_of(50), (1, 2, 3), TURN)
        assert not before.can_transform("map", "odom", stamp_of(50))
        assert before.lookup_transforms("map", "camera", [stamp_of(1)]).shape == (1, 7)
        assert len(before.tree()) == 8


# -- what goes in ----------------------------------------------------------------------------------


@pytest.fixture
def tx(buffer: tfdb.Buffer) -> Iterator[tfdb.Transaction]:
    """An open transaction, which must still be open at the end, and store nothing."""
    commit = buffer.commit
    with buffer.transaction() as tx:
        yield tx
        assert not tx.closed
    assert tx.commit == buffer.commit == commit


@pytest.mark.parametrize(
    ("call", "error"),
    [
        (lambda tx: tx.lookup_transform("map", 7), TypeError),
        (lambda tx: tx.lookup_transform("map"), TypeError),
        (lambda tx: tx.lookup_transform("map", "odom", when=5), TypeError),
        (lambda tx: tx.lookup_transform("map", "odom", 5, "linear"), TypeError),
        (lambda tx: tx.lookup_transform("map", "odom", 1.5), tfdb.InvalidStamp),
        (lambda tx: tx.lookup_transform("map", "odom", 5), tfdb.Extrapolation),
        (lambda tx: tx.lookup_transform("map", "cup"), tfdb.UnknownFrame),
        (lambda tx: tx.lookup_latest_transform("map", "odom", -1), tfdb.InvalidArgument),
        (lambda tx: tx.lookup_latest_transform("map", "odom", 1, 1.5), tfdb.InvalidStamp),
        (lambda tx: tx.lookup_transforms("map", "odom", 5), tfdb.errors.InvalidArray),
        (lambda tx: tx.lookup_transforms("map", "odom", [5], layout="x"), tfdb.InvalidArgument),
        (lambda tx: tx.lookup_transforms("map", "odom", [5], missing=1), TypeError),
        (lambda tx: tx.lookup_transforms("map", "cup", []), tfdb.UnknownFrame),
        (lambda tx: tx.can_transform("map", "odom", -5), tfdb.InvalidStamp),
        (lambda tx: tx.latest_common_time("map", "cup"), tfdb.UnknownFrame),
        (lambda tx: tx.frame_exists(None), TypeError),
        (
            lambda tx: tx.set_transform("map", "odom", stamp_of(50), (1, 2, NAN), TURN),
            tfdb.errors.InvalidTransform,
        ),
        (
            lambda tx: tx.set_transform("map", "odom", stamp_of(50), (1, 2), TURN),
            tfdb.errors.InvalidArray,
        ),
        (
            lambda tx: tx.set_transform("map", "", stamp_of(50), (1, 2, 3), TURN),
            tfdb.errors.InvalidName,
        ),
        (lambda tx: tx.set_transform("map", "odom", -5, (1, 2, 3), TURN), tfdb.InvalidStamp),
        (
            lambda tx: tx.set_transform("map", "odom", 5, (1, 2, 3), TURN, authority=7),
            TypeError,
        ),
        (
            lambda tx: tx.set_transform("base", "lidar", stamp_of(50), (1, 2, 3), TURN),
            tfdb.errors.StaticConflict,
        ),
        (lambda tx: tx.set_static_transform("map", "odom", (1, 2, 3)), tfdb.errors.StaticConflict),
        (lambda tx: tx.set_static_transform("map", "map", (1, 2, 3)), tfdb.errors.InvalidTransform),
        (lambda tx: tx.set_transforms(7), TypeError),
        (lambda tx: tx.set_transforms([7]), TypeError),
        (lambda tx: tx.set_transforms([], partial=True), TypeError),
        (lambda tx: tx.remove_frames("cup"), tfdb.UnknownFrame),
        (lambda tx: tx.remove_frames("base"), tfdb.errors.FrameInUse),
        (lambda tx: tx.remove_frames(7), TypeError),
        (lambda tx: tx.reparent("camera", "cup"), tfdb.UnknownFrame),
        (lambda tx: tx.reparent("cup", "camera"), tfdb.UnknownFrame),
        (lambda tx: tx.reparent("camera", "camera"), tfdb.errors.InvalidTransform),
        (lambda tx: tx.reparent("camera", "base", rotation=TURN), tfdb.InvalidArgument),
        (lambda tx: tx.reparent("camera", "base", None, (1, NAN, 3)), tfdb.errors.InvalidTransform),
        (lambda tx: tx.reparent("left_arm", "base", 5, (1, 2, 3), 7), tfdb.errors.InvalidArray),
    ],
)
def test_calls_that_are_refused_leave_it_open(
    tx: tfdb.Transaction, call: Callable[[Any], object], error: type[Exception]
) -> None:
    with pytest.raises(error) as caught:
        call(tx)
    assert type(caught.value) is error


def test_samples_older_than_the_history() -> None:
    buffer = make_robot(history=1.0).buffer
    with buffer.transaction() as tx, pytest.raises(tfdb.errors.TooOld) as caught:
        tx.set_transform("map", "odom", stamp_of(COUNT - 12), (1, 2, 3), TURN)
    assert caught.value.oldest == stamp_of(COUNT - 11)


# -- the end ---------------------------------------------------------------------------------------


def test_a_commit_that_would_close_a_cycle(buffer: tfdb.Buffer) -> None:
    def close() -> None:
        with buffer.transaction() as tx:
            tx.set_transform("map", "new", stamp_of(50), (1, 2, 3), TURN)
            tx.set_transform("left_hand", "base", stamp_of(60), (1, 2, 3), TURN, authority="arm")

    with refused(buffer, tfdb.errors.CycleError) as caught:
        close()
    assert {"base", "left_hand"} <= set(caught.value.frames or ())
    assert caught.value.stamp == stamp_of(60)
    assert "left_hand" in str(caught.value)
    assert str(caught.value).endswith("nothing was stored")


def test_a_commit_that_finds_no_room() -> None:
    buffer = tfdb.Buffer(max_frames=3)
    buffer.set_static_transform("map", "base", (1, 2, 3), TURN)

    def fill() -> None:
        with buffer.transaction() as tx:
            for name in "abc":
                tx.set_static_transform("base", name, (1, 2, 3), TURN)

    with pytest.raises(tfdb.errors.CapacityExceeded):
        fill()
    assert (buffer.commit, buffer.frames()) == (1, ["base", "map"])
    with buffer.transaction() as tx:
        tx.set_static_transform("base", "a", (1, 2, 3), TURN)
    assert buffer.frames() == ["a", "base", "map"]


def test_an_error_at_the_end_keeps_the_earlier_exception(buffer: tfdb.Buffer) -> None:
    """The body's own error comes out, also where the commit would have been refused."""

    def fail() -> None:
        with buffer.transaction() as tx:
            tx.set_transform("left_hand", "base", stamp_of(60), (1, 2, 3), TURN)
            raise LookupError("mine")

    with pytest.raises(LookupError, match="mine") as caught:
        fail()
    assert caught.value.__context__ is None


def test_classes_are_not_made_by_hand() -> None:
    with pytest.raises(TypeError):
        tfdb.Transaction()
    blank = tfdb.Transaction.__new__(tfdb.Transaction)
    with pytest.raises(TypeError), pytest.warns(RuntimeWarning, match="uninitialized"):
        blank.lookup_transform("map", "base")


def test_errors_have_distinct_classes() -> None:
    errors = [
        tfdb.Conflict,
        tfdb.errors.TransactionClosed,
        tfdb.errors.TransactionActive,
        tfdb.errors.WrongThread,
    ]
    for error in errors:
        assert error.__bases__ == (tfdb.TfdbError,)
        assert error.__module__ == ("tfdb" if error is tfdb.Conflict else "tfdb.errors")


def test_interrupts_while_others_wait(buffer: tfdb.Buffer) -> None:
    """Who waits for a transaction gets its turn also when that one is interrupted."""
    begun = threading.Event()
    numbers: list[int] = []

    def write() -> None:
        begun.set()
        numbers.append(buffer.set_static_transform("base", "mark", (1, 2, 3)))

    writer = threading.Thread(target=write)

    def work() -> None:
        with buffer._attempt(0, True, 0):
            writer.start()
            begun.wait()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        work()
    writer.join()
    assert numbers == [buffer.commit]
