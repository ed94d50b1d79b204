"""A process is forked while its threads use a store: the child does not hang."""

from __future__ import annotations

import json
import multiprocessing
import os

import pytest

import tfdb

from . import fork
from .child import printed_by

ENGINES = ["snapshot", "giant", "fine", "2pl-no-wait", "2pl-wait-die", "2pl-wound-wait", "silo"]


def results(concurrency: str, times: int, how: str) -> list[dict[str, str]]:
    printed = printed_by(fork.__file__, concurrency, str(times), how)
    ends: list[dict[str, str]] = json.loads(printed)
    assert len(ends) == times
    return ends


@pytest.mark.parametrize("concurrency", ENGINES)
def test_forks_beside_writers(concurrency: str) -> None:
    expected = {"end", "held", *fork.READS, *fork.WRITES}
    expected |= {f"own_{name}" for name in (*fork.READS, *fork.WRITES)}
    lookups = []
    for told in results(concurrency, 20 if concurrency == "snapshot" else 5, "busy"):
        assert told.pop("end") == "0", f"hung or died, at the last of {told}"
        assert told.keys() == expected - {"end"}
        for name, result in told.items():
            if name.startswith("own_"):
                assert result == "ok", name
            else:
                assert result in {"ok", "Forked"}, name
        # Whether it may write is one answer for the store.
        assert len({told[name] for name in fork.WRITES if name != "snapshot"}) == 1, told
        lookups += [told["lookup_transform"], told["lookup_transforms"]]
    if concurrency == "snapshot":
        assert lookups.count("ok") > len(lookups) / 2


@pytest.mark.parametrize("concurrency", ENGINES)
def test_a_store_at_rest_works_in_children_and_theirs(concurrency: str) -> None:
    for told in results(concurrency, 4 if concurrency == "snapshot" else 1, "quiet"):
        assert told.pop("end") == "0"
        assert set(told.values()) == {"ok"}


def test_a_transaction_stays_with_its_process() -> None:
    for concurrency in ENGINES:
        buf = fork.filled(concurrency)
        there, here = os.pipe()
        with buf.transaction() as tx:
            tx.set_transform("map", "odom", 5, (1, 2, 3), fork.TURNED)
            pid = os.fork()
            if pid == 0:
                try:
                    tx.lookup_transform("map", "odom", 5)
                    os.write(here, b"answered")
                except tfdb.errors.Forked:
                    os.write(here, b"Forked")
                finally:
                    os._exit(0)
            os.waitpid(pid, 0)
            assert os.read(there, 100) == b"Forked"
        assert buf.can_transform("map", "odom", 5)
        os.close(here)
        os.close(there)


_shared = fork.filled("snapshot")


def _look_up(stamp: int) -> tuple[float, ...]:
    return tuple(_shared.lookup_transform("map", "eye", stamp).pose)


def test_forked_workers_read_a_loaded_store() -> None:
    stamps = range(10, 1_000)
    with multiprocessing.get_context("fork").Pool(2) as pool:
        assert pool.map(_look_up, stamps) == [_look_up(stamp) for stamp in stamps]
