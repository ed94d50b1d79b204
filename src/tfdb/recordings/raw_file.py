"""Bytes of recordings: read by position, unpacked within bounds.

Nothing here trusts a number that it reads: no read goes beyond the end of the file, nothing unpacks
to more than its record declares, and no record may declare more than `MAX_CHUNK`.
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
"""How a zstd frame begins."""
MAX_CHUNK = 256 * 2**20
"""The most bytes that one record or chunk may hold, packed or unpacked; a program that trusts its
recordings may raise it."""
MAX_MESSAGE = 64 * 2**20
"""The most bytes of one message that is packed by itself."""

_PIECE = 65536

Packed: TypeAlias = bytes | memoryview
"""What is not packed at all is unpacked as it is, without a copy."""


class BadDataError(Exception):
    """The bytes are not what their format says."""


class BrokenChunkError(BadDataError):
    """The records of an unpacked chunk end at `at`, where something else begins."""

    def __init__(self, reason: object, at: int) -> None:
        super().__init__(str(reason))
        self.at = at


class RawFile:
    """A file that is read by position. Any number of threads; `close` is the last call."""

    def __init__(self, path: Path) -> None:
        self._descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        self.size: int = os.fstat(self._descriptor).st_size

    def look_again(self) -> None:
        """Take in how much the file has grown; raises `BadDataError` where it has shrunk."""
        size = os.fstat(self._descriptor).st_size
        if size < self.size:
            raise BadDataError(f"it shrank from {self.size} to {size} bytes while it was followed")
        self.size = size

    def read(self, at: int, count: int) -> bytes:
        """Give the bytes from a position on; raises `BadDataError` where the file has fewer."""
        check_size(count)
        if at < 0 or at + count > self.size:
            raise BadDataError(f"{count} bytes at {at} go beyond the end of the file, {self.size}")
        data = os.pread(self._descriptor, count, at)
        if len(data) != count:
            raise BadDataError(f"the file ends at {at + len(data)} while it is read")
        return data

    def close(self) -> None:
        """Close the file; again is fine."""
        descriptor, self._descriptor = self._descriptor, -1
        if descriptor >= 0:
            os.close(descriptor)


def check_size(size: int) -> None:
    """Refuse what declares more than `MAX_CHUNK` bytes."""
    if size > MAX_CHUNK:
        limit = f"the limit of {MAX_CHUNK} (tfdb.recordings.raw_file.MAX_CHUNK)"
        raise BadDataError(f"a record of {size} bytes, above {limit}")


@overload
def unpack(packing: str, packed: bytes, size: int) -> bytes: ...
@overload
def unpack(packing: str, packed: memoryview, size: int) -> Packed: ...
def unpack(packing: str, packed: Packed, size: int) -> Packed:
    """Give the `size` bytes of a chunk; `packing` is empty, `bz2`, `lz4` or `zstd`.

    Raises `BadDataError` if there are fewer or more, which are not unpacked.
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
            raise BadDataError(f"its {packing} does not unpack: {_words(error)}") from error
    if len(raw) != size:
        held = "more" if len(raw) > size else str(len(raw))
        raise BadDataError(f"a chunk that declares {size} bytes holds {held}")
    return raw


def _one_frame(packed: Packed, size: int) -> bytes | None:
    """The bytes of one zstd frame that declares this very size, without a copy in between.

    None for anything else, be it good or bad.
    """
    zstd = _zstd()
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
    """Give as many of a damaged or cut chunk's `size` bytes as can be had."""
    if not packing or size > MAX_CHUNK:
        return packed[: 0 if packing else size]
    reader, broken = _open(packing, packed)
    pieces: list[bytes] = []
    try:
        while size and (piece := reader.read(min(size, _PIECE))):
            pieces.append(piece)
            size -= len(piece)
    except broken:
        pass  # what came before is what was asked for
    return b"".join(pieces)


def unpack_message(packed: bytes) -> bytes:
    """Give the bytes of one message that is a zstd frame."""
    zstd = _zstd()
    unpacker = zstd.ZstdDecompressor()
    try:
        raw: bytes = unpacker.decompress(packed, MAX_MESSAGE + 1)
    except zstd.ZstdError as error:
        raise BadDataError(f"its zstd does not unpack: {_words(error)}") from error
    if len(raw) > MAX_MESSAGE:
        del raw  # errors that are kept keep the variables of where they were raised
        raise BadDataError(f"a message unpacks to more than the limit of {MAX_MESSAGE} bytes")
    if not unpacker.eof or unpacker.unused_data:
        raise BadDataError("its zstd does not unpack: it is not one whole frame")
    return raw


def unpack_file(path: Path, target: Path, *, salvage: bool = False) -> str:
    """Unpack a file that is zstd as a whole; with `salvage`, as far as it goes.

    Returns why not all of it was unpacked; empty: it was. Raises `BadDataError` if it is not zstd
    or grows beyond `MAX_CHUNK` and a hundred times its size.
    """
    room = MAX_CHUNK + 100 * path.stat().st_size
    with path.open("rb") as packed, target.open("wb") as out:
        reader, broken = _open("zstd", packed)
        try:
            while piece := reader.read(_PIECE):
                room -= len(piece)
                if room < 0:
                    raise BadDataError(f"it grows beyond all measure: `zstd -d {path.name}` first")
                out.write(piece)
        except broken as error:
            reason = f"its zstd does not unpack: {_words(error)}"
            if not salvage or not out.tell():
                raise BadDataError(reason) from error
            return reason
    return ""


def _open(packing: str, packed: Packed | IO[bytes]) -> tuple[Any, tuple[type[Exception], ...]]:
    """A reader, and the errors by which the library says that the data are broken."""
    stream = io.BytesIO(packed) if isinstance(packed, bytes | memoryview) else packed
    if packing == "bz2":
        return bz2.open(stream), (OSError, EOFError, ValueError)
    if packing == "lz4":
        import lz4.frame  # noqa: PLC0415 - only what is packed needs it

        return lz4.frame.open(stream), (OSError, EOFError, RuntimeError)
    if packing == "zstd":
        zstd = _zstd()
        return zstd.ZstdFile(stream), (zstd.ZstdError, EOFError)
    raise BadDataError(f"packed as {packing[:40]!r}, not bz2, lz4 or zstd")


def _zstd() -> Any:
    """The module of the standard library, or what brings it to those before 3.14."""
    if sys.version_info >= (3, 14):
        from compression import zstd  # noqa: PLC0415 - only what is packed needs it
    else:
        from backports import zstd  # noqa: PLC0415
    return zstd


def _words(error: Exception) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__
