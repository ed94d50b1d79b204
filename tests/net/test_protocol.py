"""The protocol without a network: random losses, kills, restarts and promotions."""

from __future__ import annotations

import os
import random
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import pytest

import tfdb
from tests.net.world import SOURCE, BrokenPromiseError, World
from tests.recorder.reading import state_of
from tests.test_changes import pose
from tfdb.data.errors import InvalidArgument
from tfdb.data.types import Epoch
from tfdb.net import messages, receiving, sending
from tfdb.net.events import EventLog
from tfdb.net.home import HomeStats
from tfdb.net.messages import NONE, Question, Told
from tfdb.net.mirroring import MirrorStats
from tfdb.net.receiving import Receiver
from tfdb.net.sending import Origin, Sender, epoch_for

if TYPE_CHECKING:
    from collections.abc import Iterator

STATS: Any = {"home": HomeStats, "mirror": MirrorStats}
WORLDS = int(os.environ.get("TFDB_NET_WORLDS", "40"))


def run(seed: int) -> World:
    """Run one random network to its end."""
    world = World(seed)
    for _ in range(3000):
        world.step()
    world.settle()
    return world


def test_random_worlds_keep_all_promises() -> None:
    worlds = [run(seed) for seed in range(WORLDS)]
    assert sum(world.checked for world in worlds) > 50 * WORLDS
    assert sum(world.rewound for world in worlds) > WORLDS
    assert sum(world.fenced for world in worlds) > WORLDS


def finds(seeds: int = 60) -> bool:
    """Whether a seeded fault is found."""
    for seed in range(seeds):
        try:
            run(seed)
        except (BrokenPromiseError, tfdb.TfdbError):
            return True
    return False


def test_homes_with_equal_epochs_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    usual = World.next_epoch
    monkeypatch.setattr(
        World, "next_epoch", lambda self, node: Epoch(usual(self, node).number, bytes(16))
    )
    assert finds()


def test_a_promoted_store_that_keeps_its_epoch_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        World, "next_epoch", lambda self, node: max(NONE, *self.forks, Epoch(1, b"x" * 16))
    )
    assert finds()


def test_a_rewind_without_a_word_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    usual = EventLog.add

    def add(self: EventLog, kind: Any, *rest: Any) -> None:
        if kind != "rewound":
            usual(self, kind, *rest)

    monkeypatch.setattr(EventLog, "add", add)
    assert finds()


def test_a_mirror_that_never_asks_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Receiver, "question", lambda self, now: None)
    assert finds()


