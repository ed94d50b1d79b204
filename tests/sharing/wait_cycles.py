"""Begins waits and ends them in every way, repeatedly."""

from __future__ import annotations

import asyncio
import random
from collections import Counter
from concurrent.futures import ThreadPoolExecutor

import tfdb

THREADS = 3
COROUTINES = 17


def end_of(error: BaseException | object) -> str:
    """How a wait ended; what it must not raise is raised."""
    match error:
        case asyncio.CancelledError():
            return "cancelled"
        case tfdb.errors.BufferClosed():
            return "closed"
        case tfdb.WaitTimeout() | tfdb.Extrapolation():
            return "late"
        case BaseException():
            raise error
    return "came"


def wait_cycles(name: str, rounds: int, seed: int) -> Counter[str]:
    """How the waits of so many rounds ended: each once, or this never returns."""
    rng = random.Random(seed)
    ends: Counter[str] = Counter()
    with ThreadPoolExecutor(THREADS) as threads:
        for _ in range(rounds):
            ends += asyncio.run(_round(tfdb.Buffer.open(name, mode="r"), threads, rng))
    return ends


async def _round(buf: tfdb.Buffer, threads: ThreadPoolExecutor, rng: random.Random) -> Counter[str]:
    loop = asyncio.get_running_loop()
    commit = buf.commit
    stamp = buf.lookup_transform("map", "base").stamp

    def limit() -> float:
        return rng.choice([0.0, 0.001, 0.003, 60.0])

    def later(step: int) -> int:
        return stamp + rng.randrange(20) * step

    waits: list[asyncio.Future[object]] = [
        loop.run_in_executor(threads, buf.wait_for_commit, commit + rng.randrange(20), limit())
        for _ in range(THREADS)
    ]
    for _ in range(COROUTINES):
        if rng.random() < 0.5:
            wait = buf.wait_for_commit_async(commit + rng.randrange(20), limit())
        else:
            wait = buf.wait_for_transform_async("map", "hand", later(1000), limit())
        waits.append(asyncio.ensure_future(wait))
    for wait in waits[THREADS:]:
        await asyncio.sleep(0)
        if rng.random() < 0.3:
            wait.cancel()
    if rng.random() < 0.5:
        await asyncio.wait(waits, return_when=asyncio.FIRST_COMPLETED)
    if rng.random() < 0.3:
        await asyncio.to_thread(buf.wait_for_commit, buf.commit, 60.0)
    buf.close()
    return Counter(end_of(end) for end in await asyncio.gather(*waits, return_exceptions=True))
