"""What fires a rule, when, and how its action runs."""

from __future__ import annotations

import gc
import logging
import os
import subprocess
import sys
import threading
import weakref
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import tfdb
from tests.rules.conftest import put
from tfdb import errors

if TYPE_CHECKING:
    from tfdb.rules import Event


def is_high(transform: tfdb.Transform) -> bool:
    return bool(transform.translation[0] > 10)


HEIGHTS = (1.0, 20.0, 30.0, 2.0, 3.0, 40.0, 40.0)


@pytest.mark.parametrize(
    ("fires", "expected"),
    [
        ("rises", [2, 6]),
        ("falls", [4]),
        ("changes", [2, 3, 6, 7]),  # the stamp is another one, too
        ("always", [2, 3, 6, 7]),
    ],
)
def test_each_way_to_fire(fires: Any, expected: list[int]) -> None:
    buf = tfdb.Buffer()
    fired: list[int] = []
    buf.add_rule(lambda e: fired.append(e.commit), ("map", "base"), is_high, fires=fires)
    for height in HEIGHTS:
        put(buf, height)
    assert buf.rules.drain()
    assert fired == expected


def test_the_event_has_the_state_of_its_commit() -> None:
    buf = tfdb.Buffer()
    seen: list[tuple[float, float | None, float]] = []

    @buf.rule(on=("map", "base"), when=is_high)
    def note(event: Event) -> None:
        then = event.snapshot.lookup_transform("map", "base")
        assert event.transform is not None
        before = None if event.before is None else float(event.before.translation[0])
        seen.append((float(event.transform.translation[0]), before, float(then.translation[0])))

    for height in HEIGHTS:
        put(buf, height)
    buf.rules.drain()
    assert seen == [(20.0, 1.0, 20.0), (40.0, 3.0, 40.0)]
    assert [rule.name for rule in buf.rules] == ["note"]


def test_a_condition_that_is_true_at_installation_fires_only_if_asked() -> None:
    buf = tfdb.Buffer()
    put(buf, 20.0)
    quiet: list[int] = []
    loud: list[int] = []
    buf.add_rule(lambda e: quiet.append(e.commit), ("map", "base"), is_high)
    buf.add_rule(lambda e: loud.append(e.commit), ("map", "base"), is_high, initial=True)
    put(buf, 30.0)
    put(buf, 1.0)
    put(buf, 30.0)
    buf.rules.drain()
    assert (quiet, loud) == ([4], [1, 4])


def test_no_answer_is_false() -> None:
    buf = tfdb.Buffer()
    fired: list[int] = []
    buf.add_rule(lambda e: fired.append(e.commit), ("map", "base"))
    put(buf, 1.0, child="other")
    put(buf, 1.0)
    put(buf, 2.0)
    buf.remove_frames(["base"])
    put(buf, 3.0)
    buf.rules.drain()
    assert fired == [2, 5]


def test_frames_fire_with_their_changes() -> None:
    buf = tfdb.Buffer()
    told: list[tuple[int, str, int, bool]] = []

    def note(event: Event) -> None:
        assert event.changes is not None
        assert isinstance(event.on, str)
        moved = len(event.changes.stored)
        told.append((event.commit, event.on, moved, bool(event.changes.removed)))

    buf.add_rule(note, ["base", "late"])
    buf.add_rule(note, "*", lambda changes: len(changes.stored) == 2)
    put(buf, 1.0)
    put(buf, 1.0, child="other")
    buf.set_transforms(
        tfdb.Columns("map", ["base", "other"], [50, 50], [[1, 2, 3, 0, 0, 0, 1]] * 2)
    )
    put(buf, 1.0, child="late")
    buf.remove_frames(["base"])
    buf.rules.drain()
    assert sorted(told) == [
        (1, "base", 1, False), (3, "*", 2, False), (3, "base", 1, False),
        (4, "late", 1, False), (5, "base", 0, True),
    ]  # fmt: skip


