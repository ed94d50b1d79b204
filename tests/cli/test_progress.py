"""The progress bar is on stderr of a terminal only."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from conftest import Tool


def test_no_bar_without_a_terminal(tool: Tool, bag: Path) -> None:
    assert tool.installed("info", bag).err == ""


def test_bar_on_a_terminal(bag: Path) -> None:
    master, slave = os.openpty()
    command = [sys.executable, "-m", "tfdb.cli", "check", str(bag), "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=slave, text=True) as process:
        os.close(slave)
        shown = b""
        with contextlib.suppress(OSError):  # Linux reports a closed terminal by this error
            while part := os.read(master, 4096):
                shown += part
        printed = process.communicate()[0]
    os.close(master)
    assert process.returncode == 0
    assert b"reading" in shown
    assert printed.startswith("{")
    assert "\x1b[" not in printed
