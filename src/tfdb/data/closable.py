"""The class Closable: a context manager that closes itself."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from typing import Self

__all__: list[str] = []


class _WithClose(Protocol):
    def close(self) -> None: ...


class Closable:
    """Base of classes with `close()`: a `with` block calls it at its end."""

    __slots__ = ()

    def __enter__(self) -> Self:
        return self

    def __exit__(self: _WithClose, *_: object) -> None:
        self.close()
