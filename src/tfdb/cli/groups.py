"""Commands and groups of commands, with suggestions for mistyped words."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import click

from tfdb.data.argument_checks import unknown_word
from tfdb.data.suggestions import near_names

from . import output

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

_NEGATIVE = re.compile(r"-\.?[0-9]")


class TitledOption(click.Option):
    """An option that the help lists under a title of its own."""

    def __init__(self, *args: Any, title: str, **more: Any) -> None:
        super().__init__(*args, **more)
        self.title = title


class SuggestingCommand(click.Command):
    """A command whose arguments may begin with a dash: frames and negative numbers.

    A word with a dash is an argument if an argument is missing and no option is similar. This does
    not hold for arguments that are files.
    """

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Put arguments that begin with a dash behind `--`.

        A word such as `-odd` is an option with its value; an error then also names `--`.
        """
        glued = [word for word in args[: (*args, "--").index("--")] if self._is_glued(word)]
        try:
            return super().parse_args(ctx, self._sorted(ctx, args))
        except click.NoSuchOption:
            raise
        except click.UsageError as error:
            if not glued or not any(map(_may_have_dash, self.params)):
                raise
            said = error.format_message().rstrip(".")
            raise click.UsageError(
                f"{said}; a name that begins with a dash, such as {glued[0]}, must come after --",
                ctx,
            ) from error

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the options; titled ones below their title."""
        sections: dict[str, list[tuple[str, str]]] = {"Options": []}
        for param in self.get_params(ctx):
            record = param.get_help_record(ctx)
            if record is not None and isinstance(param, click.Option):
                sections.setdefault(getattr(param, "title", "Options"), []).append(record)
        for title, records in sections.items():
            with formatter.section(title):
                formatter.write_dl(records)

    def _is_glued(self, word: str) -> bool:
        """Return whether a word is a short option joined with its value."""
        names = [
            name
            for option in self.params
            if isinstance(option, click.Option) and not (option.is_flag or option.count)
            for name in option.opts
        ]
        return not word.startswith("--") and len(word) > 2 and word[:2] in names

    def _sorted(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Sort the options before the arguments, if an argument begins with a dash.

        Raises NoSuchOption for a word that cannot be an argument.
        """
        options = {
            name: option
            for option in self.params
            if isinstance(option, click.Option)
            for name in (*option.opts, *option.secondary_opts)
        } | dict.fromkeys(("-h", "--help"))
        sorted_, words, dashed = [], [], False
        left = list(args)
        while left:
            word = left.pop(0)
            if word == "--":
                words += left
                break
            values = _values(word, options)
            if values is None:
                words.append(word)
                if word.startswith("-") and word != "-":
                    dashed = True
                    if not self._may_be_argument(word, len(words) - 1, options):
                        if ctx.resilient_parsing:
                            return args
                        raise click.NoSuchOption(word, ctx=ctx)
            else:
                sorted_ += [word, *left[:values]]
                del left[:values]
        return [*sorted_, "--", *words] if dashed else args

    def _may_be_argument(self, word: str, place: int, options: Iterable[str]) -> bool:
        """Return whether a word with a dash is an argument at this position."""
        arguments = [each for each in self.params if isinstance(each, click.Argument)]
        if place >= len(arguments) and (not arguments or arguments[-1].nargs >= 0):
            return False
        taken = arguments[min(place, len(arguments) - 1)]
        if not _may_have_dash(taken) or _NEGATIVE.match(word):
            return _may_have_dash(taken)
        is_name = taken.callback is None  # or it makes a time of the word
        return is_name and len(word) > 2 and not near_options(word, options)


def _may_have_dash(param: click.Parameter) -> bool:
    """Return whether an argument may begin with a dash: it is neither a file nor a choice."""
    return isinstance(param, click.Argument) and not isinstance(param.type, click.Path | OneOf)


def _values(word: str, options: dict[str, Any]) -> int | None:
    """Count the words after an option that belong to it; None if it is not an option."""
    name, equals, _ = word.partition("=")
    option = options.get(name)
    if name in options:
        return 0 if equals or option is None or option.is_flag or option.count else option.nargs
    if word.startswith("--") or not word.startswith("-") or word == "-":
        return None
    for place, letter in enumerate(word[1:], 2):
        if f"-{letter}" not in options:
            return None
        option = options[f"-{letter}"]
        if option is not None and not (option.is_flag or option.count):
            return 0 if place < len(word) else int(option.nargs)
    return 0


class SuggestingGroup(click.Group):
    """A command group that suggests the nearest command; without a command it prints its help."""

    words: tuple[str, ...] = ()
    """Words that are accepted in place of a command, such as `help`."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Print the help if the arguments are empty."""
        if not args and self.no_args_is_help and not ctx.resilient_parsing:
            output.say(ctx.get_help())
            ctx.exit()
        return super().parse_args(ctx, args)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the command that the first argument names."""
        hidden = {name for name, command in self.commands.items() if command.hidden}
        name, known = args[0], [each for each in self.list_commands(ctx) if each not in hidden]
        there = self.get_command(ctx, name) is not None
        if not there and not name.startswith("-") and not ctx.resilient_parsing:
            hint = suggest(name, known, self.words)
            raise click.UsageError(f"No such command {name!r}: {hint}", ctx)
        return super().resolve_command(ctx, args)


class OneOf(click.Choice[str]):
    """A choice of words; the error for any other word suggests the nearest."""

    def get_invalid_choice_message(self, value: Any, ctx: click.Context | None) -> str:  # noqa: ARG002
        """Return the error: the choices, and the nearest of them."""
        return unknown_word(str(value), self.choices)


def suggest(name: str, known: Sequence[str], words: Sequence[str]) -> str:
    """Suggest the commands that are similar, or have the word as a part; otherwise list all.

    `words` are suggested as well, but not listed.
    """
    near = [each for each in known if name.lower() in each.split("-")]
    near = near or near_names(name, [*known, *words], most=2, cutoff=0.6)
    if near:
        return f"did you mean {' or '.join(map(repr, near))}?"
    return f"the commands are {', '.join(known)}"


def near_options(word: str, options: Iterable[str]) -> list[str]:
    """Return the long options most similar to a mistyped one, the nearest first."""
    long = {name.lstrip("-"): name for name in options if name.startswith("--")}
    name = word.partition("=")[0].lstrip("-")
    begun = [each for each in long if len(name) > 1 and each.startswith(name)]
    near = begun or near_names(name, long, most=2, cutoff=0.7)
    return [long[each] for each in near]


def describe_unknown_option(error: click.NoSuchOption) -> str:
    """Return the error for an unknown option, with the nearest options."""
    command = None if error.ctx is None else error.ctx.command
    params = [] if command is None else command.params
    known = [name for each in params if isinstance(each, click.Option) for name in each.opts]
    near = near_options(error.option_name, [*known, "--help"])
    said = f"No such option {error.option_name!r}"
    if near:
        return f"{said}; did you mean {' or '.join(near)}?"
    if isinstance(command, SuggestingCommand) and any(map(_may_have_dash, params)):
        return f"{said}; a name that begins with a dash must come after --"
    return said
