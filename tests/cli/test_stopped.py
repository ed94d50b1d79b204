"""Signals and a closed pipe end every command cleanly, without temporary files."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from contextlib import closing, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import pytest

import tfdb
from tfdb.cli.app import COMMANDS, cli
from tfdb.data import new_file

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

STOPPED = Path(__file__).with_name("stopped.py")
SIGNALS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]
LONGEST = 120.0  # seconds until a hanging command is killed
TURN = (0.0, 0.6, 0.0, 0.8)

WRITES = {
    "compare": "compare POSES POSES --save OUT.png",
    "convert to .bag": "convert IN OUT.bag",
    "convert to .db3": "convert IN OUT.db3",
    "convert to .mcap": "convert IN OUT.mcap",
    "convert to .mcap for Foxglove": "convert IN OUT.mcap --foxglove",
    "convert to .tum": "convert IN OUT.tum --frames odom base_footprint",
    "convert to .npz": "convert IN OUT.npz --frames odom base_footprint",
    "expect": "expect IN -o OUT.toml",
    "freeze": "freeze IN -o OUT.tfdb",
    "merge": "merge IN SECOND -o OUT.mcap",
    "plot": "plot IN tree --save OUT.png",
    "poses": "poses IN odom base_footprint -o OUT.csv",
    "rename": "rename IN --prefix a_ -o OUT.mcap",
    "view-frames": "view-frames IN -o OUT.svg",
}
READS = {"info of a packed file": "info PACKED"}


@pytest.fixture(autouse=True)
def _children_end_on_sighup() -> Iterator[None]:
    """Under `nohup` this process and its children ignore SIGHUP."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


def environment(folder: Path) -> dict[str, str]:
    return {**os.environ, "TMPDIR": str(folder), "MPLCONFIGDIR": str(folder.parent / "matplotlib")}


def end_amid(
    how: str, command: str, folder: Path, bag: Path, stdout: int = subprocess.PIPE
) -> subprocess.CompletedProcess[str]:
    """Run a command and end it before its written file gets its name."""
    given, made = folder.parent / "given", folder / "made"
    words = {"IN": str(bag), "POSES": str(given / "poses.tum"), "PACKED": str(given / "bag.zst")}
    words["SECOND"] = str(given / "second.bag")
    arguments = [words.get(word, word.replace("OUT", str(made))) for word in command.split()]
    return subprocess.run(
        [sys.executable, str(STOPPED), how, *arguments],
        stdout=stdout,
        stderr=subprocess.PIPE,
        text=True,
        check=False,
        timeout=LONGEST,
        env=environment(folder),
    )


