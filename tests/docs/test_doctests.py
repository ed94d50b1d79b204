"""Every example in a docstring of the package prints the documented result."""

from __future__ import annotations

import doctest
import importlib
import pkgutil
from pathlib import Path
from typing import Any

import pytest

import tfdb

# What needs a library that is not always there.
NEEDS = {"tfdb.plot": "matplotlib", "tfdb.tf2.tf1.transformations": "transformations"}


def modules() -> list[str]:
    """All modules with an example in them, by their text: none is imported for it."""
    found = ["tfdb"]
    found += [each.name for each in pkgutil.walk_packages(tfdb.__path__, "tfdb.", onerror=print)]
    root = Path(tfdb.__file__).parent.parent
    texts = {}
    for name in found:
        place = root / name.replace(".", "/")
        for file in (place / "__init__.py", place.with_suffix(".py")):
            if file.is_file():
                texts[name] = file.read_text(encoding="utf-8")
    return [name for name, text in texts.items() if ">>> " in text]


@pytest.mark.parametrize("name", modules())
def test_examples_of_a_module(name: str) -> None:
    for package, library in NEEDS.items():
        if name.startswith(package):
            pytest.importorskip(library)
    assert run(examples(importlib.import_module(name))) > 0


def examples(module: Any) -> list[doctest.DocTest]:
    """Those of a module; its public classes say that they are of the package."""
    finder = doctest.DocTestFinder()
    found = finder.find(module)
    for name in getattr(module, "__all__", []):
        if module is not tfdb and isinstance(getattr(module, name), type):
            given = dict(vars(module))
            found += finder.find(getattr(module, name), f"{module.__name__}.{name}", module, given)
    return list({test.name: test for test in found}.values())


def run(tests: list[doctest.DocTest]) -> int:
    """Run them; how many examples there were."""
    runner = doctest.DocTestRunner(verbose=False)
    for test in tests:
        runner.run(test)
    result = runner.summarize(verbose=False)
    assert result.failed == 0
    return result.attempted


def test_examples_of_the_extension() -> None:
    """Its docstrings are not in a module's text: doctest looks into its classes."""
    found = doctest.DocTestFinder().find(tfdb._core, "tfdb._core", module=False)
    run(found)


def test_there_are_examples_in_many_places() -> None:
    assert {"tfdb", "tfdb.tf2", "tfdb.trajectories.trajectory"} <= set(modules())
    assert len(examples(importlib.import_module("tfdb.trajectories.trajectory"))) > 15
