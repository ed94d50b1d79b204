"""Names of a package that are imported on first use."""

from __future__ import annotations

import sys
from importlib import import_module
from importlib.util import find_spec
from types import FunctionType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence


def belong_to(package: str, contents: dict[str, Any], names: Iterable[str]) -> None:
    """Set `__module__` of classes and functions to the package where users find them.

    Names that a parent package also exports keep that package. Calls with wrong arguments raise
    errors in tfdb's words.
    """
    for name in names:
        value = contents[name]
        is_above = package.startswith(f"{getattr(value, '__module__', None)}.")
        if isinstance(value, type | FunctionType) and not is_above:
            value.__module__ = package
        if isinstance(value, FunctionType):
            contents[name] = _checked(value)
        elif isinstance(value, type) and not issubclass(value, BaseException):
            for each in value.__mro__:  # a private base as well
                if each.__module__.partition(".")[0] == "tfdb":
                    _check_methods(each)


def _check_methods(cls: type) -> None:
    """Do the same for the constructor and the public methods of a Python class."""
    if getattr(cls, "_is_protocol", False):
        return
    for name, value in list(vars(cls).items()):
        if name.startswith("_") and name not in ("__init__", "__new__"):
            continue
        if isinstance(value, FunctionType):
            setattr(cls, name, _checked(value))
        elif isinstance(getattr(value, "__func__", None), FunctionType):
            setattr(cls, name, type(value)(_checked(value.__func__)))


def _checked(function: FunctionType) -> Any:
    from tfdb._core import checked  # noqa: PLC0415 - the extension imports modules that need this one

    return checked(function)


def on_demand(
    package: str, modules: Mapping[str, Sequence[str]], needs: Mapping[str, str] = {}
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Make `__getattr__` and `__dir__` of a package from its modules and their exported names.

    The modules are attributes of the package as well. `dir` lists `__all__` and the modules, but
    not those that need a missing package, because `help` imports each listed module.
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
        dunder = (name for name in contents if name[:2] == "__")
        missing = [module for module, need in needs.items() if find_spec(need) is None]
        names = {*contents["__all__"], *dunder, *(name for name in modules if "." not in name)}
        return sorted(names.difference(missing, *(modules[module] for module in missing)))

    return find, list_names
