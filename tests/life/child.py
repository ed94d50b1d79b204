"""Runs a separate Python that must exit successfully and silently."""

from __future__ import annotations

import subprocess
import sys

LIMIT_S = 500
"""So long only where something hangs."""


def printed_by(*arguments: str) -> str:
    """Run Python with these arguments to its end; return what it printed."""
    done = subprocess.run(
        [sys.executable, *arguments], capture_output=True, text=True, timeout=LIMIT_S, check=False
    )
    assert (done.stderr, done.returncode) == ("", 0), done.stdout
    return done.stdout
