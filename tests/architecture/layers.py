"""Reads layers.toml and reports violations in a tree."""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from typing import TYPE_CHECKING, Any, NamedTuple

from tests.architecture import cpp_source

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

CPP_SUFFIXES = {".hpp", ".cpp", ".ipp"}


class Violation(NamedTuple):
    """One broken rule: `rule` names it, `path` is relative to the tree."""

    rule: str
    path: str
    line: int
    message: str

    def __str__(self) -> str:
        return f"{self.path}:{self.line}: {self.rule}: {self.message}"


class Import(NamedTuple):
    """One imported module, wherever its statement stands."""

    module: str
    line: int


def load_map(tree: Path) -> dict[str, Any]:
    """Read the tree's layers.toml."""
    return tomllib.loads((tree / "layers.toml").read_text(encoding="utf-8"))


def violations(tree: Path) -> list[Violation]:
    """Every broken rule of the tree, in a stable order."""
    layers = load_map(tree)
    found = [
        *_core(tree, layers["core"]),
        *_bindings(tree, layers["bindings"]),
        *_python(tree, layers["python"]),
        *_measure(tree, layers),
        *_sizes(tree, layers),
    ]
    return sorted(found)


def _core(tree: Path, core: dict[str, Any]) -> Iterator[Violation]:
    root = tree / core["root"]
    rooms: dict[str, list[str]] = core["rooms"]
    for path in _cpp_files(root):
        room = path.relative_to(root).parts[0]
        shown = path.relative_to(tree).as_posix()
        if room not in rooms:
            yield Violation("unknown-room", shown, 1, f"layers.toml has no room `{room}`")
            continue
        text = path.read_text(encoding="utf-8")
        program = _is_program(path, core)
        allowed = {room, *rooms[room], *(["testing"] if program else [])}
        yield from _includes(shown, text, allowed, core, program=program)
        if not program:
            yield from _headers(shown, text, room, core["headers"])
            yield from _words(shown, text, room, core["words"])
        if (
            path.suffix == ".hpp"
            and not program
            and not shown.startswith(tuple(core["plain_classes"]))
        ):
            yield from _class_headers(shown, text)


def _is_program(path: Path, core: dict[str, Any]) -> bool:
    parts = path.name.split(".")
    named = len(parts) > 2 and parts[-2] in core["program_kinds"]
    return named or path.as_posix().endswith(tuple(core["program_headers"]))


def _includes(
    shown: str, text: str, allowed: set[str], core: dict[str, Any], *, program: bool
) -> Iterator[Violation]:
    for name in cpp_source.includes(text):
        parts = name.split("/")
        if parts[0] != "tfdb" or len(parts) < 3:
            continue
        line = _line_of(text, name)
        if name in core["program_headers"]:
            if not program:
                yield Violation("layer", shown, line, f"{name} is for test programs")
        elif parts[1] not in core["rooms"]:
            yield Violation("unknown-room", shown, line, f"includes {name}")
        elif parts[1] not in allowed:
            yield Violation("layer", shown, line, f"may not use `{parts[1]}` ({name})")


def _headers(
    shown: str, text: str, room: str, headers: dict[str, list[str]]
) -> Iterator[Violation]:
    for name in cpp_source.includes(text):
        if name in headers and room not in headers[name]:
            yield Violation("header", shown, _line_of(text, name), f"may not include <{name}>")


def _words(shown: str, text: str, room: str, words: dict[str, list[str]]) -> Iterator[Violation]:
    code = cpp_source.code_only(text)
    for word, where in words.items():
        if room in {*where, "testing"}:
            continue
        for match in re.finditer(re.escape(word), code):
            line = code.count("\n", 0, match.start()) + 1
            yield Violation(
                "word", shown, line, f"`{word}` belongs to {', '.join(where) or 'no room'}"
            )


