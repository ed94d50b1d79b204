"""`Home` and `Mirror` with their threads, over a network in memory and over Zenoh."""

from __future__ import annotations

import asyncio
import threading
import time
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import pytest

import tfdb
from tests.net.conftest import LONGEST, free_endpoint, memory_links, needs_zenoh
from tests.net.memory_link import MemoryLink, Network
from tests.recorder.reading import state_of
from tests.test_changes import Writer, pose
from tfdb.data.types import Epoch
from tfdb.net.events import EventLog, NetEvents
from tfdb.net.home import Home, publish, publishes
from tfdb.net.link import Token, check_network_name, name_of, status_key, token_of
from tfdb.net.messages import NONE, Head, head_bytes, in_epoch
from tfdb.net.mirroring import Mirror, mirror
from tfdb.net.receiving import Receiver
from tfdb.net.sending import epoch_after, epoch_for, step_back, take_over

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from tfdb.net.events import Event
    from tfdb.net.link import Link
    from tfdb.net.messages import Question

    Links = Callable[[], Link]

NAME = "site/robot1"


def new_home(buffer: tfdb.Buffer, link: Link, name: str = NAME, **options: Any) -> Home:
    """Create a home on a link, as `publish` does."""
    epoch = epoch_for(buffer, name, [token.epoch for _, token in link.tokens(name)])
    return Home(buffer, name, link, epoch, **options)


def copy_once(buffer: tfdb.Buffer, link: Link) -> None:
    """Copy a home to a store by a mirror, which then stops."""
    mirror = Mirror(buffer, NAME, link)
    mirror.wait_until_live(LONGEST)
    mirror._stop()


def wait_for(events: NetEvents, kind: str) -> Event:
    """Wait for the next event of a kind."""
    until = time.monotonic() + LONGEST
    while time.monotonic() < until:
        event = events.read_next(1.0)
        if event is not None and event.kind == kind:
            return event
    raise AssertionError(f"no event {kind!r} came")


def wait_for_commit(mirror: Mirror, commit: int) -> None:
    """Wait until a mirror has a commit of its home."""
    until = time.monotonic() + LONGEST
    while mirror.position is None or mirror.position.commit < commit:
        assert time.monotonic() < until, (mirror.state, mirror.position, mirror.stats)
        with suppress(tfdb.WaitTimeout):  # the position may have been read just before
            mirror._buffer.wait_for_commit(mirror._buffer.commit, 0.05)


@pytest.mark.parametrize("delay", [0.0, 0.002])
def test_a_mirror_has_all_commits_of_its_home(links: Links, delay: float) -> None:
    source, copy = tfdb.Buffer(), tfdb.Buffer()
    writer = Writer(3)
    for _ in range(50):
        writer.act(source)
    with (
        new_home(source, links(), max_delay=delay) as home,
        Mirror(copy, NAME, links()) as mirror,
    ):
        mirror.wait_until_live(LONGEST)
        for _ in range(300):
            writer.act(source)
        home.close()
        wait_for_commit(mirror, source.commit)
        assert state_of(copy) == state_of(source)
        assert home.stats.commits > 100
        assert home.stats.lapped == 0
        assert mirror.stats.states == 1
        assert mirror.stats.commits == home.stats.commits
        assert (mirror.stats.refused, mirror.stats.outdated) == (0, 0)


def test_a_home_that_is_gone_and_a_new_one(links: Links) -> None:
    first, second, copy = tfdb.Buffer(), tfdb.Buffer(), tfdb.Buffer()
    first.set_transform("map", "base", 10, *pose(1))
    second.set_transform("map", "arm", 10, *pose(2))
    link = links()
    with Mirror(copy, NAME, links()) as mirror, mirror.events() as events:
        assert mirror.state == "absent"
        with new_home(first, link):
            mirror.wait_until_live(LONGEST)
        wait_for(events, "stale")
        assert mirror.silence is not None
        assert copy.frames() == ["base", "map"]
        with new_home(second, link) as home:
            event = wait_for(events, "rewound")
            assert event.after == (home.epoch, 1)
            mirror.wait_until_live(LONGEST)
            assert copy.frames() == ["arm", "map"]
            assert mirror.silence is None


def test_a_shared_store_goes_on_with_its_mirror(links: Links, name: str) -> None:
    link, copy = links(), tfdb.Buffer()
    with Mirror(copy, NAME, links()) as mirror, mirror.events() as events:
        for life in range(3):
            with tfdb.Buffer.open(name, size=1 << 25) as store:
                store.set_transform("map", "base", life, *pose(life))
                with new_home(store, link):
                    mirror.wait_until_live(LONGEST)
                    wait_for_commit(mirror, store.commit)
                    assert state_of(copy) == state_of(store)
            wait_for(events, "stale")
        assert mirror.stats.states == 1


