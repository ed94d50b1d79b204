"""The name of a store, as the tests of sharing have it."""

from tests.sharing.conftest import name

__all__ = ["name"]
