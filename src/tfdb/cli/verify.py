"""``tfdb verify``: its program is part of a checkout and missing in a wheel."""

import click

from .checkout_only import find

TEXT = """Check whether a recorded history of a store is strictly serializable.

Example: tfdb verify history.jsonl --steps 20

It needs a source checkout that is installed as editable: pip install -e .
"""

command: click.Command = find("verify", "verify_command", TEXT)
