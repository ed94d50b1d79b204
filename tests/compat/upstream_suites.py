"""Run upstream's own Python suites of tf2 and tf on their packages and on `tfdb.tf2`.

    PYTHONPATH=tests python -m compat.upstream_suites SOURCES [--peer PACKAGES] [--write]

SOURCES is a folder with clones of ros2/geometry2, ros2/common_interfaces, ros/geometry2 and
ros/geometry, named `ros2-geometry2`, `ros2-common_interfaces`, `ros1-geometry2`, `ros1-geometry`. A
suite without its clone is left out. The suites of ROS 2 need `make ros2`, those of ROS 1 Debian's
packages. `--write` puts the table into docs/howto/from-tf2.md. Nothing of upstream's is kept.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ros import real_ros1, ros2

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

PAGE = Path(__file__).resolve().parents[2] / "docs" / "howto" / "from-tf2.md"
HEAD = "| suite | humble | jazzy | rolling | noetic |\n|---|---|---|---|---|\n"
END = "<!-- end of the suites -->"
DEBIAN = "/usr/lib/python3/dist-packages"
COLUMNS = ("humble", "jazzy", "rolling", "noetic-devel")
ROS2 = COLUMNS[:3]
ROS1 = COLUMNS[3:]
LIMIT = 300.0
"""Seconds for one suite: one that hangs has failed."""


@dataclass(frozen=True)
class Suite:
    """A file of upstream's tests, in some branches of a repository."""

    name: str
    repository: str
    path: str
    branches: Sequence[str]


SUITES = (
    Suite("tf2_py", "ros2-geometry2", "tf2_py/test/test_buffer_core.py", ROS2),
    Suite("tf2_ros Buffer", "ros2-geometry2", "tf2_ros_py/test/test_buffer.py", ROS2),
    Suite("tf2_ros BufferClient", "ros2-geometry2", "tf2_ros_py/test/test_buffer_client.py", ROS2),
    Suite(
        "tf2_ros listener, broadcasters",
        "ros2-geometry2",
        "tf2_ros_py/test/test_listener_and_broadcaster.py",
        ROS2,
    ),
    Suite(
        "tf2_geometry_msgs",
        "ros2-geometry2",
        "tf2_geometry_msgs/test/test_tf2_geometry_msgs.py",
        ROS2,
    ),
    Suite("tf2_geometry_msgs", "ros1-geometry2", "tf2_geometry_msgs/scripts/test.py", ROS1),
    # Humble's own does not run: it imports a module that ROS 2 does not have.
    Suite(
        "tf2_sensor_msgs",
        "ros2-geometry2",
        "tf2_sensor_msgs/test/test_tf2_sensor_msgs.py",
        ROS2[1:],
    ),
    Suite(
        "tf2_sensor_msgs", "ros1-geometry2", "tf2_sensor_msgs/test/test_tf2_sensor_msgs.py", ROS1
    ),
    Suite("tf", "ros1-geometry", "tf/test/testPython.py", ROS1),
)

# Each runs one file, as `ours` or `theirs`, and prints how many of its tests pass.
CHILD_OF_ROS2 = """
import sys
side, path = sys.argv[1:]
if side == "ours":
    from tfdb import tf2
    tf2.install()
import tf2_py
# The name that upstream's build gives the module for its own suite.
sys.modules["test_tf2_py"] = tf2_py
sys.modules["test_tf2_py._tf2_py"] = sys.modules["tf2_py._tf2_py"]
import pytest
class Count:
    passed = 0
    def pytest_runtest_logreport(self, report):
        self.passed += report.when == "call" and report.passed
count = Count()
pytest.main(["-p", "no:cacheprovider", "-W", "ignore", "--rootdir", ".", path], plugins=[count])
print()
print(count.passed)
"""
CHILD_OF_ROS1 = f"""
import sys
side, path = sys.argv[1:]
sys.path.append({DEBIAN!r})
if side == "ours":
    from tfdb import tf2
    tf2.install()
import importlib.util, types, unittest, rospy
# It runs a suite that is started as a program.
sys.modules.setdefault("rostest", types.ModuleType("rostest"))
rospy.init_node("suite", disable_signals=True)
spec = importlib.util.spec_from_file_location("suite", path)
suite = importlib.util.module_from_spec(spec)
spec.loader.exec_module(suite)
tests = unittest.defaultTestLoader.loadTestsFromModule(suite)
found = unittest.TextTestRunner(sys.stdout).run(tests)
print()
print(found.testsRun - len(found.failures) - len(found.errors) - len(found.skipped), flush=True)
import os
os._exit(0)
"""


