"""Command options for each field of `Selection`."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING, Any

import click

from tfdb.recordings.selection import Selection, absolute, role_of

from .groups import OneOf, TitledOption
from .times import NS, duration_option, time_option

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from .times import TimeSpec

_GIVEN = "tfdb.selection"
_BOUNDS = "tfdb.bounds"
TITLE = "Select what is read"
_GROUPS = ("topics", "by_namespace", "mix")
_MANY = {"FROM[:TO]", "NAME", "FROM:=TO", "TOPIC[=CHILD]"}
"""The metavars of repeatable options."""


def selection_options(command: Any, *, without: Sequence[str] = ()) -> Any:
    """Add an option for each field of `Selection` to a command that reads recordings.

    `without`: fields for which the command has its own options.
    """
    for each in reversed(fields(Selection)):
        if each.name not in without:
            command = _option(each.name, **each.metadata)(command)
    return command


def groups_options(command: Any) -> Any:
    """Add only the options that choose among groups of topics to a command."""
    others = [each.name for each in fields(Selection) if each.name not in _GROUPS]
    return selection_options(command, without=others)


def _option(name: str, metavar: str, help: str) -> Any:  # noqa: A002 - the key of the metadata
    more: dict[str, Any] = {"metavar": metavar, "multiple": metavar in _MANY} if metavar else {}
    if metavar == "FILE":
        more["type"] = click.Path()
    elif "|" in metavar:
        more["type"] = OneOf(metavar.split("|"))
    return click.option(
        flag_of(name),
        f"selected_{name}",
        is_flag=None if metavar else True,
        expose_value=False,
        callback=_keeper(name, metavar),
        cls=TitledOption,
        title=TITLE,
        help=help,
        **more,
    )


def _keeper(name: str, metavar: str) -> Callable[[click.Context, click.Parameter, Any], None]:
    """Make the callback of a field's option, which keeps the value for `selected`."""
    read = _READERS.get(metavar, _as_it_is)

    def keep(ctx: click.Context, param: click.Parameter, value: Any) -> None:
        if value in (None, (), False) or ctx.resilient_parsing:
            return
        ctx.meta.setdefault(_GIVEN, {})[name] = read(ctx, param, value)

    return keep


def _as_it_is(_ctx: click.Context, _param: click.Parameter, value: Any) -> Any:
    return value


def _time(ctx: click.Context, param: click.Parameter, value: str) -> str:
    time = time_option(ctx, param, value)
    if time is None or time.ns is None:
        raise click.BadParameter("'latest' is valid for lookups only; give a time", ctx, param)
    ctx.meta.setdefault(_BOUNDS, {})[str(param.opts[0]).lstrip("-")] = time
    return time.text


def _seconds(ctx: click.Context, param: click.Parameter, value: str) -> float:
    return (duration_option(ctx, param, value) or 0) / NS


def _topics(ctx: click.Context, param: click.Parameter, value: tuple[str, ...]) -> dict[str, str]:
    pairs = {}
    for text in value:
        source, colon, target = text.partition(":")
        if not source or (colon and not target):
            raise click.BadParameter(f"{text!r} is not FROM or FROM:TO", ctx, param)
        pairs[absolute(source)] = role_of(source, target or source)
    return pairs


def _names(ctx: click.Context, param: click.Parameter, value: tuple[str, ...]) -> dict[str, str]:
    pairs: dict[str, str] = {}
    for text in value:
        old, colon, new = text.partition(":=")
        if not (old and colon and new):
            raise click.BadParameter(f"{text!r} is not FROM:=TO", ctx, param)
        if pairs.setdefault(old, new) != new:
            raise click.BadParameter(f"{old!r} has two new names", ctx, param)
    return pairs


def _poses(
    ctx: click.Context, param: click.Parameter, value: tuple[str, ...]
) -> dict[str, str | None]:
    topics: dict[str, str | None] = {}
    for text in value:
        topic, equals, child = text.partition("=")
        if not topic or (equals and not child):
            raise click.BadParameter(f"{text!r} is not TOPIC or TOPIC=CHILD", ctx, param)
        if topics.setdefault(topic, child or None) != (child or None):
            raise click.BadParameter(f"{topic!r} has two frames", ctx, param)
    return topics


def _file(_ctx: click.Context, _param: click.Parameter, value: str) -> str:
    from .common import find_paths  # noqa: PLC0415 - it uses this module

    find_paths([value])
    return value


_READERS: dict[str, Callable[[click.Context, click.Parameter, Any], Any]] = {
    "TIME": _time,
    "SECONDS": _seconds,
    "FROM[:TO]": _topics,
    "FROM:=TO": _names,
    "TOPIC[=CHILD]": _poses,
    "FILE": _file,
}
"""Converters of an option's text, by its metavar."""


def selected() -> Selection:
    """Return the selection of the command line."""
    return Selection(**given())


def given() -> dict[str, Any]:
    """Return the fields of the command line's selection; changes of them change the selection."""
    context = click.get_current_context(silent=True)
    found: dict[str, Any] = {} if context is None else context.meta.setdefault(_GIVEN, {})
    return found


def time_bounds() -> dict[str, TimeSpec]:
    """Return the times of `--start` and `--end`."""
    context = click.get_current_context(silent=True)
    found: dict[str, TimeSpec] = {} if context is None else context.meta.get(_BOUNDS, {})
    return found


def refuse_selection(names: Sequence[str], what: str, how: str) -> None:
    """Refuse other files and selections beside `names[0]`, which is `what`, given as `how`."""
    if len(names) > 1:
        raise click.UsageError(f"{what} cannot be combined with other files: give {how} alone")
    if flags := sorted(map(flag_of, given())):
        are = "is" if len(flags) == 1 else "are"
        raise click.UsageError(
            f"{names[0]} is {what}, read as a whole: {', '.join(flags)} {are} valid for recordings "
            "only"
        )


def flag_of(name: str) -> str:
    """Return the option of a field of `Selection`."""
    return "--" + name.removesuffix("s").replace("_", "-")
