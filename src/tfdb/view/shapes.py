"""Shapes of a robot model for the page: one JSON text, and the triangles of each mesh."""

from __future__ import annotations

import json
import os
import re
import warnings
import zlib
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import unquote

import numpy as np

from tfdb.data.counting import counted
from tfdb.data.errors import TfdbWarning
from tfdb.robots.shapes import load_shapes

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

MOST_SHAPES = 10_000
MOST_BYTES = 64 * 1024 * 1024
"""Largest size of a mesh file, in bytes."""
MOST_TRIANGLES = 4_000_000
"""Largest number of triangles of all meshes."""
_NAMED = 3
"""Largest number of listed names that are not shown."""
_PACKAGE = "package://"
_HEAD = 84
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
_NUMBER = 40
"""Largest number of letters of a number in a text STL."""
_VERTEX = re.compile(rb"\bvertex" + 3 * (rb"\s+(\S{1,%d})(?!\S)" % _NUMBER), re.IGNORECASE)


class BadMesh(ValueError):  # noqa: N818 - it is said, not raised further
    """A mesh cannot be shown; the text is the reason."""


@dataclass(frozen=True)
class Shapes:
    """The served content of a robot model."""

    text: bytes
    """JSON: a list of shapes, each with its frame; meshes by their numbers."""
    meshes: tuple[bytes, ...]
    """For each mesh: nine little-endian float32 numbers per triangle."""

    @property
    def mark(self) -> str:
        """A text that identifies the shapes."""
        found = zlib.crc32(self.text)
        for mesh in self.meshes:
            found = zlib.crc32(mesh, found)
        return f"{found:08x}"


def read_shapes(path: str) -> Shapes:
    """Read the shapes of a URDF file and its meshes.

    Raises as `load_urdf`. Warns once of each reason for which shapes are not shown.
    """
    found, notes = load_shapes(path)
    numbers: dict[str, int] = {}
    meshes: list[bytes] = []
    faults: dict[str, str] = {}
    shown = []
    left = MOST_TRIANGLES
    for shape in found[:MOST_SHAPES]:
        name = shape.mesh
        if name and name not in numbers and name not in faults:
            try:
                triangles = read_mesh(name, path, left)
            except (BadMesh, OSError) as error:
                faults[name] = str(error)
            else:
                left -= len(triangles)
                numbers[name] = len(meshes)
                meshes.append(triangles.tobytes())
        if name in faults:
            continue
        shown.append(
            {
                "frame": shape.link,
                "kind": shape.kind,
                "size": shape.size,
                "origin": shape.origin,
                "color": shape.color,
                "mesh": numbers.get(name),
            }
        )
    for text in _faults(faults, notes, len(found) - MOST_SHAPES):
        warnings.warn(f"{path}: {text}", TfdbWarning, stacklevel=2)
    return Shapes(json.dumps(shown, separators=(",", ":")).encode(), tuple(meshes))


def _faults(faults: dict[str, str], notes: list[str], more: int) -> Iterator[str]:
    """Describe the shapes that are not shown, each reason once."""
    for reason in dict.fromkeys(faults.values()):
        names = [name for name, why in faults.items() if why == reason]
        yield f"{counted(len(names), 'mesh file')} not shown, {reason}: {_listed(names)}"
    if notes:
        yield f"{counted(len(notes), 'shape')} not shown, of no known kind: {_listed(notes)}"
    if more > 0:
        yield f"{counted(more, 'shape')} not shown, beyond the first {MOST_SHAPES:,}"


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + more


def read_mesh(name: str, urdf: str, most: int = MOST_TRIANGLES) -> npt.NDArray[np.float32]:
    """Read the triangles of a mesh, (N, 3, 3), that a URDF file names. Raises BadMesh, OSError."""
    where = next((each for each in _places(name, Path(urdf).absolute()) if each.is_file()), None)
    if where is None:
        raise BadMesh("no such file beside the URDF or in ROS_PACKAGE_PATH, AMENT_PREFIX_PATH")
    if where.suffix.lower() != ".stl":
        raise BadMesh(f"{where.suffix or 'a name without an ending'} is not read, only .stl")
    with where.open("rb") as file:
        raw = file.read(MOST_BYTES + 1)
    if len(raw) > MOST_BYTES:
        raise BadMesh(f"larger than {MOST_BYTES // 1024**2} MiB")
    triangles = read_stl(raw)
    if len(triangles) > most:
        raise BadMesh(f"all meshes together have more than {MOST_TRIANGLES:,} triangles")
    return triangles


def _places(name: str, urdf: Path) -> Iterator[Path]:
    """List the possible paths of a mesh."""
    if not name.startswith(_PACKAGE):
        yield urdf.parent / unquote(name.removeprefix("file://"))
        return
    package, _, rest = name.removeprefix(_PACKAGE).partition("/")
    for folder in (*urdf.parents, *_folders("ROS_PACKAGE_PATH")):
        if folder.name == package:
            yield folder / rest
        yield folder / package / rest
    for folder in _folders("AMENT_PREFIX_PATH"):
        yield folder / "share" / package / rest


def _folders(variable: str) -> list[Path]:
    return [Path(each) for each in os.environ.get(variable, "").split(os.pathsep) if each]


def read_stl(raw: bytes) -> npt.NDArray[np.float32]:
    """Read the triangles of a binary or a text STL file, (N, 3, 3). Raises BadMesh."""
    count = int.from_bytes(raw[_HEAD - 4 : _HEAD], "little")
    size = _HEAD + count * _TRIANGLE.itemsize
    if len(raw) >= _HEAD and len(raw) == size:
        triangles = np.frombuffer(raw, _TRIANGLE, count, _HEAD)["corners"].astype("<f4")
    elif raw[:80].lstrip()[:5].lower() == b"solid":
        triangles = _from_text(raw)
    elif _HEAD < size <= len(raw):
        triangles = np.frombuffer(raw, _TRIANGLE, count, _HEAD)["corners"].astype("<f4")
    else:
        raise BadMesh("no STL file")
    if not len(triangles):
        raise BadMesh("no triangle in it")
    if not np.isfinite(triangles).all():
        raise BadMesh("numbers in it are not finite")
    return triangles


def _from_text(raw: bytes) -> npt.NDArray[np.float32]:
    texts = chain.from_iterable(match.groups() for match in _VERTEX.finditer(raw))
    try:
        numbers = np.fromiter(map(float, texts), np.float64)
    except ValueError:
        raise BadMesh("numbers in it cannot be read") from None
    if len(numbers) % 9:
        raise BadMesh("a triangle in it lacks corners")
    with np.errstate(over="ignore"):
        return numbers.astype("<f4").reshape(-1, 3, 3)
