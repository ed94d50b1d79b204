"""Make the packages of a release, and check them: `python tools/make_wheels.py [--native]`.

Into `dist/`: an sdist, and out of that sdist a wheel for each Python and each platform. zig's
compiler, which PyPI has, makes wheels for old glibc, for musl and for aarch64 on any machine,
without containers. `--native` makes the sdist and one wheel, for this Python and this machine, with
its own compiler and from the objects that are there: quick enough for CI.

Every package is looked into (`check`), and the wheels for this machine are installed where there is
no compiler and nothing else: there the README's programs run, and recordings are read.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import platform
import re
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tempfile
import tomllib
import zipfile
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
WORK = ROOT / "build" / "wheels"
PACKAGES = {"tfdb", "tfdb_command"}
MOST_BYTES = 2_500_000
"""Of a wheel. What it takes today is in docs/packaging.md."""
# What only a checkout has: tests, benchmarks, the driver of tf2.
FOREIGN = re.compile(r"tests?\b|bench_|measure|contenders|tf2_driver|torture|fuzz|\.(cpp|hpp|a|o)$")


@dataclass(frozen=True)
class Target:
    """A platform that wheels are made for: what zig and what pip call it."""

    machine: str
    libc: str

    @property
    def zig(self) -> str:
        """What zig calls it."""
        return f"{self.machine}-linux-{self.libc}"

    @property
    def tag(self) -> str:
        """What pip calls it: the oldest glibc or musl that will do."""
        return f"{'musllinux_1_2' if self.libc == 'musl' else 'manylinux_2_17'}_{self.machine}"


TARGETS = [Target(m, c) for c in ("gnu.2.17", "musl") for m in ("x86_64", "aarch64")]


@dataclass(frozen=True)
class Interpreter:
    """A Python whose headers are compiled against, and the tag of its wheels."""

    tag: str
    program: str
    users: tuple[str, ...]
    """All Pythons on this machine that can install such a wheel."""

    @property
    def settings(self) -> list[str]:
        """How a wheel for it is asked for."""
        return ["-C", "wheel.py-api=cp312"] if self.tag == "cp312-abi3" else []


# Which programs may make which wheels. The first that is there does; all try out what was made.
MAKERS = {
    "cp311-cp311": ["python3.11"],
    "cp312-abi3": ["python3.12", "python3.13", "python3.14"],
    "cp313-cp313t": ["python3.13t"],
    "cp314-cp314t": ["python3.14t"],
}


def run(*command: str | Path, env: dict[str, str] | None = None, cwd: Path = ROOT) -> str:
    """Run a command; what it says only if it fails."""
    done = subprocess.run(
        list(map(str, command)), env=env, cwd=cwd, text=True, stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT, check=False,
    )  # fmt: skip
    if done.returncode != 0:
        sys.exit(f"{done.stdout}\nfailed: {' '.join(map(str, command))}")
    return done.stdout


def interpreters(given: list[str]) -> dict[str, Interpreter]:
    """The Pythons on this machine by tag, of those given first."""
    code = "import sys, sysconfig; v = sys.version_info; print(f'python{v[0]}.{v[1]}', end='');"
    code += "print('t' if sysconfig.get_config_var('Py_GIL_DISABLED') else '')"
    known: dict[str, str] = {}
    names = [name for options in MAKERS.values() for name in options]
    for program in [*given, sys.executable, *filter(None, map(shutil.which, names))]:
        # A shim may stand for a Python that is not there.
        told = subprocess.run([program, "-c", code], capture_output=True, text=True, check=False)
        if told.returncode == 0:
            known.setdefault(told.stdout.strip(), program)
    found = {}
    for tag, options in MAKERS.items():
        if there := tuple(known[name] for name in options if name in known):
            found[tag] = Interpreter(tag, there[0], there)
    return found


def make_sdist(into: Path) -> Path:
    """The source distribution."""
    run(sys.executable, "-m", "build", "--sdist", "--no-isolation", "-o", into)
    (made,) = into.glob("*.tar.gz")
    return made


def unpack(sdist: Path) -> Path:
    """The tree that is in it, always at the same place: compiler caches compare paths.

    All times in the archive are one and the same: a file that is as it was keeps its time, another
    is new. Otherwise what was compiled of other sources would be taken for theirs.
    """
    folder = WORK / "source"
    with tempfile.TemporaryDirectory(dir=WORK) as made:
        shutil.unpack_archive(sdist, made)
        (tree,) = Path(made).iterdir()
        for path in filter(Path.is_file, tree.rglob("*")):
            before = folder / path.relative_to(tree)
            if before.is_file() and before.read_bytes() == path.read_bytes():
                shutil.copystat(before, path)
            else:
                path.touch()
        shutil.rmtree(folder, ignore_errors=True)
        return tree.rename(folder)


def compiler_for(target: Target) -> Path:
    """A program that CMake takes for a compiler."""
    spec = importlib.util.find_spec("ziglang")
    if spec is None or spec.origin is None:
        sys.exit("the compiler is missing: pip install -e '.[release]'")
    zig = Path(spec.origin).parent / "zig"
    path = WORK / f"c++-{target.zig}"
    text = (
        "#!/bin/sh\n"
        "for word do shift\n"
        '    case $word in -march=x86-64-v*) word="-march=x86_64_${word#-march=x86-64-}" ;; esac\n'
        '    set -- "$@" "$word"\n'
        "done\n"
        f'exec "{zig}" c++ -target {target.zig} "$@"\n'
    )
    if not path.exists() or path.read_text(encoding="utf-8") != text:  # caches look at its time
        path.write_text(text, encoding="utf-8")
    path.chmod(0o755)
    return path


def debian_headers(interpreter: Interpreter) -> Path | None:
    """A folder with Debian's pyconfig.h under the names of all machines.

    The one in /usr/include/python3.X includes that of the machine; only one is installed. All say
    the same of machines with the same integers, pointers and order of bytes.
    """
    code = "import sysconfig; print(sysconfig.get_config_h_filename())"
    config = Path(run(interpreter.program, "-c", code).strip())
    triple = sysconfig.get_config_var("MULTIARCH")
    if not triple or triple not in config.parts:
        return None
    folder = WORK / "headers" / config.parent.name
    for target in TARGETS:
        place = folder / f"{target.machine}-linux-{target.libc.partition('.')[0]}"
        (place / config.parent.name).mkdir(parents=True, exist_ok=True)
        shutil.copy(config, place / config.parent.name)
    return folder


def build_environment(interpreter: Interpreter) -> Path:
    """The interpreter with what a build requires, always at the same place, as the source is."""
    folder = WORK / f"python-{interpreter.tag}"
    python = folder / "bin" / "python"
    if not python.exists():
        run(interpreter.program, "-m", "venv", folder)
        project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
        needed = project["build-system"]["requires"]
        run(python, "-m", "pip", "install", *needed, "cmake>=3.19", "ninja>=1.11")
    return python


def make_wheel(source: Path, interpreter: Interpreter, target: Target, into: Path) -> Path:
    """One wheel."""
    env = os.environ | {
        "CXX": str(compiler_for(target)),
        "_PYTHON_HOST_PLATFORM": f"linux-{target.machine}",
        "CMAKE_ARGS": f"-DCMAKE_SYSTEM_NAME=Linux -DCMAKE_SYSTEM_PROCESSOR={target.machine}",
        "SETUPTOOLS_EXT_SUFFIX": suffix_of(interpreter, target),
    }
    if (headers := debian_headers(interpreter)) is not None:
        env["CPATH"] = str(headers)
    with tempfile.TemporaryDirectory(dir=WORK) as made:
        folder = WORK / f"{interpreter.tag}-{target.zig}"
        options = ["--no-deps", "--no-build-isolation", "--no-cache-dir", "-w", made]
        options += ["-C", f"build-dir={folder}", *interpreter.settings, str(source)]
        run(build_environment(interpreter), "-m", "pip", "wheel", *options, env=env)
        (plain,) = Path(made).glob("*.whl")
        if target.libc == "musl":  # auditwheel cannot tell it from the name of an abi3 extension
            plain = plain.rename(plain.with_name(plain.name.replace("-linux_", "-musllinux_1_2_")))
        tools = os.environ | {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
        # musl's own name; auditwheel only knows the one that Alpine gives it.
        repair = ["auditwheel", "repair", "--plat", "auto", "--exclude", "libc.so"]
        repair += ["-w", str(into), str(plain)]
        run(sys.executable, "-m", *repair, env=tools)
    for wheel in into.glob(f"*-{interpreter.tag}-*{target.tag}*.whl"):
        return wheel
    sys.exit(f"no wheel for {interpreter.tag}-{target.tag}, but {[w.name for w in into.iterdir()]}")


def suffix_of(interpreter: Interpreter, target: Target) -> str:
    """How the extension's name ends."""
    if interpreter.tag == "cp312-abi3":
        return ".abi3.so"
    version = interpreter.tag.partition("-")[2].removeprefix("cp")
    libc = target.libc.partition(".")[0]
    return f".cpython-{version}-{target.machine}-linux-{libc}.so"


