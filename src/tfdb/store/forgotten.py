"""Samples that a store with a limited history drops."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

from tfdb.data.counting import counted
from tfdb.data.errors import TfdbWarning

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from tfdb._core import Buffer


def warn_of_forgotten(buffer: Buffer, samples: int, depth: int) -> None:
    """Warn of samples that the history dropped, with a remedy; the caller is `depth` frames up."""
    are = "is" if samples == 1 else "are"
    message = (
        f"{counted(samples, 'sample')} {are} not kept: the store has a history of "
        f"{buffer.history:g} s. Buffer(history=None) keeps everything, as tfdb.load does"
    )
    warnings.warn(message, TfdbWarning, stacklevel=depth)


def missing_samples(buffer: Buffer, frame: str, stamps: npt.NDArray[np.int64]) -> int:
    """Count the stamps at which a moving edge has no sample."""
    if frame not in buffer.frames() or buffer.frame_info(frame).is_static:
        return 0
    import numpy as np

    return len(np.setdiff1d(stamps, buffer.samples(frame)[0]))
