"""Make a prefix with a real rclpy of Jazzy and tf2_msgs: `python tools/make_ros2_env.py [PREFIX]`.

The prefix (default: `.ros2` in the checkout) is used like any ROS 2 that is sourced: `environment`
gives the variables with which this very Python finds it, so tfdb is there as well. The wheels are
PyPI's, 242 MB, x86_64; one person makes them, so they serve tests and measurements only. A prefix
that is there and up to date is left as it is.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

HERE = Path(__file__).resolve().parent
PREFIX = HERE.parent / ".ros2"
WHEELS = (
    "ros-rclpy[fastrtps]==7.1.6",
    "ros-geometry-msgs==5.3.6",
    "ros-sensor-msgs==5.3.6",
    "ros-diagnostic-msgs==5.3.6",
)
# Programs that know only tf2, without what they need for other things.
PROGRAMS = (
    "crisp-python==3.6.0",
    "era-5g-tf2json==0.2.1",
    "osiris-agent==0.4.0",
    "pyquaternion==0.9.9",
    "scipy>=1.14",
)


def environment(prefix: Path = PREFIX) -> dict[str, str]:
    """The variables with which a Python like this one finds the prefix."""
    packages = sysconfig.get_path("platlib", vars={"platbase": str(prefix)})
    libraries = [str(prefix / "lib"), *map(str, Path(packages).glob("ros_*.libs"))]
    return os.environ | {
        "AMENT_PREFIX_PATH": str(prefix),
        "LD_LIBRARY_PATH": os.pathsep.join(libraries),
        "PYTHONPATH": packages,
        "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_DISTRO": "jazzy",
        "ROS_VERSION": "2",
        # The wheels would start Python anew to set LD_LIBRARY_PATH.
        "_ROS_WHEELS_BOOTSTRAP_COMPLETE": "1",
    }


def made_of() -> str:
    """What a prefix depends on: another Python or another file here asks for a new one."""
    messages = sorted((HERE / "ros2" / "tf2_msgs").rglob("*.*"))
    files = [HERE / "make_ros2_env.py", HERE / "ros2" / "generate_messages.py", *messages]
    parts = [sys.version.encode(), *(path.read_bytes() for path in files)]
    return hashlib.sha256(b"\0".join(parts)).hexdigest()


def is_made(prefix: Path = PREFIX) -> bool:
    """Whether the prefix is there, whole and up to date."""
    stamp = prefix / "made_of"
    return stamp.is_file() and stamp.read_text() == made_of()


def make(prefix: Path) -> None:
    """Install the wheels into the prefix and add tf2_msgs."""
    shutil.rmtree(prefix, ignore_errors=True)
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "-q", "install"]
    subprocess.run([*pip, "--prefix", prefix, "--no-compile", *WHEELS], check=True)
    subprocess.run([*pip, "--prefix", prefix, "--no-compile", "--no-deps", *PROGRAMS], check=True)
    generator = HERE / "ros2" / "generate_messages.py"
    subprocess.run([sys.executable, generator, prefix], env=environment(prefix), check=True)
    (prefix / "made_of").write_text(made_of())


if __name__ == "__main__":
    wanted = Path(sys.argv[1]).resolve() if len(sys.argv) > 1 else PREFIX
    if not is_made(wanted):
        make(wanted)
