"""tf2's exceptions: each is also an error of tfdb, with its fields.

The text is tf2's; `__cause__` is tfdb's error, whose text has more details.
"""

# ruff: noqa: N818  (tf2's names)

from __future__ import annotations

from tfdb.data.errors import (
    Disconnected,
    Extrapolation,
    InvalidArgument,
    TfdbError,
    UnknownFrame,
    WaitTimeout,
)
from tfdb.data.lazy_names import belong_to

__all__ = [
    "BackwardExtrapolationException",
    "ConnectivityException",
    "ExtrapolationException",
    "ForwardExtrapolationException",
    "InvalidArgumentException",
    "LookupException",
    "NoDataForExtrapolationException",
    "TimeoutException",
    "TransformException",
]


class TransformException(TfdbError):
    """Root of tf2's exceptions. Its fields are those of `tfdb.TfdbError`."""


class ConnectivityException(TransformException, Disconnected):
    """Both frames exist, but no path joins them. Fields: target, source, frames (the roots)."""


class LookupException(TransformException, UnknownFrame):
    """No frame has that name. Fields: frame, target, source."""


class ExtrapolationException(TransformException, Extrapolation):
    """An edge has no data at the stamp. Fields: reason, edge, stamp, oldest, newest."""


class BackwardExtrapolationException(ExtrapolationException):
    """The stamp is older than the edge's data."""


class ForwardExtrapolationException(ExtrapolationException):
    """The stamp is newer than the edge's data."""


class NoDataForExtrapolationException(ExtrapolationException):
    """The edge has no sample, or only one with another stamp."""


class InvalidArgumentException(TransformException, InvalidArgument):
    """An argument that tf2 refuses, such as an empty name, or one that starts with a slash."""


class TimeoutException(TransformException, WaitTimeout):
    """The timeout passed without the transform."""


def with_fields_of(
    error: TfdbError, kind: type[TransformException], text: str, **fields: object
) -> TransformException:
    """Make an exception of tf2 from tfdb's error; `fields` override the error's fields."""
    known = TfdbError.__annotations__
    kept = {name: value for name, value in vars(error).items() if name in known}
    return kind(text, **{**kept, **fields})


belong_to("tfdb.tf2", globals(), __all__)