def test_an_action_with_a_transaction_commits_as_one() -> None:
    buf = tfdb.Buffer()
    buf.set_static_transform("map", "alarm", (0, 0, 0))

    @buf.rule(on=("map", "base"), when=is_high)
    def raise_alarm(event: Event, tx: tfdb.Transaction) -> None:
        x = float(tx.lookup_transform("map", "alarm", 0).translation[0])
        tx.set_static_transform("map", "alarm", (x + 1, 0, 0))

    for height in HEIGHTS:
        put(buf, height)
    buf.rules.drain()
    assert buf.lookup_transform("map", "alarm", 0).translation[0] == 2
    assert buf.rules.stats.abandoned == 0


def test_an_action_that_raises_stores_nothing_and_stops_nothing(
    caplog: pytest.LogCaptureFixture,
) -> None:
    buf = tfdb.Buffer()
    caught: list[tuple[str, bool, str]] = []
    buf.rules.on_error = lambda rule, event, error: caught.append(
        (rule.name, event is None, str(error))
    )

    @buf.rule(on=("map", "base"), fires="always")
    def fail(event: Event, tx: tfdb.Transaction) -> None:
        tx.set_static_transform("map", "alarm", (1, 0, 0))
        raise SystemExit("not this thread")

    def wrong(transform: tfdb.Transform) -> bool:
        if transform.translation[0] == 2:
            raise ValueError("no such height")
        return is_high(transform)

    fired: list[int] = []
    buf.add_rule(lambda e: fired.append(e.commit), ("map", "base"), wrong, name="wrong")
    with caplog.at_level(logging.ERROR, "tfdb.rules"):
        for height in (20.0, 2.0, 20.0, 1.0, 20.0):
            put(buf, height)
        buf.rules.drain()
    assert "alarm" not in buf.frames()
    assert fired == [1, 5]  # what raised left the condition True
    assert sorted(caught) == [("fail", False, "not this thread")] * 5 + [
        ("wrong", True, "no such height")
    ]
    assert buf.rules.stats.exceptions == 6
    assert "the condition of rule 'wrong' raised" in caplog.text
    assert "the action of rule 'fail' raised" in caplog.text
    assert "no such height" in caplog.text


def test_a_conflict_runs_the_action_again() -> None:
    buf = tfdb.Buffer()
    buf.set_static_transform("map", "alarm", (0, 0, 0))
    runs: list[int] = []

    @buf.rule(on=("map", "base"))
    def count(event: Event, tx: tfdb.Transaction) -> None:
        x = float(tx.lookup_transform("map", "alarm", 0).translation[0])
        runs.append(event.commit)
        if len(runs) < 3:  # another writer comes between
            other = threading.Thread(
                target=lambda: buf.set_static_transform("map", "alarm", (x + 10, 0, 0))
            )
            other.start()
            other.join()
        tx.set_static_transform("map", "alarm", (x + 1, 0, 0))

    put(buf, 1.0)
    buf.rules.drain()
    assert runs == [2, 2, 2]
    assert buf.lookup_transform("map", "alarm", 0).translation[0] == 21
    assert (buf.rules.stats.retried, buf.rules.stats.invoked, buf.rules.stats.abandoned) == (
        2,
        3,
        0,
    )


def test_an_action_that_conflicts_too_often_is_abandoned() -> None:
    buf = tfdb.Buffer()
    buf.set_static_transform("map", "alarm", (0, 0, 0))
    caught: list[BaseException] = []
    buf.rules.on_error = lambda _rule, _event, error: caught.append(error)

    def lose(event: Event, tx: tfdb.Transaction) -> None:
        x = float(tx.lookup_transform("map", "alarm", 0).translation[0])
        other = threading.Thread(
            target=lambda: buf.set_static_transform("map", "alarm", (x + 10, 0, 0))
        )
        other.start()
        other.join()
        tx.set_static_transform("map", "alarm", (x + 1, 0, 0))

    buf.add_rule(lose, ("map", "base"), retries=1)
    put(buf, 1.0)
    buf.rules.drain()
    assert [type(error) for error in caught] == [tfdb.Conflict]
    assert (buf.rules.stats.abandoned, buf.rules.stats.invoked) == (1, 2)


