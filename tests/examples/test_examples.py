"""Every numbered example and the demo run from any folder and print something."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
NUMBERED = sorted(EXAMPLES.glob("[0-9][0-9]_*.py"))
PNG = b"\x89PNG\r\n\x1a\n"


def run(program: Path, folder: Path, *arguments: str) -> str:
    done = subprocess.run(
        [sys.executable, "-W", "error", str(program), *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return done.stdout


def check_pictures(folder: Path) -> None:
    for name in ("trajectory.png", "frame_tree.png", "timeline.png"):
        picture = (folder / name).read_bytes()
        assert picture.startswith(PNG)
        assert len(picture) > 5000


def test_numbers_are_consecutive() -> None:
    assert [program.name[:2] for program in NUMBERED] == [
        f"{number:02}" for number in range(1, len(NUMBERED) + 1)
    ]


@pytest.mark.parametrize("program", NUMBERED, ids=lambda program: program.stem)
def test_example(program: Path, tmp_path: Path) -> None:
    assert run(program, tmp_path).strip()


@pytest.mark.parametrize("recording", [None, "pr2.bag", "pr2.mcap"])
def test_demo(recording: str | None, tmp_path: Path) -> None:
    arguments = [] if recording is None else [str(EXAMPLES / "data" / recording)]
    printed = run(EXAMPLES / "demo.py", tmp_path, *arguments)
    assert "base_footprint" in printed
    assert "50 Hz" in printed
    assert "10,000 poses" in printed
    assert "20,000 points" in printed
    check_pictures(tmp_path / "out")


def test_demo_fits_a_terminal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    lines = run(EXAMPLES / "demo.py", tmp_path).splitlines()
    assert [line for line in lines if len(line) > 80] == []
    assert any("l_gripper_tool_frame" in line for line in lines)


def test_demo_takes_frames(tmp_path: Path) -> None:
    printed = run(EXAMPLES / "demo.py", tmp_path, "--target", "odom", "--source", "lidar")
    assert "lidar in odom" in printed


@pytest.mark.parametrize(
    "recording",
    [
        "panda/rosbagFrankaPanda.bag",
        "panda/ros2",
        "turtlebot3/rosbag2_turtlebot3_tf",
        "turtlebot_nav/tf_example.bag",
        "turtlebot_nav/tf_example",
    ],
)
def test_demo_on_real_robots(recording: str, shared_data: Path, tmp_path: Path) -> None:
    run(EXAMPLES / "demo.py", tmp_path, str(shared_data / recording), "--out", "pictures")
    check_pictures(tmp_path / "pictures")
