"""Paths that callers give: refused where they name no file, named in every error of reading one."""

from __future__ import annotations

import os
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .errors import InvalidArgument

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    Refusal = Callable[[Path, str], Exception]

NO_NAME = "no file can have this name"


def invalid(path: Path, reason: str) -> Exception:
    """Make the error of an argument."""
    return InvalidArgument(f"{path}: {reason}", path=str(path), reason=reason)


def given_path(path: Any, refusal: Refusal = invalid) -> Path:
    """Return the path of a file.

    Raises InvalidArgument for what is no path and for the empty one, which would be the current
    folder; what `refusal` makes of (path, reason) for a name that no file can have.
    """
    if isinstance(path, os.PathLike):
        path = os.fspath(path)
    if not isinstance(path, str):
        got = type(path).__name__
        raise InvalidArgument(f"a path is a str or an os.PathLike of str, got {got}", value=path)
    if not path:
        raise InvalidArgument("the path is empty: it names no file", value=path)
    made = Path(path)
    try:
        if b"\0" not in os.fsencode(path):
            return made
    except UnicodeEncodeError:
        pass  # nor can the system write it
    raise refusal(made, NO_NAME)


def given_paths(paths: Any, refusal: Refusal = invalid) -> list[Path]:
    """Return the paths of one file or of several; raises as `given_path`."""
    one = isinstance(paths, str | bytes | os.PathLike) or not hasattr(paths, "__iter__")
    return [given_path(path, refusal) for path in ([paths] if one else paths)]


@contextmanager
def errors_name(path: Path) -> Iterator[None]:
    """Let an OSError that names no file name this one."""
    try:
        yield
    except OSError as error:
        if error.filename is None and error.errno is not None:
            error.filename = str(path)
        raise
