"""The ``tfdb`` command: look into recordings of transforms from a shell.

Nothing here is part of the library's interface: scripts should call the command with ``--json``,
whose keys are kept (docs/howto/command_line.md), or use :class:`tfdb.Buffer`.
"""

from __future__ import annotations


def main() -> None:
    """Run the command line; the process ends with 0 (fine), 1 (findings) or 2 (an error)."""
    from .app import cli  # noqa: PLC0415, so that `import tfdb.cli` stays light

    cli.main(prog_name="tfdb")
