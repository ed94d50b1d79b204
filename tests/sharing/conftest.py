"""The name of a store, which is removed after the test."""

from __future__ import annotations

import os
from contextlib import suppress
from itertools import count
from typing import TYPE_CHECKING

import pytest

import tfdb

if TYPE_CHECKING:
    from collections.abc import Iterator

_numbers = count()


@pytest.fixture
def name() -> Iterator[str]:
    made = f"test-{os.getpid()}-{next(_numbers)}"
    yield made
    with suppress(tfdb.errors.NoSuchStore):  # the test made none, or removed it
        tfdb.Buffer.unlink(made)
