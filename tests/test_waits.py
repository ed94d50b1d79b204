"""Each wait ends once: by its result, its timeout or its cancellation."""

from __future__ import annotations

import asyncio
import gc
import signal
import threading
from typing import TYPE_CHECKING

import pytest

import tfdb
from tfdb.store import waiting

from .another_thread import Call

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

POSE = ((1.0, 2.0, 3.0), (0.0, 0.0, 0.6, 0.8))
LONG = 60.0


def put(buf: tfdb.Buffer, child: str, stamp: int, parent: str = "map") -> None:
    buf.set_transform(parent, child, stamp, *POSE)


@pytest.fixture
def buf() -> tfdb.Buffer:
    return tfdb.Buffer(history=None)


def test_a_lookup_waits_for_its_answer(buf: tfdb.Buffer) -> None:
    call = Call(lambda: buf.lookup_transform("map", "a", 5, timeout=LONG))
    put(buf, "b", 5)
    put(buf, "a", 4)
    put(buf, "a", 6)
    assert call.result().translation.tolist() == [1.0, 2.0, 3.0]
    assert call.result().stamp == 5


def test_existing_data_is_returned_at_once(buf: tfdb.Buffer) -> None:
    put(buf, "a", 5)
    for timeout in (0, 0.0, 5, LONG, None):
        assert buf.lookup_transform("map", "a", 5, timeout=timeout).stamp == 5
        assert buf.wait_for_transform("map", "a", 5, timeout).stamp == 5


@pytest.mark.parametrize("timeout", [0, 0.001])
def test_a_timeout_raises_the_error_of_a_lookup(buf: tfdb.Buffer, timeout: float) -> None:
    def wait() -> tfdb.Transform:
        return buf.wait_for_transform("map", "a", 9, timeout)

    with pytest.raises(tfdb.UnknownFrame):
        wait()
    put(buf, "a", 5)
    with pytest.raises(tfdb.Extrapolation) as caught:
        wait()
    assert caught.value.reason == "future"
    put(buf, "b", 5, parent="elsewhere")
    with pytest.raises(tfdb.Disconnected):
        buf.lookup_transform("b", "a", 5, timeout=timeout)
    with pytest.raises(tfdb.errors.NoSampleNear):
        buf.wait_for_transform("map", "a", 7, timeout, policy=tfdb.Nearest(tolerance=0.0))


def test_a_wait_for_a_commit(buf: tfdb.Buffer) -> None:
    call = Call(lambda: buf.wait_for_commit(0, LONG))
    put(buf, "a", 1)
    assert call.result() == 1
    assert buf.wait_for_commit(0) == 1
    with pytest.raises(
        tfdb.WaitTimeout, match=r"followed commit 1; waited \d+\.\d\d\d s:"
    ) as caught:
        buf.wait_for_commit(1, 0.001)
    assert isinstance(caught.value, TimeoutError)
    assert caught.value.commit == 1
    assert caught.value.limit == 1_000_000


HOPELESS = ["", "a\0b", "tab\t", "x" * 1025]


@pytest.mark.parametrize("name", HOPELESS)
def test_a_name_that_no_frame_can_have_is_not_waited_for(buf: tfdb.Buffer, name: str) -> None:
    put(buf, "a", 1)
    waits: list[Callable[[], object]] = [
        lambda: buf.wait_for_transform("map", name),
        lambda: buf.wait_for_transform(name, "a"),
        lambda: buf.lookup_transform("map", name, 5, timeout=LONG),
        lambda: asyncio.run(buf.wait_for_transform_async(name, "a")),
        lambda: asyncio.run(buf.wait_for_transform_async("map", name, 5, LONG)),
    ]
    for wait in waits:
        with pytest.raises(
            tfdb.errors.InvalidName, match="the wait would never end: the "
        ) as caught:
            wait()
        assert (caught.value.frame or "") == name
    with pytest.raises(tfdb.UnknownFrame):
        buf.lookup_transform("map", name)


LATE = r"; waited \d+\.\d\d\d s$"


@pytest.mark.parametrize(
    ("target", "stamp", "said"),
    [
        ("map", 3_000_000_000, r"^T\[map<-a\] at 3\.000000000 s .* by 1\.000000000 s into"),
        ("mpa", None, r"^frame 'mpa' does not exist in commit 3; did you mean 'map'\?"),
        ("b", None, r"^T\[b<-a\] has no answer: the frames are in different trees"),
    ],
    ids=["too new", "unknown", "not connected"],
)
def test_a_timeout_names_the_missing_data_and_the_waited_time(
    buf: tfdb.Buffer, target: str, stamp: int | None, said: str
) -> None:
    put(buf, "a", 1_000_000_000)
    put(buf, "a", 2_000_000_000)
    put(buf, "b", 2_000_000_000, parent="elsewhere")
    waits: list[Callable[[], object]] = [
        lambda: buf.wait_for_transform(target, "a", stamp, 0.01),
        lambda: buf.lookup_transform(target, "a", stamp, timeout=0.01),
        lambda: asyncio.run(buf.wait_for_transform_async(target, "a", stamp, 0.01)),
    ]
    for wait in waits:
        with pytest.raises(tfdb.TfdbError, match=f"{said}.*{LATE}"):
            wait()
    with pytest.raises(tfdb.TfdbError, match=said) as caught:
        buf.lookup_transform(target, "a", stamp, timeout=0)
    assert "waited" not in str(caught.value)


