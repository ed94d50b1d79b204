"""The fixture that every test against the real tf2 takes."""

from __future__ import annotations

import pytest

from compat import tf2_oracle


@pytest.fixture(scope="session")
def tf2() -> tf2_oracle.Tf2Oracle:
    return tf2_oracle.connect()
