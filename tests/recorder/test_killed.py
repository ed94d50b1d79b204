"""A recorder that is killed at any moment: each flushed commit is read from what it left."""

from __future__ import annotations

import os
import random
import subprocess
import sys
import time
from pathlib import Path

import pytest

import tfdb

from .reading import messages_of

KILLS = int(os.environ.get("TFDB_KILLS", "10"))
ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("seed", range(KILLS))
def test_each_flushed_commit_outlives_a_kill(tmp_path: Path, seed: int) -> None:
    rng = random.Random(seed)
    path = tmp_path / "drive.mcap"
    arguments = [sys.executable, "-m", "tests.recorder.recording_child", path, str(seed)]
    with subprocess.Popen(arguments, stdout=subprocess.PIPE, cwd=ROOT) as child:
        assert child.stdout is not None
        flushed = [child.stdout.readline()]
        time.sleep(rng.random() * 0.2)  # the moment of the kill
        child.kill()
        flushed += child.stdout.read().splitlines()
    last = int([each for each in flushed if each.strip()][-1])
    assert last > 0
    part = tmp_path / "drive.mcap.part"
    assert not path.exists()
    found = messages_of(part, "/tf")
    commits = [each.sequence for each in found]
    assert commits == list(range(1, len(commits) + 1))
    assert len(commits) >= last
    loaded = tfdb.load(part, salvage=True)
    assert loaded.frame_info("base").samples == len(commits)
    copy = tfdb.Buffer(history=None)
    for each in tfdb.recorded_commits(part, salvage=True):
        copy.apply(each.data)
    assert copy.frame_info("base").newest == len(commits)
