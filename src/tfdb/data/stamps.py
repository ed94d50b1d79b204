"""Stamps: integer nanoseconds, and other objects that are stamps."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from decimal import ROUND_HALF_EVEN, Context, Decimal, InvalidOperation
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, overload

from tfdb._core import to_nanoseconds

from .errors import InvalidArray, InvalidStamp

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    import numpy as np
    import numpy.typing as npt

__all__ = ["StampLike", "StampsLike", "format_seconds", "stamp"]

MAX_STAMP = 2**61 - 1


class SecNanosec(Protocol):
    """A ROS 2 time message."""

    @property
    def sec(self) -> int:
        """Whole seconds."""

    @property
    def nanosec(self) -> int:
        """Nanoseconds below one second."""


class SecsNsecs(Protocol):
    """A ROS 1 time."""

    @property
    def secs(self) -> int:
        """Whole seconds."""

    @property
    def nsecs(self) -> int:
        """Nanoseconds below one second."""


class ToNsec(Protocol):
    """Anything with `to_nsec()`."""

    def to_nsec(self) -> int:
        """Nanoseconds."""


class Nanoseconds(Protocol):
    """An `rclpy.time.Time`."""

    @property
    def nanoseconds(self) -> int:
        """Nanoseconds."""


class SupportsArray(Protocol):
    """An array of any library, or a column of a table: a Series of pandas or polars."""

    def __array__(self) -> npt.NDArray[Any]:
        """Return it as an array of numpy."""


RosTime: TypeAlias = SecNanosec | SecsNsecs | ToNsec | Nanoseconds
"""A time of ROS, of any library."""

StampLike: TypeAlias = "int | np.integer[Any] | np.datetime64 | datetime | RosTime"
"""Accepted by every parameter that is a stamp; integers are nanoseconds."""

StampsLike: TypeAlias = (
    "npt.NDArray[np.integer[Any] | np.datetime64] | SupportsArray | Iterable[StampLike]"
)
"""Accepted by every parameter that is an array of stamps."""

# A stamp has at most 19 digits; the others are below a nanosecond and rounded off.
_CONTEXT = Context(prec=60, rounding=ROUND_HALF_EVEN)
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?", re.ASCII)
"""A decimal number."""
DATE = re.compile(r"\d{4}-", re.ASCII)
"""Matches the beginning of a date."""
_FRACTION = re.compile(r"(.*:\d\d)[.,](\d+)(.*)", re.DOTALL | re.ASCII)


@overload
def stamp(seconds: float | str | Decimal | StampLike) -> int: ...  # type: ignore[overload-overlap]
@overload
def stamp(
    seconds: SupportsArray | Sequence[float | str | Decimal | StampLike],
) -> npt.NDArray[np.int64]: ...
def stamp(seconds: Any) -> Any:
    """Convert a time in seconds to nanoseconds; no other call converts a float to a stamp.

    Parameters
    ----------
    seconds
        A number of seconds >= 0. A str (`"12.5"`) or a Decimal is exact to the nanosecond. A float
        means the decimal number that Python prints for it, so `stamp(0.1)` is 100_000_000; floats
        of the present date are accurate to about 100 ns. Also an ISO 8601 date with a time zone
        (`"2026-05-17T12:00:00.25Z"`), or an object that is a stamp, such as a `datetime` with a
        time zone. Also an array, list or Series of these.

    Returns
    -------
    int or numpy.ndarray
        Nanoseconds, rounded to the nearest; for an array, int64 of the same shape.

    Raises
    ------
    InvalidStamp
        Negative, not a number, infinite, or above 2**61 - 1 ns (the year 2043); a date without a
        time zone. With `index` for an array.
    """
    if isinstance(seconds, list | tuple):
        return _each(_stamp, seconds)
    if getattr(seconds, "shape", ()) == ():
        return _stamp(seconds)
    array = _as_array(seconds)
    flat = as_nanoseconds if array.dtype.kind == "M" else partial(_each, _stamp)
    return flat(array.ravel()).reshape(array.shape)


def _stamp(seconds: Any) -> int:
    """Convert one time."""
    if not isinstance(seconds, str | int | float | Decimal):
        import numpy as np

        if isinstance(seconds, np.ndarray):
            seconds = seconds[()]  # an array without dimensions
        if isinstance(seconds, np.bool_):
            seconds = bool(seconds)
        if not isinstance(seconds, str | int | float | Decimal | np.number):
            return to_nanoseconds(seconds)
    if isinstance(seconds, bool):
        raise InvalidStamp(f"seconds must be a number, got {seconds!r}", value=seconds)
    if isinstance(seconds, str) and not NUMBER.fullmatch(seconds.strip()):
        return _date(seconds)
    try:
        value = Decimal(str(seconds).strip())
    except (InvalidOperation, ValueError):  # an integer of thousands of digits has no str
        message = f"{shown(seconds)} is not a number of seconds"
        raise InvalidStamp(message, value=seconds) from None
    if not value.is_finite() or value < 0 or value.adjusted() > 10:
        raise _no_stamp(seconds)
    nanoseconds = _rounded(value)
    if nanoseconds > MAX_STAMP:
        raise _no_stamp(seconds)
    return nanoseconds


def _rounded(seconds: Decimal) -> int:
    return int(seconds.scaleb(9, _CONTEXT).to_integral_value(ROUND_HALF_EVEN))


def _no_stamp(seconds: object) -> InvalidStamp:
    limit = format_seconds(MAX_STAMP)
    return InvalidStamp(f"{shown(seconds)} s is not a stamp: valid are 0 to {limit}", value=seconds)


def _each(convert: Callable[[Any], int], items: Iterable[Any]) -> npt.NDArray[np.int64]:
    """Convert one by one; an error gets the position as `index`."""
    import numpy as np

    made = []
    for index, item in enumerate(items):
        try:
            made.append(convert(item))
        except InvalidStamp as error:
            error.index = index
            raise
    return np.array(made, dtype=np.int64)


def _date(text: str) -> int:
    """Convert an ISO 8601 date to nanoseconds; all digits of its seconds count."""
    match = _FRACTION.fullmatch(text.strip())
    whole, digits, zone = match.groups() if match else (text.strip(), "", "")
    try:
        date = datetime.fromisoformat((whole + zone).upper()) if DATE.match(whole) else None
    except ValueError:
        date = None
    if date is None:
        message = f"{text!r} is not a number of seconds, nor a date such as 2026-05-17T12:00:00Z"
        raise InvalidStamp(message, value=text)
    if date.utcoffset() is None:
        raise InvalidStamp(
            f"{text!r} has no time zone, so it is not a point in time: "
            "end it with Z (UTC) or +02:00",
            value=text,
        )
    nanoseconds = _since_epoch(date) + _rounded(Decimal(f"0.{digits or 0}"))
    if not 0 <= nanoseconds <= MAX_STAMP:
        raise _no_stamp(text)
    return nanoseconds


def from_datetime(time: datetime) -> int:
    """Convert a datetime with a time zone to nanoseconds. The extension calls it.

    Raises InvalidStamp.
    """
    if hasattr(time, "to_datetime64"):  # of pandas, where a missing time zone means UTC
        return to_nanoseconds(time.to_datetime64())
    if time.utcoffset() is None:
        raise InvalidStamp(
            f"stamp {time!r} has no time zone, so it is not a point in time: give it one with "
            ".replace(tzinfo=timezone.utc), or .astimezone() if it is local time",
            value=time,
            reason="a datetime without a time zone",
        )
    nanoseconds = _since_epoch(time)
    if not 0 <= nanoseconds <= MAX_STAMP:
        raise InvalidStamp(
            f"stamp {time!r} is out of range: valid are 1970-01-01 to 2043-01-25",
            value=time,
            reason="out of range",
        )
    return nanoseconds


def _since_epoch(time: datetime) -> int:
    passed = time - _EPOCH
    return ((passed.days * 86_400 + passed.seconds) * 1_000_000 + passed.microseconds) * 1_000


def _as_array(values: Any) -> npt.NDArray[Any]:
    """Convert any array or Series to numpy; times with a zone are converted to UTC."""
    import numpy as np

    dtype: Any = getattr(values, "dtype", None)
    if hasattr(dtype, "tz"):  # pandas would return an array of objects
        return np.asarray(values, f"datetime64[{dtype.unit}]")
    array = np.asarray(values)
    if array.dtype.kind == "f" and getattr(dtype, "kind", "f") in "iu":
        return np.asarray(values, object)  # integers with missing values
    return array


def as_nanoseconds(values: Any) -> npt.NDArray[np.int64]:
    """Convert an array that is not int64 to stamps (N,). The extension calls it.

    Raises InvalidArray, and InvalidStamp with `index`.
    """
    import numpy as np

    if np.ma.is_masked(values):
        reason = "some of them are masked: give values[~values.mask]"
        raise InvalidArray(f"stamps: {reason}", reason=reason)
    array = _as_array(values)
    kind = array.dtype.kind
    if array.shape == (0,):
        return np.empty(0, np.int64)
    if array.ndim != 1 or kind not in "iuMO":
        wanted = "an array (N,) of integer nanoseconds, times or objects that hold stamps"
        hint = "; tfdb.stamp() converts seconds and text" if kind in "fUST" else ""
        got = f"the shape {array.shape}" if array.ndim else "a single one: write [stamp]"
        got = got if kind in "iuMO" else f"{array.dtype}"
        reason = f"expected {wanted}, got {got}{hint}"
        raise InvalidArray(f"stamps: {reason}", reason=reason)
    if kind == "O":
        return _each(to_nanoseconds, array)
    if kind == "M":
        # numpy wraps around silently if a date exceeds 64 bits of nanoseconds.
        fine = array.astype("datetime64[ns]")
        made, wrong = fine.view(np.int64), fine.astype(array.dtype) != array
        wrong |= np.isnat(fine)
    else:
        made = array.astype(np.int64)
        wrong = made != array
    if wrong.any():
        _each(to_nanoseconds, array)  # raises at the first of them
    return made


def increasing_stamps(stamps: Any) -> npt.NDArray[np.int64]:
    """Copy stamps (N,), which must increase; raises InvalidArray, InvalidStamp."""
    import numpy as np

    try:
        given = stamps if hasattr(stamps, "shape") else list(stamps)
        made = np.array(as_nanoseconds(given))
    except (TypeError, ValueError) as error:
        if isinstance(error, InvalidArray | InvalidStamp):
            raise
        reason = f"expected an array (N,) of integer nanoseconds, got {shown(stamps)}"
        raise InvalidArray(f"stamps: {reason}", reason=reason) from None
    wrong = np.flatnonzero((made < 0) | (made > MAX_STAMP))
    if len(wrong):
        index, value = int(wrong[0]), int(made[wrong[0]])
        message = f"stamps[{index}] = {value} is not a stamp: valid are 0 to {MAX_STAMP} ns"
        raise InvalidStamp(message, value=value, index=index)
    check_increasing(made)
    return made


def check_increasing(stamps: npt.NDArray[np.int64]) -> None:
    """Raise InvalidArray, with `index`, unless each stamp is greater than the previous one."""
    import numpy as np

    falling = np.flatnonzero(np.diff(stamps) <= 0)
    if len(falling):
        index = int(falling[0]) + 1
        raise InvalidArray(
            f"stamps must increase, but stamps[{index}] = {stamps[index]} follows "
            f"{stamps[index - 1]}: sort the rows first, and keep one of each stamp",
            index=index,
            stamp=int(stamps[index]),
        )


def format_seconds(nanoseconds: int) -> str:
    """Write nanoseconds as seconds, exactly: `12.5 s`."""
    sign = "-" if nanoseconds < 0 else ""
    whole, fraction = divmod(abs(nanoseconds), 1_000_000_000)
    digits = f"{fraction:09d}".rstrip("0")
    return f"{sign}{whole}{'.' if digits else ''}{digits} s"


def shown(value: object) -> str:
    """Return an argument as text for a message; Python cannot print integers of 5,000 digits."""
    if isinstance(value, int) and value.bit_length() > 1000:
        return f"an integer of {value.bit_length()} bits"
    text = repr(value)
    return text if len(text) <= 80 else f"{text[:77]}..."