def test_a_mirror_that_goes_on_from_another_commit_than_the_fork_is_found(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    usual = Receiver._pass_fork

    def pass_fork(self: Receiver, head: messages.Head) -> None:
        if self.position is not None:
            usual(self, head._replace(previous=self.position.epoch, fork=self.position.commit))

    monkeypatch.setattr(Receiver, "_pass_fork", pass_fork)
    assert finds()


def test_a_home_that_counts_commits_of_its_own_as_the_forks_is_found(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def late(*given: Any) -> sending.Origin:
        origin = sending.take_over(*given)
        return origin._replace(begin=origin.begin + 1)

    monkeypatch.setattr("tests.net.world.take_over", late)
    assert finds()


# -- single steps ----------------------------------------------------------------------------------


@pytest.fixture
def home() -> Iterator[Sender]:
    """A home whose store has ten commits, in its own epoch."""
    buf = tfdb.Buffer()
    write(buf, 10)
    sender = Sender(buf, Epoch(5, b"e" * 16))
    yield sender
    sender.close()


def write(buf: tfdb.Buffer, count: int) -> None:
    """Commit."""
    for _ in range(count):
        number = buf.commit
        buf.set_transform("map", f"frame{number % 3}", number, *pose(number))


def new_mirror(into: tfdb.Buffer | None = None) -> Receiver:
    """A mirror without a position."""
    return Receiver(into or tfdb.Buffer(), SOURCE, "", (), EventLog(SOURCE))


def kinds(receiver: Receiver) -> list[str]:
    """Return the kinds of its events."""
    found, number = [], 0
    while True:
        number, event = receiver._log.after(number)
        if event is None:
            return found
        found.append(event.kind)


def answered(receiver: Receiver, sender: Sender, now: float) -> Question:
    """Send the due request, and process the answer."""
    question = receiver.question(now)
    assert question is not None
    take_answer(receiver, sender.answer(question), now)
    return question


def take_answer(receiver: Receiver, answer: list[bytes], now: float) -> None:
    """Process all messages of an answer, and its end."""
    for each in answer:
        receiver.take_reply(each, now)
    receiver.answered(now)


def test_a_late_joiner_takes_the_state_and_goes_on(home: Sender) -> None:
    receiver = new_mirror()
    assert receiver.state == "absent"
    assert receiver.question(0.0) is None
    receiver.take(home.head(), 0.0)
    assert receiver.state == "catching up"
    assert answered(receiver, home, 0.0) == Question(home.epoch, None)
    assert (receiver.state, receiver.states) == ("live", 1)
    write(home._buffer, 3)
    message = home.next()
    assert message is not None
    receiver.take(message, 0.1)
    receiver.take(message, 0.1)
    assert receiver.question(0.1) is None
    assert (receiver.state, receiver.commits) == ("live", 3)
    assert state_of(receiver._buffer) == state_of(home._buffer)
    assert kinds(receiver) == ["catching up", "live"]


def test_a_gap_is_asked_for_once_and_later_commits_are_kept(home: Sender) -> None:
    receiver = new_mirror()
    receiver.take(home.head(), 0.0)
    answered(receiver, home, 0.0)
    sent = []
    for _ in range(3):
        write(home._buffer, 2)
        sent.append(home.next())
    receiver.take(sent[2] or b"", 0.1)
    assert receiver.state == "catching up"
    question = receiver.question(0.1)
    assert question == Question(home.epoch, 10, home.epoch)
    assert receiver.question(0.2) is None, "one at a time"
    receiver.take(sent[0] or b"", 0.2)
    receiver.take(sent[1] or b"", 0.2)
    assert (receiver.state, receiver.commits) == ("live", 6)
    for message in home.answer(question):
        receiver.take(message, 0.3)
    receiver.answered(0.3)
    assert (receiver.state, receiver.states) == ("live", 1)


def test_a_head_shows_that_commits_were_lost(home: Sender) -> None:
    receiver = new_mirror()
    receiver.take(home.head(), 0.0)
    answered(receiver, home, 0.0)
    write(home._buffer, 2)
    home.next()
    receiver.take(home.head(), 0.5)
    assert receiver.state == "catching up"
    answered(receiver, home, 0.5)
    assert (receiver.state, receiver.commits, receiver.states) == ("live", 2, 1)


def test_a_false_head_is_forgotten_when_the_home_answers(home: Sender) -> None:
    receiver = new_mirror()
    receiver.take(home.head(), 0.0)
    answered(receiver, home, 0.0)
    false = messages.Head(home.epoch, 1 << 40, NONE, 0)
    receiver.take(messages.head_bytes(false), 0.1)
    assert receiver.state == "catching up"
    assert answered(receiver, home, 0.1) == Question(home.epoch, 10, home.epoch)
    assert (receiver.state, receiver.newest) == ("live", 10)
    receiver.take(messages.head_bytes(false), 1.0)
    question = receiver.question(1.0)
    assert question is not None
    answer = home.answer(question)
    write(home._buffer, 2)
    sent = home.next() or b""
    receiver.take(messages.head_bytes(false._replace(commit=1 << 41)), 1.1)
    take_answer(receiver, answer, 1.2)
    assert receiver.state == "catching up", "that was heard after the question"
    receiver.take(sent, 1.3)
    answered(receiver, home, 5.0)
    assert (receiver.state, receiver.newest) == ("live", 12)
    receiver.answered(6.0)
    assert receiver.state == "live"


def test_parts_that_were_not_asked_for_are_not_kept(home: Sender) -> None:
    receiver = new_mirror()
    receiver.take(home.head(), 0.0)
    for part in messages.state_messages(home.epoch, 11, b"x" * 300, piece=100)[:2]:
        receiver.take(part, 0.0)
    assert receiver._parts == {}
    answered(receiver, home, 0.0)
    assert receiver.position is not None


def test_unanswered_questions_come_slower_and_slower(home: Sender) -> None:
    receiver = new_mirror()
    receiver.take(home.head(), 0.0)
    times, now = [], 0.0
    while now < 20:
        if receiver.question(now) is not None:
            times.append(now)
            receiver.answered(now)
        now += 0.01
    pauses = [b - a for a, b in pairwise(times)]
    assert 10 < len(times) < 25
    assert pauses[0] < 0.1
    assert max(pauses) <= 2.02
    answered(receiver, home, now + 5)
    assert receiver.state == "live"


def test_a_mirror_of_a_lapped_home_takes_a_state(home: Sender) -> None:
    receiver = new_mirror()
    receiver.take(home.head(), 0.0)
    answered(receiver, home, 0.0)
    write(home._buffer, 20_000)
    message = home.next()
    assert message is not None
    assert home.lapped == 20_000
    receiver.take(message, 0.1)
    answered(receiver, home, 0.1)
    assert (receiver.state, receiver.states) == ("live", 2)
    assert state_of(receiver._buffer) == state_of(home._buffer)


def test_a_state_in_parts_is_applied_when_the_last_came(
    home: Sender, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        sending, "state_messages", lambda *each: messages.state_messages(*each, piece=100)
    )
    parts = home.answer(Question(home.epoch, None))[1:]
    assert len(parts) > 3
    receiver = new_mirror()
    receiver.take(home.head(), 0.0)
    assert receiver.question(0.0) is not None
    for part in parts[1:]:
        receiver.take(part, 0.0)
        receiver.take(part, 0.0)
    assert receiver.position is None
    receiver.answered(0.0)
    assert receiver.question(5.0) is not None
    receiver.take(parts[0], 5.0)
    receiver.answered(5.0)
    assert receiver.position is None, "parts of two answers make no state"
    assert receiver.question(10.0) is not None
    for part in reversed(parts):
        receiver.take(part, 10.0)
    receiver.answered(10.0)
    assert receiver.state == "live"
    assert state_of(receiver._buffer) == state_of(home._buffer)


def test_an_answer_has_short_messages(home: Sender) -> None:
    receiver = new_mirror(tfdb.Buffer(history=None))
    receiver.take(home.head(), 0.0)
    answered(receiver, home, 0.0)
    write(home._buffer, 10_000)
    _, *commits = home.answer(Question(home.epoch, 10, home.epoch))
    assert len(commits) > 2
    assert max(map(len, commits)) < 2 * messages.PIECE
    for each in commits:
        receiver.take_reply(each, 0.0)
    assert receiver.position is not None
    assert receiver.position.commit == home._buffer.commit
    _, *parts = home.answer(Question(home.epoch, None))
    assert len(parts) > 1
    assert max(map(len, parts)) < 2 * messages.PIECE


def test_a_large_state_has_no_more_parts_than_a_mirror_accepts(home: Sender) -> None:
    state = bytes(10 * messages.MOST_PARTS + 1)
    made = messages.state_messages(home.epoch, 1, state, piece=10)
    parts = [messages.message_of(each) for each in made]
    assert len(parts) <= messages.MOST_PARTS
    assert b"".join(each.data for each in parts if isinstance(each, messages.Part)) == state


def test_a_silent_home_and_one_without_its_token_are_stale(home: Sender) -> None:
    receiver = new_mirror()
    receiver.find_home(home.epoch, 0.0)
    assert receiver.state == "catching up"
    answered(receiver, home, 0.0)
    receiver.lose_home(Epoch(1, b"x" * 16), 0.5)
    assert receiver.state == "live"
    receiver.lose_home(home.epoch, 1.0)
    assert (receiver.state, receiver.since) == ("stale", 0.0)
    receiver.take(home.head(), 2.0)
    assert receiver.state == "live"
    receiver.tick(2.0 + receiving.SILENCE)
    assert receiver.state == "live"
    receiver.tick(2.1 + receiving.SILENCE)
    assert receiver.state == "stale"


def test_a_later_home_rewinds_a_mirror_that_is_beyond_the_fork(home: Sender) -> None:
    ahead, behind = new_mirror(), new_mirror()
    for receiver in (ahead, behind):
        receiver.take(home.head(), 0.0)
        answered(receiver, home, 0.0)
    write(home._buffer, 2)
    message = home.next() or b""
    ahead.take(message, 0.1)
    promoted = Sender(behind._buffer, Epoch(6, b"f" * 16), Origin(home.epoch, 10))
    third = new_mirror()
    third.take(home.head(), 0.1)
    third.take(promoted.head(), 0.1)
    third.take(message, 0.1)
    assert third.outdated == 1
    for receiver in (ahead, third):
        receiver.take(promoted.head(), 0.2)
        answered(receiver, promoted, 0.2)
        assert receiver.position is not None
        assert receiver.position.epoch == promoted.epoch
        assert state_of(receiver._buffer) == state_of(behind._buffer)
    assert kinds(ahead) == ["catching up", "live", "catching up", "rewound", "live"]
    assert kinds(third) == ["catching up", "live"]
    promoted.close()


def test_a_mirror_that_is_too_far_behind_takes_a_state(home: Sender) -> None:
    receiver = Receiver(tfdb.Buffer(), SOURCE, "", (), EventLog(SOURCE), max_lag=3)
    receiver.take(home.head(), 0.0)
    answered(receiver, home, 0.0)
    for count, question in (
        (3, Question(home.epoch, 10, home.epoch)),
        (4, Question(home.epoch, None)),
    ):
        write(home._buffer, count)
        while home.next() is not None:
            pass
        receiver.take(home.head(), 0.1)
        assert answered(receiver, home, 0.1) == question
        assert receiver.state == "live"
        assert state_of(receiver._buffer) == state_of(home._buffer)
    assert receiver.states == 2


def test_two_homes_answer_and_the_later_one_counts(home: Sender) -> None:
    other = tfdb.Buffer()
    write(other, 3)
    later = Sender(other, Epoch(5, b"f" * 16))
    for order in ((home, later), (later, home)):
        receiver = new_mirror()
        receiver.find_home(home.epoch, 0.0)
        question = receiver.question(0.0)
        assert question is not None
        for sender in order:
            for message in sender.answer(question):
                receiver.take(message, 0.0)
        receiver.answered(0.0)
        assert receiver.position is not None
        assert (receiver.position.epoch, receiver.state) == (later.epoch, "live")
        assert state_of(receiver._buffer) == state_of(other)
    later.close()


def test_a_state_that_cannot_be_stored_is_refused_until_it_can(home: Sender) -> None:
    into = tfdb.Buffer(max_frames=len(home._buffer.frames()))
    into.set_static_transform("a", "b", *pose(1))
    receiver = new_mirror(into)
    receiver.take(home.head(), 0.0)
    answered(receiver, home, 0.0)
    assert (receiver.position, receiver.refused, receiver.state) == (None, 1, "catching up")
    answered(receiver, home, 5.0)
    assert receiver.refused == 2
    assert kinds(receiver) == ["catching up", "refused"], "each cause is told once"
    into.remove_frames(["a", "b"])
    answered(receiver, home, 10.0)
    assert receiver.state == "live"


def test_an_error_of_the_own_store_ends_the_mirror(home: Sender) -> None:
    into = tfdb.Buffer()
    receiver = new_mirror(into)
    receiver.take(home.head(), 0.0)
    question = receiver.question(0.0)
    assert question is not None
    into.close()
    head, state = home.answer(question)
    receiver.take(head, 0.0)
    with pytest.raises(tfdb.errors.BufferClosed):
        receiver.take(state, 0.0)


def test_damaged_messages_change_nothing(home: Sender) -> None:
    write(home._buffer, 1)
    kept = [home.head(), home.next() or b"", *home.answer(Question(home.epoch, None))]
    kept += messages.state_messages(home.epoch, 10, b"x" * 300, piece=100)
    receiver = new_mirror()
    count = 0
    for whole in kept:
        for at in range(len(whole)):
            broken = bytearray(whole)
            broken[at] ^= 0x41
            for data in (bytes(broken), whole[:at], whole + b"\0"):
                receiver.take(data, 0.0)
                count += 1
    assert (receiver.refused, receiver.known, receiver.state) == (count, NONE, "absent")
    assert receiver._buffer.commit == 0


@pytest.mark.parametrize(
    ("kind", "body", "reason"),
    [
        (5, b"x" * 8, "unknown kind 5"),
        (3, b"x" * 47, "a head has another size"),
        (3, b"\xff" * 48, "beyond 2\\^44"),
        (4, bytes(8) + b"\1\0\0\0\1\0\0\0x", "part 1 of 1"),
        (4, bytes(8) + b"\0\0\0\0\1\x10\0\0x", "part 0 of 4097"),
        (4, bytes(16), "of 0 bytes"),
        (1, b"\0\0\0\0" + b"\x80" * 60, "more than ten bytes"),
        (2, b"", "cut short"),
    ],
)
def test_sealed_messages_are_judged(kind: int, body: bytes, reason: str) -> None:
    with pytest.raises(tfdb.errors.CorruptMessage, match=reason):
        messages.message_of(messages._sealed(kind, Epoch(3, b"i" * 16), body))
    with pytest.raises(tfdb.errors.CorruptMessage, match=r"below 2\^63"):
        messages.message_of(messages._sealed(3, Epoch(1 << 63, bytes(16)), bytes(48)))


def test_statuses_are_read_as_written_and_damaged_ones_are_refused() -> None:
    assert {role: len(each._fields) for role, each in STATS.items()} == messages._COUNTS
    for role, states in messages._STATES.items():
        counts = tuple(range(len(STATS[role]._fields)))
        for state in states:
            told = Told(Epoch(3, b"i" * 16), role, state, "0f" * 8, 7, 9, 10**9, counts)  # type: ignore[arg-type]
            whole = messages.status_bytes(told)
            assert messages.status_of(whole) == told
        for at in range(len(whole)):
            broken = bytearray(whole)
            broken[at] ^= 0x41
            for data in (bytes(broken), whole[:at], whole + b"\0"):
                with pytest.raises(tfdb.errors.CorruptMessage):
                    messages.status_of(data)
        with pytest.raises(tfdb.errors.CorruptMessage, match="unknown kind 5"):
            messages.message_of(whole)


def test_sealed_statuses_of_random_bytes_are_refused_or_valid() -> None:
    draw = random.Random(5)
    kept = 0
    for _ in range(20_000):
        role = draw.randrange(3)
        front = bytes((role, draw.randrange(8))) + draw.randbytes(8)
        numbers = [draw.getrandbits(draw.choice((8, 44, 45, 63, 64))) for _ in range(9 + 2 * role)]
        body = front + b"".join(each.to_bytes(8, "little") for each in numbers)
        data = messages._sealed(5, Epoch(3, b"i" * 16), body)
        try:
            told = messages.status_of(data)
        except tfdb.errors.CorruptMessage:
            continue
        kept += 1
        assert messages.status_bytes(told) == data
        assert max(told.commit, told.newest) < 1 << 44
    assert 20 < kept < 19_000


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        (b"\2\0" + bytes(80), "role 2, state 0"),
        (b"\0\4" + bytes(80), "role 0, state 4"),
        (bytes(88), "the status of a home has another size"),
        (b"\1\0" + bytes(80), "the status of a mirror has another size"),
        (bytes(10) + b"\xff" * 8 + bytes(64), "beyond 2\\^44"),
        (bytes(74) + b"\xff" * 8, "beyond 2\\^63"),
        (bytes(9), "requires a buffer"),
    ],
)
def test_sealed_statuses_are_judged(body: bytes, reason: str) -> None:
    with pytest.raises(tfdb.errors.CorruptMessage, match=reason):
        messages.status_of(messages._sealed(5, Epoch(3, b"i" * 16), body))