def _class_headers(shown: str, text: str) -> Iterator[Violation]:
    """Each class says what it is, which threads may call what and what is guaranteed."""
    lines = text.splitlines()
    for block in cpp_source.blocks(text):
        if block.kind != "class":
            continue
        above = []
        for line in reversed(lines[: block.first - 1]):
            if not line.lstrip().startswith("//"):
                break
            above.append(line)
        comment = "\n".join(above)
        if "Threads:" not in comment or "Guarantee:" not in comment:
            message = f"class {block.name} opens without its `Threads:` and `Guarantee:` lines"
            yield Violation("class-header", shown, block.first, message)


def _bindings(tree: Path, bindings: dict[str, Any]) -> Iterator[Violation]:
    allowed = set(bindings["uses"])
    for path in _cpp_files(tree / bindings["root"]):
        shown = path.relative_to(tree).as_posix()
        text = path.read_text(encoding="utf-8")
        for name in cpp_source.includes(text):
            parts = name.split("/")
            line = _line_of(text, name)
            if parts[0] == "tfdb" and parts[1] not in allowed:
                yield Violation("layer", shown, line, f"may not use `{parts[1]}` ({name})")
            elif (
                "/" in name
                and parts[0] != "tfdb"
                and not (tree / bindings["root"] / name).is_file()
                and not _third_party(name, bindings)
            ):
                yield Violation("third-party", shown, line, f"may not include {name}")


def _third_party(name: str, bindings: dict[str, Any]) -> bool:
    return any(name.startswith(prefix) for prefix in bindings["third_party"])


def _python(tree: Path, python: dict[str, Any]) -> Iterator[Violation]:
    root = tree / python["root"]
    rooms: dict[str, list[str]] = python["rooms"]
    yield from _circles(rooms)
    for path in sorted(root.rglob("*.py")):
        shown = path.relative_to(tree).as_posix()
        inside = path.relative_to(root).parts
        room = inside[0] if len(inside) > 1 else "face"
        if room not in rooms:
            yield Violation("unknown-room", shown, 1, f"layers.toml has no room `{room}`")
            continue
        module = (python["package"], *inside[:-1])
        allowed = {"_core", room, *rooms[room]}
        for imported in python_imports(path.read_text(encoding="utf-8"), module):
            yield from _judge_module(shown, imported, allowed, python)


def _circles(rooms: dict[str, list[str]]) -> Iterator[Violation]:
    """A room that uses one further down the list: only such a list can close a circle."""
    below: set[str] = set()
    for room, uses in rooms.items():
        for used in uses:
            if used not in below:
                message = f"`{room}` uses `{used}`, which is not above it in layers.toml"
                yield Violation("circle", "layers.toml", 1, message)
        below.add(room)


def _judge_module(
    shown: str, imported: Import, allowed: set[str], python: dict[str, Any]
) -> Iterator[Violation]:
    parts = imported.module.split(".")
    if parts[0] == python["package"]:
        target = _python_room(parts, python["rooms"])
        if target not in allowed:
            message = f"may not use `{target}` ({imported.module})"
            yield Violation("layer", shown, imported.line, message)
        return
    if parts[0] in sys.stdlib_module_names:
        return
    allowed_files: list[str] = python["third_party"].get(parts[0], [])
    if not any(shown == entry or shown.startswith(entry + "/") for entry in allowed_files):
        yield Violation("third-party", shown, imported.line, f"may not import {parts[0]}")


