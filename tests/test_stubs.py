"""The committed stub matches the extension."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("nanobind", reason="the stub generator comes with nanobind")

ROOT = Path(__file__).resolve().parent.parent
SETTINGS = ROOT / "tests" / "typing"


def test_the_stub_matches_the_extension() -> None:
    pytest.importorskip("mypy", reason="mypy compares stubs")
    command = [sys.executable, "-m", "mypy.stubtest", "tfdb._core"]
    command += ["--allowlist", str(SETTINGS / "stubtest_allowed.txt")]
    command += ["--mypy-config-file", str(SETTINGS / "stubtest.ini")]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_committed_stub_is_the_generated_one() -> None:
    command = [sys.executable, str(ROOT / "tools" / "make_stubs.py"), "--check"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