def test_cascades_are_deeper_and_end() -> None:
    buf = tfdb.Buffer()
    caught: list[str] = []
    depths: list[tuple[str, ...]] = []
    buf.rules.on_error = lambda _rule, _event, error: caught.append(str(error))

    def again(event: Event, tx: tfdb.Transaction) -> None:
        depths.append(event.chain)
        assert event.transform is not None
        tx.set_transform(
            "map", "base", event.transform.stamp + 1, event.transform.translation, (0, 0, 0, 1)
        )

    buf.add_rule(again, ("map", "base"), fires="always", max_depth=3)
    put(buf, 1.0)
    buf.rules.drain()
    assert depths == [("again",) * depth for depth in range(4)]
    assert len(caught) == 1
    assert "again -> again -> again -> again" in caught[0]
    assert buf.commit == 5
    put(buf, 1.0, stamp=1000)  # the next commit of others has no depth
    buf.rules.drain()
    assert depths[4] == ()


def test_a_rule_runs_in_the_order_of_commits_and_never_beside_itself() -> None:
    buf = tfdb.Buffer()
    buf.rules.threads = 4
    running: list[int] = []
    order: list[int] = []
    beside: list[int] = []

    def run(event: Event) -> None:
        running.append(event.commit)
        beside.append(len(running))
        order.append(event.commit)
        running.remove(event.commit)

    buf.add_rule(run, ("map", "base"), fires="always")
    for place in range(200):
        put(buf, float(place))
    buf.rules.drain()
    assert order == list(range(1, 201))
    assert set(beside) == {1}


def test_a_series_runs_in_the_order_of_commits_then_of_installation() -> None:
    buf = tfdb.Buffer()
    order: list[tuple[int, str]] = []
    for name in ("one", "two", "three"):
        buf.add_rule(
            lambda e: order.append((e.commit, e.rule.name)),
            ("map", "base"), fires="always", serial="series", name=name,
        )  # fmt: skip
    for place in range(50):
        put(buf, float(place))
    buf.rules.drain()
    assert order == [(c, name) for c in range(1, 51) for name in ("one", "two", "three")]


def test_overlapping_actions_run_at_once() -> None:
    buf = tfdb.Buffer()
    meeting = threading.Barrier(3)
    buf.add_rule(lambda _: meeting.wait(30), ("map", "base"), fires="always", overlap=True)
    for place in range(3):
        put(buf, float(place))
    assert buf.rules.drain(30)
    assert buf.rules.stats.exceptions == 0


@pytest.mark.parametrize(("keep", "expected"), [("newest", [1, 9, 10]), ("oldest", [1, 2, 3])])
def test_a_rule_that_is_too_slow_drops_events(keep: Any, expected: list[int]) -> None:
    buf = tfdb.Buffer()
    begun, go = threading.Event(), threading.Event()
    order: list[int] = []

    def run(event: Event) -> None:
        order.append(event.commit)
        begun.set()
        go.wait()

    rule = buf.add_rule(run, ("map", "base"), fires="always", max_pending=2, keep=keep)
    put(buf, 1.0)
    begun.wait()
    for place in range(9):
        put(buf, float(place))
    while rule.stats.scheduled < 10:
        buf.wait_for_commit(0)
    assert rule.stats.pending == 2
    go.set()
    buf.rules.drain()
    assert order == expected
    assert (rule.stats.dropped, rule.stats.invoked, rule.stats.pending) == (7, 3, 0)


