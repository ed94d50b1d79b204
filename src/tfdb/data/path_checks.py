"""Checks of path arguments; errors of reading name the path."""

from __future__ import annotations

import errno
import os
from contextlib import contextmanager, suppress
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


def check_path(path: Any, refusal: Refusal = invalid) -> Path:
    """Return the path of a file.

    Raises InvalidArgument for other types and for an empty path, which would mean the current
    folder. Raises `refusal(path, reason)` for a name that no file can have.
    """
    if isinstance(path, os.PathLike):
        path = os.fspath(path)
    if not isinstance(path, str):
        got = type(path).__name__
        raise InvalidArgument(
            f"a path must be a str or an os.PathLike of str, got {got}", value=path
        )
    if not path:
        raise InvalidArgument("the path is empty: give the name of a file", value=path)
    made = Path(path)
    try:
        if b"\0" not in os.fsencode(path):
            return made
    except UnicodeEncodeError:
        pass  # the system could not write it either
    raise refusal(made, NO_NAME)


def check_paths(paths: Any, refusal: Refusal = invalid) -> list[Path]:
    """Return the paths of one file or of several; raises as `check_path`."""
    one = isinstance(paths, str | bytes | os.PathLike) or not hasattr(paths, "__iter__")
    return [check_path(path, refusal) for path in ([paths] if one else paths)]


def missing_file(path: Path) -> FileNotFoundError:
    """Make the error of a file that does not exist; it suggests the most similar name."""
    folder = path.parent
    missing = first_missing(path)
    if missing != path:
        what = f"missing folder {missing}"
        return FileNotFoundError(errno.ENOENT, f"{what}; check the path", str(path))
    from .suggestions import near_names  # noqa: PLC0415 - for errors alone

    with suppress(OSError):
        beside = [other.name for other in folder.iterdir() if other.exists()]
        near = near_names(path.name, beside, most=1, cutoff=0.6)
        if near:
            hint = f"did you mean {folder / near[0]}?"
            return FileNotFoundError(errno.ENOENT, f"no such file; {hint}", str(path))
    return FileNotFoundError(errno.ENOENT, "no such file; check the path", str(path))


def first_missing(path: Path) -> Path:
    """Return the first part of the path that does not exist."""
    return next((each for each in (*reversed(path.parents), path) if not each.exists()), path)


@contextmanager
def errors_name(path: Path) -> Iterator[None]:
    """Add the path to an OSError without one; for a missing file also the most similar name."""
    try:
        yield
    except FileNotFoundError as error:
        if error.filename not in (None, str(path)) or path.exists():
            raise
        raise missing_file(path) from None
    except OSError as error:
        if error.filename is None and error.errno is not None:
            error.filename = str(path)
        raise


def shell_word(name: str) -> str:
    """Return a file name as an argument in a shell, even if it has spaces or begins with a dash."""
    import shlex  # noqa: PLC0415 - only for the text of an error

    return shlex.quote(f"./{name}" if name.startswith("-") else name)
