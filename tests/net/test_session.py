"""`tfdb.net` over Zenoh: endpoints, two processes, kills."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from queue import SimpleQueue
from typing import TYPE_CHECKING, Any

import pytest

import tfdb
import tfdb.net
from tests.net.conftest import LONGEST, free_endpoint, needs_zenoh
from tests.net.test_home_and_mirror import wait_for, wait_for_commit
from tests.recorder.reading import state_of
from tests.test_changes import pose
from tfdb.net.messages import NONE, Question
from tfdb.net.session import check_endpoints

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = needs_zenoh
NAME = "robot1"

CHILD = """
import sys, tfdb, tfdb.net
store, endpoint = sys.argv[1:]
with (
    tfdb.Buffer.open(store, size=1 << 25) as buf,
    tfdb.net.Session(connect=endpoint) as session,
    tfdb.net.publish(buf, "robot1", session=session) as home,
):
    print("ready", flush=True)
    for line in sys.stdin:
        for number in range(int(line)):
            buf.set_transform("map", "base", buf.commit, (buf.commit + 1, 2, 3), (0, 0, 0, 1))
        print(buf.commit, flush=True)
"""


class Child:
    """A process that publishes a shared store."""

    def __init__(self, store: str, endpoint: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-c", CHILD, store, endpoint],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self.read() == "ready"

    def read(self) -> str:
        """Read a line of its output."""
        assert self.process.stdout is not None
        return self.process.stdout.readline().strip()

    def write(self, count: int) -> int:
        """Let it commit; return its last commit."""
        assert self.process.stdin is not None
        self.process.stdin.write(f"{count}\n")
        self.process.stdin.flush()
        return int(self.read())

    def end(self, number: int) -> None:
        """End it by a signal."""
        self.process.send_signal(number)
        self.process.wait(LONGEST)
        for pipe in (self.process.stdin, self.process.stdout):
            assert pipe is not None
            pipe.close()


def test_a_home_in_another_process_is_killed_and_begun_again(name: str) -> None:
    endpoint = free_endpoint()
    copy = tfdb.Buffer()
    with (
        tfdb.net.Session(listen=endpoint) as session,
        tfdb.net.mirror(NAME, into=copy, session=session) as mirror,
        mirror.events() as events,
    ):
        for _ in range(3):
            child = Child(name, endpoint)
            try:
                wait_for_commit(mirror, child.write(500))
                mirror.wait_until_live(LONGEST)
            finally:
                child.end(signal.SIGKILL)
            wait_for(events, "stale")
            with tfdb.Buffer.open(name, mode="r") as store:
                assert state_of(copy) == state_of(store)
        assert mirror.stats.states == 1, "the store outlives its process, and so does the epoch"


def test_a_router_that_is_begun_again(name: str) -> None:
    """The sessions of home and mirror reconnect by themselves."""
    endpoint = free_endpoint()
    source, copy = tfdb.Buffer(), tfdb.Buffer()
    router = tfdb.net.Session(listen=endpoint)
    with (
        tfdb.net.Session(connect=endpoint) as here,
        tfdb.net.Session(connect=endpoint) as there,
        tfdb.net.publish(source, NAME, session=here),
        tfdb.net.mirror(NAME, into=copy, session=there) as mirror,
        mirror.events() as events,
    ):
        mirror.wait_until_live(LONGEST)
        router.close()
        wait_for(events, "stale")
        source.set_transform("map", "base", 10, *pose(1))
        with tfdb.net.Session(listen=endpoint):
            wait_for(events, "live")
            wait_for_commit(mirror, source.commit)
            assert state_of(copy) == state_of(source)


class CutSession:
    """A session of Zenoh whose `close` times out in a cut network."""

    def __init__(self) -> None:
        self.closes = 0

    def close(self) -> None:
        """Fail, as Zenoh does after some seconds."""
        import zenoh

        self.closes += 1
        raise zenoh.ZError("close operation timed out!")


def test_a_session_waits_also_if_a_cut_comes_between_its_two_connections(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from tfdb.net import zenoh_link

    endpoint, open_session = free_endpoint(), zenoh_link._open
    first = CutSession()
    opened: list[str] = []

    def open_in_a_cut(config: Any, where: str) -> Any:
        opened.append(where)
        if len(opened) == 1:
            return first
        if len(opened) == 2:
            raise ConnectionError("no Zenoh router")
        return open_session(config, where)

    with tfdb.net.Session(listen=endpoint):
        monkeypatch.setattr(zenoh_link, "_open", open_in_a_cut)
        with tfdb.net.Session(connect=endpoint, wait=LONGEST):
            assert (len(opened), first.closes) == (4, 1)


LARGE = """
import sys, tfdb, tfdb.net
from pathlib import Path
endpoint, how = sys.argv[1:]
buf, copy = tfdb.Buffer(history=None), tfdb.Buffer(history=None)
for number in range(2000):
    buf.set_transform("map", "base", number, (number, 2, 3), (0, 0, 0, 1))