def test_events_between_two_firings_are_merged() -> None:
    buf = tfdb.Buffer()
    fired: list[tuple[int, int]] = []
    buf.add_rule(
        lambda e: fired.append((e.commit, e.merged)),
        ("map", "base"), fires="always", max_rate=1e-3,
    )  # fmt: skip
    put(buf, 0.0)
    assert buf.rules.drain()
    for place in range(20):
        put(buf, float(place))
    while buf.rules.stats.scheduled < 21:
        buf.wait_for_commit(0)
    stats = buf.rules.stats
    assert (stats.pending, stats.merged, stats.invoked) == (1, 19, 1)
    assert fired == [(1, 0)]
    buf.close()


def test_debounce_runs_once_after_a_burst() -> None:
    buf = tfdb.Buffer()
    fired: list[tuple[int, int]] = []
    buf.add_rule(
        lambda e: fired.append((e.commit, e.merged)),
        ("map", "base"), fires="always", debounce=0.3,
    )  # fmt: skip
    for place in range(20):
        put(buf, float(place))
    assert buf.rules.drain(30)
    assert fired[-1][0] == 20
    assert sum(merged + 1 for _, merged in fired) == 20


def test_a_removed_rule_begins_no_action() -> None:
    buf = tfdb.Buffer()
    begun, go = threading.Event(), threading.Event()
    order: list[int] = []

    def run(event: Event) -> None:
        order.append(event.commit)
        begun.set()
        go.wait()

    rule = buf.add_rule(run, ("map", "base"), fires="always")
    put(buf, 1.0)
    put(buf, 2.0)
    begun.wait()
    rule.remove()
    rule.remove()
    go.set()
    put(buf, 3.0)
    buf.rules.drain()
    assert order == [1]
    assert rule.removed
    assert len(buf.rules) == 0


def test_a_rule_may_remove_itself() -> None:
    buf = tfdb.Buffer()
    order: list[int] = []

    def once(event: Event) -> None:
        event.rule.remove()
        order.append(event.commit)

    buf.add_rule(once, ("map", "base"), fires="always")
    for place in range(10):
        put(buf, float(place))
    buf.rules.drain()
    assert order == [1]


def test_rules_come_and_go_under_load() -> None:
    buf = tfdb.Buffer(history=1e-6)
    fired: list[int] = []
    lasting: list[int] = []
    buf.add_rule(lambda e: lasting.append(e.commit), ("map", "base"), fires="always",
                 max_pending=100_000)  # fmt: skip
    ends = threading.Event()

    def write() -> None:
        while not ends.is_set():
            put(buf, 1.0)

    writer = threading.Thread(target=write)
    writer.start()
    for _ in range(2_000):
        rule = buf.add_rule(lambda e: fired.append(e.commit), ("map", "base"), fires="always")
        rule.remove()
    ends.set()
    writer.join()
    assert buf.rules.drain(60)
    assert len(buf.rules) == 1
    assert buf.rules.stats.exceptions == 0
    assert lasting == sorted(set(lasting))
    assert len(lasting) + buf.rules.stats.unseen >= buf.commit
    if buf.rules.stats.unseen == 0:
        assert lasting == list(range(1, buf.commit + 1))


def test_close_ends_the_rules() -> None:
    buf = tfdb.Buffer()
    rule = buf.add_rule(lambda _: None, ("map", "base"))
    put(buf, 1.0)
    buf.rules.drain()
    buf.close()
    with pytest.raises(errors.BufferClosed):
        buf.add_rule(lambda _: None, ("map", "base"))
    rule.remove()
    assert rule.removed


def test_threads_end_with_the_last_rule_and_begin_with_the_next() -> None:
    class Clock:
        def __call__(self) -> int:
            return 0

    clock = Clock()
    of_buffer = weakref.ref(clock)
    before = set(threading.enumerate())
    buf = tfdb.Buffer(clock=clock)
    fired: list[int] = []
    for _ in range(2):

        def note(event: Event, its: tfdb.Buffer = buf) -> None:
            fired.append(its.commit)

        rule = buf.add_rule(note, "*")
        put(buf, 1.0)
        assert buf.rules.drain(60)
        threads = set(threading.enumerate()) - before
        assert len(threads) == 2  # one evaluates, one runs the action
        rule.remove()
        for thread in threads:
            thread.join(60)
            assert not thread.is_alive()
    assert fired == [1, 2]
    del buf, clock, rule, note
    gc.collect()
    assert of_buffer() is None


