"""`tfdb.net.secure`: certificates and access control, over TLS on loopback."""

from __future__ import annotations

import json
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

import pytest

import tfdb
import tfdb.net
from tests.net.conftest import LONGEST, free_endpoint, needs_zenoh
from tests.net.test_home_and_mirror import wait_for, wait_for_commit
from tests.net.test_session import listening
from tests.net.test_status import ask_until, states
from tests.recorder.reading import state_of
from tests.test_changes import pose
from tfdb.data.types import Epoch
from tfdb.net.messages import Told, status_bytes

if TYPE_CHECKING:
    from pathlib import Path

trustme = pytest.importorskip("trustme", reason="PyPI's trustme is not installed")
pytestmark = needs_zenoh
NAME = "site/robot1"
LATER = "9223372036854775000", "ff" * 16
"""The epoch of a forged home, in a key."""


class Authority:
    """Creates files with certificates."""

    def __init__(self, folder: Path, name: str) -> None:
        self.folder, self.name, self.made = folder, name, trustme.CA()
        self.made.cert_pem.write_to_path(str(folder / f"{name}.ca"))

    def files(self, who: str) -> dict[str, Path]:
        """The arguments of `secure`."""
        cert = self.made.issue_cert("127.0.0.1", common_name=who)
        stem = self.folder / f"{self.name}-{who}"
        found = {"ca": self.folder / f"{self.name}.ca"}
        found.update(cert=stem.with_suffix(".pem"), key=stem.with_suffix(".key"))
        cert.cert_chain_pems[0].write_to_path(str(found["cert"]))
        cert.private_key_pem.write_to_path(str(found["key"]))
        return found


@pytest.fixture
def authority(tmp_path: Path) -> Authority:
    return Authority(tmp_path, "ours")


def free_secure_endpoint() -> str:
    return free_endpoint().replace("tcp/", "tls/")


def test_the_allowed_mirror_is_live_and_another_certificate_hears_nothing(
    authority: Authority,
) -> None:
    endpoint = free_secure_endpoint()
    allow: Any = {"reader": "read", "elsewhere": {"site/robot2": "read"}}
    source, copy, empty = tfdb.Buffer(), tfdb.Buffer(), tfdb.Buffer()
    source.set_transform("map", "base", 1, *pose(1))
    router = tfdb.net.secure(**authority.files("robot1"), listen=endpoint, allow=allow)
    with ExitStack() as stack:

        def session(who: str) -> Any:
            config = tfdb.net.secure(**authority.files(who), connect=endpoint)
            return stack.enter_context(tfdb.net.Session(config=config))

        here = stack.enter_context(tfdb.net.Session(config=router))
        stack.enter_context(tfdb.net.publish(source, NAME, session=here))
        following = stack.enter_context(tfdb.net.mirror(NAME, into=copy, session=session("reader")))
        others = [
            stack.enter_context(tfdb.net.mirror(NAME, into=empty, session=session(who)))
            for who in ("elsewhere", "nobody")
        ]
        following.wait_until_live(LONGEST)
        source.set_transform("map", "base", 2, *pose(2))
        wait_for_commit(following, source.commit)
        assert state_of(copy) == state_of(source)
        for other in others:
            text = wait_for(other.events(), "absent").text
            assert "access control lets this certificate read 'site/robot1'" in text
            assert (other.state, other.stats.bytes) == ("absent", 0)
        assert empty.frames() == []


