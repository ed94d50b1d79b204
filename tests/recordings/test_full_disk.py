"""On a full disk the error names the file, and existing files stay unchanged."""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from pathlib import Path

# Arguments: a folder, and `disk` (a small file system) or `limit` (a limit on file sizes).
PROGRAM = r"""
import errno, os, resource, sys
import numpy as np
import tfdb

folder, how = sys.argv[1:]
# The libraries are imported before the limit may hit a file of theirs.
import tfdb.recordings.recording_writer

def trajectory(count):
    poses = np.random.default_rng(3).normal(size=(count, 7))
    poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
    return tfdb.Trajectory("a", "b", np.arange(count) * 1000, poses)

def store(count):
    buffer = tfdb.Buffer(history=None)
    buffer.set_trajectory("map", "base", trajectory(count))
    return buffer

small, large = trajectory(20), trajectory(9000)
writers = {}
for name in ("tum", "csv", "euroc", "kitti", "npz"):
    end = "npz" if name == "npz" else "txt"
    writers[f"{name}.{end}"] = (
        lambda path, data, name=name: tfdb.trajectories.writing.write_trajectory(
            path, data, name, overwrite=True
        ),
        small, large)
for name in ("a.bag", "a.mcap", "a.db3"):
    writers[name] = (
        lambda path, data: tfdb.recordings.write_recording(path, data, overwrite=True),
        store(20), store(9000))

for name, (write, few, _) in writers.items():
    write(os.path.join(folder, name), few)
if how == "limit":
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
before = {name: open(os.path.join(folder, name), "rb").read() for name in os.listdir(folder)}
assert len(before) == len(writers) + 1, sorted(before)  # and the times of KITTI
expected = errno.ENOSPC if how == "disk" else (errno.EFBIG, errno.ENOSPC, errno.EIO)
for name, (write, _, many) in writers.items():
    for target in (name, "new-" + name):
        path = os.path.join(folder, target)
        try:
            write(path, many)
        except OSError as error:
            assert error.errno == expected or error.errno in np.atleast_1d(expected), error
            assert error.filename == path, error
        else:
            raise AssertionError(f"{target} fits")
        after = {n: open(os.path.join(folder, n), "rb").read() for n in os.listdir(folder)}
        assert after == before, (target, sorted(after))
        print(target)
"""


@pytest.mark.parametrize("how", ["disk", "limit"])
def test_a_full_disk(tmp_path: Path, how: str) -> None:
    folder = tmp_path / "disk"
    folder.mkdir()
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    mount = f"mount -t tmpfs -o size=320k none {folder}"
    namespace = ["unshare", "--user", "--map-root-user", "--mount", "sh", "-c"]
    if how == "disk" and subprocess.run([*namespace, mount], check=False).returncode:
        how = "limit"  # if the container cannot mount file systems
    run = f"{sys.executable} {program} {folder} {how}"
    command = [*namespace, f"{mount} && {run}"] if how == "disk" else ["sh", "-c", run]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.split()) == 16