def test_installed_rules_do_not_keep_the_program() -> None:
    program = """if True:
        import tfdb
        buf = tfdb.Buffer()
        buf.add_rule(lambda event: buf.snapshot(), ("map", "base"), fires="always")
        for stamp in range(1, 3000):
            buf.set_transform("map", "base", stamp, (stamp, 2, 3), (0.5, 0.5, 0.5, 0.5))
        print(buf.commit)
    """
    ended = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=120, check=False
    )
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "2999\n", "")


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_firings_are_those_that_the_commits_demand(seed: int) -> None:
    """Two writers flip a height at random; the states of all commits are the oracle."""
    buf = tfdb.Buffer(history=None)
    held = buf.snapshot()
    fired: dict[str, list[tuple[int, float | None]]] = {}

    def note(event: Event) -> None:
        value = None if event.transform is None else float(event.transform.translation[0])
        fired.setdefault(event.rule.name, []).append((event.commit, value))

    for fires in ("rises", "falls", "always"):
        buf.add_rule(note, ("map", "tool"), is_high, fires=fires, name=fires,
                     max_pending=100_000)  # fmt: skip

    def write(number: int) -> None:
        random = np.random.default_rng((seed, number))
        for step in range(300):
            choice = random.random()
            if choice < 0.7:
                stamp = 10 * step + int(random.integers(1, 100))
                put(buf, float(random.integers(0, 20)), stamp)
            elif choice < 0.8:
                put(buf, 1.0, child="other")
            elif choice < 0.97:
                parent = "base" if random.random() < 0.5 else "other"
                buf.set_static_transform(parent, "tool", (float(random.integers(0, 9)), 0, 0))
            else:
                with suppress(errors.TfdbError):
                    buf.remove_frames(["tool"])

    writers = [threading.Thread(target=write, args=(number,)) for number in (1, 2)]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    assert buf.rules.drain(60)
    expected: dict[str, list[tuple[int, float | None]]] = {"rises": [], "falls": [], "always": []}
    was, before = False, None
    for commit in range(1, buf.commit + 1):
        with held.at(commit) as state:
            try:
                now = state.lookup_transform("map", "tool")
            except errors.TfdbError:
                now = None
        truth = now is not None and is_high(now)
        value = None if now is None else float(now.translation[0])
        if truth and not was:
            expected["rises"].append((commit, value))
        if was and not truth:
            expected["falls"].append((commit, value))
        if truth and now != before:
            expected["always"].append((commit, value))
        was, before = truth, now
    held.close()
    assert buf.rules.stats.unseen == buf.rules.stats.exceptions == 0
    assert len(expected["rises"]) > 10
    assert fired["rises"] == expected["rises"]
    assert fired["falls"] == expected["falls"]
    # `always` fires for each commit that touched the path, also where the answer is the same.
    assert set(expected["always"]) <= set(fired["always"])
    assert len(set(fired["always"])) == len(fired["always"])


def test_a_lapped_dispatcher_evaluates_the_newest_state() -> None:
    buf = tfdb.Buffer(history=1e-6)
    begun, go = threading.Event(), threading.Event()
    told: list[tuple[int, int]] = []

    def slow(transform: tfdb.Transform) -> bool:
        begun.set()
        go.wait()
        return True

    buf.add_rule(lambda e: told.append((e.commit, e.unseen)), ("map", "base"), slow,
                 fires="always")  # fmt: skip
    put(buf, 1.0)
    begun.wait()
    for place in range(40_000):
        put(buf, float(place))
    go.set()
    assert buf.rules.drain(60)
    lapped = [(commit, unseen) for commit, unseen in told if unseen]
    assert len(lapped) == 1
    unseen = lapped[0][1]
    assert buf.rules.stats.unseen == unseen
    assert len(told) + unseen == buf.commit