def test_a_mirror_goes_on_from_the_position_in_its_store(links: Links, name: str) -> None:
    source, link = tfdb.Buffer(), links()
    source.set_transform("map", "base", 0, *pose(1))
    with new_home(source, link):
        for life in range(3):
            with (
                tfdb.Buffer.open(name, size=1 << 25) as store,
                Mirror(store, NAME, link) as mirror,
            ):
                mirror.wait_until_live(LONGEST)
                source.set_transform("map", "base", 1 + life, *pose(life))
                wait_for_commit(mirror, source.commit)
                assert state_of(store) == state_of(source)
                assert mirror.stats.states == (life == 0)


def test_a_promoted_mirror_and_the_old_home_in_a_cut_network() -> None:
    with memory_links() as links:
        old, new, third = links(), links(), links()
        source, spare, copy = tfdb.Buffer(), tfdb.Buffer(), tfdb.Buffer()
        source.set_transform("map", "base", 0, *pose(1))
        home = new_home(source, old)
        mirror, other = Mirror(spare, NAME, new), Mirror(copy, NAME, third)
        for each in (mirror, other):
            each.wait_until_live(LONGEST)
        old.is_cut = True  # type: ignore[attr-defined]
        fork = source.commit
        for i in range(5):
            source.set_transform("map", "alone", 10 + i, *pose(i))
        promoted = mirror.promote()
        spare.set_transform("map", "later", 20, *pose(3))
        wait_for_commit(other, spare.commit)
        assert home.state == "publishing", "it hears nothing of the other"
        old.heal()  # type: ignore[attr-defined]
        event = wait_for(home.events(), "fenced")
        assert event.before == (home.epoch, fork)
        assert f"only this store has the commits after {fork}" in event.text
        assert event.after == (home.epoch, fork + 5)
        assert home.state == "fenced"
        assert [each.commit for each in source.changes(fork)][:5] == list(range(fork + 1, fork + 6))
        assert state_of(copy) == state_of(spare)
        kinds = [each.kind for each in list_events(other.events())]
        assert "rewound" not in kinds
        assert other.stats.states == 1, "it was exactly at the fork"
        for each in (promoted, other, mirror, home):
            each.close()


def test_the_store_of_a_fenced_home_is_read_only_and_then_a_mirror(
    links: Links, tmp_path: Path
) -> None:
    source, spare = tfdb.Buffer(), tfdb.Buffer()
    source.set_transform("map", "base", 0, *pose(1))
    lost = tmp_path / "lost"
    link = links()
    home = new_home(source, link, keep_lost=lost)
    mirror = Mirror(spare, NAME, links())
    mirror.wait_until_live(LONGEST)
    with source.snapshot() as snap:
        forked = in_epoch(snap.state_bytes(), home.epoch)
    # Commits that the mirror lacks when it is promoted.
    mirror._stop()
    source.set_transform("map", "alone", 10, *pose(2))
    beyond = state_of(source)
    epoch = epoch_after(home.epoch)
    later = Home(spare, NAME, links(), epoch, origin=take_over(spare, NAME, epoch))
    event = wait_for(home.events(), "fenced")
    assert (event.before, event.after) == ((home.epoch, 1), (home.epoch, 2))
    assert "only this store has the commits after 1" in event.text
    assert f"{lost} has them. Its frames are read-only" in event.text
    for frame in ("base", "alone"):
        with pytest.raises(tfdb.errors.ReadOnly, match=f"comes from source '{NAME}'"):
            source.set_transform("map", frame, 20, *pose(3))
    copy = tfdb.Buffer()
    copy.apply(forked)
    copy.apply(lost.read_bytes())
    assert state_of(copy) == beyond
    home.close()
    spare.set_transform("map", "base", 30, *pose(4))
    with Mirror(source, NAME, link) as back:
        back.wait_until_live(LONGEST)
        wait_for_commit(back, spare.commit)
        assert state_of(source) == state_of(spare)
        rewound = wait_for(back.events(), "rewound")
        assert rewound.before == (home.epoch, 2)
    later.close()


