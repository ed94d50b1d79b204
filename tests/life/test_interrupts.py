"""Ctrl-C ends every long call at any time and leaves nothing half-written."""

from __future__ import annotations

import random
import signal
import subprocess
import sys
import time
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from . import interrupted

if TYPE_CHECKING:
    from collections.abc import Callable

TIMES = 3
SEED = 7


@pytest.mark.parametrize("name", interrupted.NAMES)
def test_keyboard_interrupt_at_any_instant(name: str) -> None:
    rng = random.Random(f"{SEED} {name}")
    for _ in range(TIMES):
        with subprocess.Popen(
            [sys.executable, interrupted.__file__, name],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        ) as child:
            assert child.stdout is not None
            assert child.stdout.readline() == "ready\n"
            time.sleep(rng.uniform(0, 0.5))  # any instant will do
            child.send_signal(signal.SIGINT)
            out, err = child.communicate(timeout=120)
        assert (out, err, child.returncode) == ("ended\n", "", 0)


class Alarms:
    """Counts alarms, and does something at each, while a call runs."""

    def __init__(self, work: Callable[[], Any]) -> None:
        self.count = 0
        self._work = work

    def __call__(self, _number: int, _frame: object) -> None:
        self.count += 1
        self._work()

    def amid(self, call: Callable[[], Any]) -> Any:
        """Call with an alarm every millisecond."""
        before = signal.signal(signal.SIGALRM, self)
        signal.setitimer(signal.ITIMER_REAL, 0.001, 0.001)
        try:
            return call()
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize("name", ["lookup_transforms", "snapshot", "re-parented"])
def test_signal_handlers_run_amid_a_call_and_may_use_the_store(name: str) -> None:
    buf = interrupted.filled()
    few = interrupted.STAMPS[::10_000]
    wanted = buf.lookup_transforms("odom", "moved", few)
    wrong = 0

    def nested() -> None:
        nonlocal wrong
        wrong += not np.array_equal(buf.lookup_transforms("odom", "moved", few), wanted)
        wrong += buf.lookup_transform("odom", "moved", int(few[3])).pose[0] != wanted[3, 0]

    call = interrupted.calls(buf)[name]
    quiet = call()
    alarms = Alarms(nested)
    found = alarms.amid(call)
    assert alarms.count >= 2  # not only behind the call
    assert wrong == 0
    assert np.array_equal(found, quiet)


def test_an_error_of_a_handler_ends_the_call() -> None:
    buf = interrupted.filled()

    def fail() -> None:
        raise RuntimeError("enough")

    call = interrupted.calls(buf)["lookup_transforms"]
    with pytest.raises(RuntimeError, match="enough"):
        Alarms(fail).amid(call)
    assert np.isfinite(call()).all()
