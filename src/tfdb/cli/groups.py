"""Groups of commands: one that is mistyped is told the nearest."""

from __future__ import annotations

import click

from tfdb.near_names import near_names

from . import output


class SuggestingGroup(click.Group):
    """A group that says which command may have been meant; alone it says what there is."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Print the help where nothing is asked for."""
        if not args and self.no_args_is_help and not ctx.resilient_parsing:
            output.say(ctx.get_help())
            ctx.exit()
        return super().parse_args(ctx, args)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command that the first argument names."""
        name, known = args[0], self.list_commands(ctx)
        if name not in known and not name.startswith("-") and not ctx.resilient_parsing:
            raise click.UsageError(f"No such command {name!r}: {suggest(name, known)}", ctx)
        return super().resolve_command(ctx, args)


def suggest(name: str, known: list[str]) -> str:
    """Name what is near, by its letters or as a part of a name; else all that there is."""
    near = [each for each in known if name.lower() in each.split("-")]
    near = near or near_names(name, known, most=2, cutoff=0.6)
    if near:
        return f"did you mean {' or '.join(map(repr, near))}?"
    return f"there are {', '.join(known)}"
