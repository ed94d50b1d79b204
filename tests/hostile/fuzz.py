"""Calls the whole public API with hostile arguments.

Run as `python -m tests.hostile.fuzz --calls N --seed S [--threads]`. Every call ends with a result
or a typed error, and one that is refused leaves the store as it was. The same seed makes the same
calls (without threads).
"""

from __future__ import annotations

import argparse
import contextlib
import faulthandler
import gc
import itertools
import logging
import mmap
import random
import sys
import tempfile
import threading
import time
import traceback
import warnings
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import tfdb

from .public_api import OFFERED, Call, everything
from .values import ENGINES, TURNED, PlantedError, Values, collect

if TYPE_CHECKING:
    from collections.abc import Callable

ALLOWED = (tfdb.TfdbError, TypeError, ValueError, OverflowError, PlantedError)
ANEW = 500
"""After so many calls a new world is made."""


class Hollow(tfdb.Buffer):
    """Never calls our __init__."""

    def __init__(self) -> None:
        pass


HOLLOW: dict[str, type] = {
    "Buffer": Hollow,
    "StoreReader": tfdb.Buffer,
    "Snapshot": tfdb.Snapshot,
    "Transaction": tfdb.Transaction,
}


class Kept(tfdb.Buffer):
    """A store with attributes."""


