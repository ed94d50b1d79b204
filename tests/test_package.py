"""What the package promises about itself: version, types, weight of its import, the GIL."""

from __future__ import annotations

import importlib.metadata
import subprocess
import sys
import sysconfig
import tomllib
from pathlib import Path

import pytest

import tfdb

ROOT = Path(__file__).resolve().parent.parent


def project() -> dict[str, object]:
    metadata = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    return dict(metadata["project"])


def run_python(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout.strip()


def test_the_version_is_spelled_once() -> None:
    assert tfdb.__version__ == project()["version"] == importlib.metadata.version("tfdb")


def test_the_changelog_knows_this_version() -> None:
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert f"## {project()['version']}" in text


def test_the_package_is_typed() -> None:
    folder = Path(tfdb.__file__).parent
    assert (folder / "py.typed").is_file()
    assert (folder / "_core.pyi").is_file()


def test_every_public_name_exists() -> None:
    assert len(tfdb.__all__) == len(set(tfdb.__all__))
    assert [name for name in tfdb.__all__ if not hasattr(tfdb, name)] == []


def test_the_recordings_are_there_when_they_are_used() -> None:
    code = "import sys, tfdb; print('tfdb.io' in sys.modules, tfdb.io.Recording.__name__)"
    assert run_python(code) == "False Recording"
    with pytest.raises(AttributeError, match="'tfdb' has no attribute 'iot'"):
        getattr(tfdb, "iot")  # noqa: B009 - type checkers know as much


@pytest.mark.parametrize("module", ["rosbags", "matplotlib", "click", "rich"])
def test_import_loads_nothing_heavy(module: str) -> None:
    code = f"import sys, tfdb; print({module!r} in sys.modules)"
    assert run_python(code) == "False"


@pytest.mark.skipif(
    not sysconfig.get_config_var("Py_GIL_DISABLED"), reason="this Python has no build without GIL"
)
def test_the_gil_stays_off() -> None:
    code = "import sys, tfdb._core; print(sys._is_gil_enabled())"
    assert run_python(code) == "False"
