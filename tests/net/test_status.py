"""`tfdb.net.status` over Zenoh."""

from __future__ import annotations

import os
import signal
import time
from typing import TYPE_CHECKING

import pytest

import tfdb
import tfdb.net
from tests.net.conftest import LONGEST, free_endpoint, needs_zenoh
from tests.net.test_home_and_mirror import wait_for
from tests.net.test_session import Child
from tests.test_changes import pose

if TYPE_CHECKING:
    from collections.abc import Callable

    from tfdb.net import Session, Status

pytestmark = needs_zenoh
NAME = "site/robot1"


def ask_until(
    session: Session, done: Callable[[list[Status]], bool], name: str | None = None
) -> list[Status]:
    """Repeat the request until the answer is as expected: declarations take some time to arrive."""
    until = time.monotonic() + LONGEST
    while not done(found := tfdb.net.status(name, session=session)):
        assert time.monotonic() < until, found
    return found


def states(found: list[Status]) -> list[tuple[str, str, str]]:
    """Return the compared fields."""
    return [(each.name, each.role, each.state) for each in found]


def test_homes_and_mirrors_answer() -> None:
    endpoint = free_endpoint()
    source, other, fleet = tfdb.Buffer(), tfdb.Buffer(), tfdb.Buffer()
    source.set_transform("map", "base", 1, *pose(1))
    with (
        tfdb.net.Session(listen=endpoint) as here,
        tfdb.net.Session(connect=endpoint) as there,
    ):
        assert tfdb.net.status(session=there) == []
        with (
            tfdb.net.publish(source, NAME, session=here) as home,
            tfdb.net.publish(other, "robot2", session=here),
            tfdb.net.mirror(NAME, into=fleet, prefix="a/", session=there) as first,
            tfdb.net.mirror(NAME, into=tfdb.Buffer(), prefix="b/", session=there),
            tfdb.net.mirror("robot3", into=tfdb.Buffer(), session=there),
        ):
            expected = [
                ("robot2", "home", "publishing"),
                ("robot3", "mirror", "absent"),
                (NAME, "home", "publishing"),
                (NAME, "mirror", "live"),
                (NAME, "mirror", "live"),
            ]
            for session in (here, there):
                found = ask_until(session, lambda found: states(found) == expected)
            absent, own, *mirrors = found[1:]
            assert (absent.epoch, absent.commit, absent.lag, absent.behind) == (None, 0, 0, 0.0)
            assert (own.epoch, own.commit, own.lag, own.owner) == (home.epoch, 1, 0, "")
            assert own.stats == home.stats
            assert first.stats in [each.stats for each in mirrors]
            assert len({each.owner for each in mirrors}) == 2
            assert [each.epoch for each in mirrors] == [home.epoch, home.epoch]
            alone = ask_until(there, lambda found: len(found) == 3, NAME)
            assert states(alone) == expected[2:]
            assert tfdb.net.status("robot4", session=there) == []
        assert ask_until(there, lambda found: not found) == []


def test_a_mirror_without_its_home_is_behind() -> None:
    with tfdb.net.Session(listen=free_endpoint()) as session:
        home = tfdb.net.publish(tfdb.Buffer(), NAME, session=session)
        with tfdb.net.mirror(NAME, into=tfdb.Buffer(), session=session) as mirror:
            mirror.wait_until_live(LONGEST)
            home.close()
            wait_for(mirror.events(), "stale")
            (found,) = ask_until(session, lambda found: len(found) == 1)
            assert found.state == "stale"
            assert found.behind is not None
            assert found.behind > 0
            (later,) = tfdb.net.status(session=session)
            assert later.behind is not None
            assert later.behind > found.behind


def test_a_stopped_process_is_silent(name: str) -> None:
    endpoint = free_endpoint()
    with tfdb.net.Session(listen=endpoint) as session:
        child = Child(name, endpoint)
        (home,) = ask_until(session, lambda found: len(found) == 1)
        os.kill(child.process.pid, signal.SIGSTOP)
        os.waitid(os.P_PID, child.process.pid, os.WSTOPPED)
        try:
            (found,) = tfdb.net.status(session=session, timeout=0.2)
        finally:
            child.process.send_signal(signal.SIGCONT)
            child.end(signal.SIGKILL)
        assert (found.name, found.state, found.epoch) == ("robot1", "silent", home.epoch)
        assert (found.commit, found.lag, found.behind, found.stats) == (None, None, None, None)


def test_a_foreign_answer_is_left_out() -> None:
    import zenoh

    endpoint = free_endpoint()
    config = zenoh.Config()
    for key, value in (("mode", '"client"'), ("connect/endpoints", f'["{endpoint}"]')):
        config.insert_json5(key, value)
    asked = []

    def answer(query: zenoh.Query) -> None:
        asked.append(query)
        query.reply(f"tfdb/1/{NAME}/@home/status", b"hello")

    with tfdb.net.Session(listen=endpoint) as session, zenoh.open(config) as other:
        other.declare_queryable(f"tfdb/1/{NAME}/@home/status", answer)
        assert ask_until(session, lambda found: bool(asked)) == []


def test_wrong_arguments() -> None:
    with tfdb.net.Session(listen=free_endpoint()) as session:
        with pytest.raises(tfdb.errors.InvalidName, match="is not a valid namespace"):
            tfdb.net.status("a*", session=session)
        for timeout in (0, -1.0):
            with pytest.raises(tfdb.InvalidArgument, match="timeout"):
                tfdb.net.status(session=session, timeout=timeout)