options = {"connect": endpoint}
if how == "config":
    options = {"config": {"mode": "client", "connect": {"endpoints": [endpoint]}}}
with (
    tfdb.net.Session(listen=endpoint) as here,
    tfdb.net.Session(**options) as there,
    tfdb.net.publish(buf, "robot1", session=here),
    tfdb.net.mirror("robot1", into=copy, session=there) as mirror,
):
    mirror.wait_until_live(60.0)
    print(copy.frames(), ".zenoh" in Path("/proc/self/maps").read_text())
"""


@pytest.mark.parametrize("how", ["connect", "config"])
def test_a_session_maps_no_shared_memory_of_zenoh(how: str) -> None:
    command = [sys.executable, "-c", LARGE, free_endpoint(), how]
    done = subprocess.run(command, capture_output=True, text=True, timeout=LONGEST, check=True)
    assert done.stdout == "['base', 'map'] False\n"


def test_each_message_of_an_answer_comes_when_it_is_sent(monkeypatch: pytest.MonkeyPatch) -> None:
    from tfdb.net import zenoh_link

    endpoint = free_endpoint()
    came: SimpleQueue[bytes | None] = SimpleQueue()
    goes_on, has_ended = threading.Event(), threading.Event()

    def answer(_: Question) -> Iterator[bytes]:
        yield b"head"
        goes_on.wait(LONGEST)
        yield b"state"
        has_ended.set()

    with tfdb.net.Session(listen=endpoint) as here, tfdb.net.Session(connect=endpoint) as there:
        here.link.serve(NAME, answer)
        there.link.ask(NAME, Question(NONE, None), came.put)
        assert came.get(timeout=LONGEST) == b"head"
        goes_on.set()
        assert [came.get(timeout=LONGEST) for _ in range(2)] == [b"state", None]

        goes_on.clear()
        has_ended.clear()
        request = there.link.ask(NAME, Question(NONE, None), came.put)
        assert came.get(timeout=LONGEST) == b"head"
        request.check()
        assert came.empty()
        monkeypatch.setattr(zenoh_link, "_PATIENCE", -1.0)
        request.check()
        request.end()
        assert came.get(timeout=LONGEST) is None
        goes_on.set()
        assert has_ended.wait(LONGEST)
    assert came.empty()


def test_queryables_are_declared_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """A router may have lost them."""
    from tfdb.net import zenoh_link

    endpoint = free_endpoint()
    copy, source = tfdb.Buffer(), tfdb.Buffer()
    source.set_transform("map", "base", 0, *pose(1))
    with tfdb.net.Session(listen=endpoint) as here, tfdb.net.Session(connect=endpoint) as there:
        with tfdb.net.publish(source, NAME, session=here):
            link: Any = here.link
            before = [part for each in link._queryables for part in each._parts]
            for part in before:
                part.undeclare()
            monkeypatch.setattr(zenoh_link, "_RENEWAL", 0.0)
            with tfdb.net.mirror(NAME, into=copy, session=there) as mirror:
                mirror.wait_until_live(LONGEST)
            assert state_of(copy) == state_of(source)
        assert not link._queryables
        link.renew()
    link.renew()


def test_a_session_closes_in_a_cut() -> None:
    from tfdb.net import zenoh_link

    data, tokens = CutSession(), CutSession()
    zenoh_link.ZenohLink(data, tokens).close()  # type: ignore[arg-type]
    assert (data.closes, tokens.closes) == (1, 1)


def test_a_namespace_has_one_home() -> None:
    endpoint = free_endpoint()
    first, second = tfdb.Buffer(), tfdb.Buffer()
    with (
        tfdb.net.Session(listen=endpoint) as here,
        tfdb.net.Session(connect=endpoint) as there,
        tfdb.net.publish(first, NAME, session=here) as home,
    ):
        with pytest.raises(tfdb.errors.StoreExists, match=r"has a home.*take_over=True") as caught:
            tfdb.net.publish(second, NAME, session=there)
        assert caught.value.path == NAME
        with tfdb.net.publish(second, NAME, session=there, take_over=True) as later:
            assert later.epoch > home.epoch
            assert wait_for(home.events(), "fenced").before is None


def test_a_home_that_has_just_begun_is_seen() -> None:
    """Its own session sees it as well, although older tokens may still arrive there."""
    with tfdb.net.Session(listen=free_endpoint()) as session:
        for number in range(60):
            name = f"{NAME}/{number}"
            with (
                tfdb.net.publish(tfdb.Buffer(), name, session=session),
                pytest.raises(tfdb.errors.StoreExists, match="has a home"),
            ):
                tfdb.net.publish(tfdb.Buffer(), name, session=session)


def test_a_new_home_is_later_than_the_last_home_of_its_mirrors() -> None:
    """This holds even if its clock, and so the epoch of its store, is behind."""
    endpoint = free_endpoint()
    source, copy = tfdb.Buffer(), tfdb.Buffer()
    late = tfdb.data.types.Epoch(1 << 62, bytes(16))
    with (
        tfdb.net.Session(listen=endpoint) as session,
        tfdb.net.mirror(NAME, into=copy, session=session) as mirror,
        mirror.events() as events,
    ):
        with tfdb.net.Home(source, NAME, session.link, late):
            mirror.wait_until_live(LONGEST)
        wait_for(events, "stale")
        with tfdb.net.publish(source, NAME, session=session) as home:
            assert home.epoch.number == late.number + 1
            wait_for(events, "live")


def test_a_large_state_comes_in_parts() -> None:
    endpoint = free_endpoint()
    source, copy = tfdb.Buffer(history=None), tfdb.Buffer(history=None)
    source.set_transforms(
        [
            tfdb.TransformStamped("map", f"frame{i}", j, *pose(i + j))
            for i in range(2000)
            for j in range(20)
        ]
    )
    with (
        tfdb.net.Session(listen=endpoint) as session,
        tfdb.net.Session(connect=endpoint) as there,
        tfdb.net.publish(source, NAME, session=session),
        tfdb.net.mirror(NAME, into=copy, session=there) as mirror,
    ):
        mirror.wait_until_live(LONGEST)
        assert state_of(copy) == state_of(source)
        assert len(state_of(source)) > 1 << 20
        assert (mirror.stats.states, mirror.stats.refused) == (1, 0)


def test_bytes_of_others_on_the_keys_are_refused() -> None:
    import zenoh

    endpoint = free_endpoint()
    source, copy = tfdb.Buffer(), tfdb.Buffer()
    source.set_transform("map", "base", 10, *pose(1))
    config = zenoh.Config()
    for key, value in (("mode", '"client"'), ("connect/endpoints", f'["{endpoint}"]')):
        config.insert_json5(key, value)
    with (
        tfdb.net.Session(listen=endpoint) as session,
        tfdb.net.publish(source, NAME, session=session) as home,
        tfdb.net.mirror(NAME, into=copy, session=session) as mirror,
        mirror.events() as events,
        zenoh.open(config) as other,
    ):
        mirror.wait_until_live(LONGEST)
        other.put(f"tfdb/1/{NAME}/log", b"hello")
        assert "cut short" in wait_for(events, "refused").text
        for query in ("feed", "feed?since=x", "feed?since=1;epoch=1-zz", "state?epoch="):
            assert list(other.get(f"tfdb/1/{NAME}/{query}", timeout=5)) == []
        source.set_transform("map", "base", 20, *pose(2))
        wait_for_commit(mirror, source.commit)
        assert (mirror.state, home.state, mirror.stats.refused) == ("live", "publishing", 1)


@pytest.mark.parametrize(
    ("where", "text"),
    [
        ({"connect": "10.0.0.1"}, "connect must have endpoints such as tcp/127"),
        ({"listen": 7}, "^listen must be an endpoint such as tcp/.*, or several, got 7$"),
        ({"listen": [7]}, "listen must have endpoints such as tcp/127"),
        ({"connect": "10.0.0.1"}, "PROTOCOL/HOST:PORT is valid, with one of tcp, tls"),
        ({"connect": "tpc/10.0.0.1:1"}, "did you mean 'tcp'"),
        ({"connect": "tcp/10.0.0.1"}, "tcp/HOST:PORT is valid, with a port from 1 to 65535"),
        ({"connect": "tcp/10.0.0.1:0"}, "port from 1 to 65535"),
        ({"connect": "tls/::1:7447"}, "tls/HOST:PORT is valid"),
        ({"listen": "tcp/a:65536"}, "port from 1 to 65535"),
        ({"wait": -1}, "wait"),
        ({"connect": "tcp/127.0.0.1:1", "config": "x.json5"}, "config cannot be combined with"),
    ],
)
def test_wrong_endpoints(where: Any, text: str) -> None:
    with pytest.raises((tfdb.InvalidArgument, TypeError), match=text):
        tfdb.net.Session(**where)


def test_configuration_of_zenoh(tmp_path: Path) -> None:
    endpoint = free_endpoint()
    path = tmp_path / "zenoh.json5"
    path.write_text('{mode: "client", connect: {endpoints: ["' + endpoint + '"]}}')
    with tfdb.net.Session(listen=endpoint), tfdb.net.Session(config=path) as session:
        assert session.link.tokens(NAME) == []
    path.write_text("{")
    with pytest.raises(tfdb.InvalidArgument, match="not a configuration of Zenoh"):
        tfdb.net.Session(config=path)
    with pytest.raises(FileNotFoundError, match=r"missing\.json5"):
        tfdb.net.Session(config=tmp_path / "missing.json5")


def test_a_router_that_is_not_there_and_an_endpoint_that_is_taken() -> None:
    endpoint = free_endpoint()
    with pytest.raises(ConnectionError, match=f"no Zenoh router at {endpoint}"):
        tfdb.net.Session(connect=endpoint)
    with tfdb.net.Session(listen=endpoint) as session:
        assert repr(session) == f"<tfdb.net.Session at {endpoint}>"
        with pytest.raises(ConnectionError, match=f"cannot listen at {endpoint}: another"):
            tfdb.net.Session(listen=endpoint)
    session.close()
    with pytest.raises(tfdb.InvalidArgument, match="is closed: make another"):
        tfdb.net.publish(tfdb.Buffer(), NAME, session=session)
    with pytest.raises(TypeError, match=r"session must be a tfdb\.net\.Session"):
        tfdb.net.publish(tfdb.Buffer(), NAME, session=7)  # type: ignore[arg-type]


def test_a_session_waits_for_a_router() -> None:
    endpoint = free_endpoint()
    began, told = threading.Event(), []

    def note(text: str) -> None:
        told.append(text)
        began.set()

    with ThreadPoolExecutor(1) as pool:
        coming = pool.submit(lambda: tfdb.net.Session(connect=endpoint, wait=LONGEST, on_wait=note))
        assert began.wait(LONGEST)
        with tfdb.net.Session(listen=endpoint), coming.result(LONGEST) as session:
            assert session.link.tokens(NAME) == []
            with pytest.raises(ConnectionError, match=f"cannot listen at {endpoint}: another"):
                tfdb.net.Session(listen=endpoint, wait=None, on_wait=note)
    with pytest.raises(ConnectionError, match=f"no Zenoh router at {endpoint}"):
        tfdb.net.Session(connect=endpoint, wait=0.1, on_wait=note)
    assert told == [f"no Zenoh router at {endpoint}: retrying every second"]


def test_endpoints_that_are_valid() -> None:
    valid = ["tcp/[::1]:7447", "tcp/localhost:1", "tcp/127.0.0.1:1#iface=lo", "serial//dev/ttyS0"]
    assert check_endpoints("connect", valid, valid[0]) == valid


BUSY = """
import sys, threading, time, tfdb
session = tfdb.net.Session(listen=sys.argv[1])
source = tfdb.Buffer()
homes = [tfdb.net.publish(source, f"robot{i}", session=session) for i in range(10)]
mirrors = [tfdb.net.mirror(each.name, into=tfdb.Buffer(), session=session) for each in homes]
for mirror in mirrors:
    mirror.wait_until_live(10)