def test_a_home_hears_the_latest_of_two_later_homes(links: Links, tmp_path: Path) -> None:
    source, spare = tfdb.Buffer(), tfdb.Buffer()
    source.set_transform("map", "base", 0, *pose(1))
    lost = tmp_path / "lost"
    home = new_home(source, links(), keep_lost=lost)
    copy_once(spare, links())
    source.set_transform("map", "alone", 10, *pose(2))
    # The first later home ends before its message arrives.
    link = links()
    first = Token("home", epoch_after(home.epoch))
    token = link.announce(NAME, first)
    epoch = epoch_after(first.epoch)
    with Home(spare, NAME, link, epoch, origin=take_over(spare, NAME, epoch)):
        event = wait_for(home.events(), "fenced")
        assert (event.before, event.after) == ((home.epoch, 1), (home.epoch, 2))
        assert f"a later home exists or existed (epoch {epoch.number})" in event.text
        assert f"{lost} has them. Its frames are read-only" in event.text
        token.undeclare()
        home.close()


def test_a_fenced_home_that_lost_nothing_goes_on_as_a_mirror_without_a_state(links: Links) -> None:
    source, spare = tfdb.Buffer(), tfdb.Buffer()
    source.set_transform("map", "base", 0, *pose(1))
    link = links()
    home = new_home(source, link)
    mirror = Mirror(spare, NAME, links())
    mirror.wait_until_live(LONGEST)
    with mirror.promote():
        event = wait_for(home.events(), "fenced")
        assert event.before == event.after == (home.epoch, 1)
        home.close()
        spare.set_transform("map", "later", 20, *pose(3))
        with Mirror(source, NAME, link) as back:
            wait_for_commit(back, spare.commit)  # more than the mirror had
            assert back.stats.states == 0
            assert state_of(source) == state_of(spare)


def test_a_home_keeps_its_state_if_lost_commits_are_gone(links: Links, tmp_path: Path) -> None:
    source, spare = tfdb.Buffer(history=1.0), tfdb.Buffer(history=1.0)
    source.set_transform("map", "base", 0, *pose(1))
    lost = tmp_path / "lost"
    home = new_home(source, links(), keep_lost=lost)
    copy_once(spare, links())
    with Mirror(tfdb.Buffer(), NAME, links()) as other:
        for second in range(10, 20):
            source.set_transform("map", "base", second * 10**9, *pose(2))
            wait_for_commit(other, source.commit)
    with pytest.raises(tfdb.errors.Gone):
        source.commits_bytes(1)
    beyond = state_of(source)
    epoch = epoch_after(home.epoch)
    with Home(spare, NAME, links(), epoch, origin=take_over(spare, NAME, epoch)):
        event = wait_for(home.events(), "fenced")
    assert event.before == (home.epoch, 1)
    assert f"{lost} has the whole state, because not all of them are kept any more" in event.text
    copy = tfdb.Buffer()
    copy.apply(lost.read_bytes())
    assert state_of(copy) == beyond
    home.close()


def test_a_promoted_home_keeps_the_commits_that_it_loses(links: Links, tmp_path: Path) -> None:
    source, spare, other = tfdb.Buffer(), tfdb.Buffer(), tfdb.Buffer()
    source.set_transform("map", "base", 0, *pose(1))
    home = new_home(source, links())
    first, second = Mirror(spare, NAME, links()), Mirror(other, NAME, links())
    for each in (first, second):
        each.wait_until_live(LONGEST)
    lost = tmp_path / "lost"
    promoted = first.promote(keep_lost=lost)
    wait_for_commit(second, spare.commit)
    second._stop()
    with spare.snapshot() as snap:
        forked = in_epoch(snap.state_bytes(), promoted.epoch)
    spare.set_transform("map", "alone", 10, *pose(2))
    beyond = state_of(spare)
    epoch = epoch_after(promoted.epoch)
    with Home(other, NAME, links(), epoch, origin=take_over(other, NAME, epoch)):
        wait_for(promoted.events(), "fenced")
    copy = tfdb.Buffer()
    copy.apply(forked)
    copy.apply(lost.read_bytes())
    assert state_of(copy) == beyond
    promoted.close()
    home.close()


