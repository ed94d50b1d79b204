"""Rates and delays of recorded columns against those counted one by one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tfdb.judging.rates import Rates

if TYPE_CHECKING:
    import numpy.typing as npt

S = 10**9
NAMES = ["map", "odom", "/driver", "/filter", ""]


def one_by_one(
    rates: Rates,
    child: str,
    columns: list[npt.NDArray[np.int64]],
    static: npt.NDArray[np.bool_],
) -> None:
    for stamp, arrival, parent, publisher, fixed in zip(*columns, static, strict=True):
        edge = NAMES[parent], child
        rates.add(edge, int(stamp), int(arrival), NAMES[publisher], static=bool(fixed))


@pytest.mark.parametrize("offset", [0, 2 * 3600 * S], ids=["one clock", "another clock"])
@pytest.mark.parametrize("seed", range(5))
def test_columns_count_as_their_rows(seed: int, offset: int) -> None:
    rng = np.random.default_rng(seed)
    natively, expected = Rates(0, 1), Rates(0, 1)
    for child in ("base", "arm", "camera"):
        rows = int(rng.integers(1, 200))
        arrivals = 100 * S + np.sort(rng.integers(0, 60 * S, rows))
        late = np.where(rng.random(rows) < 0.1, 15 * S, 0)
        stamps = arrivals - rng.integers(-S, 2 * S, rows) - late - offset
        parents, publishers = rng.integers(0, 2, rows), rng.integers(2, 5, rows)
        static = np.full(rows, child == "camera")
        poses = np.zeros((rows, 7))
        columns = (stamps, arrivals, poses, parents, publishers)
        natively.add_columns(child, columns, static, NAMES)
        one_by_one(expected, child, [stamps, arrivals, parents, publishers], static)
    assert list(natively.of_frames()) == list(expected.of_frames())
    assert natively.of_authors() == expected.of_authors()
    assert [type(frame.parent) for _, frame, _ in natively.of_frames()] == [str] * 3


def test_sums_of_delays_do_not_overflow() -> None:
    rows = 3_000_000
    rates = Rates(0, 1)
    arrivals = np.full(rows, 4000 * S)
    columns = (arrivals - 3599 * S, arrivals, np.zeros((rows, 7)), *[np.zeros(rows, np.int64)] * 2)
    rates.add_columns("base", columns, np.zeros(rows, bool), NAMES)
    assert rates.frames["base"].periods[0].total == rows * 3599 * S > 2**63