def test_a_rule_of_a_frame_keeps_up_with_a_burst_of_commits() -> None:
    buf = tfdb.Buffer(history=1.0)
    fired: list[tuple[int, int]] = []
    judged: list[int] = []
    buf.add_rule(lambda e: fired.append((e.commit, e.unseen)), "base", max_pending=1_000_000)
    buf.add_rule(lambda _: None, "base", lambda changes: judged.append(changes.commit))
    for place in range(40_000):
        put(buf, float(place))
    assert buf.rules.drain(60)
    assert [commit for commit, _ in fired] == sorted({commit for commit, _ in fired})
    assert len(fired) + sum(unseen for _, unseen in fired) == buf.commit
    assert judged == [commit for commit, unseen in fired if not unseen]


def test_bad_rules_are_refused() -> None:
    buf = tfdb.Buffer()
    for arguments in (
        {"fires": "rise"}, {"retries": -1}, {"max_depth": 1.5}, {"max_pending": 0},
        {"keep": "all"}, {"debounce": -1.0}, {"max_rate": 0}, {"max_rate": float("nan")},
        {"overlap": True, "serial": "x"}, {"initial": "no"},
    ):  # fmt: skip
        with pytest.raises(tfdb.InvalidArgument):
            buf.add_rule(lambda _: None, ("map", "base"), **arguments)  # type: ignore[arg-type]
    for on in ((), [], 3, ["a", ("b", "c")], ["*", "a"], [("a",)], None):
        with pytest.raises(tfdb.InvalidArgument, match="on must be"):
            buf.add_rule(lambda _: None, on)  # type: ignore[arg-type]
    with pytest.raises(errors.InvalidName):
        buf.add_rule(lambda _: None, "")
    with pytest.raises(tfdb.InvalidArgument, match="is valid for pairs only"):
        buf.add_rule(lambda _: None, "base", fires="changes")
    with pytest.raises(TypeError, match="callable"):
        buf.add_rule(3, "base")  # type: ignore[arg-type]
    with pytest.raises(tfdb.InvalidArgument, match="takes an event"):
        buf.add_rule(lambda: None, "base")
    with pytest.raises(errors.NotSupported):
        tfdb.Buffer(concurrency="silo").add_rule(lambda _: None, "base")
    assert len(buf.rules) == 0


def test_no_update_is_lost_between_two_rules_and_a_writer() -> None:
    """The anomaly is a lost update: all three add one to the same edge."""
    buf = tfdb.Buffer()
    buf.set_static_transform("map", "sum", (0, 0, 0))

    def add_one(tx: tfdb.Transaction) -> None:
        x = float(tx.lookup_transform("map", "sum", 0).translation[0])
        tx.set_static_transform("map", "sum", (x + 1, 0, 0))

    for name in ("one", "two"):
        buf.add_rule(
            lambda _event, tx: add_one(tx),
            ("map", "base"), fires="always", name=name, retries=1000, max_pending=10_000,
        )  # fmt: skip
    for place in range(100):
        put(buf, float(place))
        buf.run(add_one, retries=1000)
    assert buf.rules.drain(60)
    assert buf.rules.stats.abandoned == buf.rules.stats.dropped == 0
    assert buf.lookup_transform("map", "sum", 0).translation[0] == 300


def test_an_action_that_never_ends_holds_up_its_own_rule_only() -> None:
    buf = tfdb.Buffer()
    go = threading.Event()
    fired: list[int] = []
    buf.add_rule(lambda _: go.wait(), ("map", "base"), fires="always", name="stuck")
    quick = buf.add_rule(lambda e: fired.append(e.commit), ("map", "base"), fires="always")
    for place in range(20):
        put(buf, float(place))
    while quick.stats.ended < 20:
        buf.wait_for_commit(0)
    assert fired == list(range(1, 21))
    assert not buf.rules.drain(0)
    go.set()
    assert buf.rules.drain(60)


