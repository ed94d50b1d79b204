"""``tfdb view``: serves a page that shows a store, live or at any stamp."""

from __future__ import annotations

import asyncio
import errno
import signal
import sys
import threading
import webbrowser
from typing import TYPE_CHECKING, Any, cast

import click

import tfdb
from tfdb.data.errors import NotSupported
from tfdb.judging.arrivals import Arrivals
from tfdb.judging.proposing import judge_recording
from tfdb.recordings.arrivals import ArrivalReader
from tfdb.recordings.recording import Recording
from tfdb.store.frozen import is_frozen

from . import common, output
from .expect import expect_option
from .graph import STORE, is_graph, live_source, node_option
from .groups import SuggestingCommand
from .selecting import given, refuse_selection, selection_options
from .times import NS

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

    from tfdb import Buffer
    from tfdb.judging.expectations import Expectations
    from tfdb.recordings.arrivals import RecordedArrivals
    from tfdb.view.model import Model

    from .graph import Live

_PORT = 8470
_FOXGLOVE_PORT = 8765
"""The port that Foxglove and Lichtblick try by default."""
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_KEPT = 60 * NS
"""History that is kept of a graph."""


@click.command("view", cls=SuggestingCommand)
@common.file_argument
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    help=f"Port of the page; 0: any free one.  [default: {_PORT}]",
)
@click.option(
    "--host",
    default="127.0.0.1",
    metavar="ADDRESS",
    help="Address to listen on. On other addresses than loopback, browsers need the token in the "
    "printed URL.",
)
@click.option(
    "--allow-host",
    "names",
    multiple=True,
    metavar="NAME",
    help="Accept browsers that reach the page by this host name; repeatable.",
)
@click.option("--no-open", is_flag=True, help="Print the address without opening a browser.")
@click.option(
    "--foxglove",
    is_flag=True,
    help="Serve data to the viewers Foxglove and Lichtblick instead of the page. The port is then "
    "8765 unless --port is given.",
)
@expect_option
@node_option
@selection_options
@common.json_option
def command(
    *,
    file: str,
    port: int | None,
    host: str,
    names: tuple[str, ...],
    no_open: bool,
    foxglove: bool,
    expect: str | None,
    as_json: bool,
) -> None:
    """Show the frame tree and the frames in 3D in a browser, live or at any time.

    Example: tfdb view shm:robot

    FILE is a shared store (shm:NAME), a live graph (ros1:, ros2:), a recording or a frozen store.
    The page follows live data, and shows any past stamp that the store still keeps. It highlights
    edges whose newest sample is several periods old. With --expect it highlights edges that break
    an expectation. With --urdf it draws the boxes, cylinders, spheres and STL meshes of the robot's
    links. The command serves the page until Ctrl-C.
    """
    host = "127.0.0.1" if host == "localhost" else host

    def told(address: str) -> None:
        if as_json:
            output.emit_json("view", {"files": [file], "address": address})
        else:
            output.say(f"{address} shows {file}; Ctrl-C ends it")
        sys.stdout.flush()

    if foxglove:
        chosen = {"--urdf": given().get("urdf"), "--expect": expect, "--allow-host": names}
        _refuse_page_options(file, [name for name, value in chosen.items() if value])
        _serve_foxglove(file, host, _FOXGLOVE_PORT if port is None else port, told)
        return
    port = _PORT if port is None else port
    try:
        from tfdb.view.server import Server  # noqa: PLC0415 - an extra
        from tfdb.view.shapes import read_shapes  # noqa: PLC0415 - numpy
    except ImportError as error:
        raise NotSupported(
            f"tfdb view needs websockets: pip install 'tfdb[view]' ({error})", reason="websockets"
        ) from error
    expected = None if expect is None else tfdb.Expectations.read(expect)
    urdf = _urdf(file)
    shapes = None if urdf is None else read_shapes(urdf)

    def ready(address: str) -> None:
        told(address)
        if not no_open:
            # A text browser runs until its user quits; the page must be served meanwhile.
            threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()

    def serve(model: Model) -> None:
        server = Server(model, host=host, port=port, names=names, shapes=shapes)
        try:
            _run(lambda: server.run(ready))
        except OSError as error:
            raise _no_port(host, port, error) from error

    if not common.is_live(file):
        serve(_recording(file, expected))
        return
    refuse_selection((file,), "live", "it")
    with live_source(file, history=_KEPT) as live:
        serve(_live(file, live, expected))


