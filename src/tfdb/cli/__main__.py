"""``python -m tfdb.cli`` is the same as ``tfdb``."""

from tfdb_command import main

main()
