"""Types of the arguments: the used members of `tfdb.Trajectory` and `tfdb.Comparison`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt


class Drawable(Protocol):
    """A trajectory: T[target<-source] over time."""

    @property
    def target(self) -> str:
        """The frame that the poses are in."""

    @property
    def source(self) -> str:
        """The frame that moves."""

    @property
    def stamps(self) -> npt.NDArray[np.int64]:
        """Nanoseconds, (N,)."""

    @property
    def poses(self) -> npt.NDArray[np.float64]:
        """Rows x y z qx qy qz qw, (N, 7)."""


class Errors(Protocol):
    """Errors of one kind over time."""

    @property
    def stamps(self) -> npt.NDArray[np.int64]:
        """Nanoseconds, (N,)."""

    @property
    def values(self) -> npt.NDArray[np.float64]:
        """Metres or radians, (N,)."""

    @property
    def rmse(self) -> float:
        """Root of the mean square."""

    @property
    def max(self) -> float:
        """The greatest value."""


class Compared(Protocol):
    """A result of `tfdb.compare`."""

    def __len__(self) -> int:
        """Number of matched poses."""

    @property
    def reference(self) -> Drawable:
        """The matched poses of the reference."""

    @property
    def estimate(self) -> Drawable:
        """The matched poses of the estimate, aligned."""

    @property
    def alignment(self) -> Named:
        """The transform that aligned the estimate."""

    @property
    def has_stamps(self) -> bool:
        """Whether the poses have timestamps; otherwise their stamps are row numbers."""

    @property
    def align(self) -> str:
        """How the estimate was aligned."""

    @property
    def ape_translation(self) -> Errors:
        """Absolute errors in metres."""

    @property
    def ape_rotation(self) -> Errors:
        """Absolute errors in radians."""

    @property
    def rpe_translation(self) -> Errors:
        """Relative errors in metres."""

    @property
    def rpe_rotation(self) -> Errors:
        """Relative errors in radians."""


class Named(Protocol):
    """A transform between two frames."""

    @property
    def source(self) -> str:
        """The frame that is mapped."""
