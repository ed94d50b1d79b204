"""The class Installed: expectations of a buffer, until they are removed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tfdb.data.lazy_names import belong_to

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import TracebackType
    from typing import Self

    from .expectations import Expectations

__all__ = ["Installed"]


class Installed:
    """Expectations of a buffer, from `Buffer.expect`: a context manager that removes them."""

    def __init__(self, expectations: Expectations, *, enforce: bool) -> None:
        self.expectations: Expectations = expectations
        """What is expected."""
        self.enforce: bool = enforce
        """Whether lookups raise Stale over an edge whose lifespan is over."""
        self._remove: Callable[[Installed], None] | None = None  # while they are installed

    @property
    def removed(self) -> bool:
        """Whether they were removed, or their buffer closed."""
        return self._remove is None

    def remove(self) -> None:
        """Remove the expectations. Their active events are dropped without an end.

        A second call does nothing.
        """
        if (remove := self._remove) is not None:
            remove(self)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.remove()

    def __repr__(self) -> str:
        known = self.expectations
        what = [f"{each.parent} -> {each.child}" for each in known.edges]
        what += [each.name for each in known.authorities]
        ended = ", removed" if self.removed else ""
        return f"<tfdb.judging.Installed: {', '.join(what) or 'every edge'}{ended}>"


belong_to("tfdb.judging", globals(), __all__)
