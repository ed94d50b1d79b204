"""Live nodes of ROS 2 with the real rclpy: each file of `in_ros2` runs in a process with rclpy."""

from __future__ import annotations

from pathlib import Path

import pytest

from ros import ros2

FILES = sorted(Path(__file__).with_name("in_ros2").glob("*_cases.py"))


@pytest.mark.parametrize("path", FILES, ids=[path.stem for path in FILES])
def test_in_ros2(path: Path) -> None:
    ros2.run_cases(path)


def test_there_are_cases() -> None:
    assert len(FILES) >= 1
