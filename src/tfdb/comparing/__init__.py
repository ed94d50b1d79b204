"""The error of one trajectory against another: association by time, alignment, statistics.

Call `tfdb.compare`. The tests compare its numbers with those of evo (M. Grupp, "evo: Python package
for the evaluation of odometry and SLAM").
"""

from __future__ import annotations

from tfdb.data.lazy_names import belong_to

from .compare_trajectories import compare
from .comparison import Comparison, Errors

__all__ = ["Comparison", "Errors", "compare"]

belong_to("tfdb", globals(), ("Comparison", "compare"))
belong_to(__name__, globals(), ("Errors",))
