"""Reads bytes of recordings by position, and decompresses them within limits.

Numbers in a file are not trusted. No read goes beyond the end of the file. No decompression
produces more than its record declares, and no record may declare more than `MAX_CHUNK`.
"""

from __future__ import annotations

import bz2
import io
import os
import sys
from typing import IO, TYPE_CHECKING, Any, TypeAlias, overload

if TYPE_CHECKING:
    from pathlib import Path

ZSTD = b"\x28\xb5\x2f\xfd"
"""The first bytes of a zstd frame."""
MAX_CHUNK = 256 * 2**20
"""Largest size in bytes of a record or chunk, compressed or not. Programs that trust their
recordings may increase it."""
MAX_MESSAGE = 64 * 2**20
"""Largest size in bytes of a message that is compressed by itself."""

_PIECE = 65536

Packed: TypeAlias = bytes | memoryview
"""Returns uncompressed data unchanged, without a copy."""


class BadDataError(Exception):
    """The bytes violate their format."""


class BrokenChunkError(BadDataError):
    """The records of a decompressed chunk end at `at`; invalid bytes follow."""

    def __init__(self, reason: object, at: int) -> None:
        super().__init__(str(reason))
        self.at = at


class RawFile:
    """A file that is read by position, in any number of threads; `close` is the last call."""

    def __init__(self, path: Path) -> None:
        self._descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        self.size: int = os.fstat(self._descriptor).st_size

    def look_again(self) -> None:
        """Update the size of a growing file; raises `BadDataError` if it has shrunk."""
        size = os.fstat(self._descriptor).st_size
        if size < self.size:
            raise BadDataError(f"it shrank from {self.size} to {size} bytes while it was followed")
        self.size = size

    def read(self, at: int, count: int) -> bytes:
        """Return bytes from a position on; raises `BadDataError` if the file has fewer."""
        check_size(count)
        if at < 0 or at + count > self.size:
            raise BadDataError(f"{count} bytes at {at} go beyond the end of the file, {self.size}")
        data = os.pread(self._descriptor, count, at)
        if len(data) != count:
            raise BadDataError(f"the file ends at {at + len(data)} while it is read")
        return data

    def data_from(self, at: int) -> int:
        """Return the first position from `at` on that is not in a hole of a sparse file."""
        try:
            return os.lseek(self._descriptor, at, os.SEEK_DATA)
        except OSError:
            return self.size  # only a hole follows

    def close(self) -> None:
        """Close the file. A second call does nothing."""
        descriptor, self._descriptor = self._descriptor, -1
        if descriptor >= 0:
            os.close(descriptor)


def check_size(size: int) -> None:
    """Refuse a declared size above `MAX_CHUNK`."""
    if size > MAX_CHUNK:
        limit = f"the limit of {MAX_CHUNK} (tfdb.recordings.raw_file.MAX_CHUNK)"
        raise BadDataError(f"a record of {size} bytes, above {limit}")


@overload
def unpack(packing: str, packed: bytes, size: int) -> bytes: ...
@overload
def unpack(packing: str, packed: memoryview, size: int) -> Packed: ...
def unpack(packing: str, packed: Packed, size: int) -> Packed:
    """Return the `size` bytes of a chunk; `packing` is empty, `bz2`, `lz4` or `zstd`.

    Raises `BadDataError` for another size; bytes beyond `size` are not decompressed.
    """
    check_size(size)
    raw: Packed = packed
    if packing == "zstd" and (whole := _one_frame(packed, size)) is not None:
        raw = whole
    elif packing:
        reader, broken = _open(packing, packed)
        try:
            raw = reader.read(size + 1)
        except broken as error:
            raise BadDataError(f"its {packing} data are damaged: {_words(error)}") from error
    if len(raw) != size:
        held = "more" if len(raw) > size else str(len(raw))
        raise BadDataError(f"a chunk that declares {size} bytes holds {held}")
    return raw


