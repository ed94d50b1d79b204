"""``tfdb bench``: its programs are part of a checkout and missing in a wheel."""

import click

from .checkout_only import find

TEXT = """Benchmark engines and tf2 as in 'Transactional TF': CSV files and a report.

Example: tfdb bench --quick

It needs a source checkout that is installed as editable: pip install -e .
"""

command: click.Command = find("bench", "command", TEXT)
