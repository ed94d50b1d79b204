"""The runner of upstream's suites, the table of the page, and the suites if available."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from compat import upstream_suites
from compat.upstream_suites import END, HEAD, PAGE, Suite

HALF = """
import unittest
class Half(unittest.TestCase):
    def test_right(self):
        {right}
    def test_wrong(self):
        assert False
"""
OURS_IN_ROS2 = 'import tf2_ros; assert tf2_ros.Buffer.__module__.startswith("tfdb")'
SOURCES = os.environ.get("TFDB_UPSTREAM_SOURCES", "")


def git(folder: Path, *command: str) -> None:
    who = ["-c", "user.name=test", "-c", "user.email=test@localhost"]
    subprocess.run(["git", *who, *command], cwd=folder, check=True, capture_output=True)


def clone(sources: Path, suite: Suite, text: str) -> None:
    """A repository whose branch has a suite."""
    folder = sources / suite.repository
    path = folder / suite.path
    path.parent.mkdir(parents=True)
    path.write_text(text)
    git(folder, "init", "-q", "-b", suite.branches[0])
    git(folder, "add", ".")
    git(folder, "commit", "-q", "-m", "A suite")


def test_tests_of_ros_2_that_pass_on_ours_are_counted(tmp_path: Path) -> None:
    suite = Suite("own", "own", "a/test_own.py", ["jazzy"])
    clone(tmp_path, suite, HALF.format(right=OURS_IN_ROS2))
    assert upstream_suites.run_ros2(suite, "jazzy", tmp_path, None) == "?/1"
    assert upstream_suites.run_ros2(suite, "rolling", tmp_path, None) is None
    absent = Suite("own", "elsewhere", "a/test_own.py", ["jazzy"])
    assert upstream_suites.run_ros2(absent, "jazzy", tmp_path, None) is None


def test_tests_of_ros_1_that_pass_on_both_are_counted(tmp_path: Path) -> None:
    suite = Suite("own", "own", "a/test_own.py", ["noetic-devel"])
    clone(tmp_path, suite, HALF.format(right="import tf2_ros, rospy; tf2_ros.Buffer()"))
    assert upstream_suites.run_ros1(suite, "noetic-devel", tmp_path) == "1/1"


def test_the_table_has_a_row_for_each_suite() -> None:
    found = {"a": {"jazzy": "6/6", "noetic-devel": "2/1"}, "b": {"humble": "?/3"}}
    assert upstream_suites.table(found) == HEAD + "| a |  | 6/6 |  | 2/1 |\n| b | ?/3 |  |  |  |\n"


def pages_table() -> dict[str, dict[str, str]]:
    rows = PAGE.read_text(encoding="utf-8").split(HEAD)[1].split(END)[0].splitlines()
    found = {}
    for row in rows:
        name, *counts = (cell.strip() for cell in row.strip("|").split("|"))
        found[name] = {
            branch: count
            for branch, count in zip(upstream_suites.COLUMNS, counts, strict=True)
            if count
        }
    return found


def test_the_page_has_every_suite_and_each_passes_as_often_as_on_the_peer() -> None:
    found = pages_table()
    assert set(found) == {suite.name for suite in upstream_suites.SUITES}
    for suite in upstream_suites.SUITES:
        for branch in suite.branches:
            theirs, ours = map(int, found[suite.name][branch].split("/"))
            # One test of tf expects that a wait raises: `tf1_wait` in `tfdb.tf2.differences`.
            assert ours == theirs - (suite.name == "tf"), suite


@pytest.mark.skipif(not SOURCES, reason="TFDB_UPSTREAM_SOURCES names no folder with the clones")
def test_upstreams_suites_pass_as_counted_on_the_page() -> None:
    found = upstream_suites.measure(Path(SOURCES), None)
    page = pages_table()
    for name, counts in found.items():
        for branch, count in counts.items():
            assert count.split("/")[1] == page[name][branch].split("/")[1], (name, branch)
