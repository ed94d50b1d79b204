"""Recording of live stores into MCAP files, commit by commit, and their commits read back."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tfdb.data.lazy_names import on_demand as _offer

if TYPE_CHECKING:
    from .commit_reader import RecordedCommit, recorded_commits
    from .recorder import Recorder

__all__ = ["RecordedCommit", "Recorder", "recorded_commits"]

if not TYPE_CHECKING:  # type checkers would find every name in a module with `__getattr__`
    __getattr__, __dir__ = _offer(
        __name__,
        {
            "commit_reader": ("RecordedCommit", "recorded_commits"),
            "recorder": ("Recorder",),
        },
    )
