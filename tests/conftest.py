"""Fixtures that every room's tests share."""

from __future__ import annotations

import faulthandler
import os
import signal
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import HealthCheck, settings

import tfdb
from tests.appliers import use_appliers

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).resolve().parent.parent
_numbers = count()

# Fixed seeds: a run that failed once fails again, and the failing example is printed.
settings.register_profile(
    "tfdb",
    derandomize=True,
    deadline=None,
    print_blob=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)
settings.load_profile("tfdb")

# Shells let what they run in the background ignore Ctrl-C, and so would the processes of tests.
signal.signal(signal.SIGINT, signal.default_int_handler)

CHILD_SECONDS = 200  # less than `faulthandler_timeout`


def pytest_configure() -> None:
    """Limit the life of forked children: one that hangs keeps the pipe of its worker open.

    Without the limit pytest waits for ever, and names no test, after `faulthandler` has ended the
    worker. A limited child prints its threads first.
    """
    stderr = os.dup(2)  # not captured here

    def limit() -> None:
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        faulthandler.register(signal.SIGALRM, stderr, chain=True)
        signal.alarm(CHILD_SECONDS)

    os.register_at_fork(after_in_child=limit)


@pytest.fixture(scope="session")
def repository() -> Path:
    """Folder of the checkout."""
    return ROOT


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of the real robots' recordings, which are too large to ship.

    It is `$TFDB_SHARED_DATA`, or `shared/data` beside the checkout. Where it is missing the test
    skips, except with CI=true: there it fails.
    """
    folder = Path(os.environ.get("TFDB_SHARED_DATA") or ROOT.parent / "shared" / "data")
    if folder.is_dir():
        return folder
    reason = f"no recordings of real robots at {folder} (set TFDB_SHARED_DATA)"
    if os.environ.get("CI") == "true":
        pytest.fail(reason)
    pytest.skip(reason)


@contextmanager
def _store_names(many: int) -> Iterator[list[str]]:
    made = [f"test-{os.getpid()}-{next(_numbers)}" for _ in range(many)]
    yield made
    for each in made:
        with suppress(tfdb.errors.NoSuchStore):  # the test made none, or removed it
            tfdb.Buffer.unlink(each)


@pytest.fixture
def name() -> Iterator[str]:
    """Name of a shared store, which is removed after the test."""
    with _store_names(1) as (made,):
        yield made


@pytest.fixture
def names() -> Iterator[tuple[str, str]]:
    """Names of two shared stores, which are removed after the test."""
    with _store_names(2) as (one, other):
        yield one, other


@pytest.fixture(params=["apply", "applier"])
def by_both_appliers(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run a test by `Buffer.apply`, and by appliers that stay from one sample to the next."""
    if request.param == "applier":
        use_appliers(monkeypatch)
