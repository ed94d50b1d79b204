"""Checksums and definitions, against Debian's generated classes."""

from __future__ import annotations

import json
import subprocess

import pytest
from rosbags.typesys import Stores, get_typestore

import tfdb
from ros.real_ros1 import PYTHON, need
from tfdb.ros.message_kinds import MESSAGES, SERVICES, kind_of, known_kind, service_kind

SCRIPT = """
import importlib, json, sys
from genpy.dynamic import generate_dynamic

def class_of(name, part):
    package, kind = name.split("/")
    return getattr(importlib.import_module(package + "." + part), kind)

messages, services = json.loads(sys.argv[1])
found = {name: class_of(name, "msg")._md5sum for name in messages}
made = {name: generate_dynamic(name, text)[name]._md5sum for name, text in messages.items()}
asked = {name: class_of(name, "srv")._md5sum for name in services}
print(json.dumps([found, made, asked]))
"""


def test_checksums_are_those_of_debians_classes() -> None:
    need()
    names = [name for name in MESSAGES if not name.startswith("diagnostic_msgs/")]
    definitions = {name: known_kind(name).definition for name in names}
    command = [PYTHON, "-c", SCRIPT, json.dumps([definitions, list(SERVICES)])]
    output = subprocess.run(command, capture_output=True, check=True).stdout
    found, made, asked = json.loads(output.splitlines()[-1])
    ours = {name: kind_of(name).md5sum for name in names}
    assert ours == found
    # A tool that knows only the publisher's header computes the same definition.
    assert made == found
    assert {name: service_kind(name).md5sum for name in SERVICES} == asked


def test_checksums_of_diagnostics_are_those_of_rosbags() -> None:
    """Debian has no package with these messages."""
    types = get_typestore(Stores.ROS1_NOETIC)
    for name in ("DiagnosticArray", "DiagnosticStatus", "KeyValue"):
        _, checksum = types.generate_msgdef(f"diagnostic_msgs/msg/{name}")
        assert kind_of(f"diagnostic_msgs/{name}").md5sum == checksum


def test_the_old_and_the_new_name_of_tf_have_one_checksum() -> None:
    old, new = kind_of("tf/tfMessage"), kind_of("tf2_msgs/TFMessage")
    assert old.md5sum == new.md5sum == "94810edda583a504dfda3829e70d7eec"


def test_types_without_a_definition_are_received_only() -> None:
    assert kind_of("sensor_msgs/Imu").md5sum == "*"
    with pytest.raises(tfdb.InvalidArgument, match=r"'sensor_msgs/Imu'.*tf2_msgs/TFMessage"):
        known_kind("sensor_msgs/Imu")
    with pytest.raises(tfdb.InvalidArgument, match="tf2_msgs/FrameGraph"):
        service_kind("std_srvs/Empty")
