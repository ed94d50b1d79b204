"""A matplotlib backend that records its windows instead of showing them."""

from __future__ import annotations

from typing import Any

from matplotlib.backend_bases import FigureManagerBase
from matplotlib.backends.backend_agg import FigureCanvasAgg

seen: list[Any] = []


class Manager(FigureManagerBase):
    size: tuple[int, int] | None = None

    def resize(self, w: int, h: int) -> None:
        self.size = (w, h)

    @classmethod
    def pyplot_show(cls, *, block: bool | None = None) -> None:
        from matplotlib import pyplot as plt

        for number in plt.get_fignums():
            manager = plt.figure(number).canvas.manager
            seen.append((manager.canvas.figure, manager.size))


class FigureCanvas(FigureCanvasAgg):
    # What matplotlib calls a machine without a screen: there it may be chosen.
    required_interactive_framework = "headless"
    manager_class = Manager