def _one_frame(packed: Packed, size: int) -> bytes | None:
    """Return the bytes of one zstd frame that declares exactly this size, without a copy.

    None for any other data, valid or not.
    """
    zstd = zstd_module()
    unpacker = zstd.ZstdDecompressor()
    try:
        if zstd.get_frame_info(packed).decompressed_size != size:
            return None
        raw: bytes = unpacker.decompress(packed, size)
    except zstd.ZstdError:
        return None
    return raw if unpacker.eof and not unpacker.unused_data else None


@overload
def unpack_the_start(packing: str, packed: bytes, size: int) -> bytes: ...
@overload
def unpack_the_start(packing: str, packed: memoryview, size: int) -> Packed: ...
def unpack_the_start(packing: str, packed: Packed, size: int) -> Packed:
    """Return as many of the `size` bytes of a damaged or cut chunk as possible.

    Of damaged bz2 data nothing is returned: a block may be scrambled, and is verified at its end.
    """
    if not packing or size > MAX_CHUNK:
        return packed[: 0 if packing else size]
    reader, broken = _open(packing, packed)
    pieces: list[bytes] = []
    try:
        while size and (piece := reader.read(min(size, _PIECE))):
            pieces.append(piece)
            size -= len(piece)
    except EOFError:
        pass  # the bytes before the cut are the result
    except broken:
        if packing == "bz2":
            return b""
    return b"".join(pieces)


def unpack_message(packed: bytes) -> bytes:
    """Return the bytes of one message that is a zstd frame."""
    zstd = zstd_module()
    unpacker = zstd.ZstdDecompressor()
    try:
        raw: bytes = unpacker.decompress(packed, MAX_MESSAGE + 1)
    except zstd.ZstdError as error:
        raise BadDataError(f"its zstd data are damaged: {_words(error)}") from error
    if len(raw) > MAX_MESSAGE:
        del raw  # a stored error keeps the variables of its traceback alive
        raise BadDataError(f"a message unpacks to more than the limit of {MAX_MESSAGE} bytes")
    if not unpacker.eof or unpacker.unused_data:
        raise BadDataError("its zstd data are damaged: they are not one complete frame")
    return raw


def unpack_file(path: Path, target: Path, *, salvage: bool = False) -> str:
    """Decompress a file that is one zstd frame; with `salvage`, as far as possible.

    Returns the reason why a part is missing; empty if the file is complete. Raises `BadDataError`
    if it is not zstd, or grows beyond `MAX_CHUNK` and a hundred times its size.
    """
    room = most = MAX_CHUNK + 100 * path.stat().st_size
    with path.open("rb") as packed, target.open("wb") as out:
        reader, broken = _open("zstd", packed)
        try:
            while piece := reader.read(_PIECE):
                room -= len(piece)
                if room < 0:
                    limit = f"it decompresses to more than {most:,} bytes"
                    raise BadDataError(f"{limit}: run `zstd -d {path.name}` first")
                out.write(piece)
        except broken as error:
            reason = f"its zstd data are damaged: {_words(error)}"
            if not salvage or not out.tell():
                raise BadDataError(reason) from error
            return reason
    return ""


def _open(packing: str, packed: Packed | IO[bytes]) -> tuple[Any, tuple[type[Exception], ...]]:
    """Return a reader, and the errors that its library raises for damaged data."""
    stream = io.BytesIO(packed) if isinstance(packed, bytes | memoryview) else packed
    if packing == "bz2":
        return bz2.open(stream), (OSError, EOFError, ValueError)
    if packing == "lz4":
        import lz4.frame  # noqa: PLC0415 - only what is packed needs it

        return lz4.frame.open(stream), (OSError, EOFError, RuntimeError)
    if packing == "zstd":
        zstd = zstd_module()
        return zstd.ZstdFile(stream), (zstd.ZstdError, EOFError)
    raise BadDataError(f"compressed as {packing[:40]!r}, not with bz2, lz4 or zstd")


def zstd_module() -> Any:
    """Return the zstd module of the standard library; before Python 3.14, its backport."""
    if sys.version_info >= (3, 14):
        from compression import zstd  # noqa: PLC0415 - only what is packed needs it
    else:
        from backports import zstd  # noqa: PLC0415
    return zstd


def _words(error: Exception) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__