def test_stopped_waits_end_as_by_their_timeout_until_they_may_go_on(buf: tfdb.Buffer) -> None:
    put(buf, "a", 1)
    waits: list[Callable[[], object]] = [
        lambda: buf.wait_for_transform("map", "b"),
        lambda: buf.lookup_transform("map", "b", timeout=LONG),
        lambda: asyncio.run(buf.wait_for_transform_async("map", "b")),
        lambda: buf.wait_for_commit(1),
        lambda: asyncio.run(buf.wait_for_commit_async(1, LONG)),
    ]
    stopped = r"; waited \d+\.\d{3} s, then its node was shut down"
    calls = [Call(wait) for wait in waits]
    buf._stop_waits(stop=True)
    calls += [Call(wait) for wait in waits]
    for call in calls:
        with pytest.raises((tfdb.UnknownFrame, tfdb.WaitTimeout), match=stopped):
            call.result()
    assert buf.wait_for_transform("map", "a").stamp == 1
    buf._stop_waits(stop=False)
    call = Call(waits[0])
    put(buf, "b", 1)
    assert call.result().source == "b"  # type: ignore[attr-defined]
    buf.close()
    buf._stop_waits(stop=True)
    with pytest.raises(tfdb.errors.BufferClosed):
        buf.wait_for_commit(5)


def test_closing_ends_present_and_later_waits(buf: tfdb.Buffer) -> None:
    put(buf, "a", 1)
    snapshot = buf.snapshot()
    calls = [
        Call(lambda: buf.wait_for_commit(1)),
        Call(lambda: buf.wait_for_transform("map", "b")),
    ]
    buf.close()
    buf.close()
    for call in calls:
        with pytest.raises(tfdb.errors.BufferClosed):
            call.result()
    later: list[Callable[[], object]] = [
        lambda: buf.wait_for_commit(0),
        lambda: buf.lookup_transform("map", "a"),
        lambda: buf.lookup_transforms("map", "a", [1]),
        lambda: put(buf, "a", 2),
        lambda: buf.set_static_transform("map", "s", *POSE),
        lambda: buf.set_transforms([]),
        buf.snapshot,
        buf.transaction,
        lambda: buf.changes(0),
        lambda: buf.remove_frames("a"),
        buf.clear,
        buf.frames,
        buf.__enter__,
        buf.memory,
        buf.counters,
        lambda: buf.commit,
        lambda: asyncio.run(buf.wait_for_commit_async(0)),
        lambda: asyncio.run(buf.wait_for_transform_async("map", "a")),
    ]
    for work in later:
        with pytest.raises(tfdb.errors.BufferClosed) as caught:
            work()
        assert caught.value.commit == 1
    assert buf.closed
    assert (snapshot.commit, snapshot.frames()) == (1, ["a", "map"])
    assert (buf.history, buf.concurrency, buf.shared, buf.frozen) == (None, "snapshot", None, None)
    assert repr(buf) == "<tfdb.Buffer at commit 1, history unlimited, closed>"


def test_a_commit_before_the_close_is_reported(buf: tfdb.Buffer) -> None:
    async def wait() -> int:
        told = asyncio.ensure_future(buf.wait_for_commit_async(0))
        await asyncio.sleep(0)
        put(buf, "a", 1)
        buf.close()
        return await told

    assert asyncio.run(wait()) == 1


def test_a_buffer_closes_with_its_block() -> None:
    with tfdb.Buffer() as buf:
        assert not buf.closed
    assert buf.closed


@pytest.mark.parametrize(
    "timeout",
    [-1, -0.5, float("nan"), float("inf"), 1e10, 1e18, 1e300, 10**400, "1", b"1", True, 1j],
)
def test_invalid_timeouts_are_refused(buf: tfdb.Buffer, timeout: float) -> None:
    put(buf, "a", 1)
    said = set()
    for wait in (
        lambda: buf.lookup_transform("map", "a", timeout=timeout),
        lambda: buf.wait_for_transform("map", "a", 1, timeout),
        lambda: buf.wait_for_commit(0, timeout),
        lambda: buf.run(lambda _: None, timeout=timeout),
        lambda: asyncio.run(buf.wait_for_transform_async("map", "a", 1, timeout)),
        lambda: asyncio.run(buf.wait_for_commit_async(0, timeout)),
    ):
        with pytest.raises(tfdb.InvalidArgument, match="timeout must be a number") as caught:
            wait()
        assert caught.value.value is timeout
        said.add(str(caught.value))
    assert len(said) == 1


