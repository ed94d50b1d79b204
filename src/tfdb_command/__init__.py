"""The program `tfdb`: a package of its own, so that it runs before anything slow is imported."""

from __future__ import annotations

import io
import os
import signal
import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from types import FrameType

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""The signals that end a command in good order."""
_AGAIN = 0.01
"""Seconds until a signal in an import is tried again."""


class Stopped(KeyboardInterrupt):
    """A signal ended the command. Commands treat it as Ctrl-C."""

    def __init__(self, number: int) -> None:
        super().__init__(f"ended by {signal.Signals(number).name}")
        self.number = number


def _stop(number: int, frame: FrameType | None) -> None:
    """End the command, once no import is under way.

    An exception in an import may leave its lock held. Later imports of all threads then hang. The
    signal is sent again, because the command may have set a handler of its own meanwhile.
    """
    if not _is_importing(frame):
        raise Stopped(number)
    signal.signal(signal.SIGALRM, lambda *_: signal.raise_signal(number))
    signal.setitimer(signal.ITIMER_REAL, _AGAIN)


@contextmanager
def signals_held() -> Iterator[Callable[[], None]]:
    """Hold the signals that end a command, until the end of the block or a call of its value.

    The first held signal is handled then. So the block can create what must be closed, and reach
    the statement that closes it.
    """
    held: list[int] = []
    handled = [number for number in ENDING if signal.getsignal(number) is _stop]

    def release() -> None:
        while handled:
            signal.signal(handled.pop(), _stop)
        if held:
            raise Stopped(held.pop(0))

    for number in handled:
        signal.signal(number, lambda number, _: held.append(number))
    try:
        yield release
    finally:
        release()


def _is_importing(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            return True
        frame = frame.f_back
    return False


def _ready_streams() -> None:
    """Have the three standard streams, and let none of them refuse a character.

    A stream that the starting process has closed leads nowhere, and no file that is opened takes
    its place.
    """
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass
    os.close(number)
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            mode = "w" if number else "r"
            setattr(sys, name, open(number, mode, encoding="utf-8", closefd=False))  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _run() -> None:
    from tfdb.cli.app import cli  # noqa: PLC0415 - what takes long

    # A parent may have a signal ignored, as nohup does with SIGHUP. Ctrl-C is always heard.
    for number in ENDING:
        if number == signal.SIGINT or signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _stop)
    try:
        cli.main(prog_name="tfdb")
    finally:
        sys.stdout.flush()


def _leave_signals() -> None:
    """Restore the default effect of signals: the command is over.

    Python removes its handlers as the process ends. An alarm that is still set would then kill it.
    """
    signal.signal(signal.SIGALRM, signal.SIG_IGN)
    for number in ENDING:
        if signal.getsignal(number) is _stop:
            signal.signal(number, signal.SIG_DFL)


def main() -> None:
    """Run the command line; the process ends with 0 (fine), 1 (findings) or 2 (an error).

    Ctrl-C, SIGTERM and SIGHUP end it with 128 and their number, once the command has removed its
    temporary files and printed its summary. A closed pipe ends it in the same order, then by its
    signal, as it ends other programs.
    """
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    _ready_streams()
    try:
        try:
            _run()
        finally:
            _leave_signals()
    except Stopped as stopped:
        sys.exit(128 + stopped.number)
    except BrokenPipeError:
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)
        os.kill(os.getpid(), signal.SIGPIPE)
    except Exception:  # a mistake of the program's, which is not a finding either
        sys.excepthook(*sys.exc_info())
        sys.exit(2)
