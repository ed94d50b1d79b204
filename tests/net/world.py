"""Homes and mirrors in a network that loses, doubles, delays and reorders, step by step.

Each visible state of a mirror is compared with the state of its epoch's home at that commit.
"""

from __future__ import annotations

import random
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import tfdb
from tests.recorder.reading import state_of
from tests.test_changes import Writer
from tfdb.data.types import Epoch
from tfdb.net.events import EventLog
from tfdb.net.messages import NONE
from tfdb.net.receiving import Receiver
from tfdb.net.sending import Sender, step_back, take_over

if TYPE_CHECKING:
    from tfdb.net.messages import Question

SOURCE = "robot1"


class BrokenPromiseError(AssertionError):
    """The protocol has broken a guarantee."""


@dataclass
class Node:
    """A process with a store, which is a home, a mirror, or dead."""

    number: int
    buffer: tfdb.Buffer
    log: EventLog = field(default_factory=lambda: EventLog(SOURCE))
    sender: Sender | None = None
    receiver: Receiver | None = None
    was_home: bool = False
    life: int = 0
    seen: tuple[Epoch, int] = (NONE, 0)
    """The last visible position of its store."""
    read: int = 0


class World:
    """Three nodes. Threads: one."""

    def __init__(self, seed: int, *, calm: bool = False) -> None:
        self.random = random.Random(seed)
        self.writer = Writer(seed)
        self.loss = 0.0 if calm else self.random.choice([0.0, 0.05, 0.3])
        self.sight = 0.7
        """Probability that a new home sees a token."""
        self.now = 0.0
        self.flight: list[tuple[int, int, str, Any]] = []
        """Messages in transit: target node, its life, kind, and content."""
        self.history: dict[tuple[Epoch, int], bytes] = {}
        self.forks: dict[Epoch, tuple[Epoch, int]] = {}
        self.checked = self.rewound = 0
        self.fenced = 0
        self.nodes = [Node(number, self.new_store()) for number in range(3)]
        self.begin_home(self.nodes[0])
        for node in self.nodes[1:]:
            self.begin_mirror(node)

    def new_store(self) -> tfdb.Buffer:
        """Create a store with unlimited history."""
        return tfdb.Buffer(history=None)

    # -- lives -------------------------------------------------------------------------------------

    def next_epoch(self, node: Node) -> Epoch:
        """Return `epoch_for` of a store that survives its process; some tokens are invisible."""
        others = [each for each in self.nodes if each is node or self.random.random() < self.sight]
        seen = [NONE, *(each.sender.epoch for each in others if each.sender)]
        seen += [each.receiver.known for each in others if each.receiver]
        seen += [each.epoch for each in node.buffer.positions()]
        own = Epoch(1, node.buffer.epoch.id)
        if not node.buffer.positions() and own >= max(seen):
            return own
        return Epoch(max(seen).number + 1, self.random.randbytes(16))

    def begin_home(self, node: Node) -> None:
        """Turn a node into a home, even if it was a mirror."""
        node.receiver, node.was_home = None, True
        epoch = self.next_epoch(node)
        origin = take_over(node.buffer, SOURCE, epoch)
        node.sender = Sender(node.buffer, epoch, origin)
        node.life += 1
        self.forks.setdefault(epoch, origin[:2])
        self.note(node)
        self.tell(node, alive=True)

    def begin_mirror(self, node: Node) -> None:
        """Turn a node into a mirror, even if it was promoted before."""
        node.sender = None
        step_back(node.buffer, SOURCE, tuple)
        for each in node.buffer.positions():
            node.seen = max(node.seen, (each.epoch, each.commit))
        node.log, node.read = EventLog(SOURCE), 0
        node.receiver = Receiver(
            node.buffer, SOURCE, "", (), node.log, random.Random(self.random.random())
        )
        node.life += 1
        for other in self.nodes:
            if other.sender is not None:
                self.send(node, "token", (other.sender.epoch, True))

    def kill(self, node: Node) -> None:
        """End a process; its store stays."""
        if node.sender is not None:
            self.tell(node, alive=False)
            node.sender.close()
        node.sender = node.receiver = None
        node.life += 1

    def rise(self, node: Node) -> None:
        """Restart a process, with its store or an empty one."""
        if node.was_home and self.random.random() < 0.6:
            self.begin_home(node)
            return
        # The data of a home that was never a mirror does not belong to the source, unless a later
        # home replaced it.
        if (node.was_home and not node.buffer.positions()) or self.random.random() < 0.3:
            self.empty(node)
        self.begin_mirror(node)

    def empty(self, node: Node) -> None:
        """Replace the store of a node by a new one."""
        node.buffer, node.seen = self.new_store(), (NONE, 0)
        node.was_home = False

    def promote(self, node: Node) -> None:
        """Promote a mirror."""
        assert node.receiver is not None
        if node.receiver.position is not None:
            self.begin_home(node)

    # -- the network -------------------------------------------------------------------------------

    def send(self, node: Node, kind: str, what: Any) -> None:
        """Send a message to a node: once, twice or never."""
        times = 1
        if kind == "log":
            times = 0 if self.random.random() < self.loss else 1
            times += self.random.random() < self.loss / 2
        self.flight += [(node.number, node.life, kind, what)] * times

    def tell(self, home: Node, *, alive: bool) -> None:
        """Send a home's token to all other nodes."""
        assert home.sender is not None
        for node in self.nodes:
            if node is not home:
                self.send(node, "token", (home.sender.epoch, alive))

    def deliver(self) -> None:
        """Deliver one message in transit."""
        if not self.flight:
            return
        at = self.random.randrange(min(len(self.flight), 12))  # no message waits forever
        number, life, kind, what = self.flight.pop(at)
        node = self.nodes[number]
        if kind == "question":
            self.answer(node, life, what)
        elif node.life != life:
            return
        elif node.sender is not None and kind == "token":
            self.meet(node, what[0] if what[1] else NONE)
        elif node.receiver is not None:
            self.feed(node, node.receiver, kind, what)
            self.check(node)

    def feed(self, node: Node, receiver: Receiver, kind: str, what: Any) -> None:
        """Pass a message to a mirror."""
        if kind == "log":
            receiver.take(what, self.now)
        elif kind == "token":
            (receiver.find_home if what[1] else receiver.lose_home)(what[0], self.now)
        elif what:
            receiver.take_reply(what[0], self.now)
            self.flight.append((node.number, node.life, kind, what[1:]))
        else:
            receiver.answered(self.now)

    def answer(self, asker: Node, life: int, question: Question) -> None:
        """Send a request to all homes."""
        found: list[list[bytes]] = []
        for node in self.nodes:
            if node.sender is None or self.random.random() < self.loss:
                continue
            self.meet(node, question.epoch)
            if node.sender is not None:
                found.append(node.sender.answer(question))
        self.random.shuffle(found)
        messages = [each for part in found for each in part if self.random.random() >= self.loss]
        self.flight.append((asker.number, life, "answer", messages))

    def meet(self, home: Node, epoch: Epoch) -> None:
        """Announce an epoch to a home, which stops if the epoch is later."""
        if home.sender is not None and epoch > home.sender.epoch:
            self.fenced += 1
            epoch = home.sender.epoch
            self.kill(home)
            home.buffer._hand_over(SOURCE, "adopt", epoch)

    # -- steps -------------------------------------------------------------------------------------

    def write(self, home: Node) -> None:
        """Make a commit in the store of a home."""
        self.writer.act(home.buffer)
        self.note(home)

    def pump(self, home: Node) -> None:
        """Send the next message, or a head."""
        assert home.sender is not None
        message = home.sender.next() if self.random.random() < 0.8 else home.sender.head()
        for node in self.nodes:
            if message is not None and node is not home:
                self.send(node, "log", message)

    def ask(self, node: Node) -> None:
        """Send the due request of a mirror."""
        assert node.receiver is not None
        node.receiver.tick(self.now)
        question = node.receiver.question(self.now)
        if question is not None:
            self.flight.append((node.number, node.life, "question", question))
        self.check(node)

    def step(self) -> None:
        """Do one random action."""
        self.now += 0.02
        node = self.random.choice(self.nodes)
        chance = self.random.random()
        if chance < 0.5:
            self.deliver()
        elif node.sender is not None:
            if chance < 0.996:
                (self.write if chance < 0.7 else self.pump)(node)
            else:
                self.kill(node)
        elif node.receiver is not None:
            if chance < 0.992:
                self.ask(node)
            elif chance < 0.996:
                self.kill(node)
            else:
                self.promote(node)
        elif chance > 0.9:
            self.rise(node)

    def settle(self) -> None:
        """End all faults and all homes but one: all mirrors must reach its last commit."""
        self.loss, self.sight = 0.0, 1.0
        homes = [node for node in self.nodes if node.sender is not None]
        for node in homes:
            self.meet(node, max(each.sender.epoch for each in homes if each.sender is not None))
        home = next((node for node in homes if node.sender is not None), self.nodes[0])
        for node in self.nodes:
            if node.sender is None and node.receiver is None:
                self.empty(node)
                self.begin_mirror(node)
        for _ in range(1500):
            self.now += 0.02
            self.deliver()
            if home.sender is None:  # the home stopped, and its user restarts it
                self.kill(home)
                self.begin_home(home)
            for node in self.nodes:
                if node.receiver is not None:
                    self.ask(node)
                elif node.sender is not None and not self.flight:
                    self.pump(node)
        assert home.sender is not None
        for node in self.nodes:
            if node.receiver is None:
                continue
            place = (home.sender.epoch, home.buffer.commit)
            if node.seen != place or node.receiver.state != "live":
                raise BrokenPromiseError(f"{node.seen}, {node.receiver.state}: not at {place}")

    # -- what must hold ----------------------------------------------------------------------------

    def note(self, home: Node) -> None:
        """Store the state of a home."""
        assert home.sender is not None
        place = home.sender.epoch, home.buffer.commit
        state = state_of(home.buffer)
        if self.history.setdefault(place, state) != state:
            raise BrokenPromiseError(f"two homes have another state at {place}")

    def check(self, node: Node) -> None:
        """Compare the state of a mirror with that of its home."""
        found = node.buffer.positions()
        if not found:
            return
        position = found[0]
        place, before = (position.epoch, position.commit), node.seen
        if place == before:
            return
        self.checked += 1
        if place < before:
            raise BrokenPromiseError(f"{before} is followed by {place}")
        if self.history.get(place) != state_of(node.buffer):
            raise BrokenPromiseError(f"at {place} the mirror shows what no home had")
        node.seen = place
        events = []
        while True:
            node.read, event = node.log.after(node.read)
            if event is None:
                break
            events.append(event)
        previous, fork = self.forks[place[0]]
        goes_on = previous == before[0] and before[1] <= fork
        if before[0] not in (NONE, place[0]) and not goes_on:
            self.rewound += 1
            told = [
                each.after for each in events if (each.kind, each.before) == ("rewound", before)
            ]
            # Stored later commits may follow at once.
            if not any(after and after[0] == place[0] and after <= place for after in told):
                raise BrokenPromiseError(f"from {before} to {place} without a word: {events}")