def write():
    while True:
        source.set_transform("map", "base", source.commit, (1, 2, 3), (0, 0, 0, 1))
        time.sleep(0.001)
threading.Thread(target=write, daemon=True).start()
while mirrors[0].stats.commits < 10:
    pass
"""
"""A program with ten homes and mirrors, and a thread that writes. Its argument is an endpoint."""


def test_a_process_ends_that_closes_nothing() -> None:
    code = f'{BUSY}print("end")'
    command = [sys.executable, "-c", code, free_endpoint()]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=LONGEST)
    assert (done.stdout, done.stderr) == ("end\n", "")


def test_a_process_ends_after_its_session_was_closed_before_its_homes() -> None:
    code = f'{BUSY}session.close()\nprint("end")'
    for _ in range(10):
        command = [sys.executable, "-c", code, free_endpoint()]
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=LONGEST)
        assert (done.returncode, done.stdout) == (0, "end\n"), done.stderr


def test_a_mirror_has_one_thread() -> None:
    with tfdb.net.Session(listen=free_endpoint()) as session:
        before = set(threading.enumerate())
        mirrors = [
            tfdb.net.mirror(f"robot{i}", into=tfdb.Buffer(), session=session) for i in range(10)
        ]
        assert len(set(threading.enumerate()) - before) == 10
        for each in mirrors:
            each.close()
        assert not set(threading.enumerate()) - before


def test_a_forked_process_ends_and_its_parent_goes_on() -> None:
    code = """
