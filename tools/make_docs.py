"""Write the site: guides and API reference as HTML: `python tools/make_docs.py [FOLDER]`."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
import textwrap
import typing
from importlib import import_module
from pathlib import Path
from types import FunctionType
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pdoc
import pdoc.doc
import pdoc.docstrings
import pdoc.render

import tfdb

if TYPE_CHECKING:
    from collections.abc import Callable

    Members = dict[tuple[str, str], list[pdoc.doc.Doc[Any]]]

ROOT = Path(__file__).resolve().parent.parent
STUB = ROOT / "src" / "tfdb" / "_core.pyi"
CONFIGURATION = ROOT / "tools" / "site"
ROOMS = ["comparing", "errors", "judging", "plot", "recordings", "robots", "rules", "store.summary"]
ROOMS += ["net", "recorder", "streams", "trajectories"]
MODULES = ("tfdb", "tfdb.types", *(f"tfdb.{room}" for room in ROOMS))
# Base classes, which `tfdb` does not export.
UNLISTED = ("Cursor", "Freezable", "Policy", "StoreReader", "SharedReads")
UNLISTED_LINK = re.compile(rf'<a href="#(?:{"|".join(UNLISTED)})(?:\.\w+)?">(.*?)</a>')
# Unions that would take half a page where a name says it.
ALIAS = re.compile(r"\btfdb\.(?:stamps|types|loading)\.(\w+Like|Paths|(?:Pose)?Topics|Progress)\b")
HEADING = re.compile(r"^([A-Z][A-Za-z ]+)\n---+\n+", re.MULTILINE)
# Lines from the margin, and what is written below them, further in.
ENTRY = re.compile(r"((?:^\S.*\n?)+)((?:^(?:[ ]+.*)?\n|^[ ]+.*\Z)*)", re.MULTILINE)
ERROR = re.compile(rf"\b({'|'.join(tfdb.data.errors.__all__)})\b(?!\()")
OFFERED = re.compile(r"^from tfdb import \($.*?^\)$", re.MULTILINE | re.DOTALL)
CONSTRUCTOR = re.compile(r"^(    def __init__\(.*\) -> None): \.\.\.$", re.MULTILINE)


def readable_stub() -> str:
    """Return the extension's stub as Python that pdoc can run, with short names for long types.

    Native methods are in the classes that offer them.
    """
    stub = STUB.read_text(encoding="utf-8")
    names = sorted(set(ALIAS.findall(stub)))
    aliases = [f'{name} = typing.NewType("{name}", object)' for name in names]
    stub = CONSTRUCTOR.sub(r'\1: """As above."""', ALIAS.sub(r"\1", stub))
    stub = OFFERED.sub("", stub).replace("class Native", "class ")
    stub = stub.replace("    @overload\n", "")  # the last one, which says it all, is shown
    return "\n".join(
        ["from __future__ import annotations", "import typing", *aliases, stub, "import tfdb"]
    )


def as_function(original: Any) -> Callable[..., Any]:
    """Wrap a function of the extension, which pdoc would take for a variable."""

    def function(*args: Any, **kwargs: Any) -> Any:
        return original(*args, **kwargs)

    function.__name__ = function.__qualname__ = original.__name__
    function.__module__ = "tfdb"
    function.__doc__ = original.__doc__
    return function


def as_markdown(docstring: str) -> str:
    """Write sections of numpydoc as lists; lines that explain no name are a paragraph."""
    made, *rest = HEADING.split(docstring)
    for heading, content in zip(rest[::2], rest[1::2], strict=True):
        made += f"\n###### {heading}\n\n"
        for head, body in ENTRY.findall(content):
            name, text = " ".join(head.split()), textwrap.dedent(body).strip()
            if heading == "Raises":
                name = ERROR.sub(r"`\1`", name)
            elif text:
                name = f"**{name}**"
            made += (
                f" - {name}: {textwrap.indent(text, '   ').lstrip()}\n" if text else f"\n{name}\n\n"
            )
    return made


def own_members(self: pdoc.doc.Class) -> list[pdoc.doc.Doc[Any]]:
    """Return what a class documents itself: also what it has from a base without a place."""
    return [
        member
        for at, members in self._members_by_origin.items()
        if at in {self.taken_from, (self.modulename, self.qualname)} or at[1] in UNLISTED
        for member in members
    ]


def inherited_members(self: pdoc.doc.Class) -> Members:
    """Return what a class documents at its base."""
    own = {id(member) for member in self.own_members}
    found = self._members_by_origin.items()
    return {at: members for at, members in found if id(members[0]) not in own}


def evaluate_named_tuples() -> None:
    """Give the constructors of named tuples types in place of their names, which have no module."""
    known = vars(tfdb.data.types) | {"Transform": tfdb.Transform, "np": np, "npt": npt}
    for value in vars(tfdb.types).values():
        if isinstance(value, type) and issubclass(value, tuple):
            value.__new__.__annotations__ = typing.get_type_hints(value, known)


def write_reference(out: Path) -> None:
    """Write the API reference into a folder."""
    # pdoc looks for the names of an annotation where a class says that it is.
    vars(import_module("tfdb.data.lazy_names"))["belong_to"] = lambda *_: None
    for name in tfdb.__all__:
        value = getattr(tfdb, name)
        if callable(value) and not isinstance(value, type | FunctionType):
            setattr(tfdb, name, as_function(value))
    for module in map(import_module, MODULES):
        for name in getattr(module, "__all__", ()):
            getattr(module, name)  # imported on demand, and documented where they are
    for module in (tfdb.data.stamps, tfdb.data.types, tfdb.types):
        for name in tfdb.types.__all__:
            if isinstance(vars(module).get(name), str):
                setattr(module, name, type(name, (), {"__module__": "tfdb"}))
    # Annotations of classes that moved to `tfdb` are evaluated there.
    vars(tfdb).update({name: getattr(tfdb.types, name) for name in tfdb.types.__all__}, Any=Any)
    evaluate_named_tuples()
    with tempfile.TemporaryDirectory() as folder:
        # The extension's classes are documented where `tfdb` exports them; pdoc finds their
        # signatures in a stub of that name.
        (Path(folder) / "tfdb.pyi").write_text(readable_stub(), encoding="utf-8")
        sys.path.insert(0, folder)
        pdoc.docstrings.numpy = as_markdown
        for replacement in (own_members, inherited_members):
            setattr(pdoc.doc.Class, replacement.__name__, property(replacement))
        pdoc.render.configure(docformat="numpy", show_source=False, footer_text="tfdb")
        pdoc.pdoc(*MODULES, output_directory=out)
    for page in (out / "tfdb.html", out / "tfdb" / "streams.html"):
        text = page.read_text(encoding="utf-8")
        page.write_text(UNLISTED_LINK.sub(r"\1", text), encoding="utf-8")


def toctree(caption: str, *pages: str) -> str:
    """Return a hidden table of contents: it makes the entries of the sidebar."""
    return "\n".join(
        ["", "```{toctree}", ":hidden:", f":caption: {caption}", ":glob:", "", *pages, "```", ""]
    )


def examples() -> str:
    """Return a page with all programs of examples/."""
    page = "# Examples\n"
    for path in sorted((ROOT / "examples").glob("[0-9]*.py")):
        page += f"\n## {path.name}\n\n```python\n{path.read_text(encoding='utf-8')}```\n"
    return page


def write_pages(folder: Path) -> None:
    """Write the Markdown pages of the site: docs/, the README as its start, the examples."""
    shutil.copytree(ROOT / "docs", folder, dirs_exist_ok=True)
    shutil.copy(CONFIGURATION / "conf.py", folder)
    shutil.copy(ROOT / "CHANGELOG.md", folder / "changelog.md")
    (folder / "examples.md").write_text(examples(), encoding="utf-8")
    # Links of HTML: Sphinx would take those of Markdown for downloads.
    modules = "".join(
        f'- <a href="reference/{each.replace(".", "/")}.html">{each}</a>\n' for each in MODULES
    )
    (folder / "api.md").write_text(f"# API reference\n\n{modules}", encoding="utf-8")
    start = (ROOT / "README.md").read_text(encoding="utf-8").replace("](docs/", "](")
    start = start.replace("](examples/)", "](examples.md)").replace(
        "Site with these pages, the API reference and a search: `make docs`, then open "
        "`build/docs/index.html`",
        "[API reference](api.md)",
    )
    start += toctree("Guides", "tasks", "howto/README", "howto/*")
    start += toctree("Reference", "api", "examples", "changelog")
    pages = ("design", "concurrency", "engines", "replication", "wire", "free_threading")
    start += toctree("How it works", *pages)
    start += toctree("Measured", "benchmarks", "evaluation", "sweeps")
    start += toctree("Development", "where", "style", "packaging")
    (folder / "index.md").write_text(start, encoding="utf-8")


def main() -> int:
    """Write the site; the folder is emptied first."""
    out = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "build" / "docs"
    shutil.rmtree(out, ignore_errors=True)
    with tempfile.TemporaryDirectory() as folder:
        pages = Path(folder)
        write_pages(pages)
        write_reference(pages / "_extra" / "reference")
        build = [sys.executable, "-m", "sphinx", "--fail-on-warning", "--keep-going", "--quiet"]
        done = subprocess.run([*build, str(pages), str(out)], check=False)
    shutil.rmtree(out / ".doctrees")
    print(f"{out}/index.html")
    return done.returncode


if __name__ == "__main__":
    sys.exit(main())
