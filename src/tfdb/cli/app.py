"""The command group: its commands, and the handling of errors."""

from __future__ import annotations

import contextlib
import importlib
import signal
import sys
import warnings
from typing import TYPE_CHECKING, Any, NoReturn

import click

import tfdb

from . import checkout_only, output
from .graph import without_ros_arguments
from .groups import SuggestingGroup

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

# name -> one line of help; a command's module is imported when the command is used.
COMMANDS = {
    "info": "Show what a recording holds: topics, frames, edges with rates, gaps, duration.",
    "tree": "Show the frame tree with rates, gaps and publishers, now or at a given time.",
    "lookup": "Look up one transform T[TARGET<-SOURCE], and show how it was computed.",
    "echo": "Print one transform repeatedly, with its age, like tf2_echo.",
    "monitor": "Show the rate, delay, gaps and publisher of each frame, live or recorded.",
    "view": "Show the frame tree and the frames in 3D in a browser, live or at any time.",
    "view-frames": "Draw the frame tree as PDF, SVG or DOT, like tf2's view_frames.",
    "plot": "Draw the frame tree, the samples over time, trajectories or a comparison.",
    "compare": "Measure the error of a trajectory: APE (ATE) and RPE, equal to evo's.",
    "poses": "Write many poses of SOURCE in TARGET to a .tum, .csv, .npz or Parquet file.",
    "check": "Find faults of a recording: gaps, late data, double publishers, time jumps.",
    "expect": "Propose expectations from a good recording: deadlines, ages, steps.",
    "watch": "Print an event when live data breaks an expectation or meets it again.",
    "gaps": "List the gaps of each edge: start, length, publishers before and after.",
    "shm": "List, inspect and remove the shared stores of this machine.",
    "record": "Record each commit of a live store or graph into an .mcap, until Ctrl-C.",
    "play": "Play recordings into a shared store, with pause, step, seek and reverse.",
    "publish": "Publish a shared store or a file for other machines, until Ctrl-C.",
    "mirror": "Follow the store of another machine into a shared store, until Ctrl-C.",
    "net": "Show the homes and mirrors of a network, their lag, gaps and traffic.",
    "serve": "Fill a shared store from a live graph, or from a file that grows.",
    "bridge": "Carry transforms between a shared store and a live graph, both ways.",
    "static-publisher": "Publish static transforms from arguments, a URDF or a recording.",
    "change-notifier": "Report and publish when one frame has moved relative to another.",
    "buffer-server": "Answer the lookups of other nodes, like tf2's buffer_server.",
    "freeze": "Write a recording into a .tfdb file, which opens in constant time.",
    "convert": "Rewrite the transforms of a recording as .bag, .mcap, .db3 or a trajectory.",
    "merge": "Merge several recordings into one, sorted by time.",
    "rename": "Copy a recording with new names for its frames.",
    "bench": "Benchmark engines and tf2 as in 'Transactional TF': CSV files and a report.",
    "verify": "Check whether a recorded history of a store is strictly serializable.",
    "completion": "Print the script that completes tfdb's commands in a shell.",
}


class _ClosedPipe(Exception):  # noqa: N818 - it is not an error of the command
    """The reader of the output has closed it."""

    def __init__(self, error: BrokenPipeError) -> None:
        super().__init__()
        self.error = error


@contextlib.contextmanager
def _pipe_apart() -> Iterator[None]:
    """Hide a closed pipe from click and rich: they would exit with 1, which means findings."""
    try:
        yield
    except BrokenPipeError as error:
        raise _ClosedPipe(error) from None
    except SystemExit as ending:
        if isinstance(ending.__context__, BrokenPipeError):
            raise _ClosedPipe(ending.__context__) from None
        raise


class TfdbGroup(SuggestingGroup):
    """A group that imports commands lazily and prints every error in one line."""

    words: tuple[str, ...] = ("help", "version")

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        """List the commands in the order of the help, without those that are not installed."""
        installed = checkout_only.installed()
        return [each for each in COMMANDS if installed or each not in checkout_only.COMMANDS]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """Import the command's module and return its command."""
        if cmd_name not in COMMANDS:
            return None
        if cmd_name in checkout_only.COMMANDS:
            return checkout_only.find(cmd_name, COMMANDS[cmd_name])
        module = importlib.import_module(f"tfdb.cli.{cmd_name.replace('-', '_')}")
        command: click.Command = module.command
        return command

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Remove arguments for ROS, and convert `help` and `version` to their options."""
        if args[:1] == ["help"]:
            if "--json" in args:
                raise click.UsageError("help has no --json", ctx)
            args = [*(word for word in args if word != "help"), "--help"]
        elif args[:1] == ["version"] and "--json" in args:
            output.emit_json("version", {"version": tfdb.__version__})
            ctx.exit()
        elif args[:1] == ["version"]:
            args = ["--version", *args[1:]]
        return super().parse_args(ctx, without_ros_arguments(ctx, args))

    def make_context(self, *args: Any, **extra: Any) -> click.Context:
        """Parse the arguments."""
        with _pipe_apart():
            return super().make_context(*args, **extra)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command."""
        with _pipe_apart():
            return super().invoke(ctx)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, COMMANDS[name]) for name in self.list_commands(ctx)])

    def main(
        self,
        args: Sequence[str] | None = None,
        prog_name: str | None = None,
        complete_var: str | None = None,
        standalone_mode: bool = True,
        windows_expand_args: bool = True,
        **extra: Any,
    ) -> Any:
        """Run. With `standalone_mode`, exit with 0, 1, 2, or 128 plus the number of a signal."""
        given = list(sys.argv[1:] if args is None else args)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("always", tfdb.TfdbWarning)
                warnings.showwarning = _show_warning
                result = super().main(
                    given,
                    prog_name,
                    complete_var,
                    standalone_mode=False,
                    windows_expand_args=windows_expand_args,
                    **extra,
                )
        except _ClosedPipe as closed:
            raise closed.error from None
        except _ENDS as error:
            if not standalone_mode:
                raise
            _leave(error, given)
        if standalone_mode:
            sys.exit(result if isinstance(result, int) else 0)
        return result