import multiprocessing, os, sys, tfdb
source, copy = tfdb.Buffer(), tfdb.Buffer()
with (
    tfdb.net.Session(listen=sys.argv[1]) as session,
    tfdb.net.publish(source, "robot1", session=session),
    tfdb.net.mirror("robot1", into=copy, session=session) as mirror,
):
    mirror.wait_until_live(10)
    child = multiprocessing.get_context("fork").Process(target=print, args=("child",))
    child.start()
    child.join()
    if (pid := os.fork()) == 0:
        sys.exit(3)
    ended = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    source.set_transform("map", "base", 1, (1, 2, 3), (0, 0, 0, 1))
    copy.wait_for_transform("map", "base", 1, 10)
    print(child.exitcode, ended)
"""
    command = [sys.executable, "-c", code, free_endpoint()]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=LONGEST)
    assert done.stdout.split() == ["child", "0", "3"]


def test_a_mirror_of_a_closed_session_is_not_promoted() -> None:
    with tfdb.net.Session(listen=free_endpoint()) as session:
        mirror = tfdb.net.mirror(NAME, into=tfdb.Buffer(), session=session)
    with pytest.raises(tfdb.InvalidArgument, match="cannot be promoted: its session is closed"):
        mirror.promote(force=True)
    mirror.close()


def test_a_session_that_is_closed_first_ends_its_home() -> None:
    source = tfdb.Buffer()
    session = tfdb.net.Session(listen=free_endpoint())
    with tfdb.net.publish(source, NAME, session=session) as home, home.events() as events:
        session.close()
        assert "the session is closed: make another" in wait_for(events, "ended").text
        assert home.state == "ended"
        assert isinstance(home.error, tfdb.InvalidArgument)


def test_a_link_at_the_end_of_the_process_makes_no_call() -> None:
    link: Any = tfdb.net.Session(listen=free_endpoint()).link
    link.end()
    link.watch(NAME, print).undeclare()
    assert link.statuses(NAME, 0.01) == []


def test_a_process_that_may_open_no_files_raises_an_oserror() -> None:
    code = """