@pytest.fixture(scope="session")
def second(bag: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording whose frames differ from those of `bag`."""
    made = tmp_path_factory.mktemp("second") / "second.bag"
    with subprocess.Popen(
        [sys.executable, "-m", "tfdb.cli", "rename", str(bag), "--prefix", "b_", "-o", str(made)]
    ) as renaming:
        assert renaming.wait(LONGEST) == 0
    return made


@pytest.fixture
def folder(tmp_path: Path, bag: Path, second: Path) -> Path:
    """An empty folder for output and temporary files; the inputs are beside it."""
    made, given = tmp_path / "made", tmp_path / "given"
    made.mkdir()
    given.mkdir()
    rows = (f"{stamp} {stamp * 0.5} {stamp**2 * 0.1} 1 0 0 0.6 0.8\n" for stamp in range(30))
    (given / "poses.tum").write_text("".join(rows))
    (given / "second.bag").symlink_to(second)
    zstandard = pytest.importorskip("zstandard")
    (given / "bag.zst").write_bytes(zstandard.compress(bag.read_bytes()))
    return made


def test_the_table_has_every_command_that_writes_a_file() -> None:
    def options(command: click.Command) -> Iterator[str | None]:
        for part in command.commands.values() if isinstance(command, click.Group) else ():
            yield from options(part)
        yield from (option.name for option in command.params)

    context = click.Context(cli)
    commands = {name: cli.get_command(context, name) for name in COMMANDS}
    writing = {name for name, it in commands.items() if it and "overwrite" in options(it)}
    assert writing == {row.split()[0] for row in WRITES}


@pytest.mark.parametrize(
    ("row", "number"),
    [*((row, signal.SIGTERM) for row in WRITES | READS), *(("freeze", each) for each in SIGNALS)],
)
def test_a_signal_leaves_no_file(row: str, number: signal.Signals, folder: Path, bag: Path) -> None:
    done = end_amid(str(int(number)), (WRITES | READS)[row], folder, bag)
    assert done.returncode == 128 + number, done.stderr
    assert done.stderr.endswith("tfdb: stopped\n")
    assert "Traceback" not in done.stderr
    assert not list(folder.iterdir())


@pytest.mark.parametrize("row", ["convert to .db3", "freeze", "plot"])
def test_a_closed_pipe_leaves_no_file(row: str, folder: Path, bag: Path) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    done = end_amid("pipe", (WRITES | READS)[row], folder, bag, stdout=writer)
    os.close(writer)
    assert (done.returncode, done.stderr) == (-signal.SIGPIPE, "")
    assert not list(folder.iterdir())


def test_a_signal_that_is_ignored_stays_so(folder: Path, bag: Path) -> None:
    """`nohup` relies on it."""
    program = "import signal, sys; signal.signal(signal.SIGHUP, signal.SIG_IGN); "
    program += "import runpy; sys.argv.pop(0); runpy.run_path(sys.argv[0], run_name='__main__')"
    arguments = [str(STOPPED), str(int(signal.SIGHUP)), "freeze", str(bag), "-o"]
    subprocess.run(
        [sys.executable, "-c", program, *arguments, str(folder / "made.tfdb")],
        check=True,
        timeout=LONGEST,
        env=environment(folder),
    )
    assert [made.name for made in folder.iterdir()] == ["made.tfdb"]


class Interrupts:
    """Raises KeyboardInterrupt at chosen lines of `new_file`, counted from the first one."""

    def __init__(self, lines: set[int]) -> None:
        self.count = 0
        self.left = set(lines)

    def __call__(self, frame: Any, event: str, _argument: object) -> Any:
        if frame.f_code.co_filename != new_file.__file__:
            return None
        if event == "line":
            self.count += 1
            if self.count in self.left:
                self.left.remove(self.count)
                raise KeyboardInterrupt
            # Python removes a trace function that raises: later lines are not traced.
        return self


def interrupted(lines: set[int], write: Callable[[], None]) -> bool:
    """Return whether a write was interrupted at the given lines."""
    before, interrupts = sys.gettrace(), Interrupts(lines)
    sys.settrace(interrupts)
    try:
        write()
    except KeyboardInterrupt:
        return True
    finally:
        sys.settrace(before)
    return False


def test_a_new_file_is_whole_or_not_there_wherever_it_is_interrupted(tmp_path: Path) -> None:
    target = tmp_path / "made.txt"

    def write() -> None:
        with new_file.new_file(target, overwrite=True) as made:
            made.write_text("whole")

    line = 0
    while interrupted({line := line + 1}, write):
        left = list(tmp_path.iterdir())
        assert left in ([], [target]), line
        if left:
            assert target.read_text() == "whole"
            target.unlink()
    assert line > 20
    assert target.read_text() == "whole"


def test_a_second_signal_amid_the_removal_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C is pressed twice."""
    removals = 0
    rmtree = new_file.shutil.rmtree

    def interrupted_once(path: Path, **options: Any) -> None:
        nonlocal removals
        removals += 1
        if removals == 1:
            raise KeyboardInterrupt
        rmtree(path, **options)

    monkeypatch.setattr(new_file.shutil, "rmtree", interrupted_once)

    def write() -> None:
        with new_file.new_file(tmp_path / "made.txt") as made:
            made.write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write()
    assert removals == 2
    assert not list(tmp_path.iterdir())


def opened(name: str, server: subprocess.Popen[str]) -> tfdb.Buffer:
    while True:
        with suppress(tfdb.errors.NoSuchStore):
            return tfdb.Buffer.open(name, create=False, mode="r")
        assert server.poll() is None


def summary(arguments: list[str], name: str, number: signal.Signals) -> dict[str, Any]:
    """Return the output of a command that a signal ends after some commits."""
    command = [sys.executable, "-m", "tfdb.cli", *arguments, "--into", name, "--json"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as server:
        try:
            with closing(opened(name, server)) as buffer:
                buffer.wait_for_commit(50, LONGEST)
            server.send_signal(number)
            out, err = server.communicate(timeout=LONGEST)
        finally:
            server.kill()
    assert server.returncode == 128 + number
    assert err.endswith("tfdb: stopped\n")
    told: dict[str, Any] = json.loads(out)
    assert told["store"] == name
    return told


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_ends_play_with_its_summary(number: signal.Signals, bag: Path, name: str) -> None:
    told = summary(["play", str(bag), "--loop", "--speed", "20"], name, number)
    assert told["messages"] > 0
    assert told["transforms"] > 50


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_ends_serve_follow_with_its_summary(
    number: signal.Signals, mcap: Path, name: str, tmp_path: Path
) -> None:
    growing = tmp_path / "growing.mcap"
    whole = mcap.read_bytes()
    growing.write_bytes(whole[:-50])  # without its footer
    told = summary(["serve", "follow", str(growing)], name, number)
    assert told["messages"] > 0
    assert told["transforms"] > 50


def run_importing(folder: Path, program: str) -> subprocess.CompletedProcess[str]:
    """Run a program that imports modules of a folder."""
    return subprocess.run(
        [sys.executable, "-c", program],
        env=os.environ | {"PYTHONPATH": str(folder)},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


@pytest.mark.parametrize("own_handler", [False, True])
def test_a_signal_in_an_import_is_handled_after_it(tmp_path: Path, own_handler: bool) -> None:
    """By the handler that the command has then."""
    (tmp_path / "imported.py").write_text(f"""
import os, signal
os.kill(os.getpid(), signal.SIGINT)
heard = []
if {own_handler}:
    signal.signal(signal.SIGINT, lambda *_: heard.append("heard"))
print("whole")
""")
    program = """
import signal, tfdb_command
signal.signal(signal.SIGINT, tfdb_command._stop)
try:
    import imported
    while not imported.heard:
        pass
    print(*imported.heard)
except tfdb_command.Stopped as stopped:
    print(stopped)
"""
    done = run_importing(tmp_path, program)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == ("whole\nheard\n" if own_handler else "whole\nended by SIGINT\n")


def test_a_command_may_end_before_a_signal_in_its_import_is_handled(tmp_path: Path) -> None:
    """Python removes its handlers at the end; an alarm must not kill the process then."""
    (tmp_path / "imported.py").write_text("import os; os.kill(os.getpid(), 15)")
    program = """
import signal, tfdb_command
class Last:
    def __del__(self, left=signal.getitimer, alarm=signal.ITIMER_REAL):
        while left(alarm)[0]:
            pass
last = Last()
def run():
    signal.signal(signal.SIGTERM, tfdb_command._stop)
    import imported
tfdb_command._run = run
tfdb_command.main()
assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
"""
    done = run_importing(tmp_path, program)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_at_the_start_of_record_ends_it_with_a_whole_file(
    number: signal.Signals, name: str, tmp_path: Path
) -> None:
    program = f"""
import os, tfdb_command
from tfdb.recorder import mcap_file
take = mcap_file.McapFile._begin
def begin(file):
    os.kill(os.getpid(), {int(number)})
    take(file)
mcap_file.McapFile._begin = begin
tfdb_command.main()
"""
    with tfdb.Buffer.open(name) as store:
        store.set_transform("map", "base", 1, (1, 2, 3), TURN)
        done = subprocess.run(
            [sys.executable, "-c", program, "record", name, "-o", str(tmp_path / "drive.mcap")],
            capture_output=True,
            text=True,
            timeout=LONGEST,
            check=False,
        )
    assert (done.returncode, done.stderr) == (0, "")
    assert [each.name for each in tmp_path.iterdir()] == ["drive.mcap"]
    assert tfdb.load(tmp_path / "drive.mcap").frames() == ["base", "map"]


@pytest.mark.parametrize(
    "command",
    [
        ["record", "{name}", "-o", "{folder}/drive.mcap"],
        ["echo", "shm:{name}", "map", "base", "-r", "20"],
        ["monitor", "shm:{name}"],
        ["change-notifier", "shm:{name}", "--pair", "map", "base"],
        ["view", "shm:{name}", "--no-open", "--port", "0"],
    ],
    ids=lambda command: str(command[0]),
)
@pytest.mark.parametrize("writes", [False, True], ids=["at rest", "with a writer"])
def test_the_removal_of_a_store_ends_a_command(
    command: list[str], writes: bool, name: str, tmp_path: Path
) -> None:
    arguments = [each.format(name=name, folder=tmp_path) for each in command]
    ended = threading.Event()

    def write(store: tfdb.Buffer) -> None:
        while not ended.wait(0.0005):
            store.set_transform("map", "base", store.clock.now(), (store.commit, 2, 3), TURN)

    with tfdb.Buffer.open(name) as store:
        store.set_transform("map", "base", store.clock.now(), (1, 2, 3), TURN)
        writer = threading.Thread(target=write, args=(store,))
        if writes:
            writer.start()
        try:
            with subprocess.Popen(
                [sys.executable, "-m", "tfdb.cli", *arguments],
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
            ) as process:
                assert process.stdout is not None
                assert process.stdout.readline()
                tfdb.Buffer.unlink(name)
                try:
                    error = process.communicate(timeout=LONGEST)[1]
                finally:
                    process.kill()
        finally:
            ended.set()
            if writes:
                writer.join()
    assert process.returncode == 2
    assert f"the store '{name}' was removed" in error
