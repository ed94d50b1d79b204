"""Shows a picture in a window."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from tfdb.data.errors import InvalidArgument, NotSupported

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def show(figure: Figure) -> None:
    """Show a picture in a window, and wait until it is closed.

    In a notebook without windows the picture appears below the cell. The figure itself, as the last
    line of a cell, appears there as well.

    Raises
    ------
    NotSupported
        The screen is missing, or matplotlib finds none of the libraries that make windows (Tk, Qt,
        GTK).
    InvalidArgument
        The argument is not a matplotlib Figure.
    """
    from matplotlib import pyplot as plt  # noqa: PLC0415 - it chooses what makes windows
    from matplotlib.figure import Figure  # noqa: PLC0415

    given: object = figure
    if not isinstance(given, Figure):
        got = type(given).__name__
        raise InvalidArgument(f"show() takes a Figure of tfdb.plot, got {got}", value=given)
    window = plt.figure()
    canvas: Any = window.canvas
    manager = canvas.manager
    try:
        if canvas.required_interactive_framework is None:
            if _in_notebook():
                sys.modules["IPython"].display.display(figure)
                return
            raise NotSupported(
                "no window can be opened: the screen is missing, or matplotlib has no library for "
                "it (pip install PyQt6)"
            )
        manager.resize(*(int(side) for side in figure.get_size_inches() * figure.dpi))
        canvas.figure = figure
        figure.set_canvas(canvas)
        plt.show()
    finally:
        plt.close(manager.num)


def _in_notebook() -> bool:
    """Return whether a Jupyter kernel runs this program: it has imported IPython."""
    ipython: Any = sys.modules.get("IPython")
    return getattr(ipython and ipython.get_ipython(), "kernel", None) is not None