def test_a_home_keeps_its_state_if_no_message_of_the_later_home_comes(
    links: Links, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tfdb.net.home._LAST_WORD", 0.0)
    source, spare = tfdb.Buffer(), tfdb.Buffer()
    source.set_transform("map", "base", 0, *pose(1))
    home = new_home(source, links())
    mirror = Mirror(spare, NAME, links())
    mirror.wait_until_live(LONGEST)
    lost = tmp_path / "lost"
    with mirror.promote(keep_lost=lost) as promoted:
        spare.set_transform("map", "alone", 10, *pose(2))
        last = spare.commit
        link = links()
        token = link.announce(NAME, Token("home", epoch_after(promoted.epoch)))
        event = wait_for(promoted.events(), "fenced")
        assert (event.before, event.after) == (None, (promoted.epoch, last))
        said = f"this home stopped at commit {last}. {lost} has the whole state. No message"
        assert said in event.text
        copy = tfdb.Buffer()
        copy.apply(lost.read_bytes())
        assert state_of(copy) == state_of(spare)
        token.undeclare()
    home.close()


def test_a_promoted_home_that_was_killed_goes_on_as_a_mirror(links: Links) -> None:
    link, spare, other = links(), tfdb.Buffer(), tfdb.Buffer()
    source = tfdb.Buffer()
    source.set_transform("map", "base", 0, *pose(1))
    home = new_home(source, link)
    mirror, second = Mirror(spare, NAME, links()), Mirror(other, NAME, links())
    for each in (mirror, second):
        each.wait_until_live(LONGEST)
    promoted = mirror.promote()
    wait_for(home.events(), "fenced")
    home.close()
    promoted.close()
    spare.set_transform("map", "unsent", 20, *pose(3))  # its messages do not arrive any more
    with second.promote() as last:
        step_back(spare, NAME, lambda: [last.epoch])
        with Mirror(spare, NAME, link) as back:
            back.wait_until_live(LONGEST)
            assert spare.frames() == ["base", "map"]
            assert state_of(spare) == state_of(other)


def promoted_beside(other: tfdb.Buffer, spare: tfdb.Buffer, links: Links) -> tuple[Home, Mirror]:
    """Promote a mirror with the store `spare`; the mirror with the store `other` follows it."""
    source = tfdb.Buffer()
    source.set_transform("map", "base", 0, *pose(1))
    home = new_home(source, links())
    first, second = Mirror(spare, NAME, links()), Mirror(other, NAME, links())
    for each in (first, second):
        each.wait_until_live(LONGEST)
    promoted = first.promote()
    home.close()
    spare.set_transform("map", "base", 10, *pose(2))
    wait_for_commit(second, spare.commit)
    return promoted, second


def test_a_second_home_of_one_promoted_store_leaves_it_writable(links: Links, name: str) -> None:
    spare = tfdb.Buffer.open(name, create=True, size=1 << 25)
    promoted, other = promoted_beside(tfdb.Buffer(), spare, links)
    with promoted:
        epoch = epoch_after(promoted.epoch)
        again = tfdb.Buffer.open(name)
        with Home(again, NAME, links(), epoch, origin=take_over(again, NAME, epoch)):
            event = wait_for(promoted.events(), "fenced")
            assert "The later home publishes the same store, which stays writable" in event.text
            spare.set_transform("map", "base", 20, *pose(3))
            wait_for_commit(other, spare.commit)
            assert state_of(other._buffer) == state_of(spare)
            assert event.before == event.after, "nothing is lost"
    spare.close()
    again.close()


def test_a_promoted_store_with_frames_of_its_own_sends_states(links: Links) -> None:
    source, spare, copy = tfdb.Buffer(), tfdb.Buffer(), tfdb.Buffer()
    source.set_transform("map", "base", 0, *pose(1))
    home = new_home(source, links())
    mirror, other = Mirror(spare, NAME, links()), Mirror(copy, NAME, links())
    for each in (mirror, other):
        each.wait_until_live(LONGEST)
    spare.set_static_transform("base", "sticker", *pose(3))
    with mirror.promote():
        wait_for(home.events(), "fenced")
        other.wait_until_live(LONGEST)
        copy.wait_for_transform("map", "sticker", timeout=LONGEST)
        assert other.stats.states == 2
        assert state_of(copy) == state_of(spare)
    for each in (other, home):
        each.close()


def list_events(events: NetEvents) -> list[Event]:
    """Return the received events."""
    found = []
    while (event := events.read_next()) is not None:
        found.append(event)
    return found


def test_a_promoted_mirror_takes_over(links: Links) -> None:
    link = links()
    source, spare, copy = tfdb.Buffer(), tfdb.Buffer(), tfdb.Buffer()
    source.set_transform("map", "base", 0, *pose(1))
    home = new_home(source, link)
    mirror, other = Mirror(spare, NAME, links()), Mirror(copy, NAME, links())
    for each in (mirror, other):
        each.wait_until_live(LONGEST)
    with mirror.promote(max_delay=0.0) as promoted:
        assert mirror.state == "closed"
        event = wait_for(home.events(), "fenced")
        assert event.before == (home.epoch, 1)
        assert "alone" not in event.text, "the later home has all"
        spare.set_transform("map", "later", 20, *pose(3))
        wait_for_commit(other, spare.commit)
        assert other.position is not None
        assert other.position.epoch == promoted.epoch
        assert state_of(copy) == state_of(spare)
    for each in (other, home):
        each.close()


def test_a_home_that_began_before_its_mirrors_epoch_stops_and_begins_again(links: Links) -> None:
    """The home's machine may have a slow clock, and may not have reached the mirror before."""
    source, copy, link = tfdb.Buffer(), tfdb.Buffer(), links()
    source.set_transform("map", "base", 0, *pose(1))
    with Home(source, NAME, link, Epoch(9, b"i" * 16)), Mirror(copy, NAME, links()) as mirror:
        mirror.wait_until_live(LONGEST)
    source.set_transform("map", "base", 1, *pose(2))
    with (
        Home(source, NAME, link, Epoch(5, b"i" * 16)) as home,
        Mirror(copy, NAME, links()) as mirror,
        home.events() as events,
    ):
        event = wait_for(events, "fenced")
        assert (event.before, event.after) == (None, (home.epoch, 2))
        assert [token.role for _, token in link.tokens(NAME)] == ["mirror"]
        with new_home(source, link) as later:
            mirror.wait_until_live(LONGEST)
            assert later.epoch.number > 9
            assert state_of(copy) == state_of(source)


def test_mirrors_that_cannot_be_promoted(links: Links) -> None:
    link, store = links(), tfdb.Buffer()
    source = tfdb.Buffer()
    source.set_transform("map", "base", 0, *pose(1))
    with Mirror(store, NAME, link) as mirror:
        with pytest.raises(tfdb.InvalidArgument, match=r"it was never live.*force=True"):
            mirror.promote()
        mirror.promote(force=True).close()
        with pytest.raises(tfdb.InvalidArgument, match="it is closed"):
            mirror.promote(force=True)
        with pytest.raises(tfdb.InvalidArgument, match="is closed"):
            mirror.wait_until_live()
    with (
        Mirror(tfdb.Buffer(), NAME, link, prefix="r/") as mirror,
        pytest.raises(tfdb.InvalidArgument, match="frame names differ"),
    ):
        mirror.promote(force=True)
    store = tfdb.Buffer()
    store.apply(source.commits_bytes(0), source="other", prefix="other/")
    with (
        Mirror(store, NAME, link) as mirror,
        pytest.raises(tfdb.InvalidArgument, match="frames of source 'other'"),
    ):
        mirror.promote(force=True)


def test_several_homes_in_one_store(links: Links) -> None:
    link, fleet = links(), tfdb.Buffer()
    homes, mirrors, sources = [], [], []
    for number in (1, 2):
        source = tfdb.Buffer()
        sources.append(source)
        source.set_transform("map", "base", 10, *pose(number))
        homes.append(new_home(source, link, f"robot{number}"))
        mirrors.append(
            Mirror(fleet, f"robot{number}", links(), prefix=f"r{number}/", shared=["map"])
        )
    for each in mirrors:
        each.wait_until_live(LONGEST)
    assert fleet.frames() == ["map", "r1/base", "r2/base"]
    assert sorted(p.source for p in fleet.positions()) == ["robot1", "robot2"]
    with pytest.raises(tfdb.InvalidArgument, match="with prefix 'r1/' already, not 'r'"):
        Mirror(fleet, "robot1", link, prefix="r")
    with Mirror(fleet, "robot3", link, prefix="r1/arm/") as wrong, wrong.events() as events:
        with new_home(sources[0], links(), "robot3"):
            text = wait_for(events, "ended").text
        assert "'r1/arm/' of source 'robot3' overlaps prefix 'r1/' of source 'robot1'" in text
        assert wrong.state == "ended"
    for each in (*mirrors, *homes):
        each.close()


def test_a_writer_at_full_speed_does_not_wait(links: Links) -> None:
    source, copy = tfdb.Buffer(), tfdb.Buffer()
    with new_home(source, links()) as home, Mirror(copy, NAME, links()) as mirror:
        for i in range(60_000):
            source.set_transform("map", f"frame{i % 7}", i, *pose(i % 90))
        wait_for_commit(mirror, source.commit)
        assert state_of(copy) == state_of(source)
        assert home.stats.commits + home.stats.lapped == source.commit


@pytest.mark.parametrize("has_local_frame", [False, True])
def test_a_mirror_ends_if_its_store_becomes_the_home(links: Links, has_local_frame: bool) -> None:
    source, spare = tfdb.Buffer(), tfdb.Buffer()
    source.set_static_transform("map", "base", *pose(1))
    with (
        new_home(source, links()),
        Mirror(spare, NAME, links()) as mirror,
        Mirror(spare, NAME, links()) as other,
    ):
        for each in (mirror, other):
            each.wait_until_live(LONGEST)
        if has_local_frame:
            spare.set_static_transform("base", "tool", *pose(2))
        with mirror.promote(), other.events() as events:
            spare.set_static_transform("map", "base", *pose(3))
            wait_for(events, "ended")
            assert isinstance(other.error, tfdb.InvalidArgument)
            assert f"the home of '{NAME}' publishes this same store" in str(other.error)
            spare.set_static_transform("map", "base", *pose(4))


def test_counts_and_position_include_the_newest_messages(links: Links) -> None:
    source, copy = tfdb.Buffer(), tfdb.Buffer()
    source.set_transform("map", "base", 1, *pose(1))
    with new_home(source, links()), Mirror(copy, NAME, links()) as mirror:
        mirror.wait_until_live(LONGEST)
        before = mirror.stats
        for stamp in range(2, 102):
            source.set_transform("map", "base", stamp, *pose(stamp))
        wait_for_commit(mirror, source.commit)
        stats = mirror.stats
        assert stats.commits - before.commits == 100
        assert stats.bytes > before.bytes
        assert (stats.lag, stats.refused, stats.gaps) == (0, 0, before.gaps)
        assert mirror.state == "live"


@pytest.mark.filterwarnings("error::tfdb.TfdbWarning")
def test_a_warning_that_raises_ends_the_mirror(links: Links) -> None:
    source, copy = tfdb.Buffer(), tfdb.Buffer()
    source.set_transform("map", "base", 1, *pose(1))
    with new_home(source, links()), Mirror(copy, NAME, links()) as mirror:
        mirror.wait_until_live(LONGEST)
        copy.set_transform("earth", "map", 1, *pose(2))
        source.set_transform("odom", "map", 1, *pose(3))
        with mirror.events() as events:
            assert "'map' lost the parent" in wait_for(events, "ended").text
        assert mirror.state == "ended"


def test_a_shared_store_does_not_follow_itself(links: Links, name: str) -> None:
    with (
        tfdb.Buffer.open(name, size=1 << 25) as store,
        new_home(store, links()),
        Mirror(store, NAME, links()) as mirror,
    ):
        store.set_transform("map", "base", 1, *pose(1))
        with pytest.raises(tfdb.InvalidArgument, match=f"{NAME}.*publishes this same store"):
            mirror.wait_until_live(LONGEST)
        assert mirror.state == "ended"
        assert (store.commit, store.positions()) == (1, [])


def test_a_private_store_is_not_mirrored_into_itself(links: Links) -> None:
    store = tfdb.Buffer()
    with new_home(store, links()) as home:
        with pytest.raises(tfdb.InvalidArgument, match=f"this process publishes as '{NAME}'"):
            mirror(NAME, into=store)
        assert publishes(store, NAME)
        with pytest.raises(tfdb.InvalidArgument, match=f"publishes this store as '{NAME}' already"):
            publish(store, NAME, take_over=True)
        home.close()
        assert not publishes(store, NAME)


def test_the_end_of_a_mirrors_store_ends_it(links: Links) -> None:
    source, copy = tfdb.Buffer(), tfdb.Buffer()
    source.set_transform("map", "base", 10, *pose(1))
    with new_home(source, links()), Mirror(copy, NAME, links()) as mirror:
        mirror.wait_until_live(LONGEST)
        copy.close()
        source.set_transform("map", "base", 20, *pose(1))
        with mirror.events() as events:
            assert "BufferClosed" in wait_for(events, "ended").text
        assert mirror.state == "ended"
        with pytest.raises(tfdb.errors.BufferClosed):
            mirror.wait_until_live(LONGEST)


def test_the_end_of_a_homes_store_ends_it(links: Links) -> None:
    source = tfdb.Buffer()
    with new_home(source, links()) as home, home.events() as events:
        source.close()
        assert "BufferClosed" in wait_for(events, "ended").text
        assert (home.state, type(home.error)) == ("ended", tfdb.errors.BufferClosed)


def test_a_missing_home(links: Links) -> None:
    with Mirror(tfdb.Buffer(), NAME, links()) as mirror:
        with pytest.raises(tfdb.WaitTimeout, match=r"is absent, not live, after 0\.01 s"):
            mirror.wait_until_live(0.01)
        assert mirror.stats == (0, 0, 0, 0, 0, 0, 0, 0)
        assert mirror.position is None


def test_events_are_read_by_coroutines_and_end_with_the_mirror() -> None:
    async def read(events: NetEvents) -> list[str]:
        return [event.kind async for event in events]

    with memory_links() as links:
        source = tfdb.Buffer()
        source.set_transform("map", "base", 10, *pose(1))
        link = links()
        with new_home(source, link), Mirror(tfdb.Buffer(), NAME, link) as mirror:
            mirror.wait_until_live(LONGEST)
        events = mirror.events()
        assert asyncio.run(read(events))[-1] == "live"
        with pytest.raises(tfdb.errors.StreamClosed, match="no more events"):
            events.read_next()
        events.close()
        with pytest.raises(tfdb.errors.StreamClosed, match="call events"):
            events.read_next()


class SeenLog(EventLog):
    """Sets an event when a stream has looked for an event."""

    def __init__(self) -> None:
        super().__init__(NAME)
        self.seen = threading.Event()

    def after(self, number: int) -> tuple[int, Event | None]:
        found = super().after(number)
        self.seen.set()
        return found


async def begin_read(log: SeenLog, events: NetEvents) -> asyncio.Task[Event]:
    """Begin to wait for an event."""
    reading = asyncio.create_task(anext(events))
    while not log.seen.is_set():
        await asyncio.sleep(0)
    return reading


def test_a_cancelled_read_of_events_takes_none_and_has_no_thread() -> None:
    async def read() -> list[str]:
        log = SeenLog()
        with NetEvents(log) as events:
            reading = await begin_read(log, events)
            assert not [each for each in threading.enumerate() if each.name.startswith("asyncio")]
            reading.cancel()
            with pytest.raises(asyncio.CancelledError):
                await reading
            log.add("live", "one")
            log.add("stale", "two")
            return [(await anext(events)).text for _ in range(2)]

    assert asyncio.run(read()) == ["one", "two"]


@pytest.mark.parametrize("change", ["event", "end of the stream", "end of the log"])
def test_another_thread_wakes_a_coroutine_that_reads_events(change: str) -> None:
    async def read() -> str:
        log = SeenLog()
        events = NetEvents(log)
        reading = await begin_read(log, events)
        act = {"event": lambda: log.add("live", "one"), "end of the stream": events.close}
        await asyncio.to_thread(act.get(change, log.close))
        try:
            return (await asyncio.wait_for(reading, LONGEST)).text
        except StopAsyncIteration:
            return "ended"

    assert asyncio.run(read()) == ("one" if change == "event" else "ended")


def test_a_message_that_arrives_while_the_counts_are_read_is_processed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    stepped, asked = threading.Event(), threading.Event()

    def due(receiver: Receiver, now: float) -> float:
        stepped.set()
        return 10 * LONGEST

    def answer(question: Question) -> list[bytes]:
        asked.set()
        return []

    monkeypatch.setattr(Receiver, "due", due)
    link = Network().link()
    link.serve(NAME, answer)
    with Mirror(tfdb.Buffer(), NAME, link) as mirror:
        assert stepped.wait(LONGEST)
        with mirror._lock:  # as `stats` does
            link.declared[f"{NAME}/log"][0](head_bytes(Head(Epoch(5, b"x" * 16), 7, NONE, 0)))
        assert asked.wait(LONGEST)
    link.network.close()


def test_a_faster_writer_does_not_delay_the_end_of_a_home() -> None:
    class WritingLink(MemoryLink):
        """Stores a commit whenever one is sent."""

        def send(self, name: str) -> tuple[Callable[[bytes], None], Any]:
            def put(data: bytes) -> None:
                is_writing.set()
                if not is_over.is_set():
                    store.set_transform("map", "base", store.commit + 1, *pose(1))

            return put, self.declare(f"{name}/publisher", put)

    network, store = Network(), tfdb.Buffer()
    is_writing, is_over = threading.Event(), threading.Event()
    home = new_home(store, WritingLink(network), max_delay=0.0)
    closing = threading.Thread(target=home.close)
    try:
        assert is_writing.wait(LONGEST)
        closing.start()
        closing.join(LONGEST)
        assert not closing.is_alive()
    finally:
        is_over.set()
        closing.join()
        network.close()


def test_a_mirror_closes_its_own_session_although_its_promotion_failed() -> None:
    network = Network()
    link, owned = network.link(), network.link()
    mirror = Mirror(tfdb.Buffer(), NAME, link, owned=owned)

    def fail(name: str) -> Any:
        raise ConnectionError("no router")

    link.send = fail  # type: ignore[method-assign]
    with pytest.raises(ConnectionError):
        mirror.promote(force=True)
    mirror.close()
    assert owned.closed
    network.close()


@pytest.mark.parametrize(
    "name", ["", "/a", "a/", "a//b", "a b", "a*", "@home", "ä", "x" * 256, 7, None]
)
def test_names_that_no_namespace_has(name: Any) -> None:
    with pytest.raises(tfdb.errors.InvalidName, match="not a valid namespace"):
        publish(tfdb.Buffer(), name)
    with pytest.raises(tfdb.errors.InvalidName, match="not a valid namespace"):
        mirror(name, into=tfdb.Buffer())


def test_names_that_namespaces_have() -> None:
    for name in ("robot1", "a/b.c_d-e/F", "x" * 255):
        assert check_network_name(name) == name


def test_wrong_arguments() -> None:
    with pytest.raises(TypeError, match="buffer must be a Buffer"):
        publish("robot1", "robot1")  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="into must be a Buffer"):
        mirror("robot1", into="robot1")  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="shared must be a str, got int"):
        mirror("robot1", into=tfdb.Buffer(), shared=("map", 5))  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="shared must be a frame name or several, got int"):
        mirror("robot1", into=tfdb.Buffer(), shared=5)  # type: ignore[arg-type]
    with pytest.raises(tfdb.InvalidArgument, match=r"max_lag must be an integer .*, got 1\.5"):
        mirror("robot1", into=tfdb.Buffer(), max_lag=1.5)  # type: ignore[arg-type]
    with pytest.raises(tfdb.InvalidArgument, match="max_delay"):
        publish(tfdb.Buffer(), "robot1", max_delay=-1)
    with pytest.raises(tfdb.errors.NotSupported, match="keeps no feed"):
        publish(tfdb.Buffer(concurrency="silo"), "robot1")


