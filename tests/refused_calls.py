"""Properties of every refused call."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import pytest

import tfdb
from tests.stored import stored

if TYPE_CHECKING:
    from collections.abc import Iterator

TURN = (0.1, -0.7, 0.1, 0.7)


@contextmanager
def refused(buffer: tfdb.Buffer, error: type[tfdb.TfdbError]) -> Iterator[Any]:
    """The call raises `error`, and the store is what it was: commit, frames, samples, lookups."""
    before = buffer.commit, stored(buffer)
    with pytest.raises(error) as caught:
        yield caught
    assert type(caught.value) is error
    assert (buffer.commit, stored(buffer)) == before
    buffer.set_static_transform("base", "still_alive", (1, 2, 3), TURN)
    buffer.remove_frames("still_alive")


@contextmanager
def refused_when_full(buffer: tfdb.Buffer) -> Iterator[None]:
    before = (buffer.commit, buffer.frames())
    with pytest.raises(tfdb.errors.CapacityExceeded):
        yield
    assert (buffer.commit, buffer.frames()) == before
