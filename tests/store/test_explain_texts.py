"""The lines of `explain` after its first, which is the error or the transform."""

from __future__ import annotations

import pytest

import tfdb

S = 1_000_000_000
ODOM = "3 samples at 1 Hz from 0 s to 2 s"
WHOLE = "The whole path has data from 0 s (T[map<-odom]) to 2 s (T[map<-odom])."
COMMON = "The whole path has data from 2 s (T[odom<-base]) to 2 s (T[map<-odom])."
APART = "The edges of the path have no stamp in common: "


def small_store() -> tfdb.Buffer:
    """map <- odom at 0 to 2 s <- base at 2, 3 s <- cam. odom <- late at 7 s <- later at 9 s."""
    buffer = tfdb.Buffer(history=None)
    for parent, child, seconds in (
        *(("map", "odom", n) for n in (0, 1, 2)),
        *(("odom", "base", n) for n in (2, 3)),
        ("odom", "late", 7),
        ("late", "later", 9),
    ):
        buffer.set_transform(parent, child, seconds * S, (seconds, 0, 0), (0, 0, 0, 1))
    buffer.set_static_transform("base", "cam", (0, 0, 1))
    buffer.set_static_transform("x", "y", (0, 0, 1))
    return buffer


CASES: dict[str, tuple[tuple[str, str, float | None], tfdb.types.Policy | None, list[str]]] = {
    "all edges answer": (
        ("map", "cam", 2),
        None,
        [
            "  T[base<-cam]: static",
            "  T[odom<-base]: exact, sample at 2 s, age 0 s",
            "  T[map<-odom]: exact, sample at 2 s, age 0 s",
        ],
    ),
    "one frame": (("map", "map", None), None, ["  target and source are the same frame"]),
    "future of one edge": (
        ("map", "cam", 3),
        None,
        [
            "  ok   T[base<-cam]: static",
            "  ok   T[odom<-base]: exact, sample at 3 s, age 0 s",
            f"  FAIL T[map<-odom]: 3 s is after its last sample; {ODOM}",
            COMMON,
        ],
    ),
    "past of one edge, downward": (
        ("cam", "map", 1),
        None,
        [
            "  ok   T[base<-cam]: static",
            "  FAIL T[odom<-base]: 1 s is before its first sample; "
            "2 samples at 1 Hz from 2 s to 3 s",
            "  ok   T[map<-odom]: exact, sample at 1 s, age 0 s",
            COMMON,
        ],
    ),
    "the shared edges above both frames are left out": (
        ("base", "late", 2),
        None,
        [
            "  FAIL T[odom<-late]: 2 s is before its first sample; 1 sample from 7 s to 7 s",
            "  ok   T[odom<-base]: exact, sample at 2 s, age 0 s",
            APART + "T[odom<-base] ends at 3 s, before T[odom<-late] begins at 7 s.",
        ],
    ),
    "latest without a common stamp": (
        ("map", "later", None),
        None,
        [
            "  FAIL T[late<-later]: 2 s is before its first sample; 1 sample from 9 s to 9 s",
            "  FAIL T[odom<-late]: 2 s is before its first sample; 1 sample from 7 s to 7 s",
            "  ok   T[map<-odom]: exact, sample at 2 s, age 0 s",
            APART + "T[map<-odom] ends at 2 s, before T[late<-later] begins at 9 s.",
        ],
    ),
    "two trees": (
        ("map", "y", 2),
        None,
        [
            "  ok   T[x<-y]: static",
            "The frames are in two trees: an edge between 'map' and 'x' would join them.",
        ],
    ),
    "gap": (
        ("map", "odom", 1.5),
        tfdb.Interpolate(max_gap=0.5),
        [
            f"  FAIL T[map<-odom]: the gap around 1.5 s, from 1 s to 2 s, exceeds 0.5 s; {ODOM}",
            WHOLE,
        ],
    ),
    "stale": (
        ("odom", "map", 1.5),
        tfdb.Previous(max_age=0.25),
        [f"  FAIL T[map<-odom]: its sample at 1 s is older than 0.25 s at 1.5 s; {ODOM}", WHOLE],
    ),
    "nearest": (
        ("map", "odom", 1.5),
        tfdb.Nearest(tolerance=0.1),
        [f"  FAIL T[map<-odom]: no sample within 0.1 s of 1.5 s; {ODOM}", WHOLE],
    ),
    "exact": (
        ("map", "odom", 1.5),
        tfdb.Exact(),
        [f"  FAIL T[map<-odom]: no sample at 1.5 s; {ODOM}", WHOLE],
    ),
    "unknown frame without a near name": (
        ("map", "nope", None),
        None,
        ["The store has 8 frames: 'base', 'cam', 'late', 'later', 'map', 'odom', 'x', 'y'"],
    ),
    "unknown frame with a near name": (("map", "camm", None), None, []),
}


@pytest.mark.parametrize("name", CASES)
def test_each_line_of_an_explanation(name: str) -> None:
    (target, source, seconds), policy, lines = CASES[name]
    stamp = None if seconds is None else int(seconds * S)
    buffer = small_store()
    found = buffer.explain(target, source, stamp, policy)
    first, *rest = found.text.split("\n")
    assert rest == lines
    assert str(found) == found.text
    assert (found.target, found.source) == (target, source)
    assert [edge.text in line for edge, line in zip(found.edges, rest, strict=False)] == [
        True
    ] * len(found.edges)
    if found:
        assert first == repr(buffer.lookup_transform(target, source, stamp, policy))
        assert found.error is None
    else:
        assert first == str(found.error)
        with pytest.raises(type(found.error)):
            buffer.lookup_transform(target, source, stamp, policy)
    with buffer.snapshot() as snapshot:
        assert snapshot.explain(target, source, stamp, policy).text == found.text


def test_an_explanation_as_html_escapes_its_text() -> None:
    found = small_store().explain("map", "map")
    assert found._repr_html_().startswith("<pre>T[map&lt;-map] at all times")


def test_an_explanation_lists_at_most_eight_frames() -> None:
    buffer = tfdb.Buffer()
    assert buffer.explain("a", "b").text.endswith("\nThe store has no frames.")
    for n in range(8):
        buffer.set_static_transform("map", f"camera{n}", (1, 0, 0))
    assert buffer.explain("map", "zz").text.endswith(
        "The store has 9 frames: 'camera0', 'camera1', 'camera2', 'camera3', 'camera4', 'camera5', "
        "'camera6', 'camera7', ..."
    )


def test_an_explanation_names_the_clocks_of_a_path() -> None:
    buffer = small_store()
    buffer.set_transform("base", "recorded", 1_700_000_000 * S, (0, 0, 0))
    text = buffer.explain("base", "recorded", 2 * S).text
    assert "There are" not in text
    text = buffer.explain("map", "recorded", 2 * S).text
    assert (
        "There are stamps of 2 clocks, more than a year apart: odom, base from 0 s to 3 s" in text
    )
