"""Every anomaly in a handmade history is found and named."""

from __future__ import annotations

import itertools
import string
from typing import Any

import pytest

from tfdb_measure.verify import MEANINGS, History, Read, Transaction, Unseen, Write, check

UNSEEN = Unseen.UNSEEN


class Maker:
    """Transactions at given times; each in a thread of its own unless told otherwise."""

    def __init__(self) -> None:
        self.all: list[Transaction] = []
        self._threads = itertools.count(1)

    def __call__(self, begin: int, end: int, *does: Read | Write, **more: Any) -> Maker:
        reads = tuple(one for one in does if isinstance(one, Read))
        writes = tuple(one for one in does if isinstance(one, Write))
        more.setdefault("id", string.ascii_lowercase[len(self.all)])
        more.setdefault("thread", next(self._threads))
        self.all.append(Transaction(begin=begin, end=end, reads=reads, writes=writes, **more))
        return self


def saw(edge: str, value: int | None) -> Read:
    return Read(edge, None, value)


def at(edge: str, stamp: int, before: int | None, after: int | None) -> Read:
    return Read(edge, stamp, before, after)


def wrote(edge: str, value: int, stamp: int | None = None, parent: str | None = None) -> Write:
    return Write(edge, value, stamp, parent)


def removed(edge: str, value: int) -> Write:
    return Write(edge, value, remove=True)


X, Y = "x", "y"
START = (wrote(X, 1), wrote(Y, 2))


def started() -> Maker:
    return Maker()(0, 1, *START, commit=1)


def moving() -> Maker:
    """Samples 1 and 2 of x at stamps 10 and 20."""
    return Maker()(0, 1, wrote(X, 1, 10), wrote(X, 2, 20), wrote(Y, 3, 10), commit=1)


