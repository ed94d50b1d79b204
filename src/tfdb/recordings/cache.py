"""Caches of loaded recordings: frozen stores that are checked before use."""

from __future__ import annotations

import hashlib
import json
import os
import warnings
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from tfdb._core import __version__
from tfdb._core import open as open_frozen
from tfdb.data.errors import StoreExists, TfdbError, TfdbWarning
from tfdb.store.frozen import MAGIC, SUFFIX, freeze_into

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tfdb._core import Buffer

    from .selection import Choice

__all__ = ["Cache"]

# The beginning of the record in a cache: its first key, as `json` writes it.
_MARK = b'{"tfdb": "'


class Cache:
    """The cache of recordings, and the conditions for its use.

    Parameters
    ----------
    paths
        The recordings.
    choice
        The loaded selection; each selection has its own cache.

    Raises OSError if a recording cannot be read.
    """

    def __init__(self, paths: Sequence[Path], choice: Choice) -> None:
        self._files = [file for path in paths for file in _files_of(path)]
        found = [file.stat() for file in self._files]
        self._times = [status.st_mtime_ns for status in found]
        self._wanted = {
            "tfdb": __version__,
            "choice": choice.key,
            "files": [
                [f.name, status.st_size] for f, status in zip(self._files, found, strict=True)
            ],
        }
        plain = len(paths) == 1 and not choice.key
        first, *_ = whole = [path.absolute() for path in paths]
        short = _short([[path.name for path in whole], choice.key])
        beside = first.with_name(first.name + (SUFFIX if plain else f".{short}{SUFFIX}"))
        home = _home()
        elsewhere = f"{_short([str(path) for path in whole])}-{beside.name}"
        self._places = [beside, *([home / elsewhere] if home else ())]

    def open(self) -> Buffer | None:
        """Open the cache; None if it is missing, stale or damaged.

        Raises StoreExists if another file has its name.
        """
        for place in self._places:
            _refuse_foreign(place)
            try:
                found = open_frozen(place, verify=True)
                kept = json.loads(found.frozen.origin) if found.frozen else None
            except (TfdbError, ValueError):
                continue
            if not isinstance(kept, dict) or any(kept.get(k) != v for k, v in self._wanted.items()):
                continue
            if kept.get("times") == self._times:
                return found
            # A copied or touched recording has another time, but perhaps the same content.
            if kept.get("hash") == _hash(self._files):
                return self._put(found, place, kept["hash"]) or found
        return None

    def keep(self, buffer: Buffer) -> Buffer:
        """Keep the loaded data and open the copy; without a writable folder return them."""
        made_of = _hash(self._files)
        if [file.stat().st_mtime_ns for file in self._files] != self._times:
            return buffer  # the recording changed meanwhile
        for place in self._places:
            kept = self._put(buffer, place, made_of)
            if kept is not None:
                return kept
        places = " nor ".join(map(str, self._places))
        message = f"the cache is not written: {places} cannot be written"
        warnings.warn(message, TfdbWarning, stacklevel=3)
        return buffer

    def _put(self, buffer: Buffer, place: Path, made_of: str) -> Buffer | None:
        """Write a frozen store; None if it cannot be written."""
        _refuse_foreign(place)  # another process may have written it in the meantime
        record = {**self._wanted, "times": self._times, "hash": made_of}
        try:
            if place != self._places[0]:
                place.parent.mkdir(parents=True, exist_ok=True)
            freeze_into(buffer, place, overwrite=True, origin=json.dumps(record))
            return open_frozen(place)
        except (OSError, TfdbError):
            return None


def _refuse_foreign(place: Path) -> None:
    """Raise StoreExists for a file that `Cache` has not written: it is not replaced.

    A damaged cache, or one of another version, is recognised by its record.
    """
    if not place.is_file():
        return
    with suppress(OSError), place.open("rb") as file:
        before = b""
        while part := file.read(1 << 16):
            if not before and not part.startswith(MAGIC):
                break
            if _MARK in before + part:
                return
            before = part[-len(_MARK) :]
    reason = "exists already, and is not a cache of load(cache=True)"
    raise StoreExists(
        f"{place} {reason}: move it away, or load without cache", path=str(place), reason=reason
    )


def _home() -> Path | None:
    """Return the folder for caches that cannot lie beside their recording; None without one."""
    try:
        given = os.environ.get("XDG_CACHE_HOME")
        return (Path(given) if given else Path("~/.cache").expanduser()) / "tfdb"
    except RuntimeError:
        return None


def _files_of(path: Path) -> list[Path]:
    """List the files of a recording."""
    if not path.is_dir():
        real = path.resolve()  # the recorder of a .db3 may leave a log beside it
        logs = [real.with_name(real.name + end) for end in ("-wal", "-journal")]
        return [path, *(log for log in logs if log.is_file())]
    return sorted(file for file in path.iterdir() if file.is_file() and file.suffix != SUFFIX)


def _hash(files: Sequence[Path]) -> str:
    """Hash the content of the files."""
    digest = hashlib.blake2b(digest_size=16)
    for path in files:
        with path.open("rb") as file:
            digest.update(hashlib.file_digest(file, "blake2b").digest())
    return digest.hexdigest()


def _short(what: object) -> str:
    return hashlib.blake2b(repr(what).encode("utf-8", "surrogateescape"), digest_size=4).hexdigest()
