"""The program `tfdb`: a package of its own, so that it runs before anything slow is imported."""

from __future__ import annotations

import io
import os
import signal
import sys


def _ready_streams() -> None:
    """Have the three standard streams, and let none of them refuse a character.

    What whoever started this has closed leads nowhere, and no file that is opened takes its place.
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


def main() -> None:
    """Run the command line; the process ends with 0 (fine), 1 (findings) or 2 (an error).

    A closed pipe ends it as it ends other programs, by its signal, and so does Ctrl-C until the
    command can say what it stopped.
    """
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    _ready_streams()
    from tfdb.cli.app import cli  # noqa: PLC0415 - what takes long

    try:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        cli.main(prog_name="tfdb")
    except KeyboardInterrupt:
        sys.exit(130)
    except Exception:  # a mistake of the program's, which is no finding either
        sys.excepthook(*sys.exc_info())
        sys.exit(2)
