"""Loads an MCAP file while it is written."""

from __future__ import annotations

import time
from contextlib import closing
from numbers import Real
from typing import TYPE_CHECKING, Any

from tfdb import _core
from tfdb.data.argument_checks import refuse_without
from tfdb.data.errors import InvalidArgument, RecordingError
from tfdb.data.path_checks import check_path

from .load_report import Tally, warn_of_refused
from .mcap_reader import GrowingMcap
from .open_recordings import OpenRecordings, rewriter_without_survey
from .recording import runs_of
from .selection import absolute, selected
from .topic_groups import Watch, spelling_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path
    from typing import Unpack

    from tfdb._core import Buffer, Recorded

    from .containers import Source
    from .load_report import LoadReport
    from .recording import PathLike, Run
    from .rewriter import Rewriter
    from .selected import Selected
    from .selection import Choice, Selection


def follow_recording(
    buffer: Buffer,
    path: PathLike,
    *,
    timeout: float | None = None,
    interval: float = 0.2,
    **selection: Unpack[Selected],
) -> LoadReport:
    """Load an MCAP file while it is written, chunk by chunk, until it is complete.

    Each message is one commit, as soon as its chunk is in the file. The recorder decides when it
    writes a chunk (`--max-cache-size` of `ros2 bag record`). Other threads, or other processes of a
    shared store, can read meanwhile. After Ctrl-C the earlier messages stay stored.

    Parameters
    ----------
    buffer
        The store to fill. Its `history` limits the kept samples.
    path
        The file; it may still be empty. Damaged messages are refused and counted, as by `load`.
    timeout
        Seconds without growth after which an error is raised; None: wait forever.
    interval
        Seconds between two checks of the file's size.
    **selection
        Fields of `Selection`: `topics` (they may appear later), `start` and `end` as stamps,
        `exclude`, `rename`, `prefix`, `pose_topics`, `by_namespace` and `mix`. The other fields
        need the whole file.

    Raises
    ------
    RecordingError
        The file is not MCAP, is damaged, or shrank. Or it is incomplete and has not grown for
        `timeout`: complete chunks are stored, and `load(salvage=True)` reads the rest. Or it ended
        without transforms, or without one of `topics`: the other messages are stored.
    MixedSources
        Groups of topics disagree, as in `Buffer.load`; the earlier messages are stored.
    InvalidArgument
        An option that needs the whole file, or an invalid timeout or interval.
    OSError
        The file cannot be opened or read.
    """
    made = selected(follow_recording, selection)
    following = Following(buffer, path, made, timeout=timeout, interval=interval)
    following.run()
    return following.report(3)


class Following:
    """One run of `follow_recording`; its report is available after a signal."""

    def __init__(
        self,
        buffer: Buffer,
        path: PathLike,
        selection: Selection,
        *,
        timeout: float | None = None,
        interval: float = 0.2,
    ) -> None:
        """Check the arguments."""
        self._started = time.perf_counter()
        refuse_without(buffer, "buffer", "a Buffer", "set_transforms", "history")
        self._path = check_path(path, RecordingError)
        _check_seconds("interval", interval)
        if timeout is not None:
            _check_seconds("timeout", timeout)
        self._timeout, self._interval = timeout, interval
        self._selection = selection
        self._rewriter = rewriter_without_survey(selection.choice)
        self._tally = Tally(buffer)

    def run(self) -> None:
        """Store messages until the file is complete."""
        watch = _watch(self._path, self._selection.choice, self._rewriter)
        with closing(GrowingMcap(self._path)) as file:
            grown, size = time.monotonic(), file.size
            while True:
                for messages, sources in file.read():
                    self._take(messages, sources, watch)
                if file.is_complete:
                    break
                now = time.monotonic()
                if file.size != size:
                    grown, size = now, file.size
                elif self._timeout is not None and now - grown > self._timeout:
                    raise RecordingError(
                        self._path,
                        f"it has not grown for {self._timeout:g} s and has no end: its writer "
                        "stopped; salvage=True (--salvage) reads what it has",
                    )
                time.sleep(self._interval)
            came = {absolute(name) for name in self._tally.topics}
            if not self._tally.transforms or self._selection.choice.topics - came:
                with OpenRecordings(self._path, self._selection):
                    pass  # it refuses topics that are missing

    def _take(self, messages: Recorded, sources: Mapping[int, Source], watch: Watch | None) -> None:
        """Commit the wanted part of new messages, and count their topics."""
        choice, counts = self._selection.choice, messages.counts()
        for id_, source in sources.items():
            if choice.wants(source):
                self._tally.count_messages(source, counts.get(id_, 0), choice)
        for run in _runs_that_came(messages, sources, choice, watch):
            self._tally.store(run, choice, self._rewriter)

    def report(self, level: int, *, whole: bool = True) -> LoadReport:
        """Return what was stored so far; warnings name the caller `level` calls up.

        A recording that was `whole` and had no transform is an error.
        """
        seconds = time.perf_counter() - self._started
        report = self._tally.report((str(self._path),), seconds, self._rewriter, empty=not whole)
        self._rewriter.warn(str(self._path), level + 1)
        warn_of_refused(report.files, report.refused_edges, level + 1)
        return report


def refuse_mixture_so_far(path: PathLike, selection: Selection) -> None:
    """Raise the errors of `follow_recording` for the existing part of a file.

    Raises MixedSources, RecordingError and InvalidArgument.
    """
    choice, given = selection.choice, check_path(path, RecordingError)
    watch = _watch(given, choice, rewriter_without_survey(choice))
    with closing(GrowingMcap(given)) as file:
        for messages, sources in file.read():
            if watch is None:
                break
            for _ in _runs_that_came(messages, sources, choice, watch):
                pass


def _watch(path: Path, choice: Choice, rewriter: Rewriter) -> Watch | None:
    """Return a watch for groups that disagree while a file grows; None if they may disagree."""
    is_judged = choice.judges_groups and not choice.by_namespace
    return Watch(str(path), rewriter.without_names()) if is_judged else None


def _runs_that_came(
    messages: Recorded, sources: Mapping[int, Source], choice: Choice, watch: Watch | None
) -> Iterator[Run]:
    """Yield the wanted runs of new messages, each after the watch has compared it."""

    def kind(source: Source) -> object:
        return choice.kind(source), "" if watch is None else spelling_of(source)

    wanted = {id_ for id_, source in sources.items() if choice.wants(source)}
    picked = _core.Recorded()
    for index in range(len(messages)):
        received, id_, data = messages[index]
        if id_ in wanted:
            picked.add(received, id_, data)
    for run in runs_of(picked, sources, choice.wants, kind):
        if watch is not None and choice.is_judged(run.source):
            watch.look(run, *choice.kind(run.source))
        yield run


def _check_seconds(name: str, value: Any) -> None:
    is_number = isinstance(value, Real) and not isinstance(value, bool)
    if not is_number or not 0 < value < 10**9:
        raise InvalidArgument(
            f"{name} must be a positive number of seconds, got {value!r}", value=value
        )
