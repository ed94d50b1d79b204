"""Ends the threads of rules after each test."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from tfdb.rules import rules

if TYPE_CHECKING:
    from collections.abc import Iterator


@pytest.fixture(autouse=True)
def _close_buffers() -> Iterator[None]:
    """Close buffers with rules: their threads would live as long as the process."""
    yield
    for each in list(rules._all):
        each._buffer.close()
