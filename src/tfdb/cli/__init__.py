"""The ``tfdb`` command.

Nothing here is part of the library's interface. Scripts call the command with ``--json``, whose
keys are stable (docs/howto/command_line.md), or use :class:`tfdb.Buffer`.
"""