HISTORIES: dict[str, tuple[str, Maker]] = {
    "nobody wrote it": ("garbage_read", started()(2, 3, saw(X, 99))),
    "written elsewhere": ("garbage_read", started()(2, 3, saw(X, 2))),
    "on the wrong side": ("garbage_read", moving()(2, 3, at(X, 15, 2, 2))),
    "aborted": (
        "dirty_read",
        started()(2, 9, wrote(X, 3), status="aborted")(4, 5, saw(X, 3)),
    ),
    "replaced by its writer": (
        "dirty_read",
        started()(2, 9, wrote(X, 3), wrote(X, 4), commit=2)(4, 5, saw(X, 3)),
    ),
    "own write": (
        "own_write_missed",
        started()(2, 9, wrote(X, 3), Read(X, None, 1, UNSEEN, 1), commit=2),
    ),
    "own removal": (
        "own_write_missed",
        started()(2, 9, removed(X, 3), Read(X, None, 1, UNSEEN, 1), commit=2),
    ),
    "half of a batch": (
        "torn_batch",
        started()(2, 9, wrote(X, 3), wrote(Y, 4), commit=2)(3, 8, saw(X, 3), saw(Y, 2)),
    ),
    "half of a batch, the other way": (
        "torn_batch",
        started()(2, 9, wrote(X, 3), wrote(Y, 4), commit=2)(3, 8, saw(Y, 4), saw(X, 1)),
    ),
    "half of a batch on one edge": (
        "torn_batch",
        moving()(2, 9, wrote(X, 4, 40), wrote(X, 5, 30), commit=2)(3, 8, saw(X, 5)),
    ),
    "two states on one path": (
        "torn_path",
        started()(2, 3, wrote(X, 3), commit=2)(4, 5, wrote(Y, 4), commit=3)(
            2, 6, saw(X, 1), saw(Y, 4)
        ),
    ),
    "read twice": (
        "non_repeatable_read",
        started()(2, 3, wrote(X, 3), commit=2)(2, 9, saw(X, 1), saw(X, 3)),
    ),
    "lost update": (
        "lost_update",
        started()(2, 9, saw(X, 1), wrote(X, 3), commit=2)(3, 8, saw(X, 1), wrote(X, 4), commit=3),
    ),
    "lost update, order not recorded": (
        "lost_update",
        started()(2, 9, saw(X, 1), wrote(X, 3))(3, 8, saw(X, 1), wrote(X, 4)),
    ),
    "write skew": (
        "write_skew",
        started()(2, 9, saw(X, 1), wrote(Y, 3), commit=2)(3, 8, saw(Y, 2), wrote(X, 4), commit=3),
    ),
    "write skew, order not recorded": (
        "write_skew",
        started()(2, 9, saw(X, 1), wrote(Y, 3))(3, 8, saw(Y, 2), wrote(X, 4)),
    ),
    "read skew": (
        "read_skew",
        started()(2, 9, wrote(X, 3), wrote(Y, 4), commit=2)(3, 8, saw(X, 1), wrote(Y, 5), commit=3),
    ),
    "phantom between two reads": (
        "phantom_sample",
        moving()(2, 9, wrote(X, 4, 15), commit=2)(3, 8, at(X, 17, 1, 2), at(X, 17, 4, 2)),
    ),
    "phantom under a decision": (
        "phantom_sample",
        moving()(2, 9, at(X, 17, 1, 2), wrote(Y, 5, 30), commit=2)(
            3, 8, saw(Y, 3), wrote(X, 4, 15), commit=3
        ),
    ),
    "phantom at the end": (
        "phantom_sample",
        moving()(2, 9, at(X, 25, 2, None), wrote(Y, 5, 30), commit=2)(
            3, 8, saw(Y, 3), wrote(X, 4, 30), commit=3
        ),
    ),
    "new frame": (
        "phantom_frame",
        started()(2, 9, saw("z", None), wrote(X, 3), commit=2)(
            3, 8, saw(X, 1), wrote("z", 4), commit=3
        ),
    ),
    "frame gone": (
        "phantom_frame",
        started()(2, 9, saw(Y, 2), wrote(X, 3), commit=2)(3, 8, saw(X, 1), removed(Y, 4), commit=3),
    ),
    "new parent": (
        "phantom_reparent",
        Maker()(0, 1, wrote(X, 1, 10, "a"), wrote(Y, 2, 10, "a"), commit=1)(
            2, 9, saw(X, 1), wrote(Y, 3, 20, "a"), commit=2
        )(3, 8, saw(Y, 2), wrote(X, 4, 20, "b"), commit=3),
    ),
    "new parent between two reads": (
        "phantom_reparent",
        Maker()(0, 1, wrote(X, 1, 10, "a"), commit=1)(2, 9, wrote(X, 4, 20, "b"), commit=2)(
            3, 8, saw(X, 1), saw(X, 4)
        ),
    ),
    "long fork": (
        "long_fork",
        started()(2, 9, wrote(X, 3), commit=2)(2, 9, wrote(Y, 4), commit=3)(
            3, 8, saw(X, 3), saw(Y, 2)
        )(3, 8, saw(X, 1), saw(Y, 4)),
    ),
    "long fork, order not recorded": (
        "long_fork",
        started()(2, 9, saw(X, 1), wrote(X, 3))(2, 9, saw(Y, 2), wrote(Y, 4))(
            3, 8, saw(X, 3), saw(Y, 2)
        )(3, 8, saw(X, 1), saw(Y, 4)),
    ),
    "stale": ("stale_read", started()(2, 3, wrote(X, 3), commit=2)(4, 5, saw(X, 1))),
    "stale absence": ("stale_read", started()(2, 3, saw(X, None))),
    "stale in one thread": (
        "stale_read",
        started()(2, 4, wrote(X, 3), commit=2, thread=7)(4, 5, saw(X, 1), thread=7),
    ),
    "from the future": (
        "real_time_order",
        started()(2, 3, saw(X, 3))(4, 5, wrote(X, 3), commit=2),
    ),
    "each saw the other": (
        "circular_read",
        started()(2, 9, saw(Y, 4), wrote(X, 3), commit=2)(3, 8, saw(X, 3), wrote(Y, 4), commit=3),
    ),
}


