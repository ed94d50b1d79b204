"""Times as text, relative to the first or last stamp, in every range argument."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import tfdb

SECOND = 10**9
START = 1_700_000_000 * SECOND


@pytest.fixture
def store() -> tfdb.Buffer:
    """Ten seconds of `base`; `arm` moves from the second second to the eighth."""
    made = tfdb.Buffer(history=None)
    for frame, first, last in (("base", 0, 10), ("arm", 2, 8)):
        stamps = START + np.arange(first * 2, last * 2 + 1) * SECOND // 2
        poses = np.tile([1.0, 2, 3, 0, 0, 0.6, 0.8], (len(stamps), 1))
        poses[:, 0] = (stamps - START) / SECOND
        made.set_transforms(tfdb.Columns("map", frame, stamps, poses))
    return made


@pytest.mark.parametrize(
    ("given", "seconds"),
    [
        ({"start": "+3", "end": "+4.5"}, (3, 4.5)),
        ({"start": "-4", "end": "-3"}, (6, 7)),
        ({"start": " +3.5 "}, (3.5, 10)),
        ({"end": "-9.5"}, (0, 0.5)),
        ({"start": "1700000003", "end": f"{START + 4 * SECOND}ns"}, (3, 4)),
        ({"start": START + 3 * SECOND, "end": "+4"}, (3, 4)),
        ({"start": np.datetime64(START + 3 * SECOND, "ns")}, (3, 10)),
        ({"start": "+3s", "end": "-500000000ns"}, (3, 9.5)),
        ({"start": "2023-11-14T22:13:23Z", "end": "2023-11-14T23:13:24.5+01:00"}, (3, 4.5)),
        ({"start": "2023-11-14 22:13:23.000 UTC", "end": "2023-11-14T22:13:24"}, (3, 4)),
    ],
)
def test_ranges_take_offsets_and_text(
    store: tfdb.Buffer, given: Any, seconds: tuple[float, float]
) -> None:
    expected = [START + round(each * SECOND) for each in seconds]
    whole = store.trajectory("map", "base")
    found = [
        store.trajectory("map", "base", **given),
        store.trajectory("map", "base", 2, **given),
        store.snapshot().trajectory("map", "base", **given),
        whole.crop(**given),
    ]
    for each in found:
        assert [int(each.stamps[0]), int(each.stamps[-1])] == expected
        np.testing.assert_allclose(each.translations[:, 0], (each.stamps - START) / SECOND)


def test_offsets_count_from_all_that_moves_in_the_store(store: tfdb.Buffer) -> None:
    path = store.trajectory("map", "arm", start="+3", end="-3")
    assert [int(each - START) // SECOND for each in path.stamps[[0, -1]]] == [3, 7]
    cropped = store.trajectory("map", "arm").crop("+3", "-3")  # from the trajectory's own first
    assert [int(each - START) // SECOND for each in cropped.stamps] == [5]


def test_crop_reaches_before_the_first_stamp() -> None:
    path = tfdb.Trajectory("map", "base", [5, 10], [[0.0, 0, 0, 0, 0, 0, 1]] * 2)
    assert path.crop("-100").stamps.tolist() == [5, 10]
    assert path.crop("+0.000000001").stamps.tolist() == [10]


@pytest.mark.parametrize(
    "text", ["", "+", "soon", "+-1", "--1", "1e400", "+1 s", "++1", "+1_0", "latest", "2023-02-30"]
)
def test_invalid_texts_are_refused(store: tfdb.Buffer, text: str) -> None:
    path = store.trajectory("map", "base")
    for call in (
        lambda: store.trajectory("map", "base", start=text),
        lambda: store.trajectory("map", "base", end=text),
        lambda: path.crop(text),
        lambda: path.crop(end=text),
    ):
        with pytest.raises(tfdb.InvalidArgument, match=r"^(start|end): .*\+1\.5"):
            call()


def test_ranges_that_are_none(store: tfdb.Buffer) -> None:
    with pytest.raises(tfdb.InvalidArgument, match="is before start"):
        store.trajectory("map", "base", start="+4", end="+3")
    with pytest.raises(tfdb.InvalidArgument, match="is before start"):
        store.trajectory("map", "base").crop("+4", "+3")
    early = tfdb.Buffer(history=None)
    early.set_transform("map", "base", 5 * SECOND, (1, 2, 3))
    with pytest.raises(tfdb.InvalidStamp, match=r"'-6' lies before time 0.*5 s"):
        early.trajectory("map", "base", start="-6")
    still = tfdb.Buffer()
    still.set_static_transform("map", "base", (1, 2, 3))
    with pytest.raises(tfdb.InvalidArgument, match="no moving transform"):
        still.trajectory("map", "base", 10, "+1", "+2")
    with pytest.raises(tfdb.InvalidArgument, match="no moving transform"):
        tfdb.Trajectory("map", "base", [], np.zeros((0, 7))).crop("+1")
