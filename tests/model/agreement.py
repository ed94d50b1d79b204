"""Whether the store says what the model says: values to 1e-9, errors by class and by field."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, TypeVar

import numpy as np
import numpy.typing as npt
import pytest

import tfdb

from .naive import Answer, Model, Refused

if TYPE_CHECKING:
    from collections.abc import Callable

T = TypeVar("T")


def close(found: npt.ArrayLike, expected: npt.ArrayLike, tolerance: float) -> None:
    """Poses (7,) or (N, 7) are the same motion; far away, relative to the distance."""
    a, b = np.atleast_2d(np.asarray(found, float)), np.atleast_2d(np.asarray(expected, float))
    assert a.shape == b.shape
    assert (np.isnan(a).any(axis=1) == np.isnan(b).any(axis=1)).all()
    scale = np.maximum(1.0, np.abs(b[:, :3]).max(axis=1, initial=0.0, keepdims=True))
    sign = np.where(np.sum(a[:, 3:] * b[:, 3:], axis=1, keepdims=True) < 0, -1.0, 1.0)
    np.testing.assert_allclose(a[:, :3] / scale, b[:, :3] / scale, rtol=0, atol=tolerance)
    np.testing.assert_allclose(a[:, 3:], sign * b[:, 3:], rtol=0, atol=tolerance)


def outcome(ask: Callable[[], T]) -> T | Refused:
    """What the model answers, or how it refuses."""
    try:
        return ask()
    except Refused as refused:
        return refused


def refuses(refused: Refused, ask: Callable[[], object]) -> tfdb.TfdbError:
    """Check that the store refuses likewise, with the right class and fields."""
    with pytest.raises(tfdb.TfdbError) as caught:
        ask()
    error = caught.value
    assert type(error) is refused.kind, (error, refused)
    for name, value in refused.fields.items():
        assert getattr(error, name) == value, (name, error, refused)
    return error


def same_report(found: tfdb.Transform, expected: Answer) -> None:
    """Stamp, pose, and per edge which samples were used."""
    assert found.stamp == expected.stamp
    close(found.pose, expected.pose, 1e-9)
    used = [(e.child, e.parent, e.used, e.before, e.after, e.inverted) for e in found.report.edges]
    assert used == [
        (e.child, e.parent, e.used, e.before, e.after, e.inverted) for e in expected.edges
    ]


def same_frames(reads: tfdb.Reads, model: Model, state: int) -> None:
    """Frames, their samples, and what is told of them."""
    names = model.frame_names(state)
    assert reads.frames() == names
    assert [info.name for info in reads.tree()] == names
    for name in names:
        frame = model.find(name, state)
        assert frame is not None
        expected = model.visible(frame, state)
        stamps, poses, parents = reads.samples(name)
        assert stamps.tolist() == [0 if s.static else s.stamp for s in expected]
        assert parents == [model.parent_name(s, state) or "" for s in expected]
        if expected:
            np.testing.assert_allclose(poses, [s.pose for s in expected], rtol=0, atol=1e-15)
        same_info(reads.frame_info(name), model, frame, state)


def same_info(info: tfdb.FrameInfo, model: Model, frame: int, state: int) -> None:
    """What is told of one frame."""
    samples = model.visible(frame, state)
    moving = [s.stamp for s in samples if not s.static]
    assert info.is_static == bool(samples and samples[-1].static)
    assert info.samples == len(samples)
    assert info.parent == (model.parent_name(samples[-1], state) if samples else None)
    assert (info.oldest, info.newest) == ((moving[0], moving[-1]) if moving else (None, None))
    gaps = [later - earlier for earlier, later in pairwise(moving)]
    assert info.longest_gap == max(gaps, default=0)
    if gaps:
        assert info.rate == pytest.approx(len(gaps) * 1e9 / sum(gaps))
    else:
        assert info.rate is None
