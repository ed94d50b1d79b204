"""The ``tfdb`` command: look into recordings of transforms from a shell.

Nothing here is part of the library's interface: scripts should call the command with ``--json``,
whose keys are kept (docs/howto/command_line.md), or use :class:`tfdb.Buffer`.
"""
