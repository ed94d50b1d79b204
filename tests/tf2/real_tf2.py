"""Debian's real tf2_py as a judge, in a process of the system's Python.

Where python3-tf2 is missing the tests that need it skip and say so; with CI=true they fail.
"""

from __future__ import annotations

import json
import os
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

from compat.tf2_oracle import unavailable

PYTHON = "/usr/bin/python3"
ENVIRONMENT = {"PYTHONPATH": "/usr/lib/python3/dist-packages", "PATH": os.environ["PATH"]}
CHILD = Path(__file__).with_name("tf2_child.py")


@cache
def missing() -> str:
    """Return why tf2 is missing; empty: it is installed."""
    command = [PYTHON, "-c", "import tf2_py, rospy, geometry_msgs.msg"]
    try:
        tried = subprocess.run(
            command, env=ENVIRONMENT, capture_output=True, text=True, check=False
        )
    except OSError as error:
        return f"{PYTHON}: {error}"
    return "" if tried.returncode == 0 else tried.stderr.strip().splitlines()[-1]


def run(operations: list[list[Any]]) -> list[tuple[str, Any]]:
    """What tf2 answers to each: ('ok', value), or the name of its exception and its text."""
    if missing():
        unavailable(f"no real tf2: {missing()}; apt-get install python3-tf2")
    done = subprocess.run(
        [PYTHON, CHILD],
        env=ENVIRONMENT,
        input="".join(json.dumps(each) + "\n" for each in operations),
        capture_output=True,
        text=True,
        check=True,
    )
    answers = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(answers) == len(operations)
    return [(word, value) for word, value in answers]
