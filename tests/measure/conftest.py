"""The command under test."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from tests.measure.running import Bench, has

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    if not has("snapshot"):
        pytest.skip("tfdb_driver is not built into this installation")
    return Bench(tmp_path)
