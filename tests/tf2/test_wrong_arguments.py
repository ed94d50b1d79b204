"""Wrong arguments raise the same classes as on Debian's packages, or a listed difference."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

from compat.tf2_oracle import unavailable
from tf2 import real_tf2

PROGRAM = Path(__file__).with_name("wrong_arguments_program.py")
TESTS = PROGRAM.parents[1]
DEBIAN = "/usr/lib/python3/dist-packages"

TAKEN = {
    "integer time": "numbers",
    "integer time of a buffer": "numbers",
    "float timeout": "numbers",
    "number of seconds": "numbers",
    "number of a core": "numbers",
    "by name": "arguments",
    "type not imported": "registered",
    "send a tuple": "wrong_message",
}
"""Calls that raise upstream and are taken here, by the difference."""
REFUSED = {"one too many of clear": "arguments"}
"""Calls that are taken upstream and raise here."""
WORDS = {
    "no time": "time must have a to_sec method",
    "text as a timeout": "timeout must have a to_sec method",
    "text as cache_time": "cache_time must have a to_sec method",
    "one too many of set": "takes at most 2 positional arguments (transform, authority), got 3",
    "one too few of set": "set_transform() is missing the argument 'authority'",
    "one too many of clear": "clear() takes no arguments, got 1",
    "unknown name": "unexpected keyword argument 'target'; did you mean 'target_frame'?",
    "integer frame": "target_frame must be a str, got int",
    "integer authority": "authority must be a str, got int",
    "unknown type": "Type <class 'str'> is not loaded or supported",
    "no header": "obj must be an object that can have a header",
    "send nothing": "transform must be a TransformStamped or several, got None",
    "send a list of nothing": "transform[0] must be a TransformStamped, got None",
    "send text": "transform must be a TransformStamped or several, got 'x'",
}
SHOWN = {*TAKEN.values(), *REFUSED.values()}
"""The differences that are shown here."""


@cache
def theirs() -> dict[str, list[str]]:
    if real_tf2.missing():
        unavailable(f"no real tf2: {real_tf2.missing()}; apt-get install python3-tf2-ros")
    return run(real_tf2.PYTHON, real_tf2.ENVIRONMENT)


@cache
def ours() -> dict[str, list[str]]:
    path = os.pathsep.join((str(TESTS), DEBIAN))
    return run(sys.executable, os.environ | {"PYTHONPATH": path}, "tfdb")


def run(python: str, environment: dict[str, str], *args: str) -> dict[str, list[str]]:
    command = [python, str(PROGRAM), *args]
    done = subprocess.run(
        command, env=environment, capture_output=True, text=True, check=False, timeout=120
    )
    assert done.returncode == 0, done.stderr
    found: dict[str, list[str]] = json.loads(done.stdout.splitlines()[-1])
    return found


def test_each_call_ends_as_upstreams_or_as_listed() -> None:
    real, made = theirs(), ours()
    assert list(real) == list(made)
    for name, end in real.items():
        if name in TAKEN:
            assert end, name
            assert not made[name], (name, made[name])
        elif name in REFUSED:
            assert not end, name
            assert "TypeError" in made[name], (name, made[name])
        else:
            # A program that catches upstream's class catches ours.
            assert bool(end) == bool(made[name]), (name, end, made[name])
            assert set(end[1:2]) <= set(made[name]), (name, end, made[name])


@pytest.mark.parametrize("name", WORDS)
def test_the_words_name_the_argument(name: str) -> None:
    theirs()
    assert WORDS[name] in ours()[name][0]
