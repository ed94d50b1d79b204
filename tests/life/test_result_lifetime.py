"""Results outlive their store, and do not keep it alive."""

from __future__ import annotations

import gc
import pickle
import resource
from pathlib import Path
from typing import Any

import pytest

import tfdb

from .test_closing import ENGINES, TURNED, filled

STORE = 1 << 28
"""A store reserves more addresses than this."""

OTHER = (0.0, 0.6, 0.0, 0.8)


def answers(buf: tfdb.Buffer) -> list[tfdb.Transform]:
    """Ask in every way that makes a Transform with a report."""
    with buf.snapshot() as held:
        found = [reads.lookup_transform("map", "arm", 150) for reads in (buf, held)]
        found += [reads.lookup_latest_transform("arm", "map") for reads in (buf, held)]
        found += [
            reads.lookup_transform_full("map", 150, "arm", 250, "base") for reads in (buf, held)
        ]
    with buf.transaction() as tx:
        found.append(tx.lookup_transform("map", "arm", 150))
        found.append(tx.lookup_latest_transform("map", "arm"))
        tx.set_transform("arm", "hand", 150, (1, 2, 3), OTHER)
        found.append(tx.lookup_transform("hand", "map", 150))
    found += [answer.inverse() for answer in found]
    found += [pickle.loads(pickle.dumps(answer)) for answer in found]
    return found


@pytest.mark.parametrize("concurrency", ENGINES)
def test_reports_stay_unchanged(concurrency: str) -> None:
    buf = filled(concurrency)
    found = answers(buf)
    before = [(repr(answer.report), str(answer.report), repr(answer)) for answer in found]
    assert all("arm" in report and "removed" not in report for report, _, _ in before)
    buf.remove_frames("base", recursive=True)
    for i in range(20):  # in the slots of those that are gone
        buf.set_static_transform("map", f"another {i}", (3, 2, 1), OTHER)
    buf.clear()
    again = [(repr(answer.report), str(answer.report), repr(answer)) for answer in found]
    assert again == before
    del buf
    gc.collect()
    assert [(repr(a.report), str(a.report), repr(a)) for a in found] == before


def test_the_same_names_in_new_slots() -> None:
    """A path whose frames were removed and made again is another one."""
    buf = filled("snapshot")
    first = buf.lookup_transform("map", "arm", 150)
    buf.remove_frames("base", recursive=True)
    buf.set_static_transform("map", "arm", (1, 2, 3), TURNED)
    buf.set_static_transform("arm", "base", (1, 2, 3), TURNED)
    second = buf.lookup_transform("map", "base", 150)
    assert [(e.child, e.parent) for e in first.report.edges] == [("arm", "base"), ("base", "map")]
    assert [(e.child, e.parent) for e in second.report.edges] == [("base", "arm"), ("arm", "map")]


class Name(str):
    """Text that refers to something."""

    __slots__ = ("about",)
    about: Any


class Kept(tfdb.Buffer):
    """A store with an attribute."""

    answer: Any = None


def knot(kind: int) -> None:
    """Make a store that holds its own answer in one of many ways, and forget both."""
    held: list[Any] = []
    buf = Kept(clock=lambda: len(held))
    name = Name("map")
    buf.set_static_transform(name, "base", (1, 2, 3), TURNED)
    answer = buf.lookup_transform(name, "base")
    name.about = answer
    held.append(answer)
    if kind % 5 == 1:
        buf.answer = answer
    elif kind % 5 == 2:
        buf.answer = buf.snapshot()
        held.append(buf.answer.lookup_transform(name, "base").report)
    elif kind % 5 == 3:
        with buf.transaction() as tx:
            held.append(tx)
            held.append(tx.lookup_transform(name, "base").inverse())
    elif kind % 5 == 4:
        buf.answer = buf.transaction()
        buf.answer.__enter__()


def address_space() -> int:
    """Count the bytes that the process has mapped."""
    return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()


def test_ten_thousand_stores_that_hold_their_own_answers_are_freed() -> None:
    knot(0)
    gc.collect()
    before = address_space()
    gc.disable()
    gc.freeze()  # each collection would walk what the other tests left
    try:
        for i in range(10_000):
            knot(i)
            if i % 200 == 199:
                assert address_space() - before >= 10 * STORE  # those that are garbage
                gc.collect()
                assert not [obj for obj in gc.get_objects() if type(obj) is Kept]
                assert address_space() - before < 10 * STORE
    finally:
        gc.unfreeze()
        gc.enable()


def test_an_answer_keeps_no_store() -> None:
    kept = []
    for _ in range(50):
        buf = Kept()
        buf.set_static_transform("map", "base", (1, 2, 3), TURNED)
        kept.append(buf.lookup_transform("map", "base"))
    del buf
    gc.collect()
    assert not [obj for obj in gc.get_objects() if type(obj) is Kept]
    assert {answer.report.edges[0].child for answer in kept} == {"base"}
