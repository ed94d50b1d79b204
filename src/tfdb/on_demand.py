"""Names that a package offers, and imports when they are used."""

from __future__ import annotations

import sys
from importlib import import_module
from types import FunctionType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence


def belong_to(package: str, contents: Mapping[str, Any], names: Iterable[str]) -> None:
    """Say of classes and functions that they are the package's: that is where users find them."""
    for name in names:
        value = contents[name]
        if isinstance(value, type | FunctionType) and value.__module__ != package:
            value.__module__ = package


def on_demand(
    package: str, modules: Mapping[str, Sequence[str]]
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Make `__getattr__` and `__dir__` of a package out of its modules and what it takes of each.

    The modules themselves are attributes of it too.
    """
    contents = vars(sys.modules[package])

    def find(name: str) -> Any:
        for module, names in modules.items():
            if name == module or name in names:
                found = import_module(f"{package}.{module}")
                belong_to(package, vars(found), names)
                contents.update((each, getattr(found, each)) for each in names)
                return contents[name]
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    def list_names() -> list[str]:
        offered = (name for module in modules for name in (module, *modules[module]))
        return sorted({*contents, *offered})

    return find, list_names
