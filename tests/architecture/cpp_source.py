"""Just enough C++ for the layer rules: includes, words, functions and classes with lines."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

_INCLUDE = re.compile(r'^[ \t]*#[ \t]*include[ \t]*[<"]([^>"]+)[>"]', re.MULTILINE)
_NOISE = re.compile(
    r'R"(?P<tag>[^()\s\\]{0,16})\(.*?\)(?P=tag)"'
    r'|"(?:\\.|[^"\\\n])*"'
    r"|(?<![0-9A-Fa-f])'(?:\\.|[^'\\\n])+'"
    r"|//[^\n]*"
    r"|/\*.*?\*/",
    re.DOTALL,
)
_DIRECTIVE = re.compile(r"^[ \t]*#(?:[^\n\\]|\\.)*(?:\\\n(?:[^\n\\]|\\.)*)*", re.MULTILINE)
_LABELS = re.compile(r"(?:\s*(?:public|protected|private)\s*:)*\s*")
_SCOPE = re.compile(r"\b(namespace|class|struct|union|enum|extern|concept)\b")
_CLASS = re.compile(r"\bclass\s+(?:alignas\s*\([^)]*\)\s*)?(?:\[\[[^\]]*\]\]\s*)?(\w+)")


@dataclass(frozen=True)
class Block:
    """A braced declaration: `kind` is "function" or "class", lines count from 1, both included."""

    kind: str
    name: str
    first: int
    last: int


def includes(text: str) -> list[str]:
    """Names between the quotes or brackets of every include."""
    return _INCLUDE.findall(_blank_comments(text))


def code_only(text: str) -> str:
    """The text with comments and literals blanked, line for line."""
    return _NOISE.sub(lambda match: _blank(match.group()), text)


def blocks(text: str) -> Iterator[Block]:
    """Functions and classes that stand in namespaces or classes, in order of their end."""
    code = _DIRECTIVE.sub(lambda match: _blank(match.group()), code_only(text))
    scopes: list[tuple[str, str, int]] = []
    header_start = 0
    depth_in_function = 0
    for position, char in enumerate(code):
        if depth_in_function:
            depth_in_function += {"{": 1, "}": -1}.get(char, 0)
            if depth_in_function == 0 and not _continues_initialisers(code, position):
                kind, name, start = scopes.pop()
                if kind == "function":
                    yield Block(kind, name, _line(code, start), _line(code, position))
                header_start = position + 1
            elif depth_in_function == 0:
                # `a_{1}, b_{2} {`: that brace belonged to an initialiser, not to the body.
                scopes.pop()
        elif char == "{":
            header = code[header_start:position]
            start = header_start + _leading(header)
            kind, name = _classify(header)
            scopes.append((kind, name, start))
            if kind in {"function", "other"}:
                depth_in_function = 1
            else:
                header_start = position + 1
        elif char == "}":
            if scopes:
                kind, name, start = scopes.pop()
                if kind == "class":
                    yield Block(kind, name, _line(code, start), _line(code, position))
            header_start = position + 1
        elif char == ";":
            header_start = position + 1


def _classify(header: str) -> tuple[str, str]:
    bare = _without_template(header)
    scope = _SCOPE.search(bare)
    parenthesis = bare.find("(")
    assigned = re.search(r"(?<![=!<>])=(?!=)", bare)
    if scope and scope.group() in {"enum", "concept"}:
        return "other", scope.group()
    if scope and not re.search(r"\)\s*(?:const|noexcept|override|final|->|$)", bare):
        found = _CLASS.search(bare)
        return ("class", found.group(1)) if found else ("scope", scope.group())
    if parenthesis >= 0 and not (assigned and assigned.start() < parenthesis):
        name = bare[:parenthesis].split()
        return "function", name[-1] if name else "?"
    return "other", bare.strip()


def _leading(header: str) -> int:
    labels = _LABELS.match(header)
    return labels.end() if labels else 0


def _without_template(header: str) -> str:
    """Drop `template <...>` so that its `class` is not taken for a class."""
    match = re.search(r"\btemplate\s*<", header)
    while match:
        depth, end = 1, match.end()
        while depth and end < len(header):
            depth += {"<": 1, ">": -1}.get(header[end], 0)
            end += 1
        header = header[: match.start()] + header[end:]
        match = re.search(r"\btemplate\s*<", header)
    return header


def _continues_initialisers(code: str, position: int) -> bool:
    return code[position + 1 :].lstrip()[:1] in {",", "{"}


def _line(code: str, position: int) -> int:
    return code.count("\n", 0, position) + 1


def _blank(text: str) -> str:
    return re.sub(r"[^\n]", " ", text)


def _blank_comments(text: str) -> str:
    def keep_literals(match: re.Match[str]) -> str:
        found = match.group()
        return _blank(found) if found.startswith(("//", "/*")) else found

    return _NOISE.sub(keep_literals, text)