def test_a_reader_can_neither_send_commits_nor_be_a_home(authority: Authority) -> None:
    """It can publish neither commits nor the token of a later home."""
    import zenoh

    endpoint = free_secure_endpoint()
    source, copy = tfdb.Buffer(), tfdb.Buffer()
    router = tfdb.net.secure(**authority.files("robot1"), listen=endpoint, allow={"reader": "read"})
    config = tfdb.net.secure(**authority.files("reader"), connect=endpoint)
    with (
        tfdb.net.Session(config=router) as here,
        tfdb.net.publish(source, NAME, session=here) as home,
        tfdb.net.mirror(NAME, into=copy, session=here) as mirror,
        zenoh.open(zenoh.Config.from_json5(json.dumps(config))) as reader,
        tfdb.net.Session(config=config) as there,
        tfdb.net.mirror(NAME, into=tfdb.Buffer(), session=there) as allowed,
    ):
        allowed.wait_until_live(LONGEST)
        mirror.wait_until_live(LONGEST)
        reader.put(f"tfdb/1/{NAME}/log", b"hello")
        reader.liveliness().declare_token(f"tfdb/1/{NAME}/@home/{'/'.join(LATER)}")
        # A request follows these messages on the same connection, and its answer arrives.
        assert list(reader.get(f"tfdb/1/{NAME}/state?epoch=0-{'00' * 16}", timeout=5))
        source.set_transform("map", "base", 2, *pose(2))
        wait_for_commit(mirror, source.commit)
        assert (home.state, mirror.stats.refused, mirror.state) == ("publishing", 0, "live")


def test_readers_ask_and_answer_for_mirrors_and_never_for_homes(authority: Authority) -> None:
    import zenoh

    endpoint = free_secure_endpoint()
    allow: Any = {"reader": "read", "elsewhere": {"site/robot2": "read"}, "limited": {NAME: "read"}}
    router = tfdb.net.secure(**authority.files("robot1"), listen=endpoint, allow=allow)
    config = tfdb.net.secure(**authority.files("reader"), connect=endpoint)
    false = Told(Epoch(1, b"x" * 16), "home", "publishing", "", 9, 9, 0, (0,) * 6)
    with ExitStack() as stack:

        def session(who: str) -> Any:
            made = tfdb.net.secure(**authority.files(who), connect=endpoint)
            return stack.enter_context(tfdb.net.Session(config=made))

        here = stack.enter_context(tfdb.net.Session(config=router))
        home = stack.enter_context(tfdb.net.publish(tfdb.Buffer(), NAME, session=here))
        raw = stack.enter_context(zenoh.open(zenoh.Config.from_json5(json.dumps(config))))
        key = f"tfdb/1/{NAME}/@home/status"
        raw.declare_queryable(key, lambda query: query.reply(key, status_bytes(false)))
        there = session("reader")
        mirror = tfdb.net.mirror(NAME, into=tfdb.Buffer(), session=there)
        stack.enter_context(mirror).wait_until_live(LONGEST)
        for asking, name in (
            (here, None),
            (there, None),
            (there, NAME),
            (session("limited"), NAME),
        ):
            found = ask_until(asking, lambda found: len(found) > 1, name)
            assert states(found) == [(NAME, "home", "publishing"), (NAME, "mirror", "live")]
            assert {each.epoch for each in found} == {home.epoch}
        for who in ("elsewhere", "nobody"):
            denied = session(who)
            assert tfdb.net.status(session=denied) == tfdb.net.status(NAME, session=denied) == []


def test_a_home_behind_a_router_needs_to_write(authority: Authority) -> None:
    endpoint = free_secure_endpoint()
    router = tfdb.net.secure(
        **authority.files("router"),
        listen=endpoint,
        allow={"robot1": {NAME: "write"}, "reader": "read", "other": "read"},
    )
    source, copy = tfdb.Buffer(), tfdb.Buffer()
    source.set_transform("map", "base", 1, *pose(1))
    with ExitStack() as stack:
        stack.enter_context(tfdb.net.Session(config=router))
        sessions = {
            who: stack.enter_context(
                tfdb.net.Session(config=tfdb.net.secure(**authority.files(who), connect=endpoint))
            )
            for who in ("robot1", "reader", "other")
        }
        mirror = stack.enter_context(tfdb.net.mirror(NAME, into=copy, session=sessions["reader"]))
        # A process that may only read cannot be a home.
        with tfdb.net.publish(tfdb.Buffer(), NAME, session=sessions["other"]) as unseen:
            wait_for(mirror.events(), "absent")
            text = wait_for(unseen.events(), "unseen").text
            assert f"access control lets this certificate write '{NAME}'" in text
        home = stack.enter_context(tfdb.net.publish(source, NAME, session=sessions["robot1"]))
        mirror.wait_until_live(LONGEST)
        assert mirror.position is not None
        assert mirror.position.epoch == home.epoch
        assert state_of(copy) == state_of(source)
        assert home._is_seen


