"""Frozen stores: files with one state of a store, which processes map."""

from __future__ import annotations

import os
from contextlib import suppress
from typing import TYPE_CHECKING

from tfdb._core import freeze_store
from tfdb._core import open as open_frozen
from tfdb.data.errors import CapacityExceeded, ReadOnly
from tfdb.data.new_file import new_file, temporary_folder

if TYPE_CHECKING:
    from pathlib import Path

    from tfdb._core import Buffer, StoreReader

__all__ = [
    "MAGIC",
    "PICKLED",
    "SUFFIX",
    "freeze_into",
    "is_frozen",
    "reopen",
    "state_of",
    "thaw",
]

SUFFIX = ".tfdb"
MAGIC = b"TFDBFRZ1"
"""The first bytes of a frozen store."""
PICKLED = "pickled"
"""The origin of an unpickled frozen store, which has no file."""


def freeze_into(
    reads: StoreReader, path: str | os.PathLike[str], *, overwrite: bool, origin: str = ""
) -> None:
    """Implements `Buffer.freeze`; `origin` becomes `Buffer.frozen.origin` of the frozen store."""
    with new_file(path, overwrite=overwrite) as made:
        try:
            freeze_store(reads, made, origin)
        except (CapacityExceeded, ReadOnly) as error:
            if error.path is None:  # not about the file
                raise
            message = str(error).replace(str(made), os.fspath(path))
            raise type(error)(message, path=os.fspath(path), reason=error.reason) from None


def is_frozen(path: Path) -> bool:
    """Return whether a file is a frozen store, by its first bytes or its extension."""
    if not path.is_file():
        return False
    if path.suffix == SUFFIX:
        return True
    # The reader of recordings raises the error for an unreadable file.
    with suppress(OSError), path.open("rb") as file:
        return file.read(len(MAGIC)) == MAGIC
    return False


def reopen(path: str) -> Buffer:
    """Open a frozen store that was pickled."""
    return open_frozen(path)


def state_of(buffer: Buffer) -> bytes:
    """Return the newest state of a store as the bytes of a frozen store."""
    with temporary_folder() as folder:
        path = folder / f"pickled{SUFFIX}"
        freeze_store(buffer, path, PICKLED)
        return path.read_bytes()


def thaw(state: bytes) -> Buffer:
    """Open the bytes of a frozen store without a file."""
    with temporary_folder() as folder:
        path = folder / f"pickled{SUFFIX}"
        path.write_bytes(state)
        return open_frozen(path)  # the mapping stays when the file is removed
