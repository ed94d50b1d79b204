"""``tfdb verify``: judged by a program that a checkout has and a wheel has not."""

import click

from .checkout_only import find

TEXT = """Was a recorded history of a store strictly serializable? Anomalies by name.

Example: tfdb verify history.jsonl --steps 20

It runs from a checkout that is installed as editable: a wheel does not have the judge.
"""

command: click.Command = find("verify", "verify_command", TEXT)
