"""What the report's head says of where and with what it was made."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
from pathlib import Path

from tfdb import __version__

_BUSY = 0.25
"""So many running programs for each core make figures doubtful."""


def machine() -> str:
    """Processor, cores, memory and system; no names of hosts or users."""
    values: dict[str, str] = {}
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        for line in cpuinfo.read_text(encoding="utf-8").splitlines():
            name, _, value = line.partition(":")
            values[name.strip()] = value.strip()
    model = values.get("model name", platform.processor() or platform.machine())
    if "cpu family" in values:
        model += f" (family {values['cpu family']} model {values.get('model', '?')})"
    try:
        system = platform.freedesktop_os_release()["PRETTY_NAME"]
    except OSError:
        system = platform.system()
    return f"{model}, {cores()} cores, {system}, Linux {platform.release()}"


def cores() -> int:
    """Return how many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def busy() -> str | None:
    """Say how busy the machine is with other work; None where it is idle enough to measure."""
    load, all_cores = os.getloadavg()[0], os.cpu_count() or 1
    if load < _BUSY * all_cores:
        return None
    return (
        f"the machine is busy: {load:.1f} programs ran on its {all_cores} cores in the last "
        "minute; the figures are of what these left over"
    )


def versions(*, tf2: bool) -> str:
    """Return the versions of what was measured and of what measured it."""
    text = f"tfdb {__version__}, Python {platform.python_version()}"
    return f"{text}, tf2 {_tf2_version()}" if tf2 else text


def _tf2_version() -> str:
    """Ask Debian's package manager; where there is none, nobody knows."""
    query = shutil.which("dpkg-query")
    if query is None:
        return "of this system"
    done = subprocess.run(  # noqa: S603, a program of the system with fixed arguments
        [query, "-W", "-f", "${Version}", "libtf2-dev"], capture_output=True, text=True, check=False
    )
    return f"{done.stdout} (Debian, ROS 1)" if done.stdout else "of this system"


def commit(tree: Path) -> str:
    """Return the commit that a checkout stands at, and whether code was changed since."""
    git = shutil.which("git")
    if git is None:
        return "unknown"
    asked = [
        ["rev-parse", "--short=12", "HEAD"],
        ["status", "--porcelain", "--untracked-files=no", "--", ":!docs"],
    ]
    said = [
        subprocess.run(  # noqa: S603, a program of the system with fixed arguments
            [git, "-C", str(tree), *words], capture_output=True, text=True, check=False
        )
        for words in asked
    ]
    if said[0].returncode != 0:
        return "unknown"
    return said[0].stdout.strip() + (", with changes" if said[1].stdout.strip() else "")
