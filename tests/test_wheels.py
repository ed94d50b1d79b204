"""The tool that makes release packages, without making them."""

from __future__ import annotations

import io
import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING

from tools import make_wheels

import tfdb

if TYPE_CHECKING:
    import pytest

ROOT = Path(__file__).resolve().parent.parent


def archive(path: Path, files: dict[str, str]) -> Path:
    """An sdist as scikit-build-core makes it: all files are of one second."""
    with tarfile.open(path, "w:gz") as made:
        for name, text in files.items():
            member = tarfile.TarInfo(f"tfdb-0.1.0/{name}")
            member.size, member.mtime = len(text), 1_668_000_000
            made.addfile(member, io.BytesIO(text.encode()))
    return path


def test_changed_sources_are_newer_than_compiled_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(make_wheels, "WORK", tmp_path)
    first = archive(tmp_path / "1.tar.gz", {"a.cpp": "old", "b.cpp": "same", "gone.cpp": ""})
    tree = make_wheels.unpack(first)
    for name in ("a.cpp", "b.cpp"):
        os.utime(tree / name, (2_000_000_000, 2_000_000_000))
    second = archive(tmp_path / "2.tar.gz", {"a.cpp": "new", "b.cpp": "same", "sub/c.cpp": ""})
    assert make_wheels.unpack(second) == tree
    assert (tree / "b.cpp").stat().st_mtime == 2_000_000_000
    for name in ("a.cpp", "sub/c.cpp"):  # just now, not when the archive says
        assert 1_668_000_000 < (tree / name).stat().st_mtime < 2_000_000_000
    assert sorted(path.name for path in tree.rglob("*.cpp")) == ["a.cpp", "b.cpp", "c.cpp"]


def test_a_part_of_no_tag_is_refused_before_anything_is_made(tmp_path: Path) -> None:
    (tmp_path / "tfdb-0.0.9.tar.gz").touch()
    tool = [sys.executable, "tools/make_wheels.py", "--into", str(tmp_path), "--only", "win32"]
    done = subprocess.run(tool, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "no wheel has 'win32' in its tag" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["tfdb-0.0.9.tar.gz"]


def package_without_extension(folder: Path) -> Path:
    source = Path(tfdb.__file__).parent
    left_out = shutil.ignore_patterns("*.so", "__pycache__")
    return Path(shutil.copytree(source, folder / "tfdb", ignore=left_out))


def test_a_package_for_another_python_is_refused(tmp_path: Path) -> None:
    folder = package_without_extension(tmp_path / "target")
    done = refused(tmp_path / "target")
    assert f"{folder} holds no extension for Python {sys.version.split()[0]}" in done
    assert "python -m pip install tfdb" in done


def test_a_wheel_is_not_imported_as_it_lies_there(tmp_path: Path) -> None:
    folder = package_without_extension(tmp_path / "target")
    wheel = tmp_path / "tfdb.whl"
    with zipfile.ZipFile(wheel, "w") as made:
        for path in filter(Path.is_file, folder.rglob("*")):
            made.write(path, path.relative_to(tmp_path / "target"))
    assert "or lies in a zip file" in refused(wheel)


def refused(where: Path) -> str:
    """The last line of what an import from there says."""
    code = f"import sys; sys.path.insert(0, {str(where)!r}); import tfdb"
    # Without site: an editable install would find the extension.
    done = subprocess.run(
        [sys.executable, "-I", "-S", "-c", code], capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    return done.stderr.strip().splitlines()[-1]
