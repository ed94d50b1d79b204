"""The class Buffer: the extension's store and its methods in Python.

The methods import their implementations when they are called, so `import tfdb` is fast.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, overload

from tfdb import _core

from .data.lazy_names import belong_to
from .reads import Freezable, Snapshot, Transaction

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine, Iterable
    from typing import Literal, Unpack

    from tfdb._core import Policy, Transform
    from tfdb.data.stamps import StampLike
    from tfdb.data.types import (
        Name,
        Paths,
        PoseLike,
        Progress,
        QuaternionLike,
        TrajectoryLike,
        VectorLike,
        WxyzLike,
    )
    from tfdb.judging.buffer_expectations import BufferExpectations
    from tfdb.judging.event_stream import EventStream
    from tfdb.judging.expectations import Expectations, Limits
    from tfdb.judging.installed import Installed
    from tfdb.recordings.load_report import LoadReport
    from tfdb.recordings.selected import Selected
    from tfdb.rules.rule import Action, Rule, RuleOptions, Subject
    from tfdb.rules.rules import Rules
    from tfdb.store.transactions import Result
    from tfdb.streams.answers import AnswerStream
    from tfdb.streams.stream import Stream

__all__ = ["Buffer", "Snapshot", "Transaction"]


class Buffer(Freezable, _core.NativeBuffer):
    """A store of time-stamped transforms between named frames.

    Any number of threads may read and write at once. Each read sees one committed state and never
    waits for a writer. Each write is stored as a whole or not at all. `transaction` and `run` read,
    decide and write in isolation from all other writers.

    Parameters
    ----------
    history
        Seconds to keep behind each edge's newest stamp; None keeps everything.
    max_frames
        Largest number of frames.
    memory_limit
        Largest size of the store in bytes; None: the machine's memory.
    snapshot_memory
        Largest size in bytes to which the store grows to keep held snapshots readable.
    clock
        Function that returns the time in nanoseconds, for expectations and for `max_age=` of
        `lookup_latest_transform`. None: the store's clock, which a player may set.
    concurrency
        Engine of concurrency control. `snapshot` has the fastest reads, and its lookups never wait.
        The others are research engines for comparison: `giant` (one mutex for everything),
        `2pl-no-wait`, `2pl-wait-die` and `2pl-wound-wait` (locks on frames, held until the end),
        `silo` (verifies its reads at the commit), and `fine` (locks one frame after the other;
        batches and transactions are not isolated).

    Raises InvalidArgument, CapacityExceeded.
    """

    __slots__ = ("_expectations", "_rules")
    _expectations: Any  # BufferExpectations, made on first use
    _rules: Any  # Rules, made on first use

    @property
    def rules(self) -> Rules:
        """The installed rules, their statistics, and the number of threads for actions."""
        from tfdb.rules.rules import Rules

        made: Rules
        try:
            made = self._rules
        except AttributeError:
            self._rules = made = Rules(_buffer(self))
        return made

    def rule(
        self,
        on: Subject | Iterable[Subject],
        when: Callable[[Any], object] | None = None,
        **options: Unpack[RuleOptions],
    ) -> Callable[[Action], Action]:
        """Decorate a function so that commits call it: see `add_rule`.

        ```python
        @buf.rule(on=("map", "gripper"), when=lambda T: T.translation[2] < 0.1)
        def warn(event):
            print("too low since commit", event.commit)
        ```

        Parameters
        ----------
        on, when, **options
            As in `add_rule`.

        Returns
        -------
        Callable
            A decorator that returns the function unchanged.

        Raises
        ------
        The errors of `add_rule`.
        """
        buffer = _buffer(self)
        _ = buffer.closed

        def install(action: Action) -> Action:
            buffer.add_rule(action, on, when, **options)
            return action

        return install

    def add_rule(
        self,
        action: Callable[..., object],
        on: Subject | Iterable[Subject],
        when: Callable[[Any], object] | None = None,
        **options: Unpack[RuleOptions],
    ) -> Rule:
        """Install a rule: an action that is called when commits make a condition true.

        After each commit that touches `on`, one thread evaluates the condition on that commit's
        state, in the order of commits. Actions run in other threads and never hold up a writer.

        Parameters
        ----------
        action
            `fn(event)`, or `fn(event, tx)` with a transaction on the newest state. The transaction
            commits when the function returns and aborts when it raises. After a Conflict the
            function runs again, so side effects outside the store may be repeated.
        on
            A pair (target, source): each commit to its path touches it. A frame: each commit to its
            edge touches it. Or a list of these, or `"*"` for all commits. The frames need not exist
            yet.
        when
            The condition: called with the Transform of a pair, or with the Changes of a frame. It
            is False for a pair without a transform. None: always True.
        **options
            Fields of `tfdb.rules.RuleOptions`.

        Returns
        -------
        Rule

        Raises
        ------
        InvalidArgument, InvalidName, TypeError
            An argument is invalid.
        NotSupported
            This process cannot wait for commits of the store, or its engine keeps no feed.
        BufferClosed, TransactionActive
        """
        from tfdb.rules.rule import Rule

        return _buffer(self).rules._add(Rule(action, on, when, **options))

    @property
    def expectations(self) -> BufferExpectations:
        """The installed expectations, those that are broken now, and a callback for events."""
        from tfdb.judging.buffer_expectations import BufferExpectations

        made: BufferExpectations
        try:
            made = self._expectations
        except AttributeError:
            self._expectations = made = BufferExpectations(_buffer(self))
        return made

    @overload
    def expect(self, parent: Expectations, *, enforce: bool = ...) -> Installed: ...

    @overload
    def expect(
        self, parent: str, child: str, *, enforce: bool = ..., **limits: Unpack[Limits]
    ) -> Installed: ...

    def expect(
        self,
        parent: str | Expectations,
        child: str | None = None,
        *,
        enforce: bool = False,
        **limits: Unpack[Limits],
    ) -> Installed:
        """Check the commits from now on, until `remove()`: a broken limit begins an event.

        One thread of the buffer checks all expectations. The events go to `events()`, to
        `expectations.on_event` and to the logger `tfdb.expectations`.

        ```python
        with buf.expect("odom", "base", deadline=0.05, authority=["ekf", "wheels"]):
            for event in buf.events():
                print(event)
        ```

        Parameters
        ----------
        parent, child
            Frames of the edges; `*` stands for any characters. An edge without `*` in its names is
            `missing` until it has a sample. In place of both: Expectations, such as those of a
            file.
        enforce
            Also refuse old data: once the newest sample of an edge is older than its `lifespan`,
            every lookup over the edge raises Stale, at any stamp. That applies to lookups of this
            buffer, its snapshots and its transactions. The store's `clock` gives the age.
        **limits
            Fields of `tfdb.judging.Limits`, with the units of docs/howto/expectations.md.

        Returns
        -------
        Installed
            A context manager that removes the expectations at its end.

        Raises
        ------
        InvalidArgument
            A limit is invalid, or contradicts an installed expectation: the same edge or authority,
            a second default, another parent of a child, or another clock. With `enforce`: a
            lifespan is missing, ages count from arrivals, or the buffer has its own `clock=`.
        NotSupported
            This process cannot wait for commits of the store, or its engine keeps no feed.
        BufferClosed, TransactionActive
        """
        from tfdb.judging.buffer_expectations import expectations_of

        wanted = expectations_of(parent, child, limits)
        return _buffer(self).expectations._add(wanted, enforce=enforce)

    def events(self, *, max_pending: int = 1000) -> EventStream:
        """Return a stream of the events of `expect` from now on: each once, in order.

        Parameters
        ----------
        max_pending
            Largest number of unread events. Beyond it the oldest are dropped, and `missed` counts
            them.

        Returns
        -------
        EventStream

        Raises
        ------
        InvalidArgument
            `max_pending` is not an integer of at least 1.
        BufferClosed
        """
        return _buffer(self).expectations._events(max_pending)

    def load(
        self, path: Paths, *, progress: Progress | None = None, **selection: Unpack[Selected]
    ) -> LoadReport:
        """Load the transforms of recordings: `.bag`, `.db3`, `.mcap`, folders of ROS 2 bags.

        Trajectory files are recognised by their extensions (`.tum`, `.txt`, `.csv`, `.npz`,
        `.parquet`), and may be TUM, KITTI or EuRoC. A file becomes one moving edge. If it names no
        frames, the edge is T[world<-body]; `rename` sets other names.

        The files are checked before the first commit, so a damaged file leaves the buffer
        unchanged. They must not change during the load. Each message is one commit, in the order of
        receive times. A refused transform is counted and skipped; the others of its message are
        stored. A damaged message is skipped. A buffer with a limited history (10 s by default)
        drops the beginning of a long recording: the report and a TfdbWarning count the samples.
        `Buffer(history=None)` and `tfdb.load` keep everything.

        Parameters
        ----------
        path
            One recording or several; they are read in the order of their start.
        progress
            Called with (done, total). Each message counts when it is read and when it is stored.
        **selection
            The part to read, and new frame names: the fields of `tfdb.recordings.Selection`, such
            as `topics`, `start`, `exclude` and `rename`.

        Returns
        -------
        LoadReport
            Counts of the transforms read, stored, refused, skipped, dropped by the history and
            lost.

        Raises
        ------
        RecordingError
            A file is not a recording, is damaged or cut short; a topic is missing or has no
            transforms; or the selection is empty. Nothing was stored.
        MixedSources
            Without `topics`: groups of topics disagree on the edge of a frame to its parent. `/tf`
            and `/tf_static` of one namespace are one group, every other topic is a group of its
            own. Groups agree if one repeats samples of the other. Use `topics`, `by_namespace` or
            `mix`. Or files contradict each other on one topic: different transforms at one stamp,
            or stamps that interleave. Load one file, or use `prefix` or `mix`. Nothing was stored.
        TrajectoryError
            A line of a trajectory does not fit its format.
        UnknownFrame
            One of `frames` does not exist.
        ModelError
            `urdf` is not a robot model.
        InvalidArgument
            An empty path or none, a file that is given twice, an invalid option, two frames with
            one new name, or `end` before `start`.
        OSError
            A file cannot be opened.

        Warns
        -----
        TfdbWarning
            A name of `exclude` or `rename` does not exist. No edge moves from `start` to `end`.
            Joints are missing, unknown or beyond their limits. Transforms or messages were refused
            (once for each edge and error). All samples were in the store before. Stamps are more
            than a year apart, as of a simulated and a real clock. The history dropped samples. Rows
            of a trajectory repeat a stamp, or were sorted, mended or skipped. The unit or the
            columns of a trajectory were guessed.
        """
        from tfdb.recordings.load import load_into
        from tfdb.recordings.selection import selected

        return load_into(_buffer(self), path, selected(Buffer.load, selection), progress)

    @overload
    def follow(
        self,
        frames: str | Iterable[str] | None = None,
        *,
        pair: None = None,
        since: int | Literal["held"] | None = None,
        hold: bool = True,
        min_separation: float | None = None,
        lapped: Literal["raise", "skip"] = "raise",
        poll: float = 0.01,
    ) -> Stream: ...

    @overload
    def follow(
        self,
        frames: None = None,
        *,
        pair: tuple[str, str],
        since: Literal["held"] | None = None,
        hold: bool = True,
        min_separation: float | None = None,
        lapped: Literal["raise", "skip"] = "raise",
        poll: float = 0.01,
    ) -> AnswerStream: ...

    def follow(
        self,
        frames: str | Iterable[str] | None = None,
        *,
        pair: tuple[str, str] | None = None,
        since: int | Literal["held"] | None = None,
        hold: bool = True,
        min_separation: float | None = None,
        lapped: Literal["raise", "skip"] = "raise",
        poll: float = 0.01,
    ) -> Stream | AnswerStream:
        """Return a stream of the stored samples: each once, in the order of commits.

        ```python
        with buf.follow(["base"]) as stream:
            for sample in stream:
                print(sample.stamp, sample.transform.translation)
        ```

        Parameters
        ----------
        frames
            A frame or several: only samples of their edges. They need not exist yet. None: all.
        pair
            In place of frames: (target, source). The stream returns the result of
            `lookup_transform` without a stamp, each time a commit changes it.
        since
            None: commits from now on. A commit number: later commits. The feed keeps the
            last 16,384 commits or fewer; from an older number the read raises FeedLapped.
            `"held"`: all samples of the newest state, then those of later commits, without a gap.
        hold
            Hold a snapshot of the stream's position, so that no sample is dropped before it is
            read. A slow reader then uses memory, up to `snapshot_memory`; `memory()` shows it.
            Without it, `gone` counts the lost samples, and a pair is looked up in the newest state
            only.
        min_separation
            Smallest time in seconds from one returned sample of an edge to the next; other samples
            are skipped. Static transforms are never skipped.
        lapped
            What happens if commits leave the feed before they are read. `raise`: the read raises
            FeedLapped, and the next one continues. `skip`: it continues at once. `missed` counts
            these commits in both cases.
        poll
            Seconds between two polls, if this process cannot wait for commits.

        Returns
        -------
        Stream
            A stream of samples. With a pair, an AnswerStream.

        Raises
        ------
        InvalidArgument
            Both frames and a pair are given, or a pair with a commit number; the commit does not
            exist yet; a value is negative.
        InvalidName
            No frame can have the name.
        NotSupported
            The engine keeps no feed: `snapshot` and `giant` do.
        BufferClosed, TransactionActive

        Warns
        -----
        TfdbWarning
            This process cannot wait for commits of the shared store: the stream polls.
        """
        from tfdb.streams.follow import follow

        return follow(_buffer(self), frames, pair, since, hold, min_separation, lapped, poll)

    def set_trajectory(
        self, parent: str, child: str, trajectory: TrajectoryLike, *, authority: str = ""
    ) -> int:
        """Store a trajectory as the edge from `parent` to `child`, in one commit.

        A buffer with a limited history (10 s by default) drops the older poses: a TfdbWarning
        counts them. Store whole trajectories in `Buffer(history=None)`.

        Parameters
        ----------
        parent, child
            Frame names. The poses are stored as T[parent<-child]; the frame names of the trajectory
            do not matter.
        trajectory
            A `Trajectory`, or any object with `stamps` (N,) in nanoseconds and `poses` (N, 7). Rows
            that are NaN as a whole are skipped.
        authority
            As in `set_transforms`.

        Returns
        -------
        int
            Number of the commit.

        Raises
        ------
        The errors of `set_transforms`. Then nothing was stored.
        """
        from tfdb.trajectories.storing import store_trajectory

        return store_trajectory(_buffer(self), parent, child, trajectory, authority)

    def run(
        self,
        fn: Callable[[Transaction], Result],
        *,
        retries: int = 8,
        timeout: float | None = None,
        priority: int = 0,
    ) -> Result:
        """Run `fn(tx)` in a transaction, and repeat it until its commit succeeds.

        `fn` may be called several times: side effects outside `tx` must be idempotent. An attempt
        that ends in a Conflict stores nothing. A random wait precedes the next attempt: up to 0.1
        ms after the first conflict, doubled with each further one, at most 10 ms. After eight
        conflicts the ninth attempt runs alone: writers wait for it, so it cannot conflict. So `fn`
        is called at most nine times, and its commit succeeds unless `retries` or `timeout` set a
        lower limit. Engines that compare the ages of transactions count from the first attempt.

        Parameters
        ----------
        fn
            Called with an open `Transaction`, which is committed when `fn` returns. Its own
            exceptions abort the transaction and are raised. It must read and write through the
            transaction only (TransactionActive), and must not be `async def` or a generator.
        retries
            Largest number of attempts after the first. The default, 8, always suffices.
        timeout
            Seconds after which no further attempt begins; None: no limit. The first attempt always
            runs.
        priority
            From 0 to 7, as in `transaction`.

        Returns
        -------
        object
            The result of `fn` in the committed attempt.

        Raises
        ------
        Conflict
            The last conflict, with `attempts`, after all retries or at the timeout.
        InvalidArgument
            A number is out of its range.
        TransactionActive
            This thread has a transaction open in the store, or `fn` reads from or writes to the
            Buffer itself.
        TypeError
            `fn` is not callable, or returned a coroutine or generator. Nothing was stored.
        CycleError, CapacityExceeded
            The commit failed. Nothing was stored.
        """
        from tfdb.store.transactions import run_until_won

        return run_until_won(self, fn, retries=retries, timeout=timeout, priority=priority)

    def reparent(
        self,
        child: str,
        parent: str,
        stamp: StampLike | None = None,
        translation: VectorLike | PoseLike | None = None,
        rotation: QuaternionLike | None = None,
        *,
        rpy: VectorLike | None = None,
        wxyz: WxyzLike | None = None,
        authority: str = "",
    ) -> int:
        """Give a frame another parent from a stamp on, in one commit.

        Without a pose the frame keeps its place: T[parent<-child] at the stamp is computed from the
        store. It runs `Transaction.reparent` in a transaction of its own.

        Parameters
        ----------
        child, parent
            Frame names.
        stamp
            First stamp of the new parent, nanoseconds. None: the new edge is static, and holds at
            all times.
        translation, rotation, rpy, wxyz
            T[parent<-child] as in `set_transform`; without them the frame keeps its place.
        authority
            As in `set_transform`.

        Returns
        -------
        int
            Number of the commit.

        Raises
        ------
        The errors of `Transaction.reparent` and `run`. Then nothing was stored.
        """
        from tfdb.store.transactions import commit_of

        return commit_of(
            _buffer(self),
            lambda tx: tx.reparent(
                child, parent, stamp, translation, rotation, rpy=rpy, wxyz=wxyz, authority=authority
            ),
        )

    @staticmethod
    def open(
        name: Name,
        *,
        create: bool | None = None,
        mode: Literal["r", "rw"] = "rw",
        history: float | None = 10.0,
        max_frames: int = 65536,
        size: int = 1 << 30,
        snapshot_memory: int = 1 << 28,
        permissions: int = 0o600,
        group: int | str | None = None,
        lock_timeout: float | None = 10.0,
        clock: Callable[[], int] | None = None,
    ) -> Buffer:
        """Open a shared store, or create it.

        It is a `Buffer` with the same guarantees among processes as among threads: a commit is
        visible as a whole or not at all, a snapshot does not change, readers never wait. A process
        that dies at any instruction blocks and corrupts nothing: readers continue, and the next
        writer undoes its unfinished commit. Only a store that is nearly full drops held snapshots,
        to reclaim the memory of many dead writers (SnapshotTooOld). The store stays until
        `Buffer.unlink`, or until the machine restarts.

        Parameters
        ----------
        name
            A name without `/`, such as `"robot1"`; or a `pathlib.Path` on a memory file system.
        create
            True: create it; it must not exist. False: it must exist. None: create it if it is
            missing. mode="r" never creates a store.
        mode
            `rw`: read and write. `r`: read only; the store's memory is mapped read-only.
        history, max_frames, snapshot_memory
            As in `Buffer`. These arguments, and those down to `group`, apply to a new store only;
            an existing store keeps its own values.
        size
            Largest size in bytes. Memory is used as the store grows. Writes beyond the size raise
            CapacityExceeded.
        permissions, group
            Permissions and group of its files. By default only this user may open it; 0o640 lets
            the group read, 0o660 also write. Let only trusted processes write: they can damage the
            store's memory.
        lock_timeout
            Seconds that a write waits for the write of another process before it raises
            LockTimeout; None: no limit. Writes wait for suspended processes, not for dead ones.
            Ctrl-C ends the wait.
        clock
            As in `Buffer`.

        Returns
        -------
        Buffer

        Raises
        ------
        NoSuchStore, StoreExists, CorruptStore, ReadOnly, CapacityExceeded, InvalidName,
        InvalidArgument, NotSupported
        """
        from tfdb.store.shared import open_or_make

        return open_or_make(
            name,
            create=create,
            mode=mode,
            group=group,
            lock_timeout=lock_timeout,
            clock=clock,
            history=history,
            max_frames=max_frames,
            size=size,
            snapshot_memory=snapshot_memory,
            permissions=permissions,
        )

    @staticmethod
    def unlink(name: Name) -> None:
        """Remove a store. The last process that has it open frees it.

        Until then such processes can read and write, but their waits raise NoSuchStore.

        Parameters
        ----------
        name
            As in `open`.

        Raises
        ------
        NoSuchStore, CorruptStore (the file is not a store), ReadOnly, InvalidName, NotSupported
        """
        from tfdb.store.shared import unlink_store as unlink

        unlink(name)

    def wait_for_transform_async(
        self,
        target: str,
        source: str,
        stamp: StampLike | None = None,
        timeout: float | None = None,
        *,
        policy: Policy | None = None,
    ) -> Coroutine[Any, Any, Transform]:
        """Wait as `wait_for_transform` does, in an asyncio coroutine.

        One thread waits for all coroutines of the buffer; it ends a second after the last wait. A
        cancelled coroutine leaves nothing behind.

        Parameters
        ----------
        target, source, stamp, timeout, policy
            As in `wait_for_transform`.

        Returns
        -------
        Transform

        Raises
        ------
        The errors of `wait_for_transform`.
        """
        from tfdb.store.waiting import transform

        _ = _buffer(self).closed
        return transform(self, target, source, stamp, timeout, policy)

    def wait_for_commit_async(
        self, after: int, timeout: float | None = None
    ) -> Coroutine[Any, Any, int]:
        """Wait as `wait_for_commit` does, in an asyncio coroutine: see `wait_for_transform_async`.

        Parameters
        ----------
        after, timeout
            As in `wait_for_commit`.

        Returns
        -------
        int
            Number of the newest commit.

        Raises
        ------
        The errors of `wait_for_commit`.
        """
        from tfdb.store.waiting import commit

        _ = _buffer(self).closed
        return commit(self, after, timeout)

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle a shared store by its name, a frozen one by its file, others with their state.

        A pickled state becomes a frozen store without a file, which is read-only.
        """
        from tfdb.store import frozen, shared

        if (store := _buffer(self).shared) is not None:
            return shared.reopen, (store.path, store.mode, store.lock_timeout)
        if (file := self.frozen) is not None and file.origin != frozen.PICKLED:
            return frozen.reopen, (file.path,)
        return frozen.thaw, (frozen.state_of(self),)


def _buffer(self: object) -> Buffer:
    """Refuse other objects than Buffers when a method is called, not when its coroutine runs."""
    if not isinstance(self, Buffer):
        raise TypeError(f"a method of Buffer was called on a {type(self).__name__}")
    return self


belong_to("tfdb", globals(), __all__)
_core.adopt_classes(Buffer, Snapshot, Transaction)
