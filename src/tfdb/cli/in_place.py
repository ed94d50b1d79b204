"""Tables that are shown again and again."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from . import layout

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.live import Live


class InPlace:
    """Shows a table in place of the one before, on a terminal where it fits; else below it."""

    def __init__(self, *, as_json: bool) -> None:
        self._live: Live | None = None
        if sys.stdout.isatty() and not as_json:
            from rich.live import Live  # noqa: PLC0415 - see `output`

            self._live = Live(auto_refresh=False)

    @property
    def height(self) -> int | None:
        """The lines of the terminal. None: tables are shown below one another."""
        return None if self._live is None else self._live.console.height

    def show(self, shown: RenderableType) -> None:
        """Show it."""
        out = layout.console()
        if self._live is not None and out.measure(shown).maximum > self._live.console.width:
            self.close()  # in place, long names would be broken
            self._live = None
        if self._live is None:
            out.print(shown)
            return
        self._live.start()
        self._live.update(shown, refresh=True)

    def close(self) -> None:
        """Leave what is shown as it is."""
        if self._live is not None:
            self._live.stop()
