"""Processes of homes and mirrors in a bad network; each visible state of a store is checked.

    python -m tests.net.network_faults --cycles 1000 --seed 1

Needs root, because each process has its own network namespace. The seed determines the faults.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from itertools import count
from typing import IO, TYPE_CHECKING, Any

import tfdb
from tests.net.bad_network import BadNetwork
from tests.net.batches import Copy, Judge
from tests.net.conftest import LONGEST
from tests.net.world import BrokenPromiseError
from tests.recorder.reading import state_of
from tfdb.net.messages import NONE, epoch_of_text

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from typing import Self

    from tfdb.data.types import Epoch

NODES = 3
"""Number of stores. One more process is the router."""


@dataclass
class Node:
    """A process and its store."""

    number: int
    store: str
    role: str
    process: subprocess.Popen[bytes] | None = None
    unread: bytes = b""
    needs_store: bool = False
    """It stopped for a later home without a message of it; see docs/replication.md."""
    copy: Copy | None = None
    state: str = ""
    """The last printed state of its mirror."""
    is_promoted: bool = False
    """It was told to become the home, and has not answered yet."""
    paused: tuple[Epoch, int] | None = None
    """The epoch and the last commit of a paused home."""
    rewound: int = 0
    """Number of steps back that its mirror has printed."""


class Faults:
    """Three stores, a router, and faults. Threads: one, and that of the relay."""

    def __init__(
        self,
        seed: int,
        *,
        spans: tuple[float, ...],
        pace: float,
        most: int = 1,
        pause: float = 0.02,
    ) -> None:
        print(f"seed {seed}", flush=True)
        self.random = random.Random(seed)
        self.spans, self.pace, self.most, self.pause = spans, pace, most, pause
        self.tags = count(1)
        self.forks: list[tuple[int, tuple[int, int], int]] = []
        """Reports of stopped homes: later epoch, last batch, number of commits that only they
        have.
        """
        self.judge = Judge()
        self.judge.read_tags = self.drain
        self.found: Counter[str] = Counter()
        self.decks: dict[str, list[Any]] = {}
        names = [f"test-faults-{os.getpid()}-{number}" for number in range(NODES)]
        self.nodes = [Node(at, name, "mirror") for at, name in enumerate(names)]
        self.nodes[0].role = "home"
        self.router = Node(NODES, "-", "router")
        with ExitStack() as made:
            self.network = made.enter_context(BadNetwork(NODES + 1, seed))
            self.errors: IO[bytes] = made.enter_context(tempfile.TemporaryFile())
            made.callback(self.end)
            for node in (self.router, *self.nodes):
                self.start(node)
            self.settle()
            self.made = made.pop_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.made.close()

    # -- processes ---------------------------------------------------------------------------------

    def start(self, node: Node) -> None:
        """Start a process in its namespace."""
        if node.needs_store:
            if node.copy is not None:
                node.copy.buffer.close()
            tfdb.Buffer.unlink(node.store)
            node.copy, node.needs_store = None, False
        endpoint = f"tcp/{self.network.address(NODES)}:7447"
        command = [*self.network.within(node.number), sys.executable, "-m", "tests.net.fault_node"]
        command += [node.store, endpoint, node.role, str(next(self.tags)), str(self.pause)]
        pipes: dict[str, Any] = {
            "stdin": subprocess.PIPE,
            "stdout": subprocess.PIPE,
            "stderr": self.errors,
        }
        # Its own group: the end of a group with a suspended process would end the others.
        node.process = subprocess.Popen(command, start_new_session=True, **pipes)
        assert node.process.stdout is not None
        os.set_blocking(node.process.stdout.fileno(), False)
        node.unread, node.state, node.paused = b"", "", None
        node.rewound, node.is_promoted = 0, False
        if node.copy is not None:
            node.copy.steps_back = 0

    def kill(self, node: Node) -> None:
        """Kill a process, and check its store."""
        process, node.process = node.process, None
        if process is None:
            return
        process.send_signal(signal.SIGKILL)
        process.wait(LONGEST)
        for line in self.lines(node, process):
            self.hear(node, line)
        close_pipes(process)
        if node.copy is not None:
            node.copy.look(self.judge)

    def end(self) -> None:
        """Kill all processes and remove their stores."""
        for node in (*self.nodes, self.router):
            if node.process is not None:
                node.process.kill()
                node.process.wait(LONGEST)
                close_pipes(node.process)
            if node.copy is not None:
                node.copy.buffer.close()
            with suppress(tfdb.errors.NoSuchStore):
                tfdb.Buffer.unlink(node.store)

    def say(self, node: Node, line: str) -> None:
        """Send a line to a process."""
        assert node.process is not None
        assert node.process.stdin is not None
        with suppress(BrokenPipeError):  # the process ended just now
            node.process.stdin.write(f"{line}\n".encode())
            node.process.stdin.flush()

    def lines(self, node: Node, process: subprocess.Popen[bytes]) -> Iterator[dict[str, Any]]:
        """Return the new lines of a process's output."""
        assert process.stdout is not None
        while True:
            data = process.stdout.read()
            if not data:
                break
            node.unread += data
        *whole, node.unread = node.unread.split(b"\n")
        yield from map(json.loads, whole)

    def drain(self) -> None:
        """Read the output of all processes. Raises if one has ended by itself."""
        for node in (*self.nodes, self.router):
            process = node.process
            if process is None:
                continue
            ended = process.poll()
            for line in self.lines(node, process):
                self.hear(node, line)
            if ended is not None and not node.needs_store:
                raise BrokenPromiseError(f"node {node.number} ended by {ended}: {self.said()}")

    def said(self) -> str:
        """Return the last output of the processes on stderr."""
        self.errors.seek(0)
        return self.errors.read()[-5000:].decode(errors="replace")

    def hear(self, node: Node, line: dict[str, Any]) -> None:
        """Process a line of output."""
        kind = line["kind"]
        epoch = epoch_of_text(line["epoch"]) if "epoch" in line else NONE
        if kind in ("home", "refused"):
            node.is_promoted = False
        if kind == "home":
            node.role = kind
            self.open_copy(node).own.add(epoch)
            self.judge.begins[line["tag"]] = line["number"], line["parent"]
            self.judge.tag_of[epoch.number] = line["tag"]
        elif kind == "mirror":
            node.role, node.state = kind, ""
            self.open_copy(node)
        elif kind == "paused":
            node.paused = epoch, line["commit"]
        elif kind == "fenced":
            self.forks.append((line["later"], tuple(line["last"]), line["alone"]))
        elif kind == "unheard":
            node.role, node.needs_store = "mirror", True
            self.found["later homes that were not heard"] += 1
        elif kind == "refused":
            self.found["promotions refused"] += 1
        elif kind == "event":
            event = line["event"]
            self.found[f"events {event!r}"] += 1
            if event in ("live", "catching up", "stale"):
                node.state = event
            node.rewound += event == "rewound"
            if event == "refused" and "the checksum is wrong" in line["text"]:
                # A connection of Zenoh may end during a message; other messages then follow its
                # first part.
                self.found["damaged messages refused"] += 1
            elif event in ("refused", "ended"):
                raise BrokenPromiseError(f"node {node.number}: {line}")

    def open_copy(self, node: Node) -> Copy:
        """Open a node's store for reading, unless it is open."""
        if node.copy is None:
            node.copy = Copy(tfdb.Buffer.open(node.store, mode="r"))
        return node.copy

    # -- looks -------------------------------------------------------------------------------------

    def look(self, seconds: float) -> None:
        """Check all states for some time."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self.look_once()

    def look_once(self) -> None:
        """Check each store, and wait for a commit of one."""
        self.drain()
        for node in self.nodes:
            if node.needs_store and node.process is not None and node.process.poll() is not None:
                self.kill(node)
                self.start(node)
        copies = [node.copy for node in self.nodes if node.copy is not None]
        for copy in copies:
            copy.look(self.judge)
        if copies:
            buffer = self.random.choice(copies).buffer
            with suppress(tfdb.WaitTimeout):
                buffer.wait_for_commit(buffer.commit, 0.01)

    # -- faults ------------------------------------------------------------------------------------

    def deal(self, name: str, *cards: Any) -> Any:
        """Return the next of some values: each is returned once before one is repeated."""
        deck = self.decks.setdefault(name, [])
        if not deck:
            deck += cards
            self.random.shuffle(deck)
        return deck.pop()

    def cycle(self) -> None:
        """Choose faults, end them, and wait until all stores are equal."""
        for _ in range(self.random.randint(1, self.most)):
            self.fault()
        self.settle()

    def fault(self) -> None:
        """Choose a network state and a fault."""
        network = self.network
        network.loss = self.deal("loss", 0.0, 0.01, 0.05, 0.1)
        network.delay = self.deal("delay", 0.0, 0.0, 0.2)
        network.reorder = network.double = self.deal("reorder", 0.0, 0.3)
        faults: dict[str, Callable[[], None]] = {
            "nothing more": lambda: self.look(self.pace),
            "cut": lambda: self.cut(self.random.choice([*self.nodes, self.router])),
            "home killed": lambda: self.restart(self.one("home")),
            "mirror killed": lambda: self.restart(self.one("mirror")),
            "router killed": lambda: self.restart(self.router),
            "process stopped": lambda: self.stop(self.random.choice([*self.nodes, self.router])),
            "promoted": lambda: self.promote(self.one("home")),
            "promoted in a cut": lambda: self.promote(self.one("home"), self.isolate),
            "promoted while the home is stopped": lambda: self.promote(self.one("home"), self.halt),
        }
        name = self.deal("fault", *faults)
        self.found[name] += 1
        text = f"{network.loss:.0%} lost, {network.delay:g} s, {network.reorder:.0%} reordered"
        print(f"{name}; {text}", flush=True)
        self.look(self.random.uniform(0.2, 1.0) * self.pace)
        faults[name]()

    def one(self, role: str) -> Node:
        """Choose a node with a role; any node, if none has the role now."""
        return self.random.choice([node for node in self.nodes if node.role == role] or self.nodes)

    def cut(self, node: Node) -> None:
        """Cut a node off for one of the durations, in one or both directions."""
        self.isolate(node, self.deal("ways", "both", "both", "mute", "deaf"))
        self.look_for_long("cuts")

    def isolate(self, node: Node, ways: str = "both") -> None:
        """Cut a node off."""
        if ways != "deaf":
            self.network.mute.add(node.number)
        if ways != "mute":
            self.network.deaf.add(node.number)

    def stop(self, node: Node) -> None:
        """Suspend a process for one of the durations."""
        self.halt(node)
        self.look_for_long("stops")
        self.halt(node, signal.SIGCONT)

    def halt(self, node: Node, how: signal.Signals = signal.SIGSTOP) -> None:
        """Suspend a process, or continue it."""
        assert node.process is not None
        node.process.send_signal(how)

    def restart(self, node: Node) -> None:
        """Kill a process, and start it again."""
        self.kill(node)
        self.look(self.random.uniform(0.0, 1.0) * self.pace)
        self.start(node)
        self.look(self.pace)

    def promote(self, home: Node, hold: Callable[[Node], None] | None = None) -> None:
        """Promote a mirror while the old home runs; the old home may be cut off, suspended and
        killed.
        """
        if hold is not None:
            hold(home)
        later = self.one("mirror")
        if later.role == "mirror" and not later.is_promoted:
            later.is_promoted = True
            self.say(later, f"promote {next(self.tags)}")
        if hold is None:
            self.look(self.pace)
            return
        self.look_for_long("homes held off")
        if self.deal("old home", "lives", "lives", "is killed") == "is killed":
            self.restart(home)
        self.halt(home, signal.SIGCONT)

    def look_for_long(self, what: str) -> None:
        """Check all states for one of the durations."""
        seconds = self.deal(what, *self.spans)
        self.found[f"{what} of {seconds:g} s"] += 1
        self.look(seconds)

    # -- the end of a cycle ------------------------------------------------------------------------

    def settle(self) -> None:
        """End all faults: one home must remain, and all mirrors must equal it."""
        self.network.mend()
        until = time.monotonic() + LONGEST
        while True:
            home = self.paused_home(until)
            mirrors = [node for node in self.nodes if node is not home]
            while home.paused is not None and not self.are_equal(home, mirrors):
                self.wait(until, "mirrors that have the home's last commit")
            if home.paused is not None:
                break
        assert home.copy is not None
        for node in mirrors:
            assert node.copy is not None
            if state_of(node.copy.buffer) != state_of(home.copy.buffer):
                raise BrokenPromiseError(f"node {node.number} differs from its home")
            if node.copy.steps_back > node.rewound:
                raise BrokenPromiseError(f"node {node.number} went back without a word")
        while self.forks:
            self.found["forks compared"] += self.judge.compare_fork(*self.forks.pop())
        self.say(home, "go")
        home.paused = None

    def paused_home(self, until: float) -> Node:
        """Wait until only one home remains, and pause it."""
        asked: Node | None = None
        while asked is None or asked.paused is None:
            homes = [node for node in self.nodes if node.role == "home"]
            if len(homes) == 1 and homes[0] is not asked:
                asked = homes[0]
                asked.paused = None
                self.say(asked, "pause")
            self.wait(until, "one home")
            if asked is not None and asked.role != "home":
                asked = None
        return asked

    def are_equal(self, home: Node, mirrors: list[Node]) -> bool:
        """Whether all mirrors are live at the home's last commit."""
        if home.role != "home":
            home.paused = None
        return home.paused is not None and all(
            (node.role, node.state, node.is_promoted) == ("mirror", "live", False)
            and node.copy is not None
            and node.copy.place == home.paused
            for node in mirrors
        )

    def wait(self, until: float, what: str) -> None:
        """Continue to check states; fail after the time limit."""
        self.look_once()
        if time.monotonic() > until:
            told = [
                (node.number, node.role, node.state, node.paused, node.copy and node.copy.place)
                for node in self.nodes
            ]
            raise BrokenPromiseError(f"no {what} after {LONGEST} s: {told}; {self.said()}")


def close_pipes(process: subprocess.Popen[bytes]) -> None:
    """Close the ends of a process that has ended."""
    for pipe in (process.stdin, process.stdout):
        assert pipe is not None
        with suppress(BrokenPipeError):  # an unread line
            pipe.close()


def main() -> None:
    """Run cycles, and print the counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cycles", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--pause", type=float, default=0.02, help="seconds between two commits")
    parser.add_argument("--most", type=int, default=3, help="faults of a cycle, at most")
    given = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    with Faults(
        given.seed,
        spans=(1.0, 3.0, 3.0, 30.0),
        pace=1.5,
        most=given.most,
        pause=given.pause,
    ) as faults:
        for number in range(given.cycles):
            faults.cycle()
            print(f"cycle {number + 1}: {faults.judge.states:,} states judged", flush=True)
        counted = ", ".join(f"{number:,} {what}" for what, number in sorted(faults.found.items()))
        packets = f"{faults.network.lost:,} of {faults.network.packets:,} packets lost"
        print(f"{given.cycles} cycles, {faults.judge.states:,} states judged, {packets}: {counted}")


if __name__ == "__main__":
    main()
