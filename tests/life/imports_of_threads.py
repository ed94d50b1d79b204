"""Prints the modules that a listener's threads import up to its first event.

Run as `imports_of_threads.py LISTENER`, a key of `LISTENERS`.
"""

from __future__ import annotations

import logging
import sys
import threading
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import tfdb

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import TypeAlias

    Listener: TypeAlias = Callable[[tfdb.Buffer, Callable[[Any], None]], object]


def record(buf: tfdb.Buffer, heard: Callable[[object], None]) -> None:
    """Record one commit."""
    with TemporaryDirectory() as folder, tfdb.Recorder(buf, Path(folder) / "drive.mcap") as made:
        put(buf)
        made.flush()
        heard(made)


def expect(buf: tfdb.Buffer, heard: Callable[[object], None]) -> None:
    """Have an event of a limit that is broken."""
    buf.expectations.on_event = heard
    buf.expect("map", "base", max_step=0.1)
    put(buf)


def in_thread(make: Callable[[tfdb.Buffer], Callable[[], object]]) -> Listener:
    """Make a function of the buffer here, and call it in a new thread."""

    def begin(buf: tfdb.Buffer, heard: Callable[[object], None]) -> None:
        call = make(buf)
        threading.Thread(target=lambda: heard(call()), daemon=True).start()

    return begin


LISTENERS: dict[str, Listener] = {
    "a rule on frames": lambda buf, heard: buf.add_rule(heard, "base"),
    "a rule on every commit": lambda buf, heard: buf.add_rule(heard, "*"),
    "a rule on a pair": lambda buf, heard: buf.add_rule(heard, ("map", "base"), fires="always"),
    "a recorder": record,
    "an expectation": expect,
    "a watch": in_thread(lambda buf: partial(buf.watch("base").next, 1)),
    "a stream": in_thread(lambda buf: buf.follow().__next__),
    "changes": in_thread(lambda buf: buf.follow().changes().__next__),
}


def put(buf: tfdb.Buffer) -> None:
    """Move the frame by a metre."""
    buf.set_transform("map", "base", buf.commit * 1000, (buf.commit, 2, 3), (0, 0.6, 0, 0.8))


def main() -> None:
    """Begin the listener, write until it hears, and print the imports in threads."""
    logging.disable()  # of events
    buf = tfdb.Buffer()
    put(buf)
    came = threading.Event()
    imported: list[object] = []

    def note(event: str, arguments: tuple[object, ...]) -> None:
        if event == "import" and threading.current_thread() is not threading.main_thread():
            imported.append(arguments[0])

    sys.addaudithook(note)
    LISTENERS[sys.argv[1]](buf, lambda _: came.set())
    while not came.wait(0.001):
        put(buf)
    print(*imported, end="")


if __name__ == "__main__":
    main()