def make_native_wheel(into: Path) -> Path:
    """The wheel for this Python and this machine, from the objects of the checkout."""
    run(sys.executable, "-m", "build", "--wheel", "--no-isolation", "-o", into)
    (wheel,) = into.glob("*.whl")
    return wheel


def check_contents(wheel: Path) -> None:
    """Refuse what has no place in a wheel, and one that grew out of measure."""
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    roots = {name.partition("/")[0] for name in names}
    strays = [n for n in names if FOREIGN.search(n)] + sorted(
        root for root in roots - PACKAGES if not re.fullmatch(r"tfdb-[\w.]+\.dist-info", root)
    )
    native = [name for name in names if name.endswith(".so")]
    wanted = {"tfdb/py.typed", "tfdb/_core.pyi", "tfdb_command/__init__.py"}
    page = ("index.html", "style.css", "app.js", "scene.js", "tree.js", "three.js", "favicon.svg")
    wanted |= {f"tfdb/view/page/{name}" for name in page}
    if strays or len(native) != 1 or not wanted <= set(names):
        sys.exit(f"{wheel.name}: does not belong there: {strays}; extensions: {native}")
    if (size := wheel.stat().st_size) > MOST_BYTES:
        sys.exit(f"{wheel.name}: {size} bytes, more than {MOST_BYTES}")


