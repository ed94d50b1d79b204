"""``tfdb shm``: lists, inspects and removes shared stores."""

from __future__ import annotations

import stat
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import click

import tfdb
from tfdb.data.counting import counted
from tfdb.data.time_text import format_dates, format_duration, format_ns
from tfdb.store.shared import find_stores, path_of

from . import common, layout, output
from .graph import STORE, open_live
from .groups import SuggestingCommand, SuggestingGroup
from .times import NS

if TYPE_CHECKING:
    import os
    from collections.abc import Callable

    from click.decorators import FC

    from tfdb import Buffer

name_argument: Callable[[FC], FC] = click.argument("name")


@click.group("shm", cls=SuggestingGroup)
def command() -> None:
    """List, inspect and remove the shared stores of this machine.

    Example: tfdb shm ls

    The other commands read the contents of a store, as in 'tfdb tree shm:NAME'. 'tfdb shm ls
    --json' prints the list as JSON.
    """


@command.command("ls", cls=SuggestingCommand)
@layout.wide_option
@common.json_option
def list_stores(*, as_json: bool) -> None:
    """List all shared stores.

    Example: tfdb shm ls

    A store that this user or version cannot open is listed with its error.
    """
    found = [_look(name) for name in find_stores()]
    if as_json:
        output.emit_json("shm ls", {"stores": found})
        return
    if not found:
        output.say("no stores; tfdb.Buffer.open(NAME) or 'tfdb serve' makes one")
        return
    layout.console().print(layout.table(_COLUMNS, [_row(body) for body in found]))
    for body in found:
        if body["error"] is not None:
            layout.console().print(
                layout.prose(f"{body['name']}: {body['error']}"), style="bold red"
            )


_COLUMNS = (
    layout.Column("store"),
    layout.Column("frames", 1, right=True),
    layout.Column("commit", 4, right=True),
    layout.Column("memory", 3, right=True),
    layout.Column("processes", 2, right=True),
    layout.Column("history", 5, right=True),
)


def _look(name: str) -> dict[str, Any]:
    try:
        return {"name": name, "error": None, **_body(open_live(name))}
    except tfdb.TfdbError as error:
        return {"name": name, "error": output.describe_error(error)}


def _body(store: Buffer) -> dict[str, Any]:
    shared, memory = cast("tfdb.types.Shared", store.shared), store.memory()
    path = Path(shared.path)
    status = path.stat()
    return {
        "path": shared.path,
        "permissions": f"{stat.S_IMODE(status.st_mode):04o}",
        "user": status.st_uid,
        "group": status.st_gid,
        "commit": store.commit,
        "frames": len(store.frames()),
        "samples": memory.samples,
        "history_s": store.history,
        "size_bytes": shared.size,
        "memory_bytes": _memory_of(status),
        "used_bytes": memory.used_bytes,
        # 0: it may not be known. This command is one of them.
        "processes": shared.processes - 1 if shared.processes else None,
        "repairs": shared.repairs,
        "clock": _clock_body(store.clock),
    }


def _clock_body(clock: tfdb.Clock) -> dict[str, Any] | None:
    since = clock._set_since
    if since is None:
        return None
    passed = (time.monotonic_ns() - since) / NS
    shown = {"now_ns": clock.now(), "speed": clock.speed, "paused": clock.paused}
    return {**shown, "set_s_ago": round(passed, 3)}


def _clock_text(name: str, clock: dict[str, Any] | None) -> str:
    if clock is None:
        return "the system's"
    how = "paused at" if clock["paused"] else f"speed {clock['speed']:g}, at"
    ago = format_duration(round(clock["set_s_ago"] * NS))
    text = f"{how} {format_ns(clock['now_ns'])}, set {ago} ago"
    return f"{text}; 'tfdb shm reset-clock {name}' lets it follow the system's"


def _memory_of(status: os.stat_result) -> int:
    """Return the bytes that a store's file takes now; stat counts in blocks of 512."""
    return status.st_blocks * 512


def _row(body: dict[str, Any]) -> tuple[Any, ...]:
    if body["error"] is not None:
        return (body["name"], layout.loud("?"), "", "", "", "")
    return (
        body["name"],
        f"{body['frames']:,}",
        f"{body['commit']:,}",
        _mebi(body["memory_bytes"]),
        _known(body["processes"]),
        _history(body["history_s"]),
    )


