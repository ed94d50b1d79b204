"""``tfdb bench``: measured by programs that a checkout has and a wheel has not."""

import click

from .checkout_only import find

TEXT = """The paper's evaluation on this machine: engines and tf2, CSV and a report.

Example: tfdb bench --quick

It runs from a checkout that is installed as editable: a wheel has none of its programs.
"""

command: click.Command = find("bench", "command", TEXT)