def test_strangers_get_no_session(authority: Authority, tmp_path: Path) -> None:
    endpoint = free_secure_endpoint()
    router = tfdb.net.secure(**authority.files("robot1"), listen=endpoint)
    stranger = Authority(tmp_path, "theirs").files("robot1")
    # The stranger trusts our authority, but has a certificate of another one.
    config = tfdb.net.secure(**stranger, connect=endpoint)
    tls = config["transport"]["link"]["tls"]
    tls["root_ca_certificate"] = router["transport"]["link"]["tls"]["root_ca_certificate"]
    without = json.loads(json.dumps(config))
    for end in ("connect_certificate", "connect_private_key"):
        del without["transport"]["link"]["tls"][end]
    without["transport"]["link"]["tls"]["enable_mtls"] = False
    with tfdb.net.Session(config=router):
        for each in (config, without):
            with pytest.raises(ConnectionError, match=endpoint):
                tfdb.net.Session(config=each)
        with pytest.raises(ConnectionError):
            tfdb.net.Session(connect=endpoint.replace("tls/", "tcp/"))


def test_a_configuration_listens_at_its_endpoints_alone(
    authority: Authority, tmp_path: Path
) -> None:
    endpoint = free_secure_endpoint()
    before = listening()
    with tfdb.net.Session(
        config=tfdb.net.secure(**authority.files("a"), listen=endpoint, allow={})
    ):
        here = listening() - before
        assert len(here) == 1
        assert all(each.startswith("0100007F") for each in here)
        with tfdb.net.Session(config=tfdb.net.secure(**authority.files("a"), connect=endpoint)):
            assert listening() - before == here
    plain = free_endpoint()
    path = tmp_path / "zenoh.json5"
    with tfdb.net.Session(listen=plain):
        before = listening()
        for text in ("{connect: {endpoints: [%s]}}", "{mode: 'peer', connect: {endpoints: [%s]}}"):
            path.write_text(text % f"'{plain}'")
            with tfdb.net.Session(config=path):
                assert listening() == before


def test_wrong_arguments(authority: Authority, tmp_path: Path) -> None:
    ours, theirs = authority.files("a"), Authority(tmp_path, "theirs").files("b")
    broken = tmp_path / "broken.pem"
    broken.write_text("hello")
    cases: list[tuple[dict[str, Any], str]] = [
        ({"ca": theirs["ca"]}, "is not a valid certificate of"),
        ({"key": theirs["key"]}, "not a certificate and its key"),
        ({"ca": broken}, "not a certificate"),
        ({"connect": "tcp/127.0.0.1:1"}, "connect of secure must have endpoints such as tls/"),
        ({"listen": "x"}, "listen must have endpoints such as tls/"),
        ({"allow": {"b": "read"}}, "allow needs listen"),
        ({"listen": "tls/127.0.0.1:1", "allow": 7}, "allow must map common names"),
        ({"listen": "tls/127.0.0.1:1", "allow": {"": "read"}}, "common name,"),
        ({"listen": "tls/127.0.0.1:1", "allow": {"b": "raed"}}, "did you mean 'read'"),
        ({"listen": "tls/127.0.0.1:1", "allow": {"b": {"x*": "read"}}}, "not a valid namespace"),
    ]
    for wrong, text in cases:
        with pytest.raises(tfdb.TfdbError, match=text):
            tfdb.net.secure(**{**ours, **wrong})
    with pytest.raises(FileNotFoundError, match="missing"):
        tfdb.net.secure(**{**ours, "cert": "missing.pem"})
    with pytest.raises(tfdb.InvalidArgument, match="cannot be written as JSON"):
        tfdb.net.Session(config={"mode": object()})
    with pytest.raises(tfdb.InvalidArgument, match="not a configuration of Zenoh"):
        tfdb.net.Session(config={"mode": "nothing"})
