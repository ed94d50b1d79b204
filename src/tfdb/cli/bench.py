"""``tfdb bench``: its programs are part of a checkout and missing in a wheel."""

import click

from .checkout_only import find

TEXT = """Repeat the paper's evaluation of engines and tf2: CSV files and a report.

Example: tfdb bench --quick

It needs a source checkout that is installed as editable: pip install -e .
"""

command: click.Command = find("bench", "command", TEXT)