@command.command("info", cls=SuggestingCommand)
@name_argument
@common.json_option
def describe(*, name: str, as_json: bool) -> None:
    """Show size, use, owner and clock of a store.

    Example: tfdb shm info robot1
    """
    store = open_live(name)
    body = {"name": name.removeprefix(STORE), **_body(store)}
    covered = store._span()
    body["start_ns"], body["end_ns"] = covered or (None, None)
    if as_json:
        output.emit_json("shm info", body)
        return
    out = layout.console()
    out.print(body["name"], style="bold")
    repairs = (
        "never" if not body["repairs"] else f"after {counted(body['repairs'], 'death')} of writers"
    )
    for what, text in (
        ("file", f"{body['path']}, {body['permissions']}, user {body['user']}"),
        ("commit", f"{body['commit']:,}"),
        ("frames", f"{body['frames']:,}"),
        ("samples", f"{body['samples']:,}"),
        ("history", _history(body["history_s"])),
        ("data", "none" if covered is None else " to ".join(map(format_ns, covered))),
        *([("dates", dates)] if covered and (dates := format_dates(*covered)) else []),
        ("memory", f"{_mebi(body['memory_bytes'])} of at most {_mebi(body['size_bytes'])}"),
        ("processes", f"{_known(body['processes'])} beside this one"),
        ("repaired", repairs),
        ("clock", _clock_text(body["name"], body["clock"])),
    ):
        out.print(layout.wrap([f"{what:<10}", *layout.words(text)], " " * 10))


@command.command("reset-clock", cls=SuggestingCommand)
@name_argument
@common.json_option
def reset_clock(*, name: str, as_json: bool) -> None:
    """Let a store's clock follow the system's.

    Example: tfdb shm reset-clock robot1

    'tfdb play' does so when it ends. Use this command if 'tfdb play' was killed.
    """
    given = name.removeprefix(STORE)
    with tfdb.Buffer.open(given, create=False) as store:
        before = _clock_body(store.clock)
        store.clock.follow_system()
    if as_json:
        output.emit_json("shm reset-clock", {"name": given, "before": before})
    else:
        output.say(f"the clock of {given} follows the system's")


@command.command("compact", cls=SuggestingCommand)
@name_argument
@common.json_option
def compact(*, name: str, as_json: bool) -> None:
    """Return unused memory of a store.

    Example: tfdb shm compact robot1
    """
    given = name.removeprefix(STORE)
    with tfdb.Buffer.open(given, create=False) as store:
        path = Path(cast("tfdb.types.Shared", store.shared).path)
        before = _memory_of(path.stat())
        done = store.compact()
        after = _memory_of(path.stat())
    if as_json:
        body = {"name": given, "done": done, "before_bytes": before, "after_bytes": after}
        output.emit_json("shm compact", body)
    elif done:
        output.say(f"{_mebi(before)} before, {_mebi(after)} now")
    else:
        output.say(
            "nothing returned: a snapshot, a transaction or a reader holds an older state; try "
            "again"
        )


@command.command("rm", cls=SuggestingCommand)
@click.argument("names", nargs=-1, required=True, metavar="NAME...")
@common.json_option
def remove(*, names: tuple[str, ...], as_json: bool) -> None:
    """Remove stores. Processes that have one open can still use it.

    Example: tfdb shm rm robot1
    """
    given = [name.removeprefix(STORE) for name in names]
    for name in given:  # all, or none where one is not there
        if not path_of(name).exists():
            tfdb.Buffer.unlink(name)
    for name in given:
        tfdb.Buffer.unlink(name)
    if as_json:
        output.emit_json("shm rm", {"removed": given})
    else:
        output.say(f"removed {', '.join(given)}")


def _history(seconds: float | None) -> str:
    return "everything" if seconds is None else format_duration(round(seconds * 1e9))


def _known(number: int | None) -> str:
    return "?" if number is None else f"{number:,}"


def _mebi(size: int) -> str:
    return f"{size / (1 << 20):,.1f} MiB"
