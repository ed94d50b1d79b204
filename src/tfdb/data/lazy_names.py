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
    """Offer classes and functions as the package's, where users find them.

    What a package above offers as well stays that one's. The error of a call that does not fit a
    function's parameters has our words.
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
    """Do the same with the constructor and the public methods that a class of Python defines."""
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
    """Make `__getattr__` and `__dir__` of a package out of its modules and what it takes of each.

    The modules themselves are attributes of it too. `dir` lists `__all__` and these modules. It
    leaves out a module that needs a missing package, as `help` imports all that it lists.
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
