"""Arguments: valid values of parameters, and hostile ones."""

from __future__ import annotations

import array
import datetime as dt
import gc
import math
from typing import TYPE_CHECKING, Any

import numpy as np

import tfdb

if TYPE_CHECKING:
    import random
    from collections.abc import Callable, Iterator

ENGINES = ["snapshot", "giant", "fine", "2pl-no-wait", "2pl-wait-die", "2pl-wound-wait", "silo"]
NAMES = ["map", "odom", "base", "arm", "hand", "/map", "frame é", "x" * 300, ""]
TURNED = (0.0, 0.0, 0.6, 0.8)
MESSAGE = tfdb.encode_tf_message([tfdb.TransformStamped("map", "base", 500, (1, 2, 3), TURNED)] * 2)
NUMBERS: list[Any] = [
    0, -1, 1, True, 255, 2**31, 2**32, 2**63 - 1, 2**63, 2**64, -(2**63), 10**40, 0.5, -0.0,
    1e308, -1e308, math.inf, -math.inf, math.nan, 1e-320, 3 + 4j,
]  # fmt: skip


class PlantedError(Exception):
    """Raised by hostile objects: it may come out again."""


class Values:
    """Makes arguments. `world` is what hostile objects act upon."""

    def __init__(self, rng: random.Random, world: Any) -> None:
        self.rng = rng
        self.world = world
        self._made = self._makers()

    def good(self, parameter: str) -> Any:
        """Make what the parameter wants, as far as its name tells."""
        make = self._made.get(parameter)
        return self.any() if make is None else make()

    def any(self, parameter: str = "") -> Any:
        """Make anything."""
        pick = self.rng.choice
        if parameter in {"rate", "max_frames", "memory_limit", "snapshot_memory", "timeout"}:
            # What is large is granted here, and takes its time.
            return pick([0, -1, math.nan, -math.inf, None, "1", (), 1 << 200, Evil(self)])
        kind = self.rng.randrange(12)
        if kind == 0:
            return pick(NUMBERS)
        if kind == 1:
            return pick([None, NotImplemented, ..., object(), type, len, Ellipsis])
        if kind == 2:
            return pick(["\ud800", "a\0b", "", "é" * 50, b"\xff", bytearray(b"ab"), Name("map")])
        if kind == 3:
            return [self.any() for _ in range(self.rng.randrange(4))]
        if kind == 4:
            return tuple(self.any() for _ in range(self.rng.randrange(5)))
        if kind == 5:
            return self.array()
        if kind <= 8:
            return pick([Evil, Index, Float, Sequence, Message, Iterating, Vector])(self)
        if kind == 9:
            return self.world.any_object()
        if kind == 10:
            return {self.rng.choice(NAMES): 1}
        return self.good(pick(list(self._made)))

    def array(self) -> Any:
        """Make an array of some shape and kind."""
        rng = self.rng
        shape = rng.choice([(), (0,), (1,), (3,), (4,), (7,), (5, 3), (0, 3), (2, 4, 4), (3, 7)])
        kind = rng.choice(["f8", "f4", "i8", "u8", "i4", "?", "M8[ns]", "M8[s]", "c16", "O", ">f8"])
        made: Any = np.zeros(shape, kind)
        if rng.random() < 0.3 and kind in {"f8", "f4"}:
            made[...] = rng.choice([math.nan, math.inf, 1e300 if kind == "f8" else 1e30])
        if rng.random() < 0.2:
            made = made[..., ::-1] if made.ndim else made
        if rng.random() < 0.2:
            made.flags.writeable = False
        if rng.random() < 0.1 and made.dtype != "O":
            made = rng.choice([array.array("d", [1, 2, 3]), memoryview(bytearray(64))])
        return made

    def stamp(self) -> Any:
        """Make a stamp."""
        value = self.rng.randrange(0, 2_500)
        make = self.rng.choice([int, int, int, np.int64, lambda v: np.datetime64(v, "ns"), Int])
        return make(value)

    def stamps(self) -> Any:
        """Make many stamps; now and then so many that the GIL is given up."""
        count = self.rng.choice([0, 1, 2, 5, 50, 300])
        if self.rng.random() < 0.02:
            return self.world.stamps
        made = np.array([self.rng.randrange(0, 2_500) for _ in range(count)], np.int64)
        return made if self.rng.random() < 0.7 else made.tolist()

    def vector(self, width: int = 3) -> Any:
        """Make a vector, or a unit quaternion."""
        made = [self.rng.uniform(-9, 9) for _ in range(3)] if width == 3 else list(TURNED)
        return self.rng.choice([tuple, list, np.array])(made)

    def transform(self) -> tfdb.TransformStamped:
        """Make one that may be stored."""
        pick = self.rng.choice
        return tfdb.TransformStamped(
            pick(NAMES[:5]), pick(NAMES[:5]), self.stamp(), self.vector(), self.vector(4)
        )

    def batch(self) -> Any:
        """Make a batch of transforms."""
        if self.rng.random() < 0.3:
            count = self.rng.randrange(4)
            poses = np.tile(np.array([1.0, 2, 3, *TURNED]), (count, 1))
            stamps = np.arange(count, dtype=np.int64) + self.rng.randrange(2_000)
            return tfdb.Columns("map", self.rng.choice(NAMES[:5]), stamps, poses)
        return [self.transform() for _ in range(self.rng.randrange(4))]

    def _makers(self) -> dict[str, Callable[[], Any]]:
        rng = self.rng
        pick = rng.choice

        def name() -> str:
            return pick(NAMES[:4] if rng.random() < 0.9 else NAMES)

        def nothing() -> None:
            return None

        makers: dict[str, Callable[[], Any]] = dict.fromkeys(
            ("target", "source", "parent", "child", "name", "fixed_frame", "tracking"), name
        )
        makers |= dict.fromkeys(("observation", "reference", "point_frame"), name)
        makers |= dict.fromkeys(
            ("stamp", "now", "target_stamp", "source_stamp", "start", "end"), self.stamp
        )
        makers |= dict.fromkeys(("kind", "error", "traceback"), nothing)
        makers |= dict.fromkeys(("translation", "rpy", "point"), self.vector)
        makers |= dict.fromkeys(
            ("static", "partial", "recursive", "alone"), lambda: pick([False, True])
        )
        makers |= {
            "stamps": self.stamps,
            "rotation": lambda: self.vector(4),
            "wxyz": lambda: self.vector(4),
            "matrix": lambda: np.eye(4)[:, rng.choice([[0, 1, 2, 3], [1, 2, 0, 3], [1, 0, 2, 3]])],
            "matrices": lambda: np.tile(np.eye(4), (rng.randrange(3), 1, 1)),
            "points": lambda: pick([np.ones((4, 3)), np.ones((4, 3), np.float32), [[1, 2, 3]]]),
            "policy": lambda: pick(
                [None, tfdb.Interpolate(), tfdb.Exact(), tfdb.Nearest(), tfdb.Extrapolate(9.0)]
            ),
            "interval": lambda: pick([0.1, 1e-7, 1e-6]),
            "max_age": lambda: pick([None, 1.0, 1e-7]),
            "layout": lambda: pick(["pose", "matrix"]),
            "missing": lambda: pick(["raise", "nan"]),
            "out": lambda: pick([None, None, np.zeros((5, 7)), np.zeros((4, 3))]),
            "authority": lambda: pick(["", "driver", "é"]),
            "batch": self.batch,
            "transforms": self.batch,
            "messages": lambda: pick([[MESSAGE] * 3, [bytearray(MESSAGE)], (m for m in [MESSAGE])]),
            "data": lambda: pick([MESSAGE, MESSAGE[:-3], bytearray(MESSAGE), b""]),
            "encoding": lambda: pick(["cdr", "ros1", "cdr_le"]),
            "names": lambda: [name() for _ in range(rng.randrange(3))],
            "priority": lambda: rng.randrange(8),
            "age": lambda: 0,
            "fn": lambda: self.world.work,
            "retries": lambda: rng.randrange(3),
            "timeout": lambda: pick([None, 0.0, 0.001]),
            "rate": lambda: pick([None, 1e6, 1e8]),
            "history": lambda: pick([None, 1.0, 1e-6]),
            "concurrency": lambda: pick(ENGINES),
            "max_frames": lambda: pick([4, 100]),
            "memory_limit": lambda: pick([None, 1 << 24]),
            "snapshot_memory": lambda: pick([0, 1 << 20]),
            "clock": lambda: pick([None, self.world.clock]),
            "seconds": lambda: pick([1.5, "2.5", 3]),
        }
        return makers


