"""`tfdb bench` from end to end: rows, report, interruption, bad input."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.measure.running import TINY, Bench, has
from tfdb_measure import points

if TYPE_CHECKING:
    from collections.abc import Iterator


def test_rows_have_every_engine_and_round(bench: Bench) -> None:
    done = bench(*TINY, "--sweep", "skew", "--engines", "snapshot,giant", "--csv-only")
    assert done.code == 0, done.err
    found = [(row["round"], row["label"], row["engine"]) for row in done.rows]
    expected = [
        (turn, label, engine)
        for turn in ("1", "2")
        for label in points.SWEEPS["skew"].varied
        for engine in ("snapshot", "giant")
    ]
    assert found == expected  # engines take turns, round by round
    for row in done.rows:
        assert float(row["elapsed_s"]) > 0
        assert float(row["worst_value"]) <= 1e-9
        columns = ("reads_done", "reads_failed", "writes_done", "writes_failed")
        assert sum(int(row[column]) for column in columns) == 2 * 50
        assert row["joints"] == "64"
    columns = set(done.rows[0])
    assert {"reads_per_s", "writes_edges_per_s", "reads_p999_ns", "age_p99_ns"} <= columns
    assert {"retries", "lock_waits", "lapped_reads", "conflicts", "aborts"} <= columns


def test_report_has_a_picture_of_each_sweep(bench: Bench) -> None:
    pytest.importorskip("matplotlib")
    names = ("threads", "tree", "latency", "starvation")
    done = bench(
        *("--iterations", "50", "--warmup", "0", "--quick", "--engines", "snapshot"),
        *("--sweep", ",".join(names)),
    )
    assert done.code == 0, done.err
    for name in (*names, "aborts"):
        assert f'id="{name}"' in done.page
        assert (done.folder / f"{name}.png").stat().st_size > 1_000
    pictures = re.findall(r'src="data:image/png;base64,([^"]{1000,})"', done.page)
    assert len(pictures) == len(names) + 1
    assert not re.search(r'(src|href)="(?!data:)', done.page)  # needs no other file
    for word in ("machine", "versions", "command", "snapshot"):
        assert word in done.page
    assert not (done.folder / ".report.html").exists()


def test_json_names_points_and_files(bench: Bench) -> None:
    done = bench(*TINY, "--sweep", "latency", "--engines", "snapshot", "--csv-only", "--json")
    assert done.json["runs"] == done.json["planned"] == 2
    assert done.json["report"] is None
    (point,) = done.json["points"]
    assert point["engine"] == "snapshot"
    assert point["reads_p50_ns"] > 0


@pytest.mark.skipif(not has("tf2"), reason="tfdb_driver_tf2 is not built: no libtf2-dev here")
def test_tf2_takes_part(bench: Bench) -> None:
    done = bench(*TINY, "--sweep", "latency", "--engines", "snapshot,tf2", "--csv-only")
    assert done.code == 0, done.err
    assert {row["engine"] for row in done.rows} == {"snapshot", "tf2"}


@pytest.fixture
def interruptible() -> Iterator[None]:
    """Programs started here feel Ctrl-C, also where the tests run in the background."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interruptible")