import os, resource, sys
import tfdb.net.zenoh_link
from tfdb.net import Session
free = os.dup(0)
os.close(free)
resource.setrlimit(resource.RLIMIT_NOFILE, (free, free))
try:
    Session(listen=sys.argv[1])
except OSError as error:
    print(type(error).__name__, error)
"""
    command = [sys.executable, "-c", code, free_endpoint()]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=LONGEST)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("OSError Zenoh cannot open a session (Failed to init")
    assert "ulimit -n" in done.stdout


def test_nothing_listens_unless_asked() -> None:
    endpoint = free_endpoint()
    with tfdb.net.Session(listen=endpoint):
        before = listening()
        with tfdb.net.Session(connect=endpoint):
            assert listening() == before
        assert [address for address in before if not address.startswith("0100007F")] == []


def listening() -> set[str]:
    """Return the bound and listening TCP and UDP addresses of this process."""
    inodes = set()
    for each in Path("/proc/self/fd").iterdir():
        with suppress(FileNotFoundError):  # the descriptor of the listing itself
            inodes.add(str(each.readlink()))
    found = set()
    for table in ("tcp", "tcp6", "udp", "udp6"):
        for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            parts = line.split()
            if f"socket:[{parts[9]}]" in inodes and (table[:3] == "udp" or parts[3] == "0A"):
                found.add(parts[1])
    return found


def test_a_process_that_listens_connects_once_its_router_answers() -> None:
    """A home that begins while the network is partitioned joins the others afterwards."""
    here, there = free_endpoint(), free_endpoint()
    told: list[str] = []
    robot, copy = tfdb.Buffer(), tfdb.Buffer()
    robot.set_static_transform("map", "base", *pose(1))
    with (
        tfdb.net.Session(listen=here, connect=there, on_wait=told.append) as session,
        tfdb.net.publish(robot, NAME, session=session),
        tfdb.net.Session(listen=there) as router,
        tfdb.net.mirror(NAME, into=copy, session=router) as mirror,
    ):
        mirror.wait_until_live(LONGEST)
        assert state_of(copy) == state_of(robot)
        with pytest.raises(ConnectionError, match=f"cannot listen at {here}: another"):
            tfdb.net.Session(listen=here, connect=free_endpoint(), on_wait=told.append)
    assert told == [
        f"no Zenoh router at {there} yet: this process listens, and connects once it answers"
    ]
