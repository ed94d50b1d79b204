"""Shared stores: names, opening, making, removing."""

from __future__ import annotations

import os
import re
import sys
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from tfdb._core import Buffer, create_store, open_store
from tfdb._core import unlink_store as unlink_file
from tfdb.data.argument_checks import check_name, check_word
from tfdb.data.errors import (
    InvalidArgument,
    InvalidName,
    NoSuchStore,
    NotSupported,
    StoreExists,
    TfdbError,
)
from tfdb.data.path_checks import check_path

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from typing import Any, Literal

    from tfdb.data.types import Name

__all__ = ["find_stores", "open_or_make", "path_of", "reopen", "unlink_store"]

"""A name without a slash, or a path on any memory file system."""

FOLDER = Path("/dev/shm")  # noqa: S108 - where Linux keeps POSIX shared memory
PREFIX = "tfdb."
CONTROL = re.compile(r"\.control-[0-9a-f]{16}(\.new|\.old)?$")
"""The suffix of the second file of a store."""
LONGEST = 200


def path_of(name: Name) -> Path:
    """Return the file of a store.

    Raises
    ------
    InvalidName, NotSupported
    """
    if not sys.platform.startswith("linux"):
        raise NotSupported(f"stores that processes share need Linux; this is {sys.platform}")
    if isinstance(name, os.PathLike):
        return check_path(name).absolute()
    if not isinstance(name, str):
        raise TypeError(f"a store's name is a str or a path, got {type(name).__name__}")
    fault = (
        "is empty"
        if not name
        else "has a slash"
        if "/" in name
        else "has a control character"
        if not name.isprintable()
        else f"is longer than {LONGEST} bytes"
        if len(os.fsencode(name)) > LONGEST
        else "begins with a dot"
        if name.startswith(".")
        else None
    )
    if fault:
        raise InvalidName(
            f"the store's name {name!r} {fault}: a name is one word, such as 'robot1'; Python "
            "takes a pathlib.Path for a file elsewhere",
            reason=fault,
        )
    return FOLDER / (PREFIX + name)


def _group_of(group: int | str | None) -> int | None:
    if not isinstance(group, str):
        return group
    import grp  # noqa: PLC0415 - there is none beyond Unix

    try:
        return grp.getgrnam(group).gr_gid
    except KeyError:
        raise InvalidArgument(f"the group {group!r} does not exist on this machine") from None


def open_or_make(
    name: Name,
    *,
    create: bool | None,
    mode: str,
    group: int | str | None,
    lock_timeout: float | None,
    clock: Callable[[], int] | None,
    **made_with: Any,
) -> Buffer:
    """Implements `Buffer.open`."""
    check_word("mode", check_name("mode", mode), ("r", "rw"))
    if create is not None and not isinstance(create, bool):
        raise InvalidArgument(f"create must be True, False or None, got {create!r}")
    if create and mode == "r":
        raise InvalidArgument("mode='r' never creates a store: create one with mode 'rw'")
    if clock is not None and not callable(clock):
        raise InvalidArgument(f"clock must be a function that returns nanoseconds, got {clock!r}")
    path = path_of(name)
    while True:
        if not create:
            try:
                return open_store(path, mode == "rw", lock_timeout, clock)
            except NoSuchStore:
                if create is False or mode == "r":
                    raise
        try:
            create_store(path, group=_group_of(group), **made_with)
        except StoreExists:
            if create:
                raise
            continue  # another process created it first
        create = False


def unlink_store(name: Name) -> None:
    """Implements `Buffer.unlink`."""
    unlink_file(path_of(name))


def find_stores() -> Iterator[str]:
    """Yield the sorted names of the stores of this machine, also of other users.

    Leftovers of processes that were killed while they made a store are removed.
    """
    files = sorted(path_of("x").parent.glob(PREFIX + "*"))
    stores = [path for path in files if not CONTROL.search(path.name)]
    for path in {path.with_name(CONTROL.sub("", path.name)) for path in files} - {*stores}:
        with suppress(TfdbError):  # opening an incomplete store removes it
            open_store(path, False, None, None)  # noqa: FBT003 - for reading
    for path in stores:
        yield path.name.removeprefix(PREFIX)


def reopen(path: str, mode: Literal["r", "rw"], lock_timeout: float | None) -> Buffer:
    """Unpickle a shared store."""
    return Buffer.open(Path(path), create=False, mode=mode, lock_timeout=lock_timeout)
