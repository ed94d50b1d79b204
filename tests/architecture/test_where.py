"""docs/where.md leads to files that exist, and names every room of the map."""

from __future__ import annotations

import re
from pathlib import Path

from tests.architecture import layers

ROOT = Path(__file__).resolve().parents[2]
PATH = re.compile(r"`([\w.][\w./*{},-]*)`")


def paths_in(text: str) -> list[str]:
    """Every backticked word of a table that looks like a path."""
    rows = [line for line in text.splitlines() if line.startswith("|")]
    return [word for row in rows for word in PATH.findall(row) if "/" in word or "." in word]


def missing(tree: Path, text: str) -> list[str]:
    """Paths (or patterns) of the text that match nothing in the tree."""
    return [path for path in paths_in(text) if not any(tree.glob(path.rstrip("/")))]


def test_every_path_exists() -> None:
    text = (ROOT / "docs" / "where.md").read_text(encoding="utf-8")
    assert len(paths_in(text)) > 20
    assert missing(ROOT, text) == []


def test_every_room_is_named() -> None:
    text = (ROOT / "docs" / "where.md").read_text(encoding="utf-8")
    layer_map = layers.load_map(ROOT)
    rooms = [f"{layer_map['core']['root']}/{room}/" for room in layer_map["core"]["rooms"]]
    rooms += [f"src/tfdb/{room}/" for room in layer_map["python"]["rooms"] if room != "face"]
    unnamed = [room for room in rooms if (ROOT / room).is_dir() and f"`{room}" not in text]
    assert unnamed == []


def test_a_wrong_path_is_caught(tmp_path: Path) -> None:
    (tmp_path / "here.py").touch()
    text = "| a thing | `here.py`, `gone/away.py` |\nprose about `nothing.py`\n"
    assert missing(tmp_path, text) == ["gone/away.py"]
