"""``tfdb change-notifier``: reports motions of one frame in another."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import click

import tfdb
from tfdb.data.time_text import format_ns
from tfdb.store.waiting import NO_ANSWER_YET

from . import common, layout, output
from .graph import live_source, node_option
from .groups import SuggestingCommand
from .selecting import refuse_selection, selection_options
from .times import NS

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from tfdb import Transform
    from tfdb._core import StoreReader
    from tfdb.ros import Node, Publisher

    from .graph import Live


@click.command("change-notifier", cls=SuggestingCommand)
@common.file_argument
@click.option(
    "--pair",
    "pairs",
    nargs=2,
    multiple=True,
    metavar="TARGET SOURCE",
    help="Watch T[TARGET<-SOURCE]; repeatable.  [default: map base_link]",
)
@click.option(
    "--distance",
    type=click.FloatRange(min=0),
    default=0.1,
    metavar="METRES",
    help="Report a motion of SOURCE by this far since the last report.",
)
@click.option(
    "--angle",
    type=click.FloatRange(min=0),
    default=0.1,
    metavar="RADIANS",
    help="Report a rotation of SOURCE by this angle since the last report.",
)
@click.option(
    "-r",
    "--rate",
    type=click.FloatRange(min=0, min_open=True, max=1000),
    default=10.0,
    metavar="HZ",
    help="Largest number of checks per second; for a recording, per recorded second.",
)
@click.option(
    "--to",
    "topic",
    metavar="TOPIC",
    default="tf_changes",
    help="Topic on which a graph gets the changes, as tf2_msgs/TFMessage.",
)
@node_option
@selection_options
@common.json_lines_option
def command(
    *,
    file: str,
    pairs: tuple[tuple[str, str], ...],
    distance: float,
    angle: float,
    rate: float,
    topic: str,
    as_json: bool,
) -> None:
    """Report and publish when one frame has moved relative to another.

    Example: tfdb change-notifier ros1: --pair map base_link --distance 0.5

    It prints the first pose, then each motion by more than --distance or --angle, like tf's
    change_notifier. In a live graph (ros1:, ros2:) it also publishes these transforms. FILE may be
    a shared store (shm:NAME) or a recording.
    """
    watched = [Pair(*pair) for pair in pairs or (("map", "base_link"),)]
    told = Told(file, distance, angle, as_json=as_json)
    if common.is_live(file):
        refuse_selection((file,), "live", "it")
        with live_source(file) as live:
            _follow(live, watched, told, rate, topic)
        return
    loaded = common.load((file,))
    for pair in watched:
        pair.target, pair.source = common.find_frames(loaded.store, pair.target, pair.source)
    for now in _steps(loaded.span, rate):
        for pair in watched:
            told.look(loaded.store, pair, now)


def _follow(live: Live, pairs: Sequence[Pair], told: Told, rate: float, topic: str) -> None:
    publisher = None
    if live.node is not None:
        publisher = live.node.advertise(topic, "tf2_msgs/TFMessage", depth=100)
    while True:
        next_look = time.monotonic() + 1 / rate
        moved = [found for pair in pairs if (found := told.look(live.store, pair, None))]
        if moved and publisher is not None and live.node is not None:
            _publish(live.node, publisher, moved)
        live.sleep(next_look)
        live.wait(math.inf)


def _publish(node: Node, publisher: Publisher, moved: Sequence[Transform]) -> None:
    members = [
        tfdb.TransformStamped(one.target, one.source, one.stamp, one.translation, one.rotation)
        for one in moved
    ]
    publisher.publish(tfdb.encode_tf_message(members, node.encoding))


def _steps(span: tuple[int, int] | None, rate: float) -> Iterator[int]:
    if span is None:
        yield 0
        return
    count = 0
    while (now := span[0] + round(count * NS / rate)) <= span[1]:
        yield now
        count += 1


@dataclass
class Pair:
    """Two frames, and the last reported pose of one in the other."""

    target: str
    source: str
    last: Transform | None = field(default=None)

    def __post_init__(self) -> None:
        self.target, self.source = self.target.removeprefix("/"), self.source.removeprefix("/")


@dataclass(frozen=True)
class Told:
    """Reports motions beyond the limits."""

    file: str
    distance: float
    angle: float
    as_json: bool

    def look(self, store: StoreReader, pair: Pair, stamp: int | None) -> Transform | None:
        """Report a pair's pose if it has moved beyond a limit."""
        try:
            found = store.lookup_transform(pair.target, pair.source, stamp)
        except NO_ANSWER_YET:
            return None
        moved, turned = (0.0, 0.0) if pair.last is None else _between(pair.last, found)
        if pair.last is not None and moved <= self.distance and turned <= self.angle:
            return None
        first, pair.last = pair.last is None, found
        if self.as_json:
            output.emit_json_line("change-notifier", self._body(found, moved, turned))
        else:
            how = "is at" if first else f"moved {moved:.3f} m, {turned:.3f} rad, to"
            place = ", ".join(f"{float(value):.3f}" for value in found.translation)
            turn = ", ".join(f"{float(value):.3f}" for value in found.rotation)
            into, of = layout.transform_name(found.target, found.source)
            chunks = [format_ns(found.stamp), f" {into}", of, *layout.words(f" {how}")]
            output.say(layout.wrap([*chunks, f" [{place}]", f" [{turn}]"]))
        return found

    def _body(self, found: Transform, moved: float, turned: float) -> dict[str, Any]:
        return {
            "files": [self.file],
            "target": found.target,
            "source": found.source,
            "stamp_ns": found.stamp,
            "moved_m": moved,
            "turned_rad": turned,
            "translation": found.translation.tolist(),
            "rotation_xyzw": found.rotation.tolist(),
        }


def _between(one: Transform, other: Transform) -> tuple[float, float]:
    """Return the distance in metres and the angle in radians between two poses."""
    moved = math.dist(one.translation, other.translation)
    # The chord of the angle is exact for small angles; q and -q are the same rotation.
    chord = min(math.dist(one.rotation, sign * other.rotation) for sign in (1, -1))
    return moved, 4 * math.asin(min(1.0, chord / 2))
