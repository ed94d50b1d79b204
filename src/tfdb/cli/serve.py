"""``tfdb serve``: fills a shared store."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, cast

import click

import tfdb
from tfdb.data.counting import counted
from tfdb.data.time_text import format_duration
from tfdb.recordings.following import Following, refuse_mixture_so_far
from tfdb.recordings.static_conflicts import way_on
from tfdb.store.summary import span

from . import common, layout, output
from .graph import STORE, listening, node_option
from .groups import SuggestingCommand, SuggestingGroup
from .selecting import selected, selection_options
from .times import NS, duration_option

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from click.decorators import FC

    from tfdb import Buffer, TransformStamped
    from tfdb.recordings.containers import Source
    from tfdb.recordings.load_report import LoadReport
    from tfdb.recordings.open_recordings import OpenRecordings
    from tfdb.recordings.rewriter import Rewriter

    from .graph import Live

_STEP_NS = 1_000_000
"""How far behind what is there a recording goes on, where its own pace is not known yet."""


def speed_option(_context: click.Context, _option: click.Parameter, value: float) -> float:
    """Refuse what passes every comparison."""
    if math.isnan(value):
        raise click.BadParameter("nan is not a speed")
    return value


into_option: Callable[[FC], FC] = click.option(
    "--into", metavar="NAME", required=True, help="Name of the store; a missing one is created."
)
history_option: Callable[[FC], FC] = click.option(
    "--history",
    metavar="SECONDS",
    default="10",
    show_default=True,
    callback=duration_option,
    help="Seconds of transforms that a new store keeps.",
)


@click.group("serve", cls=SuggestingGroup)
def command() -> None:
    """Fill a shared store from a recording at its own pace, or from a live graph.

    Example: tfdb serve bag drive.mcap --into robot1
    """


def _open(name: str, history: int | None) -> Buffer:
    return tfdb.Buffer.open(name, history=None if history is None else history / NS)


@command.command("bag", cls=SuggestingCommand)
@common.files_argument
@into_option
@click.option(
    "--speed",
    type=click.FloatRange(min=0, min_open=True),
    default=1.0,
    show_default=True,
    callback=speed_option,
    help="Speed of playing: 2 is twice as fast, 'inf' does not wait.",
)
@click.option("--loop", is_flag=True, help="Start again at the end, until Ctrl-C.")
@history_option
@selection_options
@common.json_option
def bag(
    *,
    files: tuple[str, ...],
    into: str,
    speed: float,
    loop: bool,
    history: int | None,
    as_json: bool,
) -> None:
    """Play recordings into the store NAME at their own pace.

    Example: tfdb serve bag drive.mcap --into robot1 --loop

    Stamps are those of the recording. If the store holds newer ones, and at each loop, they are
    shifted, so that they always grow. The store stays when the command ends or is stopped by
    Ctrl-C. 'tfdb shm rm NAME' removes it.
    """
    paths = common.find_paths(files)
    name = into.removeprefix(STORE)
    with common.open_selected(paths) as recordings:
        rewriter = recordings.rewriter()
        store = _open(name, history)  # after what may be refused
        player = Player(store, recordings, rewriter, speed)
        if not as_json:
            names = [str(path) for path in paths]
            text = f"{', '.join(names)} into shm:{name}; Ctrl-C ends it"
            output.say(layout.wrap(layout.words(text, *names)))

        def show() -> None:
            if as_json:
                shown = {"files": [str(path) for path in paths], "store": name}
                output.emit_json("serve bag", {**shown, **player.body()})
            else:
                output.say(layout.wrap(layout.words(player.describe())))

        try:
            player.begin()
            player.play()
            if rewriter.left_out and not (player.transforms or player.refused):
                raise tfdb.errors.RecordingError(recordings.names, rewriter.reason())
            rewriter.warn(", ".join(map(str, paths)), 2)
            while loop and player.transforms:
                player.play()
        except KeyboardInterrupt:
            show()
            raise
        show()


@command.command("follow", cls=SuggestingCommand)
@common.file_argument
@into_option
@click.option(
    "--timeout",
    type=click.FloatRange(min=0, min_open=True),
    metavar="SECONDS",
    help="Stop with an error if FILE has not grown for this long.  [default: wait]",
)
@history_option
@selection_options
@common.json_option
def follow(
    *,
    file: str,
    into: str,
    timeout: float | None,
    history: int | None,
    as_json: bool,
) -> None:
    """Load an MCAP file into the store NAME while it is written.

    Example: tfdb serve follow running.mcap --into robot1

    Messages arrive chunk by chunk, as the recorder writes them. The store stays when the command
    ends or is stopped by Ctrl-C. --frame, --keep, --urdf and offsets from the first or last stamp
    need a finished file. Groups of topics that disagree stop the command; the store keeps the
    earlier messages.
    """
    (path,) = common.find_paths([file])
    common.refuse_frozen([path])
    selection = selected()
    name = into.removeprefix(STORE)
    # What cannot be followed is refused before there is a store.
    refuse_mixture_so_far(path, selection)
    store = _open(name, history)
    if not as_json:
        text = f"{file} into shm:{name}, as it grows; Ctrl-C ends it"
        output.say(layout.wrap(layout.words(text, file)))
    following = Following(store, path, selection, timeout=timeout)
    try:
        following.run()
    except KeyboardInterrupt:
        _say_followed(following.report(1, whole=False), file, name, as_json=as_json)
        raise
    _say_followed(following.report(1), file, name, as_json=as_json)


def _say_followed(report: LoadReport, file: str, name: str, *, as_json: bool) -> None:
    if as_json:
        shown = {"messages": report.messages, "transforms": report.transforms}
        more = {
            "refused": report.refused,
            "refused_transforms": report.refused_transforms,
            "seconds": round(report.seconds, 3),
        }
        output.emit_json("serve follow", {"files": [file], "store": name, **shown, **more})
        return
    passed = format_duration(round(report.seconds * NS))
    text = f"{counted(report.transforms, 'transform')} in {counted(report.messages, 'message')}"
    text += f", in {passed}"
    output.say(layout.wrap(layout.words(text)))


_graph_options = (
    into_option,
    history_option,
    node_option,
    common.json_option,
)


def _serves_graph(function: Any) -> Any:
    for option in reversed(_graph_options):
        function = option(function)
    return function


@command.command("ros1", cls=SuggestingCommand)
@click.option(
    "--master", metavar="URI", default="", help="URI of the ROS master.  [default: ROS_MASTER_URI]"
)
@_serves_graph
def ros1(*, master: str, into: str, history: int | None, as_json: bool) -> None:
    """Fill the store NAME from /tf and /tf_static of a ROS 1 graph, until Ctrl-C.

    Example: tfdb serve ros1 --into robot1

    This process listens; all others look up by tfdb.Buffer.open("NAME") or
    tfdb.tf2.Buffer(store="NAME"). It needs no ROS package. from:=to and __name:=NAME work as in
    ROS. The store stays when the command ends.
    """
    _serve_graph(f"ros1:{master}", into, history, as_json=as_json)


@command.command("ros2", cls=SuggestingCommand)
@click.option(
    "--domain", metavar="ID", default="", help="Number of the ROS domain.  [default: ROS_DOMAIN_ID]"
)
@_serves_graph
def ros2(*, domain: str, into: str, history: int | None, as_json: bool) -> None:
    """Fill the store NAME from /tf and /tf_static of a ROS 2 graph, until Ctrl-C.

    Example: tfdb serve ros2 --domain 7 --into robot1

    This process listens; all others look up by tfdb.Buffer.open("NAME") or
    tfdb.tf2.Buffer(store="NAME"). It needs rclpy and tf2_msgs: source the setup.bash of ROS 2
    first. --ros-args works as in ROS. The store stays when the command ends.
    """
    _serve_graph(f"ros2:{domain}", into, history, as_json=as_json)


def _serve_graph(graph: str, into: str, history: int | None, *, as_json: bool) -> None:
    name = into.removeprefix(STORE)
    began = time.monotonic()
    with listening(graph, history=history, into=name) as live:
        if not as_json:
            text = f"{graph} as {live.node_name} into shm:{name}; Ctrl-C ends it"
            output.say(layout.wrap(layout.words(text)))
        try:
            live.sleep(math.inf)
            live.check()
        finally:
            _say_served(live, graph, name, began, as_json=as_json)


def _say_served(live: Live, graph: str, name: str, began: float, *, as_json: bool) -> None:
    commits, infos = live.store.commit - live.commit, live.store.tree()
    found = span(infos)
    listener = live.listener
    damaged = 0 if listener is None else listener.corrupt.total()
    refused = 0 if listener is None else listener.refused.total()
    seconds = time.monotonic() - began
    if as_json:
        body = {
            "files": [graph],
            "store": name,
            "commits": commits,
            "damaged": damaged,
            "refused_transforms": refused,
            "frames": len(infos),
            "newest_ns": None if found is None else found[1],
            "seconds": round(seconds, 3),
        }
        output.emit_json(f"serve {graph.partition(':')[0]}", body)
        return
    text = f"{counted(commits, 'commit')}, {counted(len(infos), 'frame')}"
    text += f", in {format_duration(round(seconds * NS))}"
    if damaged:
        text += f"; {counted(damaged, 'damaged message')} left out"
    if refused:
        text += f"; {counted(refused, 'transform')} refused"
    output.say(text)


@dataclass
class Player:
    """Plays recordings into a store, again and again."""

    store: Buffer
    recordings: OpenRecordings
    rewriter: Rewriter
    speed: float
    messages: int = 0
    transforms: int = 0
    refused: int = 0
    refused_transforms: int = 0
    rounds: int = 0
    first_refusal: str | None = None
    _newest: int | None = None
    _shift: int | None = None
    _step: int = _STEP_NS
    _began: float = field(default_factory=time.monotonic)

    def __post_init__(self) -> None:
        found = span(self.store.tree())
        self._newest = None if found is None else found[1]

    def begin(self) -> None:
        """Store what stays: the fixed joints of the model."""
        fixed = self.rewriter.fixed_joints()
        if fixed:
            who = self.rewriter.model_name
            self.store.set_transforms(fixed, static=True, authority=who)
            self.transforms += len(fixed)

    def play(self) -> None:
        """Play them once, one step behind the round before."""
        if self.rounds:
            time.sleep(self._step / NS / self.speed)
        began, first, last, played, moves = time.monotonic(), None, 0, 0, False
        self._shift = None
        for source, received, data in self._messages():
            is_static = self.recordings.choice.is_static(source)
            transforms = self._take(source, received, data, static=is_static)
            if transforms is None:
                continue
            if first is None or not (moves or self.rewriter.window[0] is None):
                began, first = time.monotonic(), received  # what is before `--start` takes no time
            last, played = received, played + 1
            moves = moves or (bool(transforms) and not is_static)
            wait = began + (received - first) / NS / self.speed - time.monotonic()
            if wait > 0:
                time.sleep(wait)
            self._store(source, transforms, static=is_static)
        if first is not None and played > 1:
            self._step = max((last - first) // (played - 1), 1)
        self.rounds += 1

    def _messages(self) -> Iterator[tuple[Source, int, bytes]]:
        for recording in self.recordings.files:
            yield from recording.messages(self.recordings.choice.wants)

    def _take(
        self, source: Source, received: int, data: bytes, *, static: bool
    ) -> list[TransformStamped] | None:
        """What is left of a message; None: nothing, or it cannot be read."""
        self.messages += 1
        before = len(self.rewriter.refused_members)
        try:
            decoded = self.rewriter.decoded(data, source, received, static=static)
        except tfdb.TfdbError as error:
            self._refuse(error)
            return None
        unread = self.rewriter.refused_members[before:]
        self.refused_transforms += len(unread)
        for each in unread:
            self._name(type(each).__name__, str(each))
        transforms = self.rewriter.transforms(decoded, source, static=static)
        return None if decoded and not transforms else transforms

    def _store(
        self, source: Source, transforms: Sequence[TransformStamped], *, static: bool
    ) -> None:
        if not static:
            transforms = list(self._shifted(transforms))
        try:
            refused = self.store.set_transforms(
                transforms, static=static, authority=source.authority, partial=True
            )
        except (tfdb.errors.ReadOnly, tfdb.errors.LockTimeout):
            raise
        except tfdb.TfdbError as error:
            self._refuse(error)
            return
        self.transforms += len(transforms) - len(refused)
        self.refused += bool(transforms) and len(refused) == len(transforms)
        self.refused_transforms += len(refused)
        for member in refused:
            text = member.message
            if self.first_refusal is None and member.error == "StaticConflict":
                frame = self.rewriter.old_name(transforms[member.index].child)
                text = way_on(text, frame, self._topics())
            self._name(member.error, text)

    def _refuse(self, error: tfdb.TfdbError) -> None:
        """Count a message of which nothing is stored."""
        self.refused += 1
        self.refused_transforms += len(error.refused or ())
        self._name(type(error).__name__, str(error))

    def _topics(self) -> dict[str, bool]:
        """The topics that are played, and whether each is static."""
        is_static = self.recordings.choice.is_static
        return {each.topic: is_static(each) for each in self.recordings.sources}

    def _name(self, error: str, message: str) -> None:
        """Keep the first refusal for the summary."""
        self.first_refusal = self.first_refusal or f"{error}: {message}"

    def _shifted(self, transforms: Iterable[TransformStamped]) -> Iterator[TransformStamped]:
        """Move stamps behind those that were there when this round began."""
        for transform in transforms:
            stamp = cast("int", transform.stamp)
            newest = stamp - self._step if self._newest is None else self._newest
            if self._shift is None:
                self._shift = newest + self._step - stamp if stamp <= newest else 0
            stamp += self._shift
            self._newest = max(stamp, newest)
            yield replace(transform, stamp=stamp)

    def body(self) -> dict[str, Any]:
        """Return what was done, as JSON."""
        return {
            "messages": self.messages,
            "transforms": self.transforms,
            "refused": self.refused,
            "refused_transforms": self.refused_transforms,
            "rounds": self.rounds,
            "shift_ns": self._shift or 0,
            "newest_ns": self._newest,
            "seconds": round(time.monotonic() - self._began, 3),
        }

    def describe(self) -> str:
        """Say what was done."""
        passed = format_duration(round((time.monotonic() - self._began) * NS))
        text = f"{counted(self.transforms, 'transform')} in {counted(self.messages, 'message')}"
        text += f", in {passed}"
        if self._shift:
            text += f"; stamps are {format_duration(self._shift)} later than recorded"
        if self.first_refusal is not None:
            counts = layout.refused_counts(self.refused, self.refused_transforms)
            text += f"; {counts}, the first: {self.first_refusal}"
        return text