class World:
    """Some stores, what was made from them, and what hostile objects do to them."""

    def __init__(self, rng: random.Random, shared: World | None = None) -> None:
        self.rng = rng
        self.depth = 0
        self.acts = 0
        self.stores: list[tfdb.Buffer] = shared.stores if shared else self._stores()
        self.snapshots = shared.snapshots if shared else [buf.snapshot() for buf in self.stores]
        self.transactions: list[tfdb.Transaction] = []
        self.alone = shared is None
        self.stamps = shared.stamps if shared else np.arange(9_000, dtype=np.int64) % 2_500
        self.made: list[Any] = [tfdb.Transform("map", "base", (1, 2, 3), TURNED, 500)]
        self.values = Values(rng, self)

    def _stores(self) -> list[tfdb.Buffer]:
        stores: list[tfdb.Buffer] = []
        for engine in ("snapshot", self.rng.choice(ENGINES)):
            buf = Kept(None, concurrency=engine, clock=self.clock)  # type: ignore[arg-type]
            buf.set_static_transform("map", "odom", (1, 2, 3), TURNED)
            for stamp in range(100, 2_100, 100):
                buf.set_transform("odom", "base", stamp, (stamp, 2, 3), TURNED)
                buf.set_transform("base", "arm", stamp, (4, stamp, 6), (0.6, 0.0, 0.0, 0.8))
            buf.own = buf.lookup_transform("map", "arm")  # type: ignore[attr-defined]
            stores.append(buf)
        return stores

    def clock(self) -> Any:
        """Tell the time, in between mischief."""
        self.act()
        return self.rng.choice([700, 700, 700, -1, None, "now", 2**70])

    def work(self, tx: tfdb.Transaction) -> Any:
        """Do what `run` is for, in between mischief."""
        self.act()
        tx.set_transform("odom", "base", self.rng.randrange(2_000), (1, 2, 3), TURNED)
        self.act()
        return tx.lookup_transform("map", "base")

    def any_object(self) -> Any:
        """Give any object that there is."""
        pool = [self.stores, self.snapshots, self.transactions, self.made]
        return self.rng.choice(self.rng.choice([some for some in pool if some]))

    def begin(self) -> tfdb.Transaction:
        """Give a transaction: one that is there, or a new one."""
        if len(self.transactions) > 4:
            self.transactions.pop(0)
        if not self.transactions or self.rng.random() < 0.1:
            tx = self.rng.choice(self.stores).transaction(self.rng.randrange(8))
            self.transactions.append(tx)
            if self.rng.random() < 0.8:
                with contextlib.suppress(*ALLOWED):
                    tx.__enter__()
        return self.rng.choice(self.transactions)

    def owner(self, name: str) -> Any:
        """Give an object of a class."""
        rng = self.rng
        if rng.random() < 0.02 and name in HOLLOW:
            cls = HOLLOW[name]
            return cls.__new__(cls)
        if name == "Transaction":
            return self.begin()
        if name == "Snapshot":
            if rng.random() < 0.1:
                self.snapshots[rng.randrange(len(self.snapshots))] = rng.choice(
                    self.stores
                ).snapshot()
            return rng.choice(self.snapshots)
        if name in ("Buffer", "StoreReader"):
            return rng.choice(self.stores)
        if name == "Transform":
            return next(thing for thing in self.made if isinstance(thing, tfdb.Transform))
        fitting = [thing for thing in self.made if type(thing).__name__ == name]
        if name == "Watch" and not fitting:
            fitting = [rng.choice(self.stores).watch("map", [("map", "base")])]
        if name == "Clock" and not fitting:
            fitting = [rng.choice(self.stores).clock]
        if name == "Trajectory" and not fitting:
            fitting = [tfdb.Trajectory("map", "base", [1, 500, 1_000], [[1, 2, 3, *TURNED]] * 3)]
        return rng.choice(fitting or [OFFERED[name]])

    def act(self) -> None:
        """What a hostile object does amid a call."""
        if self.depth > 2:
            return
        self.depth += 1
        self.acts += 1
        try:
            self._act(self.rng.randrange(14))
        except ALLOWED:
            if self.rng.random() < 0.3:
                raise
        finally:
            self.depth -= 1

    def _act(self, kind: int) -> None:
        rng = self.rng
        buf = rng.choice(self.stores)
        if kind == 0:
            raise PlantedError
        if kind == 1:
            rng.choice(self.snapshots).close()
        elif kind == 2:
            buf.set_transform("odom", "base", rng.randrange(3_000), (7, 8, 9), TURNED)
        elif kind == 3:
            buf.remove_frames(rng.choice(["arm", "hand", "base"]), recursive=True)
        elif kind == 4:
            buf.lookup_transform("map", rng.choice(["base", "arm"]), rng.randrange(2_500))
        elif kind == 5:
            buf.lookup_transforms("map", "base", [rng.randrange(2_500) for _ in range(5)])
        elif kind == 6 and self.transactions:
            rng.choice(self.transactions).abort()
        elif kind == 7 and self.transactions:
            rng.choice(self.transactions).__exit__(None, None, None)
        elif kind == 8:
            collect()
        elif kind == 9:
            self.made.append(rng.choice(self.snapshots).lookup_latest_transform("map", "base"))
        elif kind == 10 and self.alone:
            self.stores[rng.randrange(len(self.stores))] = rng.choice(self.stores)
        elif kind == 12 and not self.alone:
            # Amid a batch of another thread, which has given up the GIL.
            at = rng.randrange(9_000)
            self.stamps[at:] = rng.choice([-1, 0, 1_500, 2**63 - 1, -(2**63)])
            self.stamps[at:] = np.arange(9_000 - at) % 2_500
        elif kind == 11:
            buf.set_static_transform(rng.choice(["map", "base"]), "hand", (1, 2, 3), TURNED)

    def close(self) -> None:
        """End what is open."""
        for tx in self.transactions:
            with contextlib.suppress(*ALLOWED):
                tx.abort()
        self.transactions.clear()


def digest(held: tfdb.Snapshot) -> Any:
    """Everything that a state says."""
    names = held.frames()
    samples = [held.samples(name) for name in names]
    # Who wrote last and how many samples came late is said of the store, not of one state.
    infos = [replace(info, authority="", late=0) for info in held.tree()]
    return names, infos, [(s.tobytes(), p.tobytes(), parents) for s, p, parents in samples]


