"""Appliers that stay from one sample to the next, in the place of `Buffer.apply`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import tfdb

if TYPE_CHECKING:
    from collections.abc import Iterable

    import pytest


def use_appliers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let `Buffer.apply` use one applier for each source, prefix and list of shared frames."""
    kept: dict[tuple[Any, ...], Any] = {}

    def apply(
        buffer: tfdb.Buffer,
        data: bytes,
        *,
        source: str = "",
        prefix: str = "",
        shared: str | Iterable[str] = (),
    ) -> tfdb.types.Position:
        names = (shared,) if isinstance(shared, str) else tuple(shared)
        key = id(buffer), source, prefix, names
        if key not in kept:
            kept[key] = buffer._applier(source, prefix, names)
        applied: tfdb.types.Position = kept[key].apply(data)
        return applied

    monkeypatch.setattr(tfdb.Buffer, "apply", apply)
