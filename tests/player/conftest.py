"""Names of shared stores that a test makes."""

from __future__ import annotations

import itertools
import os
from contextlib import suppress
from typing import TYPE_CHECKING

import pytest

import tfdb

if TYPE_CHECKING:
    from collections.abc import Iterator

_numbers = itertools.count()


@pytest.fixture
def name() -> Iterator[str]:
    """Return a name for a store, which is removed behind the test."""
    made = f"test-player-{os.getpid()}-{next(_numbers)}"
    yield made
    with suppress(tfdb.errors.NoSuchStore):  # the test made none
        tfdb.Buffer.unlink(made)
