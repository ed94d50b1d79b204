"""Options of loading on random recordings: the native filter equals one in Python."""

from __future__ import annotations

import random
from collections import Counter
from dataclasses import replace
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from tests.stored import stored

import tfdb
from tfdb import _core
from tfdb.recordings import Recording, RecordingWriter
from tfdb.recordings.recorded_edges import RecordedEdges
from tfdb.recordings.rewriter import Rewriter
from tfdb.recordings.selection import Selection

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

S = 10**9
END = 2**31 * S
FRAMES = [*(f"f{number}" for number in range(7)), "\u00e4", "/two"]
KEEPS_NOTHING = "left out by|have no transform|all messages were refused"


def member(random: random.Random, now: int) -> tfdb.TransformStamped:
    """Make a random transform, which is usually valid, in order and part of a tree."""
    parent, child = sorted(random.sample(FRAMES, 2))
    if random.random() < 0.03:
        parent, child = child, parent
    late = int(random.random() * 3 * S) if random.random() < 0.1 else 0
    turn = np.array([random.gauss(0, 1) for _ in range(4)])
    turn /= np.linalg.norm(turn)
    place = [random.random(), 2.0, 3.0]
    fault = random.random()
    if fault < 0.02:
        place[0] = float("nan")
    elif fault < 0.04:
        turn *= 0
    elif fault < 0.05:
        child = parent
    elif fault < 0.06:
        child += "\n"
    stamp = max(0, now - late)
    return tfdb.TransformStamped(parent, child, stamp, tuple(place), tuple(turn))


def record(path: Path, seed: int) -> Path:
    """Write 250 messages of two robots, some of them cut."""
    rng, now = random.Random(seed), 20 * S
    with RecordingWriter(path) as writer:
        for _ in range(250):
            now += int(rng.random() * 0.05 * S)
            topic = rng.choices(["/tf", "/tf_static", "/robot1/tf"], [20, 1, 5])[0]
            members = [member(rng, now) for _ in range(rng.choice([0, 1, 1, 2, 5]))]
            data = tfdb.encode_tf_message(members, writer.encoding)
            if rng.random() < 0.03:
                data = data[: rng.randrange(len(data))]
            node = rng.choice(["/driver", "/filter"])
            static = topic == "/tf_static"
            writer.write(data, now, topic=topic, static=static, authority=node)
    return path


class Expected:
    """The samples that a filter in Python stores, message by message."""

    def __init__(
        self,
        path: Path,
        keeps: Callable[[Any, tfdb.TransformStamped], bool],
        window: tuple[int, int] = (0, END),
        name: Callable[[Any, str], str] = lambda _, frame: frame,
        history: float | None = None,
    ) -> None:
        self.buffer = tfdb.Buffer(history=history)
        self.left_out = 0
        self.reasons: Counter[str] = Counter()
        with Recording(path) as recording:
            for source, _, data in recording.messages():
                chosen = self._choose(source, data, keeps, window, name)
                if chosen is None:
                    continue
                result = self.buffer.ingest_many(
                    [chosen],
                    encoding=source.encoding,
                    static=source.is_static,
                    authority=source.authority,
                )
                self.reasons.update({each: n.count for each, n in result.reasons.items()})

    def _choose(
        self, source: Any, data: bytes, keeps: Any, window: tuple[int, int], name: Any
    ) -> bytes | None:
        try:
            given = tfdb.decode_tf_message(data, source.encoding)
        except tfdb.TfdbError:
            return data
        left = [
            replace(each, parent=name(source, each.parent), child=name(source, each.child))
            for each in given
            if keeps(source, each)
            and (source.is_static or window[0] <= int(each.stamp) <= window[1])
        ]
        self.left_out += len(given) - len(left)
        if given and not left:
            return None
        return tfdb.encode_tf_message(left, source.encoding)


def compare(path: Path, expected: Expected, history: float | None = None, **options: Any) -> Any:
    buffer = tfdb.Buffer(history=history)
    if not expected.buffer.frames():
        with pytest.raises(tfdb.errors.RecordingError, match=KEEPS_NOTHING):
            buffer.load(path, **options)
        return None
    report = buffer.load(path, **options)
    assert stored(buffer) == stored(expected.buffer)
    assert buffer.commit == expected.buffer.commit
    assert report.left_out == expected.left_out
    assert Counter(report.reasons) == expected.reasons
    return report


def everything(_: Any, __: Any) -> bool:
    return True


