"""The table of docs/concurrency.md: the C++ classes that threads share, from the lines above them.

`python -m tests.architecture.guarantees` writes it.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from tests.architecture import layers

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).resolve().parents[2]
PAGE = Path("docs/concurrency.md")
BEGIN = "<!-- classes: begin (python -m tests.architecture.guarantees) -->"
END = "<!-- classes: end -->"

_COMMENT = re.compile(r"^\s*///?\s?(.*)$")
_TEMPLATE = re.compile(r"^\s*template\s*<")
_TYPE = re.compile(r"^\s*(?:class|struct)\s+((?:\w+::)*\w+)[^;]*$")
_SHARED = re.compile(r"\bany\b|WrongThread")
_PARTS = re.compile(r"^(?P<what>.*?)\s*Threads:\s*(?P<threads>.*?)\s*Guarantee:\s*(?P<last>.*)$")


@dataclass(frozen=True)
class Promise:
    """What one class says of itself: where it is, who may call what, what is guaranteed."""

    name: str
    path: str
    threads: str
    guarantee: str

    @property
    def shared(self) -> bool:
        """Whether several threads may have one object of it, or are told that they may not."""
        return bool(_SHARED.search(self.threads)) and "value" not in self.threads


def promises_in(text: str, path: str) -> Iterator[Promise]:
    """The types of one file above which `Threads:` and `Guarantee:` stand."""
    above: list[str] = []
    for line in text.splitlines():
        comment = _COMMENT.match(line)
        if comment:
            above.append(comment.group(1))
            continue
        if _TEMPLATE.match(line) and not _TYPE.match(line):
            continue
        declared = _TYPE.match(line)
        parts = _PARTS.match(" ".join(above)) if declared else None
        if declared and parts:
            yield Promise(declared.group(1), path, parts["threads"], parts["last"])
        above = []


def promises(tree: Path) -> list[Promise]:
    """Those of the library and of the bindings; test programs make none."""
    core = layers.load_map(tree)["core"]
    kinds = set(core["program_kinds"])
    found: list[Promise] = []
    for root in (core["root"], "bindings"):
        for path in sorted((tree / root).rglob("*")):
            shown = path.relative_to(tree).as_posix()
            is_program = (
                not kinds.isdisjoint(path.name.split(".")[1:-1])
                or shown.endswith(tuple(core["program_headers"]))
                or "/testing/" in shown
            )
            if path.suffix in {".hpp", ".cpp", ".ipp"} and not is_program:
                found += promises_in(path.read_text(encoding="utf-8"), shown)
    return found


def table(found: list[Promise]) -> str:
    """The rows as they stand in the page."""
    lines = ["| class | threads | guarantee |", "|---|---|---|"]
    for promise in filter(lambda promise: promise.shared, found):
        cells = (f"`{promise.name}` ({promise.path})", promise.threads, promise.guarantee)
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines)


def between(text: str) -> str:
    """What stands between the page's two marks."""
    return text.partition(BEGIN)[2].partition(END)[0].strip()


def main() -> None:
    """Write the table into the page."""
    page = ROOT / PAGE
    text = page.read_text(encoding="utf-8")
    head, _, rest = text.partition(BEGIN)
    tail = rest.partition(END)[2]
    page.write_text(
        f"{head}{BEGIN}\n{table(promises(ROOT))}\n{END}{tail}", encoding="utf-8", newline="\n"
    )


if __name__ == "__main__":
    main()