def test_a_child_of_fork_has_no_rules_but_may_add_its_own() -> None:
    buf = tfdb.Buffer()
    rule = buf.add_rule(lambda _: None, ("map", "base"))
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        found = rule.removed, len(buf.rules)
        fired: list[int] = []
        buf.add_rule(lambda e: fired.append(e.commit), "base")
        put(buf, 1.0)
        os.write(writing, f"{found} {buf.rules.drain(30)} {fired}".encode())
        os._exit(0)
    os.waitpid(child, 0)
    assert os.read(reading, 100) == b"(True, 0) True [1]"
    os.close(reading)
    os.close(writing)
    assert not rule.removed


def test_rules_of_a_shared_store_see_the_commits_of_other_buffers(name: str) -> None:
    writer = tfdb.Buffer.open(name, create=True)
    reader = tfdb.Buffer.open(name)
    fired: list[int] = []
    reader.add_rule(lambda e: fired.append(e.commit), ("map", "base"), is_high)
    for height in HEIGHTS:
        put(writer, height)
    reader.rules.drain()
    assert fired == [2, 6]


def test_figures_are_logged(caplog: pytest.LogCaptureFixture) -> None:
    buf = tfdb.Buffer()
    buf.rules.stats_log_interval = 0.001
    buf.add_rule(lambda _: None, ("map", "base"), name="quiet")
    with caplog.at_level(logging.INFO, "tfdb.rules"):
        while "all rules" not in caplog.text:
            put(buf, 1.0)
    assert "rule 'quiet'" in caplog.text
    buf.close()


@pytest.mark.parametrize(
    ("option", "error"),
    [
        ({"at": "x"}, errors.InvalidStamp),
        ({"at": -5}, errors.InvalidStamp),
        ({"policy": 5}, TypeError),
    ],
)
def test_a_wrong_stamp_or_policy_is_refused_and_other_rules_go_on(
    option: Any, error: type[Exception]
) -> None:
    buf = tfdb.Buffer()
    fired: list[int] = []
    buf.add_rule(lambda e: fired.append(e.commit), ("map", "base"))
    with pytest.raises(error):
        buf.add_rule(print, ("map", "base"), **option)
    put(buf, 1.0)
    assert buf.rules.drain()
    assert fired == [1]
    with pytest.raises(errors.InvalidArgument, match="valid for pairs only"):
        buf.add_rule(print, "base", initial=True)


def test_drain_is_refused_in_functions_of_rules() -> None:
    buf = tfdb.Buffer()
    refused: list[str] = []

    def drain(what: object) -> bool:
        with pytest.raises(errors.InvalidArgument, match="it would wait for itself"):
            buf.rules.drain()
        refused.append(type(what).__name__)
        return True

    buf.add_rule(drain, "base", drain)
    put(buf, 1.0)
    assert buf.rules.drain()
    assert refused == ["Changes", "Event"]


def test_more_threads_run_events_that_wait() -> None:
    buf = tfdb.Buffer()
    buf.rules.threads = 1
    begun, end = threading.Event(), threading.Event()

    def block(_: Event) -> None:
        begun.set()
        assert end.wait(60)

    ran = threading.Event()
    buf.add_rule(block, "base")
    buf.add_rule(lambda _: ran.set(), "camera")
    put(buf, 1.0)
    assert begun.wait(60)
    put(buf, 1.0, child="camera")
    buf.rules.drain(0)
    while buf.rules.stats.scheduled < 2:
        buf.wait_for_commit(0)
    buf.rules.threads = 2
    assert ran.wait(60)
    end.set()
    assert buf.rules.drain()