class Judge:
    """Knows what each store's newest state, and each snapshot, looked like."""

    def __init__(self) -> None:
        self._known: dict[int, tuple[Any, int, Any]] = {}

    def look(self, buf: tfdb.Buffer) -> None:
        """Compare the newest state with what it was at the same commit."""
        try:
            with buf.snapshot() as held:
                self._compare(buf, held.commit, digest(held))
        except tfdb.errors.TransactionActive:
            return  # this thread's own transaction is in the way

    def look_at(self, held: tfdb.Snapshot) -> None:
        """Compare a snapshot with what it was."""
        try:
            self._compare(held, held.commit, digest(held))
        except (tfdb.errors.SnapshotClosed, tfdb.errors.SnapshotTooOld):
            return

    def _compare(self, of: Any, commit: int, state: Any) -> None:
        known = self._known.get(id(of))
        if known is None or known[1] != commit:
            self._known[id(of)] = (of, commit, state)
        elif known[2] != state:
            before, after = (text[:2_000] for text in (repr(known[2]), repr(state)))
            raise AssertionError(f"commit {commit} was {before} and is now {after}")

    def forget(self) -> None:
        """Begin anew."""
        self._known.clear()


class Fuzzer:
    """Makes calls, one after the other."""

    def __init__(self, seed: int, shared: World | None = None) -> None:
        self.rng = random.Random(seed)
        self.shared = shared
        self.calls = everything()
        self.judge = Judge()
        self.ends: Counter[str] = Counter()
        self.world = World(self.rng, shared)
        self.now = "nothing"
        self.acts = 0

    def step(self, number: int) -> None:
        """Make one call, and look at what it left."""
        if number % ANEW == ANEW - 1 and self.shared is None:
            self.world.close()
            self.judge.forget()
            self.world = World(self.rng)
        if self.shared is None and number % 16 == 0:
            for buf in self.world.stores:
                self.judge.look(buf)
            self.judge.look_at(self.rng.choice(self.world.snapshots))
        if self.rng.random() < 0.05:
            self.world.close()
        call = self.rng.choice(self.calls)
        self.now = f"{number}: {call.owner}.{call.name}"
        # The thread of expectations asks the clock, which acts.
        self.acts = self.world.acts if self.world.depth == 0 else -1
        before = [(buf, buf.commit) for buf in self.world.stores]
        try:
            kept = self.make(call)
        except ALLOWED as error:
            self.ends[type(error).__name__] += 1
            if self.shared is None and isinstance(error, tfdb.TfdbError):
                str(error)
            self.compare(before)
        else:
            self.ends["result"] += 1
            self.keep(kept)

    def compare(self, before: list[tuple[tfdb.Buffer, int]]) -> None:
        """A refused call changes no state that it does not replace by another commit.

        Nor does it commit, if no hostile object did.
        """
        if self.shared is not None:
            return
        if self.world.acts == self.acts:
            assert before == [(buf, buf.commit) for buf in self.world.stores], self.now
        if self.rng.random() < 0.8:
            return
        for buf, commit in before:
            if buf.commit == commit:
                self.judge.look(buf)

    def keep(self, made: Any) -> None:
        """Keep some of what came out, to be called in turn."""
        made_type = type(made).__name__
        if isinstance(made, tfdb.Buffer | tfdb.Snapshot | tfdb.Transaction):
            return
        if made_type in OFFERED:
            self.world.made.append(made)
            del self.world.made[1:-20]

    def make(self, call: Call) -> Any:
        """Make the call."""
        rng = self.rng
        values = self.world.values
        if call.owner is None:
            function: Callable[..., Any] = OFFERED[call.name]
        else:
            owner = self.world.owner(call.owner)
            if call.is_property:
                return getattr(owner, call.name)
            if self.shared is not None and call.owner == "Transaction":
                return self.together(call)
            if rng.random() < 0.02 and call.owner != "Trajectory":
                function = getattr(type(owner), call.name)  # and a self of any kind
                return function(values.any())
            function = getattr(owner, call.name)
        count = len(call.positional)
        if rng.random() < 0.1:
            count = rng.randrange(count + 2)
        names = (*call.positional, "more", "than", "there", "are")[:count]
        given = list(names) + [name for name in call.keywords if rng.random() < 0.5]
        arguments = [values.good(name) for name in given]
        if given and rng.random() < 0.7:
            at = rng.randrange(len(given))
            arguments[at] = values.any(given[at])
        positional = arguments[: len(names)]
        keywords = dict(zip(given[len(names) :], arguments[len(names) :], strict=True))
        if rng.random() < 0.02:
            keywords[rng.choice(["\ud800", "self", "stamp", "", "né"])] = values.any()
        return function(*positional, **keywords)

    def together(self, call: Call) -> Any:
        """Open a transaction for one call only, so that no other thread waits forever."""
        values = self.world.values
        arguments = [values.good(name) for name in call.positional]
        with self.rng.choice(self.world.stores).transaction() as tx:
            if call.name.startswith("_"):
                return None
            return getattr(tx, call.name)(*arguments)