def check(packages: list[Path]) -> None:
    """What each package says of itself, and what is in it."""
    run(sys.executable, "-m", "twine", "check", "--strict", *packages)
    for package in packages:
        size = f"{package.stat().st_size / 1e6:.2f} MB"
        if package.suffix == ".whl":
            check_contents(package)
            if "-abi3-" in package.name:
                run(sys.executable, "-m", "abi3audit", "--strict", package)
        print(f"  {package.name}: {size}")


def programs() -> str:
    """What the README says in Python, one after the other."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    return "\n".join(re.findall(r"^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL))


def try_out(wheel: Path, program: str) -> None:
    """Install a wheel where nothing else is, run the README's programs and read recordings."""
    with tempfile.TemporaryDirectory() as folder:
        bare = Path(folder)
        run(program, "-m", "venv", bare / "env")
        python = bare / "env" / "bin" / "python"
        run(python, "-m", "pip", "install", "--only-binary", ":all:", wheel)
        env = {"PATH": str(python.parent), "HOME": str(bare), "LANG": "C.UTF-8"}
        data = Path("examples", "data")
        shutil.copytree(ROOT / data, bare / data)
        run(python, "-I", "-c", programs(), env=env, cwd=bare)
        for recording in ("pr2.bag", "pr2.mcap"):
            run(python.parent / "tfdb", "info", data / recording, env=env, cwd=bare)
    print(f"  {wheel.name}: installed with nothing else into {program}, it runs")


def main() -> None:
    """Make and check."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--native", action="store_true", help="one wheel, for here; quick")
    parser.add_argument("--into", type=Path, default=ROOT / "dist", help="default: dist/")
    parser.add_argument("--python", action="append", default=[], help="a Python off the PATH")
    parser.add_argument("--only", default="", help="a part of a tag: cp312, aarch64, musllinux ...")
    options = parser.parse_args()
    found = interpreters(options.python)
    wanted = [
        (tag, target)
        for tag in MAKERS
        for target in TARGETS
        if options.only in f"{tag}-{target.tag}"
    ]
    missing = list(dict.fromkeys(tag for tag, _ in wanted if tag not in found))
    if not wanted:
        parser.error(f"no wheel has {options.only!r} in its tag")
    WORK.mkdir(parents=True, exist_ok=True)
    options.into.mkdir(parents=True, exist_ok=True)
    for old in options.into.glob("tfdb-*"):
        old.unlink()
    sdist = make_sdist(options.into)
    if options.native:
        wheel = make_native_wheel(options.into)
        check([sdist, wheel])
        try_out(wheel, sys.executable)
        return
    source = unpack(sdist)
    # What was made twice of the same sources is the same, byte for byte.
    with tarfile.open(sdist) as archive:
        os.environ.setdefault("SOURCE_DATE_EPOCH", str(int(archive.getmembers()[0].mtime)))
    wheels = []
    here = Target(platform.machine(), "gnu.2.17" if platform.libc_ver()[0] == "glibc" else "musl")
    for tag, target in wanted:
        if (interpreter := found.get(tag)) is None:
            continue
        wheel = make_wheel(source, interpreter, target, options.into)
        check([wheel])
        if target == here:
            for program in interpreter.users:
                try_out(wheel, program)
        else:
            print(f"  {wheel.name}: not tried out, this machine is {here.tag}")
        wheels.append(wheel)
    check([sdist])
    print(f"{1 + len(wheels)} packages in {options.into}")
    for tag in missing:
        print(f"NOT MADE: {tag}, which needs {' or '.join(MAKERS[tag])} on the PATH or by --python")
    sys.exit(1 if missing else 0)


if __name__ == "__main__":
    main()