def test_an_idle_thread_does_not_take_the_place_of_two() -> None:
    buf = tfdb.Buffer()
    both = threading.Barrier(2)
    buf.add_rule(lambda _: None, "warm")
    put(buf, 1.0, child="warm")
    assert buf.rules.drain()  # one thread is idle now
    buf.add_rule(lambda _: both.wait(60), "base")
    buf.add_rule(lambda _: both.wait(60), "base")
    put(buf, 1.0)
    assert buf.rules.drain()
    assert buf.rules.stats.exceptions == 0


def test_drain_and_a_series_do_not_wait_for_an_event_of_a_removed_rule() -> None:
    buf = tfdb.Buffer()
    fired: list[int] = []
    late = buf.add_rule(print, "base", debounce=1e6, serial="s")
    buf.add_rule(lambda e: fired.append(e.commit), "base", serial="s")
    put(buf, 1.0)
    while buf.rules.stats.scheduled < 2:
        buf.wait_for_commit(0)
    late.remove()
    assert buf.rules.drain(60)
    assert fired == [1]


def test_a_second_parameter_with_a_default_gets_no_transaction() -> None:
    buf = tfdb.Buffer()
    seen: list[object] = []
    buf.add_rule(lambda event, kept=seen: kept.append(event.commit), "base")
    put(buf, 1.0)
    assert buf.rules.drain()
    assert seen == [1]


async def _later(_: Event) -> None:
    raise AssertionError


def _generates(_: Event) -> Any:
    yield 1


@pytest.mark.parametrize("action", [_later, _generates])
def test_an_action_that_would_only_begin_its_work_is_refused(action: Any) -> None:
    with pytest.raises(TypeError, match="must be a plain function"):
        tfdb.Buffer().add_rule(action, "base")


def test_a_very_small_rate_and_wrong_settings() -> None:
    buf = tfdb.Buffer()
    rule = buf.add_rule(print, "base", max_rate=1e-300)
    put(buf, 1.0)
    while rule.stats.invoked < 1:
        buf.wait_for_commit(0)
    put(buf, 1.0)
    put(buf, 2.0)
    while rule.stats.scheduled < 3:
        buf.wait_for_commit(0)
    rule.remove()
    fired: list[int] = []
    buf.add_rule(lambda e: fired.append(e.commit), "base")
    put(buf, 3.0)
    assert buf.rules.drain(60)
    assert fired == [4]
    with pytest.raises(
        errors.InvalidArgument, match="retries must be an integer of at least 0, got -1"
    ):
        buf.add_rule(print, "base", retries=-1)
    with pytest.raises(errors.InvalidArgument, match="positive or None, got 0"):
        buf.rules.stats_log_interval = 0
    with pytest.raises(TypeError, match="on_error must be callable"):
        buf.rules.on_error = 5  # type: ignore[assignment]


def test_rules_go_on_though_no_held_state_can_be_read() -> None:
    buf = tfdb.Buffer(history=1e-6, snapshot_memory=0)
    writing = threading.Event()
    writing.set()

    def write() -> None:
        stamp = 0
        while writing.is_set():
            stamp += 1000
            buf.set_transforms(
                [
                    tfdb.TransformStamped("map", child, stamp, (0, 0, 0), (0, 0, 0, 1))
                    for child in ("base", *"abcdefgh")
                ]
            )

    fired: list[int] = []
    rule = buf.add_rule(lambda e: fired.append(e.commit), ("map", "base"), fires="always")
    writer = threading.Thread(target=write)
    writer.start()
    while rule.stats.unseen < 10_000:
        buf.wait_for_commit(buf.commit, 10)
    writing.clear()
    writer.join()
    last = put(buf, 1.0, stamp=10**18)
    assert buf.rules.drain(60)
    assert not rule.removed
    assert fired[-1] == last
    assert fired == sorted(set(fired))
    assert rule.stats.scheduled + rule.stats.unseen == buf.commit