@pytest.fixture(params=[(seed, kind) for seed in range(3) for kind in ("bag", "mcap", "db3")])
def path(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    seed, kind = request.param
    return record(tmp_path / f"run.{kind}", seed)


pytestmark = pytest.mark.filterwarnings("ignore::tfdb.TfdbWarning")


def test_all_transforms(path: Path) -> None:
    compare(path, Expected(path, everything), mix=True)


def test_names(path: Path) -> None:
    prefixed = Expected(path, everything, name=lambda _, frame: f"r/{frame}")
    compare(path, prefixed, mix=True, prefix="r/")
    new = {"f1": "f9", "/two": "one", "\u00e4": "b/\u00f6"}
    renamed = Expected(path, everything, name=lambda _, frame: new.get(frame, frame))
    given = {"f1": "f9", "//two": "one", "\u00e4": "b/\u00f6"}
    compare(path, renamed, mix=True, rename=given)
    both = Expected(path, everything, name=lambda _, frame: "x" + new.get(frame, frame))
    compare(path, both, mix=True, rename=given, prefix="x")


def test_namespaces(path: Path) -> None:
    def name(source: Any, frame: str) -> str:
        return f"robot1/{frame}" if source.topic.startswith("/robot1") else frame

    compare(path, Expected(path, everything, name=name), by_namespace=True)

    def keeps(source: Any, each: tfdb.TransformStamped) -> bool:
        return "robot1/f5" not in (name(source, each.parent), name(source, each.child))

    expected = Expected(path, keeps, name=name)
    compare(path, expected, by_namespace=True, exclude="robot1/f5")


@pytest.mark.parametrize(("start", "end"), [(22 * S, END), (0, 23 * S), (21 * S, 24 * S)])
def test_times(path: Path, start: int, end: int) -> None:
    expected = Expected(path, everything, (start, end))
    compare(path, expected, mix=True, start=start, end=end)


@pytest.mark.parametrize("entry", ["f3", "f*", "/tf_static", "driver", "/tf:f3", "*:f?", "none"])
def test_exclude(path: Path, entry: str) -> None:
    plain = entry.removeprefix("/")

    def keeps(source: Any, each: tfdb.TransformStamped) -> bool:
        topic = source.topic.removeprefix("/")
        names = [topic, source.authority, each.parent, each.child]
        if ":" in entry:
            names = [f"{topic}:{each.child}"]
        return not any(fnmatchcase(name.removeprefix("/"), plain) for name in names)

    compare(path, Expected(path, keeps), mix=True, exclude=entry)
    window = (22 * S, 25 * S)
    expected = Expected(path, keeps, window, lambda _, frame: f"p{frame}")
    compare(path, expected, mix=True, exclude=entry, start=window[0], end=window[1], prefix="p")


def test_a_limited_history_forgets_as_many_as_are_missing(path: Path) -> None:
    whole = Expected(path, everything)
    for history in (0.5, 2.0):
        limited = Expected(path, everything, history=history)
        report = compare(path, limited, history, mix=True)
        missing = sum(
            len(np.setdiff1d(whole.buffer.samples(frame)[0], limited.buffer.samples(frame)[0]))
            for frame in whole.buffer.frames()
            if frame in limited.buffer.frames() and not whole.buffer.frame_info(frame).is_static
        )
        # A stamp that arrives again after it was forgotten counts again.
        assert missing <= report.forgotten <= missing + report.reasons.get("TooOld", 0)
        assert report.forgotten > 0


def test_names_that_are_no_text_are_refused_once(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    good = tfdb.TransformStamped("map", "base", S, (1, 2, 3), (0, 0.6, 0, 0.8))
    bad = tfdb.TransformStamped("map", "XX", S, (1, 2, 3), (0, 0.6, 0, 0.8))
    with RecordingWriter(path) as writer:
        for second in (1, 2, 3):
            members = [replace(each, stamp=second * S) for each in (good, bad)]
            data = tfdb.encode_tf_message(members, "cdr").replace(b"XX", b"\xff\xfe")
            writer.write(data, second * S, topic="/tf")
    for options in ({}, {"prefix": "r/"}, {"exclude": "nothing"}, {"start": 0}):
        buffer = tfdb.Buffer(history=None)
        report = buffer.load(path, **options)
        assert report.reasons == {"InvalidName": 3}
        assert (report.transforms, report.commits, report.left_out) == (3, 3, 0)
        assert report.refused_edges[0].edge == options.get("prefix", "") + r"\xff\xfe"
    assert tfdb.Buffer(history=None).load(path, exclude="\ufffd*", end=2 * S).left_out == 2


def test_an_error_in_the_choice_ends_the_load(tmp_path: Path) -> None:
    path = record(tmp_path / "run.mcap", 1)
    buffer = tfdb.Buffer(history=None)
    with pytest.raises(tfdb.errors.InvalidName, match="cannot be written as UTF-8"):
        buffer.load(path, mix=True, prefix="\ud800")
    assert not buffer.frames()


def surveys(path: Path) -> tuple[RecordedEdges | None, RecordedEdges]:
    """Return the edges that a native survey finds, and those of a store with everything."""
    survey, everything = _core.EdgeSurvey(), tfdb.Buffer(history=None)
    rewriter = Rewriter(Selection().choice, (None, None), None)
    with Recording(path) as recording:
        for run in recording.read(None, lambda source: (source.encoding, source.is_static)):
            rewriter.survey(run, survey, run.source.encoding, run.source.is_static)
            rewriter.ingest(run, everything, run.source.encoding, run.source.is_static)
    found = survey.edges()
    native = None if found is None else RecordedEdges.of_survey(found)
    return native, RecordedEdges.of_store(everything)


def test_a_survey_without_a_store_finds_the_edges_of_one(tmp_path: Path) -> None:
    for seed in range(5):
        path, rng, now = tmp_path / f"run{seed}.mcap", random.Random(seed), 20 * S
        parents = {FRAMES[i]: FRAMES[rng.randrange(i)] for i in range(1, len(FRAMES))}
        with RecordingWriter(path) as writer:
            for _ in range(200):
                now += int(rng.random() * 0.05 * S)
                static = rng.random() < 0.1
                members = [member(rng, now) for _ in range(rng.choice([0, 1, 3]))]
                members = [replace(each, child=rng.choice(FRAMES[1:])) for each in members]
                members = [replace(each, parent=parents[each.child]) for each in members]
                data = tfdb.encode_tf_message(members, writer.encoding)
                topic = "/tf_static" if static else "/tf"
                writer.write(data, now, topic=topic, static=static)
        native, stored = surveys(path)
        assert native == stored
        assert len(stored.frames) == len(FRAMES)


def test_a_survey_leaves_several_parents_to_a_store(path: Path) -> None:
    native, stored = surveys(path)
    assert native is None
    assert max(len(each) for each in stored.parents.values()) > 1