def run_alone(seed: int, calls: int, place: mmap.mmap) -> Counter[str]:
    """Fuzz in this thread."""
    fuzzer = Fuzzer(seed)
    for number in range(calls):
        try:
            fuzzer.step(number)
        except BaseException:
            print(f"call {fuzzer.now} of seed {seed}", flush=True)
            raise
        finally:
            note = fuzzer.now.encode(errors="replace")[:200].ljust(200)
            place[:200] = note
    fuzzer.world.close()
    return fuzzer.ends


def run_together(seed: int, calls: int, count: int = 4) -> Counter[str]:
    """Fuzz the same stores from many threads."""
    everything()  # which Python 3.11 cannot find out in two threads at once
    ends: Counter[str] = Counter()
    wrong: list[str] = []
    for part in range(max(1, calls // (count * ANEW))):
        shared = World(random.Random(seed + part))

        def work(which: int, shared: World = shared, part: int = part) -> None:
            now = "the first"
            try:
                fuzzer = Fuzzer(seed + 1_000 * part + which, shared)
                for number in range(ANEW):
                    fuzzer.step(number)
                    now = fuzzer.now
                ends.update(fuzzer.ends)
            except BaseException:
                wrong.append(f"behind call {now}\n{traceback.format_exc()}")

        threads = [threading.Thread(target=work, args=(i,)) for i in range(count)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        if wrong:
            raise AssertionError("\n".join(wrong))
    return ends


def main() -> None:
    """Fuzz, and say how the calls ended."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--calls", type=int, default=200_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--threads", action="store_true")
    parser.add_argument("--seconds", type=float, help="goes on with further seeds for so long")
    parser.add_argument("--note", type=Path, help="a file that names the call, should it crash")
    options = parser.parse_args()
    # A clock that raises ends expectations, which say so.
    logging.getLogger("tfdb").addHandler(logging.NullHandler())
    if options.note is not None:
        options.note = options.note.absolute()
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        fuzz(options)


def fuzz(options: argparse.Namespace) -> None:
    """Call as the options say. Some calls write files into the working folder."""
    faulthandler.enable()
    warnings.simplefilter("ignore")
    print(f"seed {options.seed}", flush=True)
    place = mmap.mmap(-1, 4096)
    if options.note is not None:
        options.note.write_bytes(bytes(4096))
        with options.note.open("r+b") as file:
            place = mmap.mmap(file.fileno(), 4096)
    ends: Counter[str] = Counter()
    end = time.monotonic() + (options.seconds or 0)
    for seed in itertools.count(options.seed):
        if options.threads:
            ends += run_together(seed, options.calls)
        else:
            ends += run_alone(seed, options.calls, place)
        if time.monotonic() >= end:
            break
        print(f"seed {seed + 1}", flush=True)
    gc.collect()
    print(*(f"{name} {count}" for name, count in ends.most_common()), sep="\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
