"""The Python blocks of the howto pages and the README run."""

from __future__ import annotations

import os
import re
import shutil
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)
PAGES = sorted((ROOT / "docs" / "howto").glob("*.md"))


def blocks(page: Path) -> list[str]:
    """The Python blocks of a page, each with so many empty lines that line numbers fit."""
    text = page.read_text(encoding="utf-8")
    return ["\n" * text.count("\n", 0, m.start(1)) + m.group(1) for m in BLOCK.finditer(text)]


@pytest.fixture
def workplace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the recordings at the places that the pages name."""
    shutil.copytree(ROOT / "examples" / "data", tmp_path / "examples" / "data")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(page: Path) -> None:
    space: dict[str, object] = {"__name__": "__page__"}
    for source in blocks(page):
        exec(compile(source, str(page), "exec"), space)


# tests/ros/test_howto_live.py runs these, on real graphs.
LIVE = {"ros1-node", "ros2-node", "ros2-without-ros"}
# Those that need PyPI's eclipse-zenoh.
NETWORK = {"several-machines"}


@pytest.mark.parametrize(
    "page", [p for p in PAGES if blocks(p) and p.stem not in LIVE], ids=lambda page: page.stem
)
def test_page_runs(page: Path, workplace: Path) -> None:
    if page.stem in NETWORK and "CI" not in os.environ:
        pytest.importorskip("zenoh", reason="eclipse-zenoh is not installed")
        pytest.importorskip("trustme", reason="trustme is not installed")
    run(page)


def test_readme_runs(workplace: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run(ROOT / "README.md")
    printed = capsys.readouterr().out
    assert "[1.2 2.  1.1]" in printed
    assert "T[base<-camera]: static" in printed


def test_programs_of_the_readme_are_short() -> None:
    programs = [program.split("\n") for program in blocks(ROOT / "README.md")]
    lines = [sum(line.strip() != "" for line in program) for program in programs]
    assert len(lines) == 4
    assert lines[0] == 1
    assert max(lines[1:3]) <= 5
    assert lines[3] <= 10


def test_the_readme_names_an_existing_package() -> None:
    """`pip install tfdb` works once the changelog names a release."""
    released = "(unreleased)" not in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert ("pip install tfdb" in readme) == released
    assert released or "\npip install . " in readme


# The beginnings of the rows of docs/benchmarks.md behind the rows of the README.
MEASURED = (
    "C++ lookup, chain of 10, interpolated",
    "Python `lookup_transform` by name, chain of 4, interpolated",
    "`tfdb.tf2.Buffer`: `lookup_transform`, interpolated, chain of 4",
    "batch of 100,000 sorted stamps over 10 s, chain of 4",
    "loading 1 M transforms (`.mcap`), against rosbags and tf2 inserts",
)


def test_ratios_of_the_readme_are_the_measured_ones() -> None:
    benchmarks = (ROOT / "docs" / "benchmarks.md").read_text(encoding="utf-8").splitlines()
    rows = [next(row for row in benchmarks if row.startswith(f"| {text} |")) for text in MEASURED]
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    shown = re.findall(r"^\| .* \| ([\d.]+x) \|$", readme, re.MULTILINE)
    assert shown == [row.split(" | ")[3] for row in rows]


def test_index_names_every_page() -> None:
    index = (ROOT / "docs" / "howto" / "README.md").read_text(encoding="utf-8")
    listed = set(re.findall(r"\]\(([\w-]+\.md)\)", index))
    assert listed == {page.name for page in PAGES} - {"README.md"}


@pytest.mark.parametrize("page", [ROOT / "README.md", *PAGES], ids=lambda page: page.stem)
def test_links_lead_somewhere(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)#\s]+)", text):
        if "://" not in target:
            assert (page.parent / target).exists(), f"{page.name} links to {target}"