@pytest.mark.parametrize("text", ["\ud800", "a\0", "a" * 1024])
def test_prefixes_that_no_frame_has(text: str) -> None:
    with pytest.raises(tfdb.errors.InvalidName, match=r"prefix: .* which has 1 to 1024 bytes"):
        mirror("robot1", into=tfdb.Buffer(), prefix=text)


@pytest.mark.parametrize("name", ["\ud800", "a\0", "a" * 1025, ""])
def test_shared_frames_that_cannot_be(name: str) -> None:
    with pytest.raises(tfdb.errors.InvalidName, match=r"shared: .* which has 1 to 1024 bytes"):
        mirror("robot1", into=tfdb.Buffer(), prefix="a/", shared=("map", name))


def test_files_of_lost_commits_that_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(tfdb.InvalidArgument, match="give keep_lost"):
        publish(tfdb.Buffer(), "robot1", keep_lost=tmp_path)
    for path in (tmp_path / "missing" / "lost", tmp_path / ("a" * 300)):
        with pytest.raises(OSError, match=r"missing folder|name too long") as caught:
            publish(tfdb.Buffer(), "robot1", keep_lost=path)
        assert caught.value.filename == str(path)
    assert not list(tmp_path.iterdir())


@needs_zenoh
def test_a_store_that_cannot_be_written_is_refused_at_once(tmp_path: Path) -> None:
    tfdb.Buffer().freeze(tmp_path / "state.tfdb")
    frozen, engine = tfdb.open(tmp_path / "state.tfdb"), tfdb.Buffer(concurrency="silo")
    closed = tfdb.Buffer()
    closed.close()
    with tfdb.net.Session(listen=free_endpoint()) as session:
        for store, kind in (
            (frozen, tfdb.errors.ReadOnly),
            (engine, tfdb.errors.NotSupported),
            (closed, tfdb.errors.BufferClosed),
        ):
            with pytest.raises(kind):
                mirror(NAME, into=store, session=session)  # type: ignore[arg-type]


