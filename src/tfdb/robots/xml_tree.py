"""A small XML tree with line numbers, parsed by the standard library's expat without entities.

`xml.etree` expands entities of a document type and keeps no line numbers. Here a document type is
refused before anything in it is read, so no entity can be declared: neither one that grows without
bound nor one that opens another file or address.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING
from xml.parsers import expat

if TYPE_CHECKING:
    from collections.abc import Iterator

MAX_DEPTH = 200


class XmlError(Exception):
    """An error in the text, with its line."""

    def __init__(self, reason: str, line: int) -> None:
        super().__init__(f"line {line}: {reason}")
        self.reason = reason
        self.line = line


@dataclass
class Element:
    """An element: tag with its prefix, attributes, children; character data is skipped."""

    tag: str
    attributes: dict[str, str]
    line: int
    children: list[Element] = field(default_factory=list)

    def get(self, attribute: str) -> str | None:
        """Return an attribute without surrounding blanks; None if it is missing."""
        value = self.attributes.get(attribute)
        return None if value is None else value.strip()

    def all(self, tag: str) -> Iterator[Element]:
        """Return the children with a tag."""
        return (child for child in self.children if child.tag == tag)

    def first(self, tag: str) -> Element | None:
        """Return the first child with a tag."""
        return next(self.all(tag), None)


def parse_xml(raw: bytes) -> Element:
    """Return the root element of a document; raises `XmlError`."""
    builder = _Builder()
    try:
        builder.parser.Parse(raw, True)  # noqa: FBT003 - expat takes it by position only
    except expat.ExpatError as error:
        reason = expat.ErrorString(error.code)
        raise XmlError(f"not well-formed XML: {reason}", error.lineno) from None
    except (LookupError, ValueError) as error:
        raise XmlError(f"not XML in a known encoding: {error}", 1) from None
    return builder.document.children[0]


class _Builder:
    """Collects elements while expat parses."""

    def __init__(self) -> None:
        self.parser = expat.ParserCreate()
        self.parser.StartDoctypeDeclHandler = self.document_type
        self.parser.StartElementHandler = self.start
        self.parser.EndElementHandler = self.end
        self.document = Element("", {}, 0)
        self.open = [self.document]

    def document_type(self, *_: object) -> None:
        reason = "a document type (<!DOCTYPE>) is refused, entities with it"
        raise XmlError(reason, self.parser.CurrentLineNumber)

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        line = self.parser.CurrentLineNumber
        if len(self.open) > MAX_DEPTH:
            raise XmlError(f"elements nested deeper than {MAX_DEPTH}", line)
        element = Element(tag, attributes, line)
        self.open[-1].children.append(element)
        self.open.append(element)

    def end(self, _: str) -> None:
        self.open.pop()