def test_gaps_and_the_time_since_commits_are_missing_are_counted(home: Sender) -> None:
    receiver = new_mirror()
    assert receiver.lacking_since is None
    receiver.take(home.head(), 1.0)
    assert (receiver.lacking_since, receiver.gaps) == (1.0, 0)
    answered(receiver, home, 1.5)
    assert receiver.lacking_since is None
    write(home._buffer, 2)
    home.next()
    receiver.take(home.head(), 2.0)
    assert (receiver.lacking_since, receiver.gaps) == (2.0, 1)
    receiver.tick(2.5 + receiving.SILENCE)
    assert (receiver.state, receiver.lacking_since) == ("stale", 2.0)
    receiver.take(home.head(), 6.0)
    answered(receiver, home, 6.0)
    assert (receiver.state, receiver.lacking_since, receiver.gaps) == ("live", None, 2)
    receiver.lose_home(home.epoch, 7.0)
    assert (receiver.state, receiver.lacking_since) == ("stale", 6.0)


@pytest.mark.parametrize("missed", [0, 3])
def test_a_mirror_that_continues_is_live_after_a_message_of_its_home(
    home: Sender, missed: int
) -> None:
    into = tfdb.Buffer()
    first = new_mirror(into)
    first.take(home.head(), 0.0)
    answered(first, home, 0.0)
    write(home._buffer, missed)
    home.next()
    receiver = new_mirror(into)
    receiver.find_home(home.epoch, 1.0)
    assert (receiver.state, receiver.lacking_since, receiver.gaps) == ("catching up", 1.0, 0)
    assert answered(receiver, home, 1.1) == Question(home.epoch, 10, home.epoch)
    assert (receiver.state, receiver.commits, receiver.gaps) == ("live", missed, missed > 0)
    receiver.lose_home(home.epoch, 2.0)
    assert receiver.question(3.0) is None
    write(home._buffer, missed)
    home.next()
    receiver.find_home(home.epoch, 4.0)
    assert receiver.state == "catching up"
    receiver.take(home.head(), 4.5)
    assert receiver.state == ("catching up" if missed else "live")


