"""``python -m tfdb.cli`` is the same as ``tfdb``."""

from . import main

main()
