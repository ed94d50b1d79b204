"""docs/concurrency.md has the thread guarantees from the comments of the C++ classes."""

from __future__ import annotations

import re

from tests.architecture import guarantees

ROOT = guarantees.ROOT


def test_the_table_is_in_step_with_the_headers() -> None:
    found = guarantees.promises(ROOT)
    assert {"Buffer", "Snapshot", "EdgeView", "EdgeWriter", "Word"} <= {p.name for p in found}
    page = (ROOT / guarantees.PAGE).read_text(encoding="utf-8")
    assert guarantees.between(page) == guarantees.table(found), (
        "run: python -m tests.architecture.guarantees"
    )


def test_the_lines_above_a_class_are_found() -> None:
    text = (
        "/// A thing | of two lines.\n/// Threads: any;\n/// all. Guarantee: wait-free\n"
        "template <class T>\nclass Thing final : Base {\n};\n"
        "/// Threads: one. Guarantee: none.\nint function();\n"
        "/// Only words.\nstruct Other {\n};\n"
        "// Threads: one. Guarantee: none.\nstruct Outer::Inner {\n};\n"
    )
    found = list(guarantees.promises_in(text, "a.hpp"))
    assert [(p.name, p.threads, p.guarantee) for p in found] == [
        ("Thing", "any; all.", "wait-free"),
        ("Outer::Inner", "one.", "none."),
    ]
    assert [promise.name for promise in found if promise.shared] == ["Thing"]


def test_links_of_the_documents_lead_somewhere() -> None:
    pages = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    for page in pages:
        text = page.read_text(encoding="utf-8")
        for link in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", text):
            if "://" not in link:
                assert (page.parent / link).exists(), f"{page.relative_to(ROOT)}: {link}"


def test_paths_named_in_the_design_exist() -> None:
    for name in ("design.md", "concurrency.md"):
        text = (ROOT / "docs" / name).read_text(encoding="utf-8")
        for path in re.findall(r"`((?:core|bindings|src|tests|measure)/[\w./]+)`", text):
            assert (ROOT / path).exists(), f"docs/{name}: {path}"


def test_anchors_of_the_design_exist() -> None:
    for page in (ROOT / "docs").glob("*.md"):
        text = page.read_text(encoding="utf-8")
        headings = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
        anchors = {re.sub(r"[^\w\- ]", "", h).strip().lower().replace(" ", "-") for h in headings}
        for anchor in re.findall(r"\]\(#([^)]+)\)", text):
            assert anchor in anchors, f"{page.name}: #{anchor}"