@pytest.mark.parametrize("timeout", [9e9, 2**63 / 1e9 - 1])
def test_the_longest_timeout(buf: tfdb.Buffer, timeout: float) -> None:
    put(buf, "a", 1)
    waits = (
        lambda: buf.wait_for_commit(1, timeout),
        lambda: asyncio.run(buf.wait_for_commit_async(2, timeout)),
        lambda: buf.wait_for_transform("map", "a", 5, timeout).stamp,
        lambda: asyncio.run(buf.wait_for_transform_async("map", "a", 7, timeout)).stamp,
    )
    for newest, wait in zip((2, 3, 5, 7), waits, strict=True):
        call = Call(wait)
        put(buf, "a", newest)
        assert call.result() == newest


def test_where_nothing_can_be_waited_for(buf: tfdb.Buffer) -> None:
    put(buf, "a", 1)
    with buf.snapshot() as snapshot, pytest.raises(tfdb.InvalidArgument, match="never changes"):
        snapshot.lookup_transform("map", "a", timeout=1)
    with buf.transaction():
        with pytest.raises(tfdb.errors.TransactionActive):
            buf.wait_for_commit(0, LONG)
        with pytest.raises(tfdb.errors.TransactionActive):
            buf.wait_for_transform("map", "b")
    silo = tfdb.Buffer(concurrency="silo")
    put(silo, "a", 1)
    assert silo.lookup_transform("map", "a", timeout=LONG).stamp == 1
    with pytest.raises(tfdb.errors.NotSupported, match="'silo'"):
        silo.wait_for_transform("map", "b")
    with pytest.raises(tfdb.InvalidArgument):
        buf.wait_for_commit(-1)


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="the machine has no such timer")
def test_a_signal_ends_a_wait_at_once_and_its_handler_may_wait(buf: tfdb.Buffer) -> None:
    def handler(*_: object) -> None:
        with pytest.raises(tfdb.WaitTimeout):
            buf.wait_for_commit(buf.commit, 0.001)
        raise KeyboardInterrupt

    other = Call(lambda: buf.wait_for_transform("map", "a"))
    before = signal.signal(signal.SIGALRM, handler)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.02)
        with pytest.raises(KeyboardInterrupt):
            buf.wait_for_transform("map", "b", timeout=LONG)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    put(buf, "a", 1)
    assert other.result().stamp == 1


def test_coroutines_wait_together(buf: tfdb.Buffer) -> None:
    async def main() -> list[tfdb.Transform]:
        waits = [
            asyncio.create_task(buf.wait_for_transform_async("map", f"f{i}", 5)) for i in range(200)
        ]
        next_commit = asyncio.create_task(buf.wait_for_commit_async(buf.commit, LONG))
        await asyncio.sleep(0)
        writer = threading.Thread(target=lambda: [put(buf, f"f{i}", 5) for i in range(200)])
        writer.start()
        found = await asyncio.gather(*waits)
        assert await next_commit >= 1
        writer.join()
        return found

    assert [t.source for t in asyncio.run(main())] == [f"f{i}" for i in range(200)]


def test_each_end_of_a_coroutines_wait(buf: tfdb.Buffer) -> None:
    put(buf, "a", 1)

    async def main() -> None:
        assert (await buf.wait_for_transform_async("map", "a")).stamp == 1
        assert await buf.wait_for_commit_async(0) == 1
        for timeout in (0, 0.001):
            with pytest.raises(tfdb.Extrapolation):
                await buf.wait_for_transform_async("map", "a", 5, timeout)
            with pytest.raises(tfdb.WaitTimeout) as caught:
                await buf.wait_for_commit_async(1, timeout)
            assert (caught.value.commit, caught.value.limit) == (1, timeout * 1_000_000_000)
        task = asyncio.create_task(buf.wait_for_transform_async("map", "b"))
        await asyncio.sleep(0)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        waits = [
            asyncio.create_task(buf.wait_for_transform_async("map", "b")),
            asyncio.create_task(buf.wait_for_commit_async(1)),
        ]
        await asyncio.sleep(0)
        buf.close()
        for ended in await asyncio.gather(*waits, return_exceptions=True):
            assert isinstance(ended, tfdb.errors.BufferClosed)
        with pytest.raises(tfdb.errors.BufferClosed):
            await buf.wait_for_transform_async("map", "a")

    asyncio.run(main())


