"""The API reference builds, without a warning, and shows the extension's signatures."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("pdoc")
ROOT = Path(__file__).resolve().parents[2]


def test_reference(tmp_path: Path) -> None:
    done = subprocess.run(
        [
            sys.executable,
            "-W",
            "error",
            str(ROOT / "tools" / "make_docs.py"),
            str(tmp_path / "api"),
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    page = (tmp_path / "api" / "tfdb.html").read_text(encoding="utf-8")
    for name in ("Buffer.lookup_transform", "Snapshot", "UnknownFrame", "decode_tf_message"):
        assert f'id="{name}"' in page
    assert "(unknown)" not in page
    # Sections stand apart, and errors without a description are a sentence with links.
    assert page.count(">Raises</h6>\n\n") == page.count(">Raises</h6>") > 20
    raised = re.search(r">Raises</h6>\s*(.*?)</code>", page, re.DOTALL)
    assert raised is not None
    assert raised[1] == '<p><code><a href="#UnknownFrame">UnknownFrame</a>'
    assert (tmp_path / "api" / "index.html").is_file()