def _measure(tree: Path, layers: dict[str, Any]) -> Iterator[Violation]:
    """The measuring house: its folders of C++, then its package."""
    measure = layers["measure"]
    root = tree / measure["root"]
    for path in _cpp_files(root):
        shown = path.relative_to(tree).as_posix()
        folder = path.relative_to(root).parts[0]
        if folder == "contenders":
            continue  # in Python, with an environment full of other people's files
        if folder not in measure["folders"]:
            yield Violation("unknown-room", shown, 1, f"layers.toml has no folder `{folder}`")
            continue
        rules = measure["folders"][folder]
        allowed = {
            folder,
            *rules["uses"],
            *(["testing"] if _is_program(path, layers["core"]) else []),
        }
        text = path.read_text(encoding="utf-8")
        for name in cpp_source.includes(text):
            parts = name.split("/")
            line = _line_of(text, name)
            if parts[0] == "tfdb" or parts[0] + "/" + parts[-1] in _own_headers(root):
                room = parts[1] if parts[0] == "tfdb" else parts[0]
                if room not in allowed:
                    yield Violation("layer", shown, line, f"may not use `{room}` ({name})")
            elif "/" in name and not name.startswith(tuple(rules.get("third_party", []))):
                yield Violation("third-party", shown, line, f"may not include {name}")
    python = {**layers["python"], "third_party": measure["third_party"]}
    for path in sorted((root / measure["package"]).rglob("*.py")):
        shown = path.relative_to(tree).as_posix()
        for imported in python_imports(path.read_text(encoding="utf-8"), (measure["package"],)):
            if imported.module.split(".")[0] != measure["package"]:
                yield from _judge_module(shown, imported, set(measure["uses"]), python)


def _own_headers(root: Path) -> set[str]:
    return {f"{path.parent.name}/{path.name}" for path in root.glob("*/*.hpp")}


def _python_room(parts: list[str], rooms: dict[str, Any]) -> str:
    if len(parts) > 1 and parts[1] == "_core":
        return "_core"
    if len(parts) > 1 and parts[1] in rooms:
        return parts[1]
    return "face"


def python_imports(text: str, package: tuple[str, ...]) -> list[Import]:
    """Modules that a file of `package` imports, relative ones resolved."""
    found: list[Import] = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            found.extend(Import(alias.name, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(package[: len(package) - node.level + 1]) if node.level else ""
            stem = ".".join(part for part in (base, node.module or "") if part)
            names = [alias.name for alias in node.names]
            # `from tfdb import plot` names a room only together with what it imports.
            ours = stem in {".".join(package[:1]), base}
            modules = [f"{stem}.{name}" for name in names] if ours else [stem]
            found.extend(Import(module, node.lineno) for module in modules)
    return sorted(found, key=lambda each: each.line)


def _sizes(tree: Path, layers: dict[str, Any]) -> Iterator[Violation]:
    limits: dict[str, int] = layers["limits"]
    for name in ("core", "bindings", "measure", "src", "tests", "tools", "examples"):
        for path in sorted((tree / name).rglob("*")):
            if path.is_relative_to(tree / "measure" / "contenders" / "env"):
                continue  # an environment full of other people's files
            if path.suffix in CPP_SUFFIXES | {".py"} and path.is_file():
                yield from _sizes_of(path, path.relative_to(tree).as_posix(), limits)


def _sizes_of(path: Path, shown: str, limits: dict[str, int]) -> Iterator[Violation]:
    text = path.read_text(encoding="utf-8")
    count = len(text.splitlines())
    if count > limits["file_lines"]:
        yield Violation("file-length", shown, 1, f"{count} lines, at most {limits['file_lines']}")
    lengths = _python_functions(text) if path.suffix == ".py" else _cpp_functions(text)
    for function, line, length in lengths:
        if length > limits["function_lines"]:
            message = f"{function} has {length} lines, at most {limits['function_lines']}"
            yield Violation("function-length", shown, line, message)


def _cpp_functions(text: str) -> Iterator[tuple[str, int, int]]:
    for block in cpp_source.blocks(text):
        if block.kind == "function":
            yield block.name, block.first, block.last - block.first + 1


def _python_functions(text: str) -> Iterator[tuple[str, int, int]]:
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            length = (node.end_lineno or node.lineno) - node.lineno + 1
            first = node.body[0]
            if ast.get_docstring(node, clean=False) is not None:
                length -= (first.end_lineno or first.lineno) - first.lineno + 1
            yield node.name, node.lineno, length


def _cpp_files(root: Path) -> list[Path]:
    return sorted(path for path in root.rglob("*") if path.suffix in CPP_SUFFIXES)


def _line_of(text: str, needle: str) -> int:
    return text.count("\n", 0, text.find(needle)) + 1
