"""Transactions of many threads at once: exact sums, no hang, nothing left over."""

from __future__ import annotations

import random
import typing

import pytest

import tfdb
import tfdb.types
from another_thread import Call

TILT = (0.5, -0.5, 0.5, 0.5)
ISOLATING = [e for e in typing.get_args(tfdb.types.Concurrency) if e != "fine"]
THREADS = 4
ACCOUNTS = 12
START = 1000.0
SEED = 20240817


def account(number: int) -> str:
    return f"account_{number}"


def balance(reads: tfdb.Transaction | tfdb._core.StoreReader, number: int) -> float:
    """Alternately in both directions: T[bank<-account] is tilted, and its x is the money."""
    if number % 2:
        back = reads.lookup_transform(account(number), "bank").inverse()
        return round(float(back.translation[0]))
    return float(reads.lookup_transform("bank", account(number)).translation[0])


def total(reads: tfdb.Transaction | tfdb._core.StoreReader) -> float:
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
