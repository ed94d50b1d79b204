"""The interpreter ends while daemon threads are inside a call: quietly, with status 0."""

from __future__ import annotations

import pytest

from . import exit_amid_calls, imports_of_threads
from .child import printed_by


@pytest.mark.parametrize("concurrency", ["snapshot", "giant", "2pl-wait-die", "silo"])
def test_threads_inside_every_call(concurrency: str) -> None:
    times = 3 if concurrency == "snapshot" else 1
    printed = printed_by(exit_amid_calls.__file__, concurrency, str(times), *exit_amid_calls.CALLS)
    ends = dict(line.split() for line in printed.splitlines())
    assert ends == dict.fromkeys(exit_amid_calls.CALLS, ",".join("0" * times))


@pytest.mark.parametrize("listener", imports_of_threads.LISTENERS)
def test_threads_import_nothing(listener: str) -> None:
    """An import in a thread does not end with the program, whose exit code it may change."""
    assert printed_by(imports_of_threads.__file__, listener) == ""