def _urdf(file: str) -> str | None:
    """Return the file of --urdf; if FILE has no joint states, remove it from the selection."""
    chosen = given()
    urdf: str | None = chosen.get("urdf")
    if urdf is None or "joint_topic" in chosen:
        return urdf
    if common.is_live(file) or not _has_joint_states(file):
        del chosen["urdf"]
    return urdf


def _has_joint_states(file: str) -> bool:
    (path,) = common.find_paths((file,))
    if is_frozen(path):
        return False
    with Recording(path, salvage=given().get("salvage", False)) as recording:
        return any(source.holds_joint_states for source in recording.all_sources)


def _refuse_page_options(file: str, names: list[str]) -> None:
    """Refuse options and files that --foxglove does not support."""
    if names:
        raise click.UsageError(f"{', '.join(names)} cannot be used with --foxglove")
    if not common.is_live(file):
        raise click.UsageError(
            f"--foxglove serves live stores and graphs, and {file} is a file; to write one for "
            f"Foxglove: tfdb convert {file} OUT.mcap --foxglove"
        )
    refuse_selection((file,), "live", "it")


def _serve_foxglove(file: str, host: str, port: int, ready: Callable[[str], None]) -> None:
    try:
        from tfdb.view.foxglove_server import serve_foxglove  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise NotSupported(
            f"tfdb view --foxglove needs foxglove-sdk: pip install 'tfdb[foxglove]' ({error})",
            reason="foxglove-sdk",
        ) from error
    with live_source(file, history=_KEPT) as live:
        try:
            serve_foxglove(live.store, file, host=host, port=port, ready=ready)
        except OSError as error:
            raise _no_port(host, port, error) from error


def _run(serve: Callable[[], Coroutine[Any, Any, None]]) -> None:
    """Run until a signal. Its handler runs after the loop: within a task it would be printed."""
    handlers = {number: signal.getsignal(number) for number in _SIGNALS}
    came: list[int] = []

    def take(number: int, _: object) -> None:
        came.append(number)

    async def main() -> None:
        task = asyncio.create_task(serve())

        def end(number: int) -> None:
            came.append(number)
            task.cancel()

        for number in heard:
            asyncio.get_running_loop().add_signal_handler(number, end, number)
        if came:
            task.cancel()
        await task

    heard = [number for number, handler in handlers.items() if callable(handler)]
    try:
        for number in heard:  # an exception would leave a loop that is half made
            signal.signal(number, take)
        asyncio.run(main())
    except asyncio.CancelledError:
        if not came:
            raise
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
    for first in came[:1]:
        handler = handlers[signal.Signals(first)]
        if callable(handler):
            handler(first, None)


def _no_port(host: str, port: int, error: OSError) -> click.ClickException:
    if error.errno == errno.EADDRINUSE:
        why = f"port {port} of {host} is in use: give another --port, or 0 for any free one"
    else:
        why = f"cannot listen on port {port} of {host}: {error.strerror or error}"
    return click.ClickException(why)


def _live(file: str, live: Live, expected: Expectations | None) -> Model:
    from tfdb.view.model import Model  # noqa: PLC0415 - as the server

    opening = ""
    if not is_graph(file):
        name = file.removeprefix(STORE)
        opening = f'buf = tfdb.Buffer.open({name!r}, create=False, mode="r")'
    return Model(live.store, file, live=live, opening=opening, expected=expected)


def _recording(file: str, expected: Expectations | None) -> Model:
    from tfdb.view.model import Model  # noqa: PLC0415 - as the server

    (path,) = common.find_paths((file,))
    if is_frozen(path):
        if expected is not None:
            common.refuse_frozen([path], lacks="arrival times")
        refuse_selection((file,), "a frozen store", "FILE.tfdb")
        return Model(tfdb.open(path), file, opening=f"buf = tfdb.open({file!r})")
    opening = "" if given() else f"buf = tfdb.load({file!r})"
    if expected is None:
        store = common.load((file,), apart=True).store
        return Model(cast("Buffer", store), file, opening=opening)
    reader = ArrivalReader()
    store = common.load((file,), apart=True, arrivals=reader).store
    events = judge_recording(Arrivals.of(cast("RecordedArrivals", reader.found)), expected)
    return Model(cast("Buffer", store), file, opening=opening, expected=expected, events=events)
