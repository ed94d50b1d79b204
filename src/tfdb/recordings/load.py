"""Loads recordings into a store, one commit per message."""

from __future__ import annotations

import time
import warnings
from typing import TYPE_CHECKING

from tfdb._core import Buffer
from tfdb.data.argument_checks import check_flag
from tfdb.data.errors import TfdbWarning
from tfdb.store.forgotten import warn_of_forgotten
from tfdb.store.summary import clocks, describe_clocks

from .load_report import Tally, warn_of_refused
from .open_recordings import OpenRecordings, each_once
from .selection import selected

if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Unpack

    from tfdb.data.types import FrameInfo, Paths, Progress

    from .arrivals import ArrivalReader
    from .load_report import LoadReport
    from .selected import Selected
    from .selection import Selection

__all__ = ["load"]


def load(
    path: Paths,
    *,
    progress: Progress | None = None,
    cache: bool = False,
    **selection: Unpack[Selected],
) -> Buffer:
    """Load recordings into a new buffer that keeps everything.

    Parameters
    ----------
    path, progress
        As in `Buffer.load`.
    cache
        Keep the loaded data as a frozen store, and open it the next time. This takes as long as
        reading the file once. The cache is `drive.mcap.tfdb` beside the recording, or lies in
        `$XDG_CACHE_HOME/tfdb` (`~/.cache/tfdb`) if the recording's folder is not writable. It is
        valid while the recording has the same size and modification time, or the same content. A
        cache that is stale, damaged, or of another version of tfdb is replaced. Loads with other
        options, or of several files, have separate caches.
    **selection
        The part to read, and new frame names: the fields of `tfdb.recordings.Selection`, such as
        `topics`, `start`, `exclude` and `rename`.

    Returns
    -------
    Buffer
        With `cache` a frozen store, which is read-only.

    Raises
    ------
    StoreExists
        With `cache`: another file has the name of the cache. It is never replaced.

    And as `Buffer.load`.

    Warns
    -----
    TfdbWarning
        As `Buffer.load`; with `cache` also if no folder is writable. Then nothing is cached, and
        the buffer is not frozen.
    """
    made, paths = selected(load, selection), each_once(path)
    buffer = Buffer(history=None)
    if not check_flag("cache", cache) or not paths:
        load_into(buffer, paths, made, progress)
        return buffer
    from .cache import Cache  # noqa: PLC0415 - most programs need none

    cached = Cache(paths, made.choice)
    found = cached.open()
    if found is not None:
        _warn([str(each) for each in paths], (), 0, found, 3)
        return found
    load_into(buffer, paths, made, progress)
    return cached.keep(buffer)


def load_into(
    buffer: Buffer,
    path: Paths,
    selection: Selection,
    progress: Progress | None = None,
    arrivals: ArrivalReader | None = None,
) -> LoadReport:
    """Load the transforms of recordings into a store, as `Buffer.load`.

    The files are checked before the first commit, so a damaged one leaves the store unchanged.
    `arrivals` gets each message. Warnings name the caller's caller.
    """
    started = time.perf_counter()
    tally = Tally(buffer)
    before = buffer.tree()
    clocks_before = len(clocks(before, buffer))
    with OpenRecordings(each_once(path), selection) as recordings:
        choice = recordings.choice
        names = tuple(str(recording.path) for recording in recordings.files)
        meter = _Meter(recordings.count, progress, 3 if choice.needs_survey else 2)
        rewriter = recordings.rewriter(meter.step)
        runs = recordings.read(meter.step)
        tally.store_model(rewriter)
        for recording in recordings.files:
            tally.count(recording, choice)
        if arrivals is not None:
            arrivals.begin(recordings, rewriter)
        for run in runs:
            tally.store(run, choice, rewriter, meter.step)
            if arrivals is not None:
                arrivals.take(run)
        if arrivals is not None:
            arrivals.end()
    report = tally.report(names, time.perf_counter() - started, rewriter)
    for note in report.notes:
        warnings.warn(note, TfdbWarning, stacklevel=3)
    rewriter.warn(", ".join(names), 4)
    warn_of_refused(report.files, report.refused_edges, 4)
    for text in (each for rows in report.trajectories for each in rows.complaints()):
        warnings.warn(text, TfdbWarning, stacklevel=3)
    if report.forgotten:
        warn_of_forgotten(buffer, report.forgotten, 4)
    _warn(report.files, before, clocks_before, buffer, 4)
    return report


def _warn(
    files: Sequence[str],
    before: Sequence[FrameInfo],
    clocks_before: int,
    store: Buffer,
    depth: int,
) -> None:
    """Warn of data that were stored before, and of stamps of another clock.

    The caller is `depth` frames up.
    """
    after = store.tree()
    if any(i.samples for i in before if not i.is_static) and _extent(before) == _extent(after):
        message = f"{', '.join(files)}: every sample was in the store before; loaded twice?"
        warnings.warn(message, TfdbWarning, stacklevel=depth)
    found = clocks(after, store)
    several = describe_clocks(found)
    if several and clocks_before < len(found):
        warnings.warn(f"{', '.join(files)}: {several}", TfdbWarning, stacklevel=depth)


def _extent(infos: Sequence[FrameInfo]) -> set[tuple[object, ...]]:
    """Return numbers that change with each added sample."""
    return {(i.name, i.parent, i.samples, i.oldest, i.newest) for i in infos}


class _Meter:
    """Counts progress: each message counts each time it is read, and once when stored."""

    def __init__(self, messages: int, progress: Progress | None, times: int) -> None:
        self._total = times * messages
        self._done = 0
        self._progress = progress

    def step(self, messages: int) -> None:
        # A file read again by another library counts again, but never beyond its share.
        self._done = min(self._done + messages, self._total)
        if self._progress is not None:
            self._progress(self._done, self._total)
