"""Write the table of `tfdb.tf2.differences` into docs/howto/from-tf2.md.

`python tools/write_differences.py`; with `--check` nothing is written, and the status is 1 where
the page has another table.
"""

from __future__ import annotations

import sys
from pathlib import Path

from tfdb.tf2.differences import DIFFERENCES

PAGE = Path(__file__).resolve().parents[1] / "docs" / "howto" / "from-tf2.md"
HEAD = "| | tf2 | `tfdb.tf2` | because |\n|---|---|---|---|\n"
END = "<!-- end of the table -->"


def table() -> str:
    """The table in Markdown."""
    rows = []
    for name, each in DIFFERENCES.items():
        cells = (f"`{name}`", each.tf2, each.ours, each.reason)
        rows.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |\n")
    return HEAD + "".join(rows)


def with_table(page: str) -> str:
    """The page with the table as it must be."""
    before, rest = page.split(HEAD)
    return before + table() + END + rest.split(END)[1]


def main() -> int:
    """Write the page, or check it."""
    page = PAGE.read_text(encoding="utf-8")
    made = with_table(page)
    if "--check" in sys.argv[1:]:
        return int(made != page)
    PAGE.write_text(made, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
