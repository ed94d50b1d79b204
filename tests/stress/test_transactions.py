"""Transactions of many Python threads at once: sums stay exact, nothing hangs, nothing is left."""

from __future__ import annotations

import random
import typing

import numpy as np
import pytest

import tfdb
import tfdb.types
from elsewhere import Call

TILT = (0.5, -0.5, 0.5, 0.5)
ISOLATING = [e for e in typing.get_args(tfdb.types.Concurrency) if e != "fine"]
THREADS = 4
ACCOUNTS = 12
START = 1000.0
SEED = 20240817


def account(number: int) -> str:
    return f"account_{number}"


def balance(reads: tfdb.Transaction | tfdb.Reads, number: int) -> float:
    """Alternately in both directions: T[bank<-account] is tilted, and its x is the money."""
    if number % 2:
        back = reads.lookup_transform(account(number), "bank").inverse()
        return round(float(back.translation[0]))
    return float(reads.lookup_transform("bank", account(number)).translation[0])


def total(reads: tfdb.Transaction | tfdb.Reads) -> float:
    return sum(balance(reads, number) for number in range(ACCOUNTS))


class Bank:
    """Accounts as frames; every second one moves, with all its samples at one stamp."""

    def __init__(self, engine: str) -> None:
        self.buffer = tfdb.Buffer(history=None, concurrency=engine)
        for number in range(ACCOUNTS):
            self.put(self.buffer, number, START)

    @staticmethod
    def put(writes: tfdb.Transaction | tfdb.Buffer, number: int, money: float) -> None:
        if number % 3:
            writes.set_static_transform("bank", account(number), (money, 1, 2), TILT)
        else:
            writes.set_transform("bank", account(number), 7, (money, 1, 2), TILT)

    def transfer(self, source: int, target: int, money: float) -> None:
        def move(tx: tfdb.Transaction) -> None:
            left = balance(tx, source) - money
            right = balance(tx, target) + money
            self.put(tx, source, left)
            self.put(tx, target, right)
            assert balance(tx, source) == left

        self.buffer.run(move)


@pytest.mark.parametrize("engine", ISOLATING)
def test_money_is_neither_made_nor_lost(engine: str) -> None:
    bank = Bank(engine)

    def trade(seed: int) -> None:
        choice = random.Random(SEED + seed)
        for _ in range(120):
            source, target = choice.sample(range(ACCOUNTS), 2)
            bank.transfer(source, target, choice.randint(1, 100))

    def audit() -> None:
        for _ in range(40):
            assert bank.buffer.run(total) == ACCOUNTS * START
            with bank.buffer.snapshot() as snapshot:
                assert total(snapshot) == ACCOUNTS * START

    calls = [Call(lambda seed=seed: trade(seed)) for seed in range(THREADS)]
    auditor = Call(audit)
    for call in calls:
        call.result()
    auditor.result()
    assert total(bank.buffer) == ACCOUNTS * START
    counters = bank.buffer.counters()
    assert bank.buffer.commit == counters.commits == ACCOUNTS + 120 * THREADS
    print(f"seed {SEED}, {engine}: {counters}")


@pytest.mark.parametrize("engine", ISOLATING)
def test_frames_made_once(engine: str) -> None:
    """Four threads create what is missing: each name is created by exactly one of them."""
    buffer = tfdb.Buffer(history=None, concurrency=engine)
    buffer.set_static_transform("map", "base", (1, 2, 3), TILT)

    def claim(tx: tfdb.Transaction, name: str, who: int) -> bool:
        if tx.frame_exists(name):
            return False
        tx.set_transform("base", name, who, (who, 1, 2), TILT, authority=f"thread {who}")
        return True

    def work(who: int) -> list[int]:
        return [i for i in range(40) if buffer.run(lambda tx, i=i: claim(tx, f"tool_{i}", who))]

    calls = [Call(lambda who=who: work(who)) for who in range(1, THREADS + 1)]
    won = [call.result() for call in calls]
    assert sorted(i for mine in won for i in mine) == list(range(40))
    for who, mine in enumerate(won, start=1):
        for i in mine:
            assert buffer.samples(f"tool_{i}")[0].tolist() == [who]
            assert buffer.frame_info(f"tool_{i}").authority == f"thread {who}"


@pytest.mark.parametrize("engine", ISOLATING)
def test_a_cup_is_in_one_hand(engine: str) -> None:
    """Threads re-parent one frame to their own hand if it is on the table, and put it back."""
    buffer = tfdb.Buffer(history=None, concurrency=engine)
    for who in range(THREADS):
        buffer.set_static_transform("map", f"hand_{who}", (who, 1, 2), TILT)
    buffer.set_static_transform("map", "table", (5, 5, 5), TILT)
    buffer.set_static_transform("table", "cup", (0.1, 0.2, 0.3), TILT)

    def where(tx: tfdb.Transaction) -> str:
        return tx.lookup_transform("map", "cup").report.edges[0].parent

    def grasp(tx: tfdb.Transaction, hand: str) -> bool:
        if where(tx) != "table":
            return False
        tx.reparent("cup", hand)
        return True

    def put_back(tx: tfdb.Transaction, hand: str) -> None:
        assert where(tx) == hand, "somebody took it out of a hand"
        tx.reparent("cup", "table", None, (0.1, 0.2, 0.3), TILT)

    def work(who: int) -> int:
        hand = f"hand_{who}"
        grasped = 0
        for _ in range(25):
            if buffer.run(lambda tx: grasp(tx, hand)):
                grasped += 1
                buffer.run(lambda tx: put_back(tx, hand))
        return grasped

    calls = [Call(lambda who=who: work(who)) for who in range(THREADS)]
    grasped = sum(call.result() for call in calls)
    assert grasped > 0
    assert buffer.commit == THREADS + 2 + 2 * grasped
    assert buffer.lookup_transform("table", "cup").translation == pytest.approx([0.1, 0.2, 0.3])


def test_short_lived_frames_in_bulk_leave_memory_flat() -> None:
    """Made and removed under readers and transactions; their slots and memory are used again."""
    buffer = tfdb.Buffer(history=None)
    buffer.set_static_transform("map", "base", (1, 2, 3), TILT)
    size = 250

    def churn(turns: range) -> None:
        for turn in turns:
            names = [f"car_{turn}_{i}" for i in range(size)]
            poses = np.tile([turn, 1.0, 2.0, *TILT], (size, 1))
            buffer.set_transforms(tfdb.Columns("map", names, np.full(size, turn), poses))
            buffer.remove_frames(names)

    def read() -> int:
        found = 0
        for i in range(6000):
            turn = i % 80
            try:
                seen = buffer.lookup_transform("map", f"car_{turn}_{i % size}")
            except tfdb.UnknownFrame:
                continue
            assert seen.translation[0] == turn, "a reused slot answered for its old frame"
            found += 1
        return found

    def decide() -> None:
        for i in range(200):
            buffer.run(
                lambda tx, i=i: (
                    tx.frame_exists(f"car_{i % 80}_0"),
                    tx.set_static_transform("map", "base", (i, 2, 3), TILT),
                )
            )

    calls = [Call(lambda: churn(range(80))), Call(read), Call(decide)]
    for call in calls:
        call.result()
    assert buffer.frames() == ["base", "map"]
    # What an open transaction could still see is kept until it ends; then nothing grows any more.
    churn(range(80, 85))
    before = buffer.memory()
    churn(range(85, 125))
    after = buffer.memory()
    assert after.frames == before.frames
    assert after.used_bytes <= before.used_bytes
    print(f"{after.frames} slots for {125 * size} frames, {size} at a time")
