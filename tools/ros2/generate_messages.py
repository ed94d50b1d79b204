"""Generate and compile the messages of `tf2_msgs` with the rosidl generators of a ROS 2 prefix.

PyPI's wheels of rclpy bring the generators and the headers, and no tf2_msgs. One extension module
holds what ROS 2 spreads over six libraries: the structs, their type supports, their conversion to
Python. Run by `tools/make_ros2_env.py`, in the environment of that prefix.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import sysconfig
from concurrent.futures import ThreadPoolExecutor
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from rosidl_adapter.action import convert_action_to_idl
from rosidl_adapter.msg import convert_msg_to_idl
from rosidl_adapter.srv import convert_srv_to_idl
from rosidl_generator_c import generate_c
from rosidl_generator_py import generate_py
from rosidl_generator_type_description import generate_type_hash
from rosidl_typesupport_c import generate_c as generate_typesupport_c
from rosidl_typesupport_fastrtps_c import generate_typesupport_fastrtps_c
from rosidl_typesupport_introspection_c import generate_c as generate_introspection

PACKAGE = "tf2_msgs"
NEEDS = (
    "action_msgs",
    "builtin_interfaces",
    "geometry_msgs",
    "service_msgs",
    "std_msgs",
    "unique_identifier_msgs",
)
SOURCES = Path(__file__).with_name(PACKAGE)
STRUCTS = "rosidl_generator_c"
PYTHON = "rosidl_generator_py"
DISPATCH = "rosidl_typesupport_c"
FAST_DDS = "rosidl_typesupport_fastrtps_c"
INTROSPECTION = "rosidl_typesupport_introspection_c"
CONVERTERS = {
    ".msg": convert_msg_to_idl,
    ".srv": convert_srv_to_idl,
    ".action": convert_action_to_idl,
}


def make(prefix: Path) -> None:
    """Put the package `tf2_msgs` beside the others of the prefix."""
    packages = Path(sysconfig.get_path("platlib", vars={"platbase": str(prefix)}))
    with TemporaryDirectory() as folder:
        work = Path(folder)
        generate(prefix, work)
        module = work / PYTHON / PACKAGE
        compile_all(prefix, work, module / f"{PACKAGE}_s__{DISPATCH}.so")
        (module / "__init__.py").touch()
        for source in module.rglob("*.c"):
            source.unlink()
        shutil.copytree(module, packages / PACKAGE, dirs_exist_ok=True)
    # Both are looked for by name.
    for kind in (FAST_DDS, INTROSPECTION):
        library = prefix / "lib" / f"lib{PACKAGE}__{kind}.so"
        library.unlink(missing_ok=True)
        library.symlink_to(packages / PACKAGE / f"{PACKAGE}_s__{DISPATCH}.so")


def generate(prefix: Path, work: Path) -> None:
    """Write the sources of each generator into a folder of its own."""
    idl = work / "idl"
    relative = [path.relative_to(SOURCES) for path in SOURCES.rglob("*.*")]
    with redirect_stdout(StringIO()):
        for path in relative:
            CONVERTERS[path.suffix](SOURCES, PACKAGE, path, idl / path.parent)
    files = [path.with_suffix(".idl") for path in relative]
    share = prefix / "share"
    arguments = {
        "package_name": PACKAGE,
        "idl_tuples": [f"{idl}:{path}" for path in files],
        "ros_interface_dependencies": [
            f"{package}:{path}" for package in NEEDS for path in (share / package).rglob("*.idl")
        ],
        "include_paths": [f"{package}:{share / package}" for package in NEEDS],
        "type_description_tuples": [f"{path}:{idl / path.with_suffix('.json')}" for path in files],
        "ros_interface_files": [str(SOURCES / path) for path in relative],
        "target_dependencies": [],
    }

    def run(generator: Any, of: str, into: Path, *more: Any) -> None:
        given = work / "arguments.json"
        template_dir = str(share / of / "resource")
        given.write_text(
            json.dumps(arguments | {"output_dir": str(into), "template_dir": template_dir})
        )
        for path in files:
            (into / path.parent / "detail").mkdir(parents=True, exist_ok=True)
        generator(str(given), *more)

    def folder(generator: str) -> Path:
        return work / generator / PACKAGE

    run(generate_type_hash, "rosidl_generator_type_description", idl)
    run(generate_c, STRUCTS, folder(STRUCTS))
    run(generate_typesupport_fastrtps_c, FAST_DDS, folder(FAST_DDS))
    run(generate_introspection, INTROSPECTION, folder(INTROSPECTION))
    run(generate_typesupport_c, DISPATCH, folder(DISPATCH), [FAST_DDS, INTROSPECTION])
    run(generate_py, PYTHON, folder(PYTHON), [DISPATCH])
    for generator in (STRUCTS, FAST_DDS, INTROSPECTION):
        header = f"{generator}__visibility_control.h"
        template = (share / generator / "resource" / f"{header}.in").read_text()
        text = template.replace("@PROJECT_NAME@", PACKAGE)
        text = text.replace("@PROJECT_NAME_UPPER@", PACKAGE.upper())
        (folder(generator) / "msg" / header).write_text(text)


def compile_all(prefix: Path, work: Path, module: Path) -> None:
    """Make one extension module of all sources."""
    includes = [*work.glob("rosidl_*"), sysconfig.get_path("include"), np.get_include()]
    includes += [prefix / "include", *(prefix / "include").iterdir()]
    flags = ["-O1", "-fPIC", "-w", *(f"-I{path}" for path in includes)]

    def compile_one(source: Path) -> Path:
        kind = ["gcc", "-std=c11"] if source.suffix == ".c" else ["g++", "-std=c++17"]
        result = work / f"{'_'.join(source.relative_to(work).parts)}.o"
        subprocess.run([*kind, *flags, "-c", source, "-o", result], check=True)
        return result

    sources = [path for path in work.rglob("*.c*") if path.suffix in {".c", ".cpp"}]
    with ThreadPoolExecutor(os.cpu_count()) as several:
        objects = list(several.map(compile_one, sources))
    kinds = (STRUCTS, PYTHON, DISPATCH, FAST_DDS, INTROSPECTION)
    libraries = [f"{package}__{kind}" for package in NEEDS for kind in kinds]
    libraries += ["rosidl_runtime_c", DISPATCH, FAST_DDS, INTROSPECTION]
    libraries += ["rosidl_typesupport_fastrtps_cpp", "rmw", "rcutils", "fastcdr"]
    link = [f"-l{name}" for name in libraries if (prefix / "lib" / f"lib{name}.so").exists()]
    # Those libraries need others of the prefix, which are found when it is loaded.
    link += [f"-L{prefix / 'lib'}", "-Wl,--allow-shlib-undefined"]
    subprocess.run(["g++", "-shared", *map(str, objects), "-o", str(module), *link], check=True)


if __name__ == "__main__":
    make(Path(sys.argv[1]))
