"""Names of ROS 1: resolving, remapping, validity."""

from __future__ import annotations

import json
import subprocess

import pytest

import tfdb
from ros.real_ros1 import PYTHON, need
from tfdb.ros.names import Names, anonymous, host_and_port, is_loopback, parse_arguments

HERE = {"ROS_IP": "127.0.0.1"}
NAMES = ["tf", "/tf", "~tf", "a/b", "/a/b/", "~a/b", "tf_static", "x9"]


def made(name: str = "n", *arguments: str, **environment: str) -> Names:
    return Names(name, ["program", *arguments], {**HERE, **environment})


@pytest.mark.parametrize("namespace", ["", "/", "robot", "/robot/", "/a/b"])
def test_names_resolve_as_those_of_rosgraph(namespace: str) -> None:
    need()
    ours = made(ROS_NAMESPACE=namespace)
    script = (
        "import json, sys, rosgraph.names as n\n"
        "node, names = json.loads(sys.argv[1])\n"
        "print(json.dumps([n.resolve_name(each, node) for each in names]))"
    )
    command = [PYTHON, "-c", script, json.dumps([ours.node, NAMES])]
    theirs = json.loads(subprocess.run(command, capture_output=True, check=True).stdout)
    assert [ours.resolve(name) for name in NAMES] == theirs


def test_arguments_remap() -> None:
    names = made("n", "tf:=/robot/tf", "~map:=other", "__ns:=deep", "__name:=new", "_x:=1", "--y")
    assert names.node == "/deep/new"
    assert names.resolve("tf") == names.resolve("/deep/tf") == "/robot/tf"
    assert names.resolve("~map") == "/deep/other"
    assert names.resolve("/tf") == "/tf"
    assert parse_arguments(["_x:=1", "a:=b", "9:=b", "a:=", "-a:=b"]) == {"a": "b"}


def test_the_master_and_the_host_come_from_arguments_before_the_environment() -> None:
    names = made("n", "__master:=http://m:1", "__ip:=10.0.0.1", ROS_MASTER_URI="http://e:2")
    assert (names.master, names.host) == ("http://m:1", "10.0.0.1")
    assert made(ROS_MASTER_URI="http://e:2").master == "http://e:2"
    assert made().master == "http://localhost:11311"
    assert made(ROS_HOSTNAME="robot").host == "robot"
    assert Names("n", [], {}).host
    assert is_loopback("127.0.1.1")
    assert is_loopback("localhost")
    assert not is_loopback("10.0.0.1")


@pytest.mark.parametrize("name", ["", "9a", "a b", "a//b", "a~b", "é", "a-b", "/a\n"])
def test_invalid_names_are_refused(name: str) -> None:
    with pytest.raises(tfdb.errors.InvalidName) as caught:
        made().resolve(name)
    assert caught.value.value == name
    assert repr(name) in str(caught.value)


@pytest.mark.parametrize("name", ["", "/a", "a/b", "~a", "a b"])
def test_a_node_is_named_without_its_namespace(name: str) -> None:
    with pytest.raises(tfdb.errors.InvalidName, match="ROS_NAMESPACE"):
        made(name)


@pytest.mark.parametrize("host", ["http://robot", "robot:11311"])
def test_a_uri_as_host_is_refused(host: str) -> None:
    with pytest.raises(tfdb.InvalidArgument, match="ROS_HOSTNAME or ROS_IP"):
        made(ROS_HOSTNAME=host)


@pytest.mark.parametrize(
    "uri", ["", "robot", "http://robot", "http://:1", "http://a:b", "[", "x://["]
)
def test_invalid_uris_are_refused(uri: str) -> None:
    with pytest.raises(tfdb.InvalidArgument, match="not a ROS URI"):
        host_and_port(uri)


def test_uris_are_taken_apart() -> None:
    assert host_and_port("http://robot:11311/") == ("robot", 11311)
    assert host_and_port("rosrpc://10.0.0.1:5") == ("10.0.0.1", 5)


def test_anonymous_names_are_names() -> None:
    assert made(anonymous("tfdb")).node.startswith("/tfdb_")
