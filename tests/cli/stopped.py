"""Runs `tfdb` and ends it while it writes: `stopped.py HOW ARGUMENT...`.

Before a written file gets its name, the process gets the signal HOW. For HOW `pipe`, the reader of
stdout closes the pipe instead.
"""

from __future__ import annotations

import os
import sys
from typing import TYPE_CHECKING

import tfdb_command
from tfdb.data import new_file
from tfdb.recordings import packed_file

if TYPE_CHECKING:
    from pathlib import Path

how = sys.argv.pop(1)
_bring_to_disk = new_file.bring_to_disk
_unpack_file = packed_file.unpack_file


def stop() -> None:
    if how == "pipe":
        print("nobody reads this", flush=True)
    else:
        os.kill(os.getpid(), int(how))


def bring_to_disk(path: Path) -> None:
    assert path.exists()
    stop()
    _bring_to_disk(path)


def unpack_file(path: Path, into: Path, *, salvage: bool = False) -> int:
    lost = _unpack_file(path, into, salvage=salvage)
    assert into.exists()
    stop()
    return lost


new_file.bring_to_disk = bring_to_disk
packed_file.unpack_file = unpack_file
tfdb_command.main()
