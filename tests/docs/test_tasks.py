"""Each task of docs/tasks.md runs and has at most five lines."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

import tfdb
from tfdb.trajectories.writing import write_trajectory

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "tasks.md"
PARTS = re.compile(r"^## ([^\n]+)$|^### ([^\n]+)$|^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
PATIENCE = 300.0  # seconds
IMPORTS = """import threading
import numpy as np
import tfdb
from tfdb.robots.urdf import load_urdf
"""


@dataclass
class Task:
    """One row."""

    have: str
    want: str
    language: str
    program: str

    def __str__(self) -> str:
        return f"{self.have}: {self.want}"


def tasks() -> list[Task]:
    found, have, want = [], "", ""
    for group, task, language, program in PARTS.findall(PAGE.read_text(encoding="utf-8")):
        have, want = group or have, task or want
        if language:
            found.append(Task(have, want, language, program))
    return found


@pytest.fixture(scope="module")
def things(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the page says that there is."""
    folder = tmp_path_factory.mktemp("things")
    for kind in ("bag", "mcap"):
        shutil.copy(ROOT / "examples" / "data" / f"pr2.{kind}", folder / f"drive.{kind}")
    shutil.copy(ROOT / "tests" / "cases" / "two_robots.mcap", folder / "robots.mcap")
    buf = tfdb.load(folder / "drive.mcap")
    start, end = buf.common_times("map", "base_link")
    for name, rate, begin in (("a", 20.0, start), ("b", 13.0, start + 100_000_000)):
        path = buf.trajectory("map", "base_link", rate, begin, end)
        write_trajectory(folder / f"{name}.tum", path)
    howto = (ROOT / "docs" / "howto" / "read_urdf.md").read_text(encoding="utf-8")
    model = re.search(r'URDF = """\n(.*?)"""', howto, re.DOTALL)
    assert model is not None
    (folder / "arm.urdf").write_text(model.group(1), encoding="utf-8")
    return folder


def test_there_are_tasks_and_each_is_short() -> None:
    found = tasks()
    assert len({str(task) for task in found}) == len(found)
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert set(re.findall(r"(\d+) tasks", readme)) == {str(len(found))}
    for task in found:
        assert sum(line.strip() != "" for line in task.program.splitlines()) <= 5, str(task)
        assert len(max(task.program.splitlines(), key=len)) <= 100, str(task)


@pytest.mark.parametrize("task", tasks(), ids=str)
def test_task(task: Task, things: Path, tmp_path: Path) -> None:
    folder = tmp_path / "here"
    shutil.copytree(things, folder)
    command = {
        "python": [sys.executable, "-W", "error", "-c", IMPORTS + task.program],
        "sh": ["sh", "-eu", "-c", task.program],
    }[task.language]
    beside = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        command,
        cwd=folder,
        env={**os.environ, "PATH": beside, "MPLBACKEND": "agg"},
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
