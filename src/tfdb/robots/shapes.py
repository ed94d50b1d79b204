"""The visual shapes of links in a URDF: boxes, cylinders, spheres, meshes, and their colours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias, cast, get_args

from .urdf import Reader, parse_robot, read_bytes

if TYPE_CHECKING:
    import os
    from collections.abc import Iterator

    from .xml_tree import Element

Kind: TypeAlias = Literal["box", "cylinder", "sphere", "mesh"]
Color: TypeAlias = "tuple[float, float, float, float]"


@dataclass(frozen=True)
class Shape:
    """One `<visual>` of a link."""

    link: str
    kind: Kind
    size: tuple[float, ...]
    """Metres: x, y, z of a box; radius and length along z of a cylinder; radius of a sphere. For a
    mesh: its scale along x, y, z."""
    origin: tuple[float, ...]
    """T[link<-shape], `[x y z qx qy qz qw]`."""
    color: Color | None
    """Red, green, blue, opacity, 0 to 1; None: not in the file."""
    mesh: str = ""
    """Name of the mesh in the file."""


def load_shapes(path: str | os.PathLike[str]) -> tuple[list[Shape], list[str]]:
    """Read the shapes of a robot model; return them, and a note for each of unknown kind.

    Raises and warns as `load_urdf`. A bad size or colour raises ModelError.
    """
    root = parse_robot(read_bytes(path), str(path))
    reader = _ShapeReader(str(path))
    reader.robot(root)
    shapes = list(reader.shapes(root))
    reader.warn(stacklevel=3)
    return shapes, reader.notes


class _ShapeReader(Reader):
    """Reads `<visual>` elements; errors name the file and the line."""

    def __init__(self, path: str) -> None:
        super().__init__(path)
        self.notes: list[str] = []

    def shapes(self, root: Element) -> Iterator[Shape]:
        visuals = [(link, each) for link in root.all("link") for each in link.all("visual")]
        colors: dict[str, Color] = {}
        for owner in (root, *(visual for _, visual in visuals)):
            for material in owner.all("material"):
                color = self.color(material)
                if color is not None:
                    colors.setdefault(material.get("name") or "", color)
        for link, visual in visuals:
            shape = self.shape(self.name(link), visual, colors)
            if shape is not None:
                yield shape

    def shape(self, link: str, visual: Element, colors: dict[str, Color]) -> Shape | None:
        geometry = visual.first("geometry")
        if geometry is None or not geometry.children:
            self.refuse(visual, f"a visual of link {link!r} has no geometry")
        found = geometry.children[0]
        if found.tag not in get_args(Kind):
            known = ", ".join(get_args(Kind))
            self.notes.append(f"line {found.line}: <{found.tag[:40]}> of link {link!r} ({known})")
            return None
        kind = cast("Kind", found.tag)
        material = visual.first("material")
        color = None
        if material is not None:
            color = self.color(material) or colors.get(material.get("name") or "")
        mesh = (found.get("filename") or "") if kind == "mesh" else ""
        if kind == "mesh" and not mesh:
            self.refuse(found, f"a mesh of link {link!r} names no file")
        origin = self.origin(visual.first("origin"))
        return Shape(link, kind, self.size(found, kind), origin, color, mesh)

    def size(self, element: Element, kind: Kind) -> tuple[float, ...]:
        if kind == "mesh":
            return self.numbers(element, "scale", (1.0, 1.0, 1.0))
        if kind == "box":
            sizes = self.numbers(element, "size", ())
        else:
            names = ("radius", "length") if kind == "cylinder" else ("radius",)
            sizes = tuple(self.number(element, name, -1.0) for name in names)
        if not sizes or min(sizes) < 0:
            self.refuse(element, f"<{kind}> lacks a size, or has a negative one")
        return sizes

    def color(self, material: Element) -> Color | None:
        found = material.first("color")
        if found is None:
            return None
        red, green, blue, opacity = (
            min(max(value, 0.0), 1.0)
            for value in self.numbers(found, "rgba", (0.5, 0.5, 0.5, 1.0), count=4)
        )
        return red, green, blue, opacity
