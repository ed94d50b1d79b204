"""The site builds without a warning: guides, a search, the API with all signatures."""

from __future__ import annotations

import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

pytest.importorskip("pdoc")
pytest.importorskip("sphinx")
pytest.importorskip("myst_parser")
pytest.importorskip("furo")
ROOT = Path(__file__).resolve().parents[2]


class Page(HTMLParser):
    """The links and the anchors of a page."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.anchors: set[str] = set()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        self.anchors |= {given[name] for name in ("id", "name") if name in given}
        if tag == "a" and "href" in given:
            self.links.append(given["href"])
        elif tag in {"script", "img"} and "src" in given:
            self.loaded.append(given["src"])
        elif tag == "link" and given.get("rel") == "stylesheet":
            self.loaded.append(given["href"])


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site of `make docs`."""
    out = tmp_path_factory.mktemp("site") / "docs"
    tool = str(ROOT / "tools" / "make_docs.py")
    done = subprocess.run(
        [sys.executable, "-W", "error", tool, str(out)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return out


def test_reference(site: Path) -> None:
    page = (site / "reference" / "tfdb.html").read_text(encoding="utf-8")
    names = (
        "Buffer.lookup_transform",
        "Buffer.tree",
        "Snapshot.trajectory",
        "UnknownFrame",
        "load",
    )
    for name in names:
        assert f'<section id="{name}"' in page or f'<div id="{name}"' in page, name
    assert "(unknown)" not in page
    # Sections stand apart, and errors without a description are a sentence with links.
    assert page.count(">Raises</h6>\n\n") == page.count(">Raises</h6>") > 20
    raised = re.findall(r">Raises</h6>\s*(.*?)</code>", page, re.DOTALL)
    assert '<p><code><a href="#UnknownFrame">UnknownFrame</a>' in raised


def test_every_page_is_in_the_site_and_in_its_search(site: Path) -> None:
    docs = ROOT / "docs"
    names = {str(page.relative_to(docs).with_suffix("")) for page in docs.rglob("*.md")}
    names |= {"index", "api", "examples", "changelog"}
    assert {name for name in names if not (site / f"{name}.html").is_file()} == set()
    index = (site / "searchindex.js").read_text(encoding="utf-8")
    assert {name for name in names if f'"{name}"' not in index} == set()
    assert (site / "search.html").is_file()


def test_links_lead_to_pages_and_anchors_of_the_site(site: Path) -> None:
    pages = {path: Page(path) for path in site.rglob("*.html")}
    assert len(pages) > 40
    broken = []
    for path, page in pages.items():
        for link in [*page.links, *page.loaded]:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            anchor = unquote(parts.fragment)
            known = pages[target].anchors if target in pages else set()
            if not target.is_file() or (anchor and target in pages and anchor not in known):
                broken.append(f"{path.relative_to(site)}: {link}")
    assert broken == []


def test_the_site_works_without_a_network(site: Path) -> None:
    for path in site.rglob("*.html"):
        assert [link for link in Page(path).loaded if urlsplit(link).netloc] == [], path