def test_thousands_of_coroutines_begin_and_end(buf: tfdb.Buffer) -> None:
    async def one(i: int) -> str:
        task = asyncio.create_task(buf.wait_for_transform_async("map", f"f{i % 7}", 10 + i, 0.2))
        await asyncio.sleep(0)
        if i % 3 == 0:
            task.cancel()
        try:
            await task
        except asyncio.CancelledError:
            return "cancelled"
        except (tfdb.UnknownFrame, tfdb.Extrapolation):
            return "late"
        return "came"

    async def main() -> list[str]:
        ends = asyncio.gather(*(one(i) for i in range(3000)))
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        for i in range(7):
            put(buf, f"f{i}", 0)
            put(buf, f"f{i}", 2000)
        return await ends

    ends = asyncio.run(main())
    assert len(ends) == 3000
    for end in ("cancelled", "came", "late"):
        assert end in ends
    assert buf._ended_waits(0) == {}


def test_a_burst_beside_many_waits_is_looked_at_once(buf: tfdb.Buffer) -> None:
    put(buf, "a", 0)

    async def main() -> list[tfdb.Transform]:
        waits = [
            asyncio.create_task(buf.wait_for_transform_async("map", "a", 50_000 + i))
            for i in range(1000)
        ]
        await asyncio.sleep(0)
        for stamp in range(1, 10_000):  # each commit touches the frame of all waits
            put(buf, "a", stamp)
        assert not any(task.done() for task in waits)
        put(buf, "a", 60_000)
        return await asyncio.gather(*waits)

    assert len(asyncio.run(main())) == 1000


def test_waits_end_also_where_memory_does(
    buf: tfdb.Buffer,
) -> None:
    class Poor:
        def __init__(self) -> None:
            self.asked = 0

        def __getattr__(self, name: str) -> object:
            return getattr(buf, name)

        def _await_ended_waits(self, timeout: float) -> None:
            self.asked += 1
            if self.asked <= 2:  # at the second time the wait is registered
                raise MemoryError
            buf._await_ended_waits(timeout)

    async def main() -> None:
        with pytest.raises(MemoryError):
            await waiting.commit(Poor(), 0, LONG)  # type: ignore[arg-type]

    asyncio.run(main())
    assert buf._ended_waits(0) == {}
    put(buf, "a", 1)
    assert buf._ended_waits(0) == {}


def test_a_thread_that_waits_for_coroutines_ends_after_them(buf: tfdb.Buffer) -> None:
    put(buf, "a", 1)
    before = set(threading.enumerate())
    with pytest.raises(tfdb.WaitTimeout):
        asyncio.run(buf.wait_for_commit_async(1, 0.001))
    [teller] = set(threading.enumerate()) - before
    assert teller.name == "tfdb waits"
    buf.close()
    teller.join(LONG)
    assert not teller.is_alive()
    gc.collect()


def test_a_closed_loop_does_not_break_other_waits(buf: tfdb.Buffer) -> None:
    loop = asyncio.new_event_loop()
    task = loop.create_task(buf.wait_for_transform_async("map", "a"))
    loop.run_until_complete(asyncio.sleep(0, None))
    loop.run_until_complete(asyncio.sleep(0, None))
    loop.close()
    put(buf, "a", 1)
    assert asyncio.run(buf.wait_for_transform_async("map", "a", 1, LONG)).stamp == 1
    assert not task.done()
    task._log_destroy_pending = False  # type: ignore[attr-defined]


@pytest.mark.parametrize("timeout", [None, 0, LONG])
def test_a_frozen_store_has_all_its_commits(
    buf: tfdb.Buffer, tmp_path: Path, timeout: float | None
) -> None:
    put(buf, "a", 5)
    put(buf, "a", 6)
    buf.freeze(tmp_path / "one.tfdb")
    with tfdb.open(tmp_path / "one.tfdb") as frozen:

        def wait(after: int) -> tuple[int, int]:
            told = asyncio.run(frozen.wait_for_commit_async(after, timeout))
            return frozen.wait_for_commit(after, timeout), told

        assert wait(0) == wait(1) == (2, 2)
        for after in (2, 3, 1000):
            with pytest.raises(
                tfdb.errors.NotSupported, match="is frozen and gets no further commit"
            ):
                frozen.wait_for_commit(after, timeout)
            with pytest.raises(
                tfdb.errors.NotSupported, match="is frozen and gets no further commit"
            ):
                asyncio.run(frozen.wait_for_commit_async(after, timeout))
        assert frozen.wait_for_transform("map", "a", timeout=timeout).stamp == 6
        with pytest.raises(tfdb.UnknownFrame if timeout == 0 else tfdb.errors.NotSupported):
            frozen.wait_for_transform("map", "b", timeout=timeout)