def test_questions_and_epochs_as_text() -> None:
    epoch = Epoch(12, bytes(range(16)))
    for question in (Question(epoch, 7, epoch), Question(epoch, None)):
        read = dict(part.split("=") for part in str(question).split(";"))
        parts = [read.get(each) for each in ("since", "of", "epoch")]
        assert messages.question_of(*parts) == question
    for since, text in (("-1", "1-" + "0" * 32), ("1", "1-00"), ("1", ""), ("٣", "1-" + "0" * 32)):
        with pytest.raises(ValueError, match="is not"):
            messages.question_of(since, text, text)


def test_the_epoch_of_a_new_home(name: str) -> None:
    private = tfdb.Buffer()
    write(private, 1)
    assert epoch_for(private, SOURCE, []) > private.epoch
    shared = tfdb.Buffer.open(name, create=True, size=1 << 25)
    assert epoch_for(shared, SOURCE, []) == shared.epoch
    assert epoch_for(shared, SOURCE, [Epoch(3, bytes(16)), shared.epoch]) == shared.epoch
    later = Epoch(1 << 62, bytes(16))
    assert epoch_for(shared, SOURCE, [later]).number == later.number + 1
    for number in ((1 << 63) - 1, 1 << 63):
        with pytest.raises(InvalidArgument, match=f"^epoch {number} of a token"):
            epoch_for(shared, SOURCE, [Epoch(number, bytes(16))])
    shared.apply(private.commits_bytes(0), source=SOURCE)
    assert epoch_for(shared, "other", []) == shared.epoch
    assert epoch_for(shared, SOURCE, []) > shared.epoch, "it was a mirror: its log may fork"
    shared.close()


def test_a_mirror_of_a_later_home_asks_an_earlier_one_so_that_it_stops(home: Sender) -> None:
    """The earlier home's machine may have a slow clock, and the home may have started without a
    mirror.
    """
    into = tfdb.Buffer()
    later = Sender(home._buffer, Epoch(6, b"f" * 16))
    receiver = new_mirror(into)
    receiver.take(later.head(), 0.0)
    answered(receiver, later, 0.0)
    receiver.take(home.head(), 0.1)
    assert receiver.question(0.1) is None, "the later home is there"
    receiver.lose_home(later.epoch, 0.2)
    assert receiver.question(0.2) is None
    receiver.take(home.head(), 0.5)
    assert receiver.question(0.5) == Question(later.epoch, 10, later.epoch)
    receiver.answered(0.5)
    assert receiver.question(5.0) is None
    again = new_mirror(into)
    assert again.question(6.0) is None
    again.take(home.head(), 6.0)
    assert again.question(6.0) == Question(later.epoch, 10, later.epoch)
    assert again.state == "absent"
    later.close()