def test_tokens() -> None:
    epoch = Epoch(12, bytes(range(16)))
    for token in (Token("home", epoch), Token("mirror", epoch, "owner")):
        assert token_of(token.key("a/b")) == token
        assert name_of(token.key("a/b")) == name_of(status_key("a/b", token.role)) == "a/b"
    for key in ("tfdb/1/a/log", "tfdb/1/a/@home/1", "tfdb/1/a/@home/x/" + "0" * 32, "", "/@x/1/2"):
        with pytest.raises(ValueError, match="is not"):
            token_of(key)


def test_a_mirror_of_a_promoted_home_that_is_begun_again_loses_nothing(links: Links) -> None:
    spare, other = tfdb.Buffer(), tfdb.Buffer()
    promoted, second = promoted_beside(other, spare, links)
    promoted.close()
    epoch = epoch_after(promoted.epoch)
    origin = take_over(spare, NAME, epoch)
    assert origin[:2] == (promoted.epoch, spare.commit - 1)
    with Home(spare, NAME, links(), epoch, origin=origin):
        spare.set_transform("map", "base", 20, *pose(3))
        wait_for_commit(second, spare.commit)
        assert second.stats.states == 1, "the first one"
        assert second.position is not None
        assert second.position.epoch == epoch
        assert state_of(other) == state_of(spare)
    second._stop()
    assert "rewound" not in [each.kind for each in second.events()]
