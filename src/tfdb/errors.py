"""All errors of tfdb; `TfdbError` is the root. The eight most used are also attributes of `tfdb`.

>>> import tfdb
>>> issubclass(tfdb.errors.GapTooLarge, tfdb.TfdbError)
True
"""

from __future__ import annotations

from .data import errors as _errors
from .data.errors import *  # noqa: F403 - all of them

__all__: list[str] = []
__all__ += _errors.__all__
