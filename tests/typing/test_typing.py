"""What users write passes mypy --strict, and what they must not write does not."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("mypy", reason="types are judged by mypy")

HERE = Path(__file__).resolve().parent


def mypy(name: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "mypy", "--strict", "--no-error-summary", "--config-file="]
    command += ["--cache-dir", os.devnull]
    return subprocess.run(
        [*command, str(HERE / name)], capture_output=True, text=True, check=False, cwd=HERE
    )


def test_good_use_has_no_type_errors() -> None:
    done = mypy("good_use.py")
    assert done.returncode == 0, done.stdout + done.stderr


def test_every_line_of_bad_use_is_an_error() -> None:
    done = mypy("bad_use.py")
    source = (HERE / "bad_use.py").read_text(encoding="utf-8").splitlines()
    expected = {i for i, line in enumerate(source, start=1) if line.endswith("# error")}
    found = {int(line) for line in re.findall(r"bad_use\.py:(\d+): error", done.stdout)}
    assert found == expected, done.stdout + done.stderr
