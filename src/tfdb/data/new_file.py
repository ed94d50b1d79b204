"""Atomic writing of files: a file appears under its name when it is complete.

All writers of tfdb use `new_file`.
"""

from __future__ import annotations

import errno
import os
import shutil
import stat
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from .argument_checks import check_flag
from .path_checks import check_path, invalid

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from contextlib import AbstractContextManager

    from .path_checks import Refusal

EXISTS = "exists already; pass overwrite=True to replace it"

# Errors of file systems without hard links.
_NO_LINKS = frozenset({errno.EPERM, errno.EOPNOTSUPP, errno.ENOSYS, errno.EMLINK, errno.EINVAL})


@contextmanager
def new_file(
    path: str | os.PathLike[str], *, overwrite: bool = False, refusal: Refusal = invalid
) -> Iterator[Path]:
    """Yield a path to write to; at the end of the block the file is renamed to `path`.

    The file is written in a temporary folder beside the target and synced to the disk before it is
    renamed. An exception, a full disk, or a name that was taken in the meantime without `overwrite`
    leaves the old file unchanged and no other file. A symbolic link stays: its target is replaced.

    Raises `refusal(path, reason)` if the name is taken and may not be replaced, or is that of a
    folder or device; a broken link counts as taken. Raises OSError, with `path` as its filename, if
    the file cannot be written.
    """
    path = check_path(path, refusal)
    refuse_existing(path, overwrite=overwrite, refusal=refusal)
    target = Path(os.path.realpath(path) if path.is_symlink() else path.absolute())
    work = _unused(target.parent, ".tfdb-")
    with _errors_name(path, work), _made(work):
        made = work / path.name
        yield made
        bring_to_disk(made)
        if overwrite:
            if target.exists():
                shutil.copymode(target, made)
            made.replace(target)
        else:
            try:
                take_name(made, target)
            except FileExistsError:
                raise refusal(path, EXISTS) from None
        bring_to_disk(target.parent)


def refuse_unwritable(path: Path) -> None:
    """Raise OSError, with `path` as its filename, if `new_file` could not write the file now."""
    work = _unused(path.absolute().parent, ".tfdb-")
    with _errors_name(path, work), _made(work):
        (work / path.name).touch()


def temporary_folder() -> AbstractContextManager[Path]:
    """Yield a new temporary folder, which is removed with its files at the end of the block."""
    import tempfile  # noqa: PLC0415 - few recordings are unpacked

    return _made(_unused(Path(tempfile.gettempdir()), "tfdb-"))


def _unused(parent: Path, prefix: str) -> Path:
    return parent / f"{prefix}{os.urandom(8).hex()}"


@contextmanager
def _made(work: Path) -> Iterator[Path]:
    """Make a folder, and remove it with its files at the end of the block.

    A signal that raises, such as Ctrl-C, leaves nothing behind: the removal is prepared before the
    folder is made, and repeated if a signal ends it.
    """
    try:
        try:
            work.mkdir(0o700)
            yield work
        finally:
            shutil.rmtree(work, ignore_errors=True)
    finally:
        # A signal may have ended the first removal.
        shutil.rmtree(work, ignore_errors=True)


def refuse_existing(
    path: Path, *, overwrite: bool = False, refusal: Refusal = invalid, hint: str = EXISTS
) -> None:
    """Raise the error `refusal(path, reason)` unless the file may be written."""
    if not os.path.lexists(path):
        return
    if not check_flag("overwrite", overwrite):
        raise refusal(path, hint)
    # The rename would replace a device or pipe by a file.
    if path.exists() and not stat.S_ISREG(path.stat().st_mode):
        raise refusal(path, "is not a regular file")


def is_one_of(path: Path, inputs: Sequence[Path]) -> bool:
    """Return whether a file is one of the inputs or lies in one of them, also under other names."""
    if not path.exists():
        return False
    files = [file for each in inputs for file in (each, *(each.iterdir() if each.is_dir() else ()))]
    return any(file.exists() and path.samefile(file) for file in files)


@contextmanager
def _errors_name(path: Path, folder: Path) -> Iterator[None]:
    """Change errors about files in `folder` to name the requested file."""
    try:
        yield
    except OSError as error:
        name = error.filename
        inside = name is None or (isinstance(name, str) and Path(name).is_relative_to(folder))
        if error.errno is None or not inside:
            raise
        said = os.strerror(error.errno)
        if not path.parent.exists():
            said = f"missing folder {path.parent}"
        raise OSError(error.errno, said, str(path)) from error


def bring_to_disk(path: Path) -> None:
    """Sync a file, or the names in a folder, to the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        # Some file systems cannot sync folders.
        if error.errno not in (errno.EINVAL, errno.ENOTSUP) or not path.is_dir():
            raise
    finally:
        os.close(descriptor)


def take_name(made: Path, target: Path) -> None:
    """Rename the file; raises `FileExistsError` if the name is taken."""
    try:
        os.link(made, target)
    except OSError as error:
        if error.errno not in _NO_LINKS:
            raise
        # Creating the name reserves it for this process; the rename then replaces it.
        os.close(os.open(target, os.O_WRONLY | os.O_CREAT | os.O_EXCL))
        made.replace(target)