def extract(repository: Path, branch: str, path: str, into: Path) -> Path | None:
    """Write a file, or the files of a folder, of a branch; None: the branch is missing."""
    git = ["git", "-C", str(repository)]
    if not repository.exists():
        return None
    for reference in (branch, f"origin/{branch}"):
        packed = subprocess.run(
            [*git, "archive", reference, path], capture_output=True, check=False
        )
        if packed.returncode == 0:
            subprocess.run(["tar", "-x", "-C", str(into)], input=packed.stdout, check=True)
            return into / path
    return None


def passed(command: Sequence[str], environment: dict[str, str], folder: Path) -> int:
    """How many tests of a suite pass; 0 for one that hangs."""
    try:
        done = subprocess.run(
            command,
            env=environment,
            cwd=folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
            timeout=LIMIT,
        )
    except subprocess.TimeoutExpired as late:
        sys.stderr.write(f"{late.stdout!r}\n")
        return 0
    sys.stderr.write(done.stdout)
    last = done.stdout.strip().rpartition("\n")[2]
    return int(last) if last.isdecimal() else 0


def run_ros2(suite: Suite, branch: str, sources: Path, peer: Path | None) -> str | None:
    """How often the tests pass on upstream's packages and on ours; None where it is not there."""
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        path = extract(sources / suite.repository, branch, suite.path, folder)
        if path is None:
            return None
        extract(sources / "ros2-common_interfaces", branch, "sensor_msgs_py", folder)
        environment = ros2.environment()
        packages = [environment["PYTHONPATH"], str(folder / "sensor_msgs_py")]

        def run(side: str, *more: str) -> int:
            command = [sys.executable, "-c", CHILD_OF_ROS2, side, str(path)]
            paths = {"PYTHONPATH": os.pathsep.join([*more, *packages])}
            return passed(command, environment | paths, folder)

        theirs = "?" if peer is None else str(run("theirs", str(peer)))
        return f"{theirs}/{run('ours')}"


def run_ros1(suite: Suite, branch: str, sources: Path) -> str | None:
    """How often the tests pass on Debian's packages and on ours; None where it is not there."""
    with tempfile.TemporaryDirectory() as made, real_ros1.running_master() as master:
        folder = Path(made)
        path = extract(sources / suite.repository, branch, suite.path, folder)
        if path is None:
            return None
        environment = real_ros1.environment(master)
        pythons = {"theirs": real_ros1.PYTHON, "ours": sys.executable}
        counts = (
            passed([python, "-c", CHILD_OF_ROS1, side, str(path)], environment, folder)
            for side, python in pythons.items()
        )
        return "/".join(map(str, counts))


def measure(sources: Path, peer: Path | None) -> dict[str, dict[str, str]]:
    """The counts of each suite by branch."""
    found: dict[str, dict[str, str]] = {}
    for suite in SUITES:
        for branch in suite.branches:
            if branch in ROS2:
                counts = run_ros2(suite, branch, sources, peer)
            else:
                counts = run_ros1(suite, branch, sources)
            if counts is not None:
                found.setdefault(suite.name, {})[branch] = counts
    return found


def table(found: dict[str, dict[str, str]]) -> str:
    """The table in Markdown."""
    rows: Iterable[list[str]] = (
        [name, *(counts.get(branch, "") for branch in COLUMNS)] for name, counts in found.items()
    )
    return HEAD + "".join("| " + " | ".join(row) + " |\n" for row in rows)


def main() -> int:
    """Run them and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("sources", type=Path, help="Folder with the four clones.")
    parser.add_argument("--peer", type=Path, help="Folder with upstream's packages for ROS 2.")
    parser.add_argument("--write", action="store_true", help="Write the table into the page.")
    given = parser.parse_args()
    found = measure(given.sources.absolute(), given.peer and given.peer.absolute())
    made = table(found)
    if given.write:
        before, rest = PAGE.read_text(encoding="utf-8").split(HEAD)
        PAGE.write_text(before + made + END + rest.split(END)[1], encoding="utf-8")
    sys.stdout.write(made)
    return 0


if __name__ == "__main__":
    sys.exit(main())
