"""Run every fuzzer of a build folder for a while, each on its own growing corpus."""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def seeds_of(fuzzer: Path) -> list[Path]:
    """Return the committed seed folder, `core/tfdb/<room>/<stem>.corpus`, if there is one."""
    _, room, stem = fuzzer.name.split("_", 2)
    folder = ROOT / "core" / "tfdb" / room / f"{stem}.corpus"
    return [folder] if folder.is_dir() else []


def run(fuzzer: Path, build: Path, seconds: int) -> bool:
    """Run one fuzzer; whatever it finds stays under the build folder."""
    corpus = build / "corpus" / fuzzer.name
    findings = build / "findings"
    corpus.mkdir(parents=True, exist_ok=True)
    findings.mkdir(exist_ok=True)
    command = [str(fuzzer), f"-max_total_time={seconds}", "-print_final_stats=1", "-seed=1"]
    command += ["-timeout=10", "-rss_limit_mb=2048", "-verbosity=0"]
    command += [f"-artifact_prefix={findings}/{fuzzer.name}-", str(corpus)]
    command += [str(folder) for folder in seeds_of(fuzzer)]
    print(f"{fuzzer.name}: {seconds} s", flush=True)
    return subprocess.run(command, check=False).returncode == 0


def main() -> int:
    """Return 0, or 1 when a fuzzer found something or there is none."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("build", type=Path)
    parser.add_argument("--seconds", type=int, default=60, help="for each fuzzer")
    arguments = parser.parse_args()
    build = arguments.build.resolve()
    fuzzers = sorted((build / "bin").glob("fuzz_*"))
    results = [run(fuzzer, build, arguments.seconds) for fuzzer in fuzzers]
    print(f"{sum(results)} passed, {len(results) - sum(results)} failed")
    return 0 if fuzzers and all(results) else 1


if __name__ == "__main__":
    sys.exit(main())
