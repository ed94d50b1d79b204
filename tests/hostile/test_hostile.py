"""The fuzzer of the public API, in a child process, so that a crash does not end the tests."""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from .public_api import everything

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.slow
@pytest.mark.parametrize(("calls", "more"), [(100_000, []), (60_000, ["--threads"])])
def test_only_typed_errors_and_a_store_that_stays(
    calls: int, more: list[str], tmp_path: Path
) -> None:
    note = tmp_path / "call"
    command = [sys.executable, "-m", "tests.hostile.fuzz", "--calls", str(calls), "--seed", "20"]
    done = subprocess.run(
        [*command, "--note", str(note), *more],
        capture_output=True,
        text=True,
        timeout=1_200,
        check=False,
    )
    last = note.read_bytes()[:200].decode().strip()
    assert done.returncode == 0, f"{last}\n{done.stdout[-2_000:]}\n{done.stderr[-8_000:]}"
    assert done.stderr == ""
    ends = dict(line.split() for line in done.stdout.splitlines()[1:])
    assert sum(map(int, ends.values())) == calls
    assert int(ends["result"]) > calls / 3
    assert len(ends) > 15  # kinds of errors


def test_the_whole_face_is_called() -> None:
    calls = {(call.owner, call.name) for call in everything()}
    wanted = {
        ("Buffer", "lookup_transform"),
        ("Buffer", "explain"),
        ("Buffer", "run"),
        ("Buffer", "ingest_many"),
        ("Buffer", "history"),
        ("Snapshot", "close"),
        ("Snapshot", "__exit__"),
        ("Transaction", "reparent"),
        ("Transform", "__matmul__"),
        ("Transform", "report"),
        (None, "Buffer"),
        (None, "Transform"),
        (None, "Columns"),
        (None, "encode_tf_message"),
        (None, "stamp"),
    }
    assert wanted <= calls
