"""Ctrl-C ends every call that waits for a stopped writer."""

from __future__ import annotations

import signal
from threading import Timer
from typing import TYPE_CHECKING

import tfdb

from . import held_calls
from .child import Child

if TYPE_CHECKING:
    from pathlib import Path

LONGEST = 60.0  # seconds, before a call that hears nothing is ended


def test_the_table_has_every_public_call(name: str, tmp_path: Path) -> None:
    buffer = tfdb.Buffer.open(name)
    held_calls.ready(buffer)
    waits = held_calls.calls_that_wait(buffer)
    answers = held_calls.calls_that_answer(buffer, name, tmp_path)
    assert {called.split()[0] for called in waits | answers} == held_calls.public()
    assert not waits.keys() & answers.keys()


def test_ctrl_c_ends_every_call_that_waits_for_a_stopped_writer(name: str, tmp_path: Path) -> None:
    buffer = tfdb.Buffer.open(name)
    held_calls.ready(buffer)
    before = buffer.commit
    waits = held_calls.calls_that_wait(buffer)
    answers = held_calls.calls_that_answer(buffer, name, tmp_path)
    with Child("hold_lock", name) as holder:
        holder.wait_until_stopped()
        held = buffer.commit
        with Child(name, tmp_path, module="held_calls") as caller:
            for called in answers:
                assert ended(caller, called) == "answered", called
            for called in waits:
                assert ended(caller, called, waits=True) == "interrupted", called
            assert caller.end() == 0
        assert buffer.commit == held > before
        holder.send(signal.SIGCONT)
        assert holder.says() == "committed"
    assert buffer.commit == held + 1


def ended(caller: Child, called: str, *, waits: bool = False) -> str:
    """How a call ends; one that waits is interrupted, once another thread has been heard."""
    watchdog = Timer(LONGEST, caller.send, [signal.SIGKILL])
    watchdog.start()
    try:
        assert caller.says() == called
        if waits:
            caller.wait_until_asleep()
            caller.tell(called)
            assert caller.says() == f"heard {called}", "the call keeps the GIL"
            caller.send(signal.SIGINT)
        return caller.says()
    finally:
        watchdog.cancel()
