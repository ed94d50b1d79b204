"""docs/howto/from-tf2.md names existing calls and every difference."""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path

import pytest
from tools import write_differences

import tfdb
from tfdb import tf2

PAGE = Path(__file__).resolve().parents[2] / "docs" / "howto" / "from-tf2.md"


def test_every_call_exists() -> None:
    rows = [row for row in PAGE.read_text(encoding="utf-8").splitlines() if row.startswith("| ")]
    names = set(re.findall(r"`(tf2\.[\w.]+)`", "\n".join(row.split(" | ")[1] for row in rows)))
    assert len(names) > 50
    for name in names:
        found: object = tf2
        for part in name.split(".")[1:]:
            if part == "transformations":
                pytest.importorskip("transformations")
            if part in {"tf1", "covariance"}:
                import_module(f"tfdb.tf2.{part}")
            found = getattr(found, part)


def test_every_public_name_is_in_the_table() -> None:
    text = PAGE.read_text(encoding="utf-8")
    modules = {"clouds", "geometry", "msgs"}
    missing = {name for name in tf2.__all__ if f"tf2.{name}" not in text} - modules
    assert missing <= {"FilterFailureReason", "TransformableResult"}
    calls = {name for name in vars(tfdb.tf2.Buffer) if not name.startswith("_")}
    assert {name for name in calls if f"Buffer.{name}`" not in text} <= {"clock", "close"}


def test_the_table_of_differences() -> None:
    """Otherwise: python tools/write_differences.py."""
    text = PAGE.read_text(encoding="utf-8")
    assert write_differences.with_table(text) == text
    assert text.count("\n| `") > 40