def test_interrupt_leaves_the_finished_points(bench: Bench) -> None:
    command = bench.command(
        *("--seconds", "0.05", "--warmup", "0", "--joints", "64", "--rounds", "1000"),
        *("--sweep", "latency", "--engines", "snapshot"),
    )
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        table = bench.folder / "results.csv"
        while not (table.exists() and table.read_text(encoding="utf-8").count("\n") >= 3):
            assert process.poll() is None
            os.sched_yield()
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=120)
    assert process.returncode == 130, err
    assert b"stopped" in err
    text = table.read_text(encoding="utf-8")
    assert text.endswith("\n")
    assert text.count("\n") < 1_000
    if (bench.folder / "report.html").exists():  # matplotlib is there
        page = (bench.folder / "report.html").read_text(encoding="utf-8")
        assert "stopped early" in page
        assert page.endswith("</html>")


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (["--engines", "snapshot,nosuch"], ["nosuch", "2pl-wound-wait", "tf2"]),
        (["--engines", ","], ["at least one engine"]),
        (["--sweep", "colour"], ["colour", "read-ratio", "tree"]),
        (["--threads", "0"], ["--threads", "1"]),
        (["--threads", "many"], ["--threads", "many"]),
        (["--read-ratio", "1.5"], ["--read-ratio", "1.5"]),
        (["--seconds", "-1"], ["--seconds"]),
        (["--rounds", "0"], ["--rounds"]),
        (["--tree", "bush"], ["bush", "humanoid"]),
        (["--joints", "100", "--sweep", "read-length"], ["--read-length 256", "--joints 256"]),
        (["--joints", "20", "--sweep", "tree"], ["humanoid", "32"]),
        (["--reads", "transaction", "--engines", "tf2", "--sweep", "skew"], ["transactions"]),
    ],
)
def test_bad_input_is_named_and_writes_nothing(
    bench: Bench, arguments: list[str], parts: list[str]
) -> None:
    if "tf2" in arguments and not has("tf2"):
        pytest.skip("tfdb_driver_tf2 is not built: no libtf2-dev here")
    engines = [] if "--engines" in arguments else ["--engines", "snapshot"]
    done = bench(*arguments, *engines)
    for part in parts:
        assert part in done.error
    assert not bench.folder.exists()


def test_missing_drivers_are_named(bench: Bench, tmp_path: Path) -> None:
    nowhere = {**os.environ, "TFDB_DRIVERS": str(tmp_path)}
    done = bench(*TINY, "--engines", "snapshot", env=nowhere)
    assert "tfdb_driver" in done.error
    assert "install" in done.error
    assert "libtf2-dev" in bench(*TINY, "--engines", "tf2", env=nowhere).error
    assert not bench.folder.exists()


def test_a_driver_that_fails_is_named_and_the_rest_is_kept(bench: Bench, tmp_path: Path) -> None:
    fake = tmp_path / "tfdb_driver"
    fake.write_text(
        "#!/bin/sh\n"
        'case "$*" in *giant*) echo "no such luck" >&2; exit 1;; esac\n'
        'echo \'{"reads_done": 1, "writes_done": 1, "reads_per_s": 2.0}\'\n',
        encoding="utf-8",
    )
    fake.chmod(0o755)
    done = bench(
        *("--sweep", "latency", "--engines", "snapshot,giant", "--rounds", "1", "--csv-only"),
        env={**os.environ, "TFDB_DRIVERS": str(tmp_path)},
    )
    assert "no such luck" in done.error
    assert "1 of 2" in done.error
    assert [row["engine"] for row in done.rows] == ["snapshot"]


@pytest.mark.parametrize("words", [["--quick"], ["--sweep", "skew", "--json"]])
def test_without_a_checkout_it_names_the_install(words: list[str]) -> None:
    code = (
        "import sys; sys.modules['tfdb_measure'] = None\n"
        f"from tfdb.cli.app import cli; cli({['bench', *words]})"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith("tfdb: error: ")
    assert "pip install -e ." in line
    assert "TFDB_MEASURE=1" in line


def test_a_wheel_holds_no_program_and_nothing_that_measures() -> None:
    text = (Path(__file__).resolve().parents[2] / "pyproject.toml").read_text(encoding="utf-8")
    build = tomllib.loads(text)["tool"]["scikit-build"]
    assert build["build"]["targets"] == ["_core"]
    assert build["install"]["components"] == ["python"]
    assert build["wheel"]["packages"] == ["src/tfdb", "src/tfdb_command"]
    (checkout,) = build["overrides"]
    assert checkout["if"] == {"any": {"state": "editable", "env": {"TFDB_MEASURE": True}}}
