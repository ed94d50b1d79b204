"""Running `tfdb bench` with points that take milliseconds."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from tfdb_measure import programs

if TYPE_CHECKING:
    from pathlib import Path

TINY = ("--iterations", "50", "--warmup", "0", "--joints", "64", "--rounds", "2")


def has(engine: str) -> bool:
    try:
        programs.driver(engine)
    except programs.DriverMissing:
        return False
    return True


@dataclass(frozen=True)
class Outcome:
    """How a run ended, and what it left in its folder."""

    code: int
    out: str
    err: str
    folder: Path

    @property
    def rows(self) -> list[dict[str, str]]:
        with (self.folder / "results.csv").open(encoding="utf-8", newline="") as file:
            return list(csv.DictReader(file))

    @property
    def page(self) -> str:
        return (self.folder / "report.html").read_text(encoding="utf-8")

    @property
    def json(self) -> dict[str, Any]:
        return dict(json.loads(self.out))

    @property
    def error(self) -> str:
        assert self.code == 2, self.out + self.err
        *warnings, line = self.err.strip().splitlines()
        assert all(warning.startswith("tfdb: warning: ") for warning in warnings)
        return line.removeprefix("tfdb: error: ")


class Bench:
    """`tfdb bench` in a process of its own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder / "report"

    def command(self, *arguments: object) -> list[str]:
        words = [*(str(argument) for argument in arguments), "--out", str(self.folder)]
        return [sys.executable, "-m", "tfdb.cli", "bench", *words]

    def __call__(self, *arguments: object, env: dict[str, str] | None = None) -> Outcome:
        done = subprocess.run(
            self.command(*arguments),
            capture_output=True,
            text=True,
            timeout=300,
            check=False,
            env=env,
        )
        return Outcome(done.returncode, done.stdout, done.stderr, self.folder)
