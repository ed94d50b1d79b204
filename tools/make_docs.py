"""Write the API reference as HTML: `python tools/make_docs.py [FOLDER]`."""

from __future__ import annotations

import re
import shutil
import sys
import tempfile
import textwrap
from importlib import import_module
from pathlib import Path
from types import FunctionType
from typing import TYPE_CHECKING, Any

import pdoc
import pdoc.docstrings
import pdoc.render

import tfdb

if TYPE_CHECKING:
    from collections.abc import Callable

ROOT = Path(__file__).resolve().parent.parent
STUB = ROOT / "src" / "tfdb" / "_core.pyi"
ROOMS = ("comparing", "errors", "plot", "recordings", "robots", "store.summary", "trajectories")
MODULES = ("tfdb", "tfdb.types", *(f"tfdb.{room}" for room in ROOMS))
# Unions that would take half a page where a name says it.
ALIAS = re.compile(r"\btfdb\.(?:stamps|types|loading)\.(\w+Like|Paths|(?:Pose)?Topics|Progress)\b")
HEADING = re.compile(r"^([A-Z][A-Za-z ]+)\n---+\n+", re.MULTILINE)
# Lines from the margin, and what is written below them, further in.
ENTRY = re.compile(r"((?:^\S.*\n?)+)((?:^(?:[ ]+.*)?\n|^[ ]+.*\Z)*)", re.MULTILINE)
ERROR = re.compile(rf"\b({'|'.join(tfdb.data.errors.__all__)})\b(?!\()")
CONSTRUCTOR = re.compile(r"^(    def __init__\(.*\) -> None): \.\.\.$", re.MULTILINE)


def readable_stub() -> str:
    """Return the extension's stub as Python that pdoc can run, with short names for long types."""
    stub = STUB.read_text(encoding="utf-8")
    names = sorted(set(ALIAS.findall(stub)))
    aliases = [f'{name} = typing.NewType("{name}", object)' for name in names]
    stub = CONSTRUCTOR.sub(r'\1: """As above."""', ALIAS.sub(r"\1", stub))
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


def main() -> int:
    """Write the pages; the folder is emptied first."""
    out = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "build" / "docs"
    shutil.rmtree(out, ignore_errors=True)
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
    with tempfile.TemporaryDirectory() as folder:
        # The extension's classes are documented where `tfdb` exports them; pdoc finds their
        # signatures in a stub of that name.
        (Path(folder) / "tfdb.pyi").write_text(readable_stub(), encoding="utf-8")
        sys.path.insert(0, folder)
        pdoc.docstrings.numpy = as_markdown
        pdoc.render.configure(docformat="numpy", show_source=False, footer_text="tfdb")
        pdoc.pdoc(*MODULES, output_directory=out)
    print(f"{out}/index.html")
    return 0


if __name__ == "__main__":
    sys.exit(main())
