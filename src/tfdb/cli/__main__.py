"""Run the ``tfdb`` command by ``python -m tfdb.cli``."""

from tfdb_command import main

main()