_ENDS = (tfdb.TfdbError, OSError, click.ClickException, click.Abort, KeyboardInterrupt)


def _leave(error: BaseException, given: Sequence[str]) -> NoReturn:
    """Print the error that ended the command, and exit."""
    number = _signal_of(error)
    if number is not None or not isinstance(error, Exception):
        # A terminal that was closed takes no more.
        with contextlib.suppress(OSError):
            output.say("tfdb: stopped", err=True)
        sys.exit(128 + (number or signal.SIGINT))
    command = _command_of(given)
    if "--json" in given:
        # The error may be that the output takes no more.
        with contextlib.suppress(OSError):
            output.emit_json_line(command, output.error_body(error, command))
    output.say(f"tfdb: error: {output.describe_error(error, command)}", err=True)
    sys.exit(2)


def _signal_of(error: BaseException) -> int | None:
    """Return the signal that ended the command, even if an error followed; None without one."""
    for cause in (error, error.__cause__, error.__context__):
        if isinstance(cause, KeyboardInterrupt):
            return int(getattr(cause, "number", signal.SIGINT))
    return signal.SIGINT if isinstance(error, click.Abort) else None


def _command_of(given: Sequence[str]) -> str | None:
    """Return the name of the command in the arguments; for a subcommand, the group's name first."""
    at = next((i for i, word in enumerate(given) if word in COMMANDS), None)
    if at is None:
        return None
    command, part = cli.get_command(click.Context(cli), given[at]), given[at + 1 : at + 2]
    if isinstance(command, click.Group) and part and part[0] in command.commands:
        return f"{given[at]} {part[0]}"
    return given[at]


def _show_warning(
    message: Warning | str, category: type[Warning], *where: Any, **more: Any
) -> None:
    """Print a TfdbWarning in one line, and other warnings as Python does."""
    if issubclass(category, tfdb.TfdbWarning):
        output.warn(" ".join(str(message).split()))
    else:
        _show_other_warning(message, category, *where, **more)


_show_other_warning = warnings.showwarning


def _print_version(ctx: click.Context, _param: click.Parameter, value: bool) -> None:
    if value and not ctx.resilient_parsing:
        output.say(f"tfdb {tfdb.__version__}")
        ctx.exit()


@click.group(
    cls=TfdbGroup,
    invoke_without_command=True,
    context_settings={
        "help_option_names": ["-h", "--help"],
        "max_content_width": 100,
        "show_default": True,
    },
)
@click.option(
    "--version",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_print_version,
    help="Print the version and stop.",
)
@click.pass_context
def cli(ctx: click.Context) -> None:
    """Inspect, check, convert and share robot transforms, recorded or live.

    A FILE is one of these:

    \b
      drive.bag, drive.mcap, a folder of .db3   a recording of ROS 1 or ROS 2
      path.tum, .csv, .npz ...                  a trajectory
      drive.tfdb                                a frozen store, written by 'tfdb freeze'
      shm:NAME                                  a shared store of this machine
      ros1: or ros1:http://host:port            a live graph (running nodes) of ROS 1
      ros2: or ros2:7                           a live graph of ROS 2, in domain 7
      ros2+zenoh: or ros2+zenoh:7               the same over Zenoh; works without ROS
      ros2+dds: or ros2+dds:7                   the same over DDS; works without ROS

    An edge joins a frame to its parent. A static edge never moves; a moving edge has samples over
    time.

    Most commands that take a FILE read all of these. merge, rename and play read recordings and
    trajectories only. convert also reads .tfdb files, to write a trajectory or a viewer's file.
    monitor reads all but .tfdb files. watch reads live stores and graphs only.

    --json prints the result of a command as JSON. --help ignores --json.

    Exit codes: 0 is success, 2 an error (one line on stderr). 'check', 'watch', 'record', 'publish'
    and 'mirror' also return 1; their help explains when.
    """  # noqa: D301, click wants the character
    if ctx.invoked_subcommand is None:
        output.say(ctx.get_help())
