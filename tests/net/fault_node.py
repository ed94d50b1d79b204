"""A process of a network with faults: a router, or a store that is a home or a mirror.

    python -m tests.net.fault_node STORE ENDPOINT router|home|mirror TAG SECONDS

It prints its state as lines of JSON. It reads the lines `pause`, `go` and `promote TAG`. A home
commits one batch every SECONDS.
"""

from __future__ import annotations

import json
import re
import select
import sys
import threading
from typing import TYPE_CHECKING, Any

import tfdb
from tests.net.batches import last_batch, write_batch
from tfdb.net.messages import epoch_text

if TYPE_CHECKING:
    from tfdb.net import Home, Mirror

NAME = "robot1"


def open_store(name: str) -> tfdb.Buffer:
    """Open a node's store, or create it."""
    return tfdb.Buffer.open(name, size=1 << 26)


def tell(kind: str, **what: Any) -> None:
    """Print a line by one write, because another thread may print as well."""
    sys.stdout.write(f"{json.dumps({'kind': kind, **what})}\n")
    sys.stdout.flush()


class Node:
    """A store and its current role. Threads: one; another one prints events."""

    def __init__(self, store: str, session: tfdb.net.Session, tag: int, pause: float) -> None:
        self.store, self.session, self.tag, self.pause = store, session, tag, pause
        self.buffer = open_store(store)

    def be_home(self, home: Home) -> None:
        """Commit batches until a later home exists."""
        number, parent = last_batch(self.buffer)
        # The tag is printed before its first batch, so that the check knows it.
        tell("home", tag=self.tag, number=number, parent=parent, epoch=epoch_text(home.epoch))
        goes = True
        while home.state == "publishing":
            if select.select([sys.stdin], [], [], self.pause)[0]:
                goes = sys.stdin.readline() == "go\n"
                if not goes:
                    tell("paused", commit=self.buffer.commit, epoch=epoch_text(home.epoch))
            elif goes:
                number += 1
                try:
                    write_batch(self.buffer, number, self.tag)
                except tfdb.errors.ReadOnly:  # the home was fenced just now
                    goes = False
        home.close()
        if home.error is not None:
            raise home.error
        (fenced,) = [event for event in home.events() if event.kind == "fenced"]
        if fenced.before is not None and fenced.after is not None:
            later = re.search(r"\(epoch (\d+)\)", fenced.text)
            assert later is not None
            alone = fenced.after[1] - fenced.before[1]
            tell("fenced", later=int(later[1]), last=last_batch(self.buffer), alone=alone)
        if "Its frames are read-only" not in fenced.text:
            tell("unheard")
            raise SystemExit

    def be_mirror(self) -> Home:
        """Follow a home until this store should be the home."""
        max_lag = 20 if self.tag % 3 == 0 else None
        mirror = tfdb.net.mirror(NAME, into=self.buffer, session=self.session, max_lag=max_lag)
        tell("mirror")
        printer = threading.Thread(target=print_events, args=[mirror], daemon=True)
        printer.start()
        while True:
            command, *tag = sys.stdin.readline().split() or ["end"]
            if command == "end":
                raise SystemExit
            if command == "promote":
                try:
                    home = mirror.promote()
                except tfdb.InvalidArgument as error:  # the mirror was never live
                    tell("refused", text=str(error))
                    continue
                self.tag = int(tag[0])
                printer.join()
                return home


def print_events(mirror: Mirror) -> None:
    """Print the events of a mirror until it is closed."""
    for event in mirror.events():
        tell("event", event=event.kind, text=event.text)


def main() -> None:
    """Run."""
    store, endpoint, role, tag, pause = sys.argv[1:]
    if role == "router":
        with tfdb.net.Session(listen=endpoint):
            tell("router")
            sys.stdin.read()
        return
    with tfdb.net.Session(connect=endpoint, wait=None) as session:
        node = Node(store, session, int(tag), float(pause))
        if role == "home":
            node.be_home(tfdb.net.publish(node.buffer, NAME, session=session, take_over=True))
        while True:
            node.be_home(node.be_mirror())


if __name__ == "__main__":
    main()
