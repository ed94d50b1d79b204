"""How far one trajectory is off another: association by time, alignment, errors, statistics.

`tfdb.compare` is the way in. Numbers are those of evo (M. Grupp, "evo: Python package for the
evaluation of odometry and SLAM"), with which the tests compare them.
"""

from __future__ import annotations

from tfdb.data.lazy_names import belong_to

from .compare_trajectories import compare
from .comparison import Comparison, Errors

__all__ = ["Comparison", "Errors", "compare"]

belong_to("tfdb", globals(), ("Comparison", "compare"))
belong_to(__name__, globals(), ("Errors",))
