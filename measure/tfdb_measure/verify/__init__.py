"""Was a store's recorded history strictly serializable? And if not, what went wrong, by name.

Every written value is unique, so each read says whose write it saw. From that follows a graph of
who must come before whom; a history is strictly serializable exactly if the graph, together with
the order of real time, has no cycle.
"""

from tfdb.data.lazy_names import belong_to

from .anomalies import MEANINGS, Anomaly
from .check import Verdict, check
from .history import (
    FORMAT,
    History,
    HistoryError,
    Read,
    Transaction,
    Unseen,
    Write,
    load_history,
    parse_history,
)

__all__ = [
    "FORMAT",
    "MEANINGS",
    "Anomaly",
    "History",
    "HistoryError",
    "Read",
    "Transaction",
    "Unseen",
    "Verdict",
    "Write",
    "check",
    "load_history",
    "parse_history",
]

belong_to(__name__, globals(), __all__)
