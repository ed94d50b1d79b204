"""Run Python with the extension of a build folder that was compiled for AddressSanitizer.

`tools/run_under_asan.py build/asan-python -m tests.hostile.fuzz --calls 1000`

First it reads beyond the end of a block on purpose: a run that could find nothing would be silent
as well.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FAULT = """
import ctypes, tfdb._core
print(tfdb._core.__file__, flush=True)
ctypes.string_at(ctypes.create_string_buffer(100), 101)
"""


def library(name: str) -> str:
    """Find a library of the compiler that the preset names."""
    command = ["g++", f"-print-file-name={name}"]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def lay_out(build: Path) -> Path:
    """Lay the package beside the extension; return the folder to import it from."""
    folder = build / "python"
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(ROOT / "src" / "tfdb", folder / "tfdb", ignore=shutil.ignore_patterns("*.so"))
    extension = build / f"_core{sysconfig.get_config_var('EXT_SUFFIX')}"
    if b"__asan_report_load" not in extension.read_bytes():
        sys.exit(f"{extension} was not compiled for AddressSanitizer")
    shutil.copy2(extension, folder / "tfdb")
    return folder


def main() -> int:
    """Return the status of that Python."""
    folder = lay_out(Path(sys.argv[1]).resolve())
    environment = os.environ | {
        # The runtime must come first, and the library of exceptions before any is thrown.
        "LD_PRELOAD": f"{library('libasan.so')} {library('libstdc++.so')}",
        # Python keeps much until its end, and beyond; its handler of signals would hide ours.
        "ASAN_OPTIONS": "detect_leaks=0:handle_segv=2:handle_sigbus=2",
        "PYTHONMALLOC": "malloc",
        "PYTHONPATH": os.pathsep.join([str(folder), str(ROOT), sysconfig.get_path("purelib")]),
    }
    # Without site the editable install is not found before ours.
    python = [sys.executable, "-S"]
    planted = subprocess.run(
        [*python, "-c", FAULT], env=environment, capture_output=True, text=True, check=False
    )
    seen = planted.returncode != 0 and "heap-buffer-overflow" in planted.stderr
    if not seen or not planted.stdout.startswith(str(folder)):
        print(planted.stdout, planted.stderr, sep="", file=sys.stderr)
        sys.exit("AddressSanitizer does not see what this Python does")
    command = [*python, *sys.argv[2:]]
    return subprocess.run(command, env=environment, cwd=ROOT, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
