"""Pictures of trajectories, comparisons, frame trees and samples; needs matplotlib.

Install it with ``pip install tfdb[plot]``.

Each function takes data, draws nothing on a screen and returns a matplotlib ``Figure`` to save or
to show: ``tfdb.plot.trajectory(buf.trajectory("map", "base")).savefig("trajectory.png")``.
"""

from __future__ import annotations

from tfdb.data.lazy_names import belong_to

try:
    import matplotlib as mpl  # noqa: F401
except ImportError as _error:
    raise ImportError(
        f"tfdb.plot needs matplotlib: pip install 'tfdb[plot]' ({_error})"
    ) from _error

from .draw_compare import comparison
from .draw_timeline import Arrivals, timeline
from .draw_trajectory import trajectory
from .draw_tree import frame_tree
from .window import show

__all__ = ["Arrivals", "comparison", "frame_tree", "show", "timeline", "trajectory"]

belong_to(__name__, globals(), __all__)
