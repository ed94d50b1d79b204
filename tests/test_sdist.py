"""The source distribution has all files of a build and no others."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tarfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
STRAY = [
    ".venv/bin/python",
    "myvenv/pyvenv.cfg",
    "env-of-mine/venv/lib/big.so",
    "build/cp311-cp311-linux_x86_64/bin/tfdb_tests",
    "out/tree.png",
    "dist/tfdb-0.0.0.tar.gz",
    ".stamps/install",
]
NEEDED = [
    "LICENSE",
    "README.md",
    "CMakeLists.txt",
    "core/tfdb/store/buffer.hpp",
    "bindings/module.cpp",
    "measure/CMakeLists.txt",
    "src/tfdb/__init__.py",
    "src/tfdb/_core.pyi",
    "src/tfdb/py.typed",
    "examples/data/pr2.mcap",
]


@pytest.fixture(scope="module")
def members(tmp_path_factory: pytest.TempPathFactory) -> set[str]:
    """Names in the archive that is made from a littered copy of the tree."""
    pytest.importorskip("build", reason="the front end `build` is not installed")
    pytest.importorskip("scikit_build_core", reason="scikit-build-core is not installed")
    tree, out = tmp_path_factory.mktemp("tree"), tmp_path_factory.mktemp("out")
    for name in ("CMakeLists.txt", "LICENSE", "README.md", "pyproject.toml", ".gitignore"):
        shutil.copy(ROOT / name, tree)
    for name in ("core", "bindings", "measure", "src", "examples"):
        shutil.copytree(ROOT / name, tree / name)
    for name in STRAY:
        (tree / name).parent.mkdir(parents=True, exist_ok=True)
        (tree / name).write_text("stray", encoding="utf-8")
    command = [sys.executable, "-m", "build", "--sdist", "--no-isolation", "-o", str(out)]
    subprocess.run([*command, str(tree)], check=True, capture_output=True)
    (archive,) = out.glob("*.tar.gz")
    with tarfile.open(archive) as tar:
        return {name.partition("/")[2] for name in tar.getnames()}


def test_the_sdist_holds_all_files_of_a_build(members: set[str]) -> None:
    assert set(NEEDED) - members == set()


@pytest.mark.parametrize("name", STRAY)
def test_it_leaves_strays_out(members: set[str], name: str) -> None:
    assert name not in members
