"""Layout of text for the width of the terminal. Frame names are never broken or cut.

A table that is too wide loses its least important columns, in the end all but the names. `--wide`
and a pipe show all columns.

`rich` is imported where it is used, because shell completion waits for every import.
"""

# ruff: noqa: PLC0415

from __future__ import annotations

import os
import re
import shutil
import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import click

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from click.decorators import FC
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from tfdb.recordings.load_report import LoadReport

    Cell: TypeAlias = str | Text

UNLIMITED = 100_000
"""Columns of a line without a limit: more than the longest name needs."""
_GAP = 2
_WIDE = "tfdb.wide"
# Characters that end a line, control a terminal or reverse its text direction; names may have them.
_HOSTILE = re.compile("[\x00-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069\ufeff]")

_PLAIN_LINES = str.maketrans("│├└─", "||`-")


def _wide(ctx: click.Context, _param: click.Parameter, value: bool) -> None:
    ctx.meta[_WIDE] = value


wide_option: Callable[[FC], FC] = click.option(
    "--wide",
    is_flag=True,
    expose_value=False,
    callback=_wide,
    help="Show all columns; do not fit to the terminal.",
)


def width() -> int:
    """Return the width of a line: COLUMNS, the terminal's width, or no limit."""
    context = click.get_current_context(silent=True)
    if context is not None and context.meta.get(_WIDE):
        return UNLIMITED
    given = os.environ.get("COLUMNS", "")
    if given.isdecimal() and int(given) > 0:
        return int(given)
    return shutil.get_terminal_size().columns if sys.stdout.isatty() else UNLIMITED


def console() -> Console:
    """Return a console for standard output that breaks no lines."""
    from rich.console import Console

    return Console(width=UNLIMITED, highlight=False, emoji=False, markup=False)


def safe(text: str) -> str:
    """Escape the characters that end a line or control the terminal: names may have them."""
    return _HOSTILE.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


def drawing(lines: str) -> str:
    """Return line-drawing text, in ASCII if the output has no other characters."""
    encoding = getattr(sys.stdout, "encoding", None) or "utf-8"
    return lines if encoding.lower().startswith("utf") else lines.translate(_PLAIN_LINES)


def words(text: str, *names: str) -> list[str]:
    """Split prose where lines may break: before words and the arrow of T[a<-b], not in names."""
    odd = sorted((safe(name) for name in names if " " in name or "<-" in name), key=len)
    unbroken = "|".join([*map(re.escape, reversed(odd)), r"(?!<-)\S"])
    return re.findall(rf"\s*(?:<-)?(?:{unbroken})+|\s*<-", safe(text))


def transform_name(target: str, source: str) -> list[str]:
    """Return T[target<-source], which may break at its arrow."""
    return [f"T[{safe(target)}", f"<-{safe(source)}]"]


def wrap(chunks: Iterable[str], indent: str = "  ") -> str:
    """Join unbreakable chunks into lines of the terminal's width.

    Lines after the first are indented.
    """
    limit = width()
    lines = [""]
    for chunk in chunks:
        if lines[-1].strip() and cells(lines[-1]) + cells(chunk) > limit:
            lines.append(indent + chunk.lstrip())
        else:
            lines[-1] += chunk
    return "\n".join(lines)


def prose(text: str, *names: str) -> str:
    """Break prose into lines of the terminal's width, but no name of `names`."""
    return wrap(words(text, *names))


def cells(text: str) -> int:
    """Return the width of a text in columns; some characters take two."""
    from rich.cells import cell_len

    return cell_len(text)


@dataclass(frozen=True)
class Column:
    """A column of a table.

    If the table is too wide, columns of the highest `rank` are left out first; rank 0 stays.
    """

    name: str
    rank: int = 0
    right: bool = False


