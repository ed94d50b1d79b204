"""``tfdb completion``: prints the completion script of a shell."""

from __future__ import annotations

import click
from click.shell_completion import get_completion_class

from . import common, output
from .groups import OneOf, SuggestingCommand

WHERE = {
    "bash": "tfdb completion bash > ~/.local/share/bash-completion/completions/tfdb",
    "zsh": "tfdb completion zsh > ~/.zfunc/_tfdb   # with ~/.zfunc in $fpath",
    "fish": "tfdb completion fish > ~/.config/fish/completions/tfdb.fish",
}


@click.command("completion", cls=SuggestingCommand)
@click.argument("shell", type=OneOf(list(WHERE)))
@common.json_option
def command(*, shell: str, as_json: bool) -> None:
    """Print the script that completes tfdb's commands in a shell.

    Example: tfdb completion bash

    \b
    bash  tfdb completion bash > ~/.local/share/bash-completion/completions/tfdb
    zsh   tfdb completion zsh > ~/.zfunc/_tfdb   (with ~/.zfunc in $fpath)
    fish  tfdb completion fish > ~/.config/fish/completions/tfdb.fish
    """  # noqa: D301, click wants the character
    from .app import cli  # noqa: PLC0415, app imports this module on demand

    maker = get_completion_class(shell)
    if maker is None:
        raise click.ClickException(f"this version of click knows no completion for {shell}")
    script = maker(cli, {}, "tfdb", "_TFDB_COMPLETE").source()
    if as_json:
        output.emit_json("completion", {"shell": shell, "script": script, "save": WHERE[shell]})
    else:
        output.say(script)
