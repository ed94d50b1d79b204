"""Tables that are updated in place."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from . import layout

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.live import Live


class InPlace:
    """Shows a table in place of the previous one if the terminal has room, otherwise below it."""

    def __init__(self, *, as_json: bool) -> None:
        self._live: Live | None = None
        if sys.stdout.isatty() and not as_json:
            from rich.live import Live  # noqa: PLC0415 - see `output`

            self._live = Live(auto_refresh=False)

    @property
    def height(self) -> int | None:
        """Number of lines of the terminal; None if tables are shown below one another."""
        return None if self._live is None else self._live.console.height

    def show(self, shown: RenderableType) -> None:
        """Show a table."""
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
        """End the updates; the last table stays."""
        if self._live is not None:
            self._live.stop()