def table(
    columns: Sequence[Column], rows: Iterable[Sequence[Cell]], depths: Sequence[int] | None = None
) -> Table:
    """Print a table of as many columns as fit, and the names of the omitted ones.

    Parameters
    ----------
    columns
        All columns; the first is always shown.
    rows
        One cell for each column; text is taken literally.
    depths
        Depth of each row's frame in the tree. Without the column `parent` the names are indented by
        it, if there is room.
    """
    from rich.box import SIMPLE_HEAD
    from rich.table import Table
    from rich.text import Text

    cleaned = [[_text(cell) for cell in row] for row in rows]
    shown = _fitting(columns, cleaned)
    if depths and "parent" not in [columns[i].name for i in shown]:
        shown = _indent(columns, cleaned, depths)
    lacks = [column.name for i, column in enumerate(columns) if i not in shown and column.name]
    made = Table(box=SIMPLE_HEAD, padding=(0, _GAP - 1, 0, 0), pad_edge=False, show_edge=False)
    made.header_style = "bold"
    for i in shown:
        justify = "right" if columns[i].right else "left"
        made.add_column(columns[i].name, justify=justify, overflow="fold")  # type: ignore[arg-type]
    for row in cleaned:
        made.add_row(*(row[i] for i in shown))
    if lacks and cleaned:
        made.caption = Text(prose(f"--wide shows also: {', '.join(lacks)}"), style="dim")
        made.caption_justify = "left"
    return made


def _text(cell: Cell) -> Text:
    return _styled(cell) if isinstance(cell, str) else cell


def _fitting(columns: Sequence[Column], rows: Sequence[Sequence[Text]]) -> list[int]:
    """Return the columns that fit into a line, chosen by importance."""
    sizes = [
        max([cells(column.name), *(row[i].cell_len for row in rows)])
        for i, column in enumerate(columns)
    ]
    used = {i: any(row[i].plain for row in rows) for i in range(len(columns))}
    left = width()
    shown: list[int] = []
    for i in sorted(used, key=lambda i: (not used[i] and columns[i].rank > 0, columns[i].rank, i)):
        if not shown or columns[i].rank == 0 or sizes[i] + _GAP <= left:
            left -= sizes[i] + (_GAP if shown else 0)
            shown.append(i)
    return sorted(shown)


def _indent(
    columns: Sequence[Column], rows: Sequence[list[Text]], depths: Sequence[int]
) -> list[int]:
    """Indent the names by depth, if the important columns still fit; return the shown columns."""
    from rich.text import Text

    others = [column for column in columns if column.name != "parent"]
    places = [i for i, column in enumerate(columns) if column.name != "parent"]
    plain = [row[0] for row in rows]
    top = min(depths)
    shown: list[int] = []
    for step in (2, 1, 0):
        for row, name, depth in zip(rows, plain, depths, strict=True):
            row[0] = Text(" " * (step * (depth - top))) + name
        shown = _fitting(others, [[row[i] for i in places] for row in rows])
        widest = max((row[0].cell_len for row in rows), default=0)
        if widest <= width() and all(
            i in shown for i, column in enumerate(others) if column.rank <= 1
        ):
            break
    return [places[i] for i in shown]


def say_refused(out: Console, report: LoadReport | None) -> None:
    """Print the counts of refused messages and transforms, if any were refused."""
    if report and report.refused_edges:
        text = f"{report.refused_counts}; 'tfdb check' lists the reasons"
        out.print(prose(text), style="red")


def literal(text: str) -> Text:
    """Return a text without markup."""
    from rich.text import Text

    return Text(text)


def fits(made: Table) -> bool:
    """Return whether all cells of a table fit."""
    return console().measure(made).maximum <= width()


def quiet(text: str) -> Text:
    """Return a text in a dim style."""
    return _styled(text, "dim")


def loud(text: str) -> Text:
    """Return a text in a conspicuous style."""
    return _styled(text, "bold red")


def _styled(text: str, style: str = "") -> Text:
    from rich.text import Text

    return Text(safe(text), style=style)