class Name(str):
    """Text of a class of its own."""

    __slots__ = ("about",)


class Int(int):
    """An integer of a class of its own."""


class Evil:
    """Does something to the world whenever it is asked for anything."""

    def __init__(self, values: Values) -> None:
        self._values = values

    def _act(self, answer: Any, others: list[Any] = NUMBERS) -> Any:
        values = self._values
        values.world.act()
        return answer if values.rng.random() < 0.8 else values.rng.choice(others)

    def __repr__(self) -> str:
        return str(self._act(self._values.rng.choice(["evil", "\ud800", ""])))


class Index(Evil):
    """An integer."""

    def __index__(self) -> int:
        return self._act(700)  # type: ignore[no-any-return]


class Float(Evil):
    """A number."""

    def __float__(self) -> float:
        return self._act(0.7)  # type: ignore[no-any-return]


class Sequence(Evil):
    """A sequence that changes its mind."""

    def __len__(self) -> int:
        # Not a length for which somebody would make room.
        length = self._values.rng.randrange(5)
        return self._act(length, [-1, None, 2.5, 2**70])  # type: ignore[no-any-return]

    def __getitem__(self, at: int) -> Any:
        if at > 4:
            raise IndexError(at)
        return self._act(self._values.rng.choice([1.0, 5, "map", None]))


class Iterating(Evil):
    """Something to iterate over."""

    def __iter__(self) -> Iterator[Any]:
        for _ in range(self._values.rng.randrange(4)):
            yield self._act(self._values.rng.choice([5, MESSAGE, "map", bytearray(MESSAGE)]))


class Vector(Evil):
    """x, y, z and w."""

    x = property(lambda self: self._act(1.0))
    y = property(lambda self: self._act(2.0))
    z = property(lambda self: self._act(0.6))
    w = property(lambda self: self._act(0.8))


class Message(Evil):
    """A stamp, a transform and a dtype in one."""

    sec = property(lambda self: self._act(0))
    nanosec = property(lambda self: self._act(500))
    dtype = property(lambda self: self._act("M"))
    shape = property(lambda self: self._act((3,)))
    parent = property(lambda self: self._act("map"))
    child = property(lambda self: self._act("base"))
    stamp = property(lambda self: self._act(600))
    translation = property(lambda self: self._act((1, 2, 3)))
    rotation = property(lambda self: self._act(TURNED))
    to_nsec = property(lambda self: self._act(lambda: dt.timedelta(1)))


def collect() -> None:
    """Free what is garbage, here and now."""
    gc.collect(0)