@pytest.mark.parametrize(("name", "maker"), HISTORIES.values(), ids=HISTORIES.keys())
def test_found_by_name(name: str, maker: Maker) -> None:
    verdict = check(History(maker.all))
    assert verdict.serializable is False
    assert verdict.names == {name}
    (anomaly,) = verdict.anomalies
    assert anomaly.meaning == MEANINGS[name]
    assert anomaly.steps
    assert set(anomaly.transactions) <= {one.id for one in maker.all}
    print(name, *anomaly.steps, sep="\n  ")


def test_every_name_of_the_list_is_shown_by_an_example() -> None:
    # Without an order of its own a history cannot show that order to be contradictory.
    unshown = {"write_cycle", "not_serializable"}
    assert {name for name, _ in HISTORIES.values()} == set(MEANINGS) - unshown


def test_no_order_of_two_writes_that_never_met() -> None:
    """Commit numbers of different edges that contradict each other in time."""
    maker = Maker()(2, 3, wrote(X, 1), wrote(Y, 2), commit=5)(4, 5, wrote(X, 3), commit=2)
    assert check(History(maker.all)).names == {"real_time_order"}


FINE: dict[str, Maker] = {
    "nothing": Maker(),
    "a read beside a write, old": started()(2, 9, wrote(X, 3), commit=2)(3, 8, saw(X, 1)),
    "a read beside a write, new": started()(2, 9, wrote(X, 3), commit=2)(3, 8, saw(X, 3)),
    "a reader older than both batches": started()(2, 3, *(wrote(X, 3), wrote(Y, 4)), commit=2)(
        1, 9, saw(X, 1), saw(Y, 2)
    ),
    "a late sample that nobody looked at": moving()(2, 3, wrote(X, 4, 5), commit=2)(
        4, 5, at(X, 15, 1, 2), saw(X, 2)
    ),
    "a correction": moving()(2, 3, wrote(X, 4, 20), commit=2)(4, 5, at(X, 15, 1, 4), saw(X, 4)),
    "gone and back": started()(2, 3, removed(X, 3), commit=2)(4, 5, saw(X, None))(
        6, 7, wrote(X, 4), commit=3
    )(8, 9, saw(X, 4)),
    "own writes": started()(2, 3, wrote(X, 3), Read(X, None, 3, UNSEEN, 1), saw(X, 1), commit=2),
    "an aborted reader may see anything": started()(2, 3, saw(X, 77), status="aborted"),
    "unknown, seen": started()(2, 3, wrote(X, 3), status="unknown")(4, 5, saw(X, 3)),
    "unknown, not seen": started()(2, 3, wrote(X, 3), status="unknown")(4, 5, saw(X, 1)),
    "no order recorded": Maker()(0, 9, wrote(X, 1))(1, 8, wrote(X, 2))(2, 7, wrote(X, 3))(
        10, 11, saw(X, 2)
    ),
}


@pytest.mark.parametrize("maker", FINE.values(), ids=FINE.keys())
def test_nothing_wrong(maker: Maker) -> None:
    verdict = check(History(maker.all))
    assert verdict.serializable is True, verdict
    assert verdict.anomalies == []


def test_a_long_search_is_undecided() -> None:
    maker = Maker()
    for value in range(1, 9):
        maker(0, 99, saw(Y, None), wrote(X, value), id=value)
    maker(0, 99, saw(X, 1), saw(Y, None), id="first")
    maker(0, 99, wrote(Y, 10), saw(X, 2), id="second")
    maker(0, 99, wrote(Y, 11), saw(X, 2), id="third")
    assert check(History(maker.all)).serializable is True
    hurried = check(History(maker.all), steps=3)
    assert hurried.serializable is None
    assert hurried.undecided
    assert "order of writes to x, y" in hurried.undecided


def test_the_smallest_example_is_kept_and_all_are_counted() -> None:
    maker = started()
    maker(2, 9, wrote(X, 3), wrote(Y, 4), commit=2)
    maker(3, 8, saw(X, 3), saw(Y, 2), saw(X, 3), saw(X, 3), id="long")
    maker(3, 8, saw(X, 3), saw(Y, 2), id="short")
    (anomaly,) = check(History(maker.all)).anomalies
    assert (anomaly.name, anomaly.count) == ("torn_batch", 2)
    assert "short" in anomaly.transactions
