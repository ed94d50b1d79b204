"""Two static edges revised as a pair at full speed: tfdb's readers never see half of a revision.

The same program runs the real tf2, whose rate of torn reads is printed: it has no batch to offer.
"""

from __future__ import annotations

import json
import shutil
import subprocess
from typing import TYPE_CHECKING

import pytest

from compat.tf2_oracle import REPOSITORY, TF2_HEADER, unavailable

if TYPE_CHECKING:
    from pathlib import Path

SECONDS = 1.0


@pytest.fixture(scope="module")
def torn_pair(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if not TF2_HEADER.exists():
        unavailable("real tf2 is not installed: apt-get install libtf2-dev")
    cmake = shutil.which("cmake")
    if cmake is None:
        unavailable("cmake is not installed")
    build = tmp_path_factory.mktemp("torn_pair")
    source = REPOSITORY / "benchmarks" / "cpp"
    configure = [str(cmake), "-S", str(source), "-B", str(build), "-DCMAKE_BUILD_TYPE=Release"]
    compile_it = [str(cmake), "--build", str(build), "--target", "torn_pair", "--parallel", "2"]
    for command in (configure, compile_it):
        subprocess.run(command, check=True, capture_output=True, text=True)
    return build / "bin" / "torn_pair"


def race(program: Path, store: str) -> dict[str, int]:
    command = [str(program), store, str(SECONDS)]
    result = subprocess.run(command, check=True, capture_output=True, text=True)
    counts: dict[str, int] = json.loads(result.stdout)
    print(result.stdout.strip())
    return counts


@pytest.mark.slow
def test_no_torn_reads(torn_pair: Path) -> None:
    theirs, ours = race(torn_pair, "tf2"), race(torn_pair, "tfdb")
    assert theirs["reads"] > 0
    assert ours["reads"] > 0
    assert ours["writes"] > 0
    assert ours["torn"] == 0
