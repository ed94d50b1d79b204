"""The tree obeys layers.toml, and the checks find planted violations."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.architecture import cpp_source, layers

ROOT = Path(__file__).resolve().parents[2]


def test_the_tree_obeys_its_map() -> None:
    found = layers.violations(ROOT)
    assert not found, "\n" + "\n".join(str(violation) for violation in found)


def test_every_room_of_the_map_exists_or_is_spelled_right() -> None:
    rooms = layers.load_map(ROOT)["core"]["rooms"]
    for room, uses in rooms.items():
        assert set(uses) <= set(rooms), f"{room} uses a room that is not on the map"
        assert room not in uses


def test_the_map_has_no_cycle() -> None:
    rooms = layers.load_map(ROOT)["core"]["rooms"]
    placed: set[str] = set()
    while len(placed) < len(rooms):
        ready = {room for room, uses in rooms.items() if set(uses) <= placed} - placed
        assert ready, f"a cycle among {sorted(set(rooms) - placed)}"
        placed |= ready


def imports_within(room: Path) -> dict[str, set[str]]:
    """What each module directly in a room imports of the others, for type checkers too."""
    names = {path.stem for path in room.glob("*.py")} - {"__init__"}
    package = room.relative_to(ROOT / "src").parts
    found: dict[str, set[str]] = {}
    for name in names:
        text = (room / f"{name}.py").read_text(encoding="utf-8")
        modules = [each.module.split(".") for each in layers.python_imports(text, package)]
        inside = {
            parts[2] for parts in modules if len(parts) > 2 and (parts[0], parts[1]) == package
        }
        found[name] = inside & names
    return found


def circle(imports: dict[str, set[str]]) -> set[str]:
    """The modules that cannot be put in an order in which each comes after those it imports."""
    left = dict(imports)
    while ready := [name for name, others in left.items() if not others & set(left)]:
        for name in ready:
            del left[name]
    return set(left)


def test_no_modules_of_a_room_import_each_other_in_a_circle() -> None:
    rooms = [path.parent for path in (ROOT / "src" / "tfdb").glob("*/__init__.py")]
    assert len(rooms) > 10
    # Commands and tf2's classes name each other's types.
    found = {each.name: circle(imports_within(each)) for each in rooms}
    del found["cli"], found["tf2"]
    assert {room: names for room, names in found.items() if names} == {}
    imports = imports_within(ROOT / "src" / "tfdb" / "data")
    assert circle({**imports, "errors": {"types"}}) >= {"errors", "stamps", "types"}


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """Make a small tree that obeys the real map."""
    shutil.copy(ROOT / "layers.toml", tmp_path)
    files = {
        "core/tfdb/base/ids.hpp": "#pragma once\n",
        "core/tfdb/sync/word.hpp": "#include <atomic>\nauto order = std::memory_order_relaxed;\n",
        "core/tfdb/wire/cdr.hpp": '#include "tfdb/base/ids.hpp"\n',
        "bindings/module.cpp": '#include <nanobind/nanobind.h>\n#include "tfdb/store/x.hpp"\n',
        "bindings/tf2/calls.cpp": '#include "tf2/calls.hpp"\n',
        "bindings/tf2/calls.hpp": "#pragma once\n",
        "src/tfdb/__init__.py": "import numpy\nfrom tfdb._core import Buffer\n",
        "src/tfdb/recordings/__init__.py": "from tfdb.data import errors\n",
        "measure/against/groups.hpp": "#pragma once\n",
        "measure/tf2/tf2.hpp": "#pragma once\n",
    }
    for name, text in files.items():
        write(tmp_path / name, text)
    return tmp_path


def write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


def test_a_clean_tree_is_clean(tree: Path) -> None:
    assert layers.violations(tree) == []


LONG_CPP = "int f(int x) {\n" + "    x += 1;\n" * 60 + "    return x;\n}\n"
LONG_PYTHON = "def f(x: int) -> int:\n" + "    x += 1\n" * 60 + "    return x\n"

SEEDED = [
    ("layer", "core/tfdb/wire/bad.hpp", '#include "tfdb/store/buffer.hpp"\n'),
    ("layer", "core/tfdb/store/bad.cpp", '#include "tfdb/store/naive_model.hpp"\n'),
    ("layer", "core/tfdb/wire/bad.test.cpp", '#include "tfdb/graph/names.hpp"\n'),
    ("unknown-room", "core/tfdb/attic/bad.hpp", "#pragma once\n"),
    ("unknown-room", "core/tfdb/wire/bad.hpp", '#include "tfdb/attic/old.hpp"\n'),
    ("word", "core/tfdb/graph/bad.cpp", "x.load(std::memory_order_acquire);\n"),
    ("word", "core/tfdb/graph/bad.cpp", "std::mutex lock;\n"),
    ("header", "core/tfdb/graph/bad.cpp", "#include <thread>\n"),
    ("header", "core/tfdb/graph/bad.cpp", "#include <atomic>\n"),
    ("class-header", "core/tfdb/graph/bad.hpp", "// A thing.\nclass Bad {\n    int x;\n};\n"),
    ("function-length", "core/tfdb/graph/bad.cpp", LONG_CPP),
    ("file-length", "core/tfdb/graph/bad.cpp", "int x;\n" * 1001),
    ("layer", "bindings/bad.cpp", '#include "tfdb/history/ring.hpp"\n'),
    ("third-party", "bindings/bad.cpp", "#include <boost/python.hpp>\n"),
    ("layer", "src/tfdb/bad.py", "from tfdb.cli import app\n"),
    ("layer", "src/tfdb/bad.py", "from tfdb import cli\n"),
    ("layer", "src/tfdb/recordings/bad.py", "from ..cli import app\n"),
    ("layer", "src/tfdb/tf2/bad.py", "def f():\n    import tfdb.recordings\n"),
    ("layer", "src/tfdb/data/bad.py", "if TYPE_CHECKING:\n    from tfdb.store import report\n"),
    ("third-party", "src/tfdb/bad.py", "import rosbags\n"),
    ("third-party", "src/tfdb/bad.py", "def f():\n    from scipy import spatial\n"),
    ("unknown-room", "src/tfdb/attic/bad.py", "x = 1\n"),
    ("function-length", "src/tfdb/bad.py", LONG_PYTHON),
    ("file-length", "src/tfdb/bad.py", "x = 1\n" * 1001),
    ("third-party", "src/tfdb/plot/bad.py", "import tfdb_measure\n"),
    ("third-party", "measure/against/bad.cpp", "#include <tf2/buffer_core.h>\n"),
    ("layer", "measure/workload/bad.hpp", '#include "tfdb/txn/commit.ipp"\n'),
    ("layer", "measure/tf2/bad.cpp", '#include "tfdb/store/buffer.hpp"\n'),
    ("layer", "measure/workload/bad.hpp", '#include "against/groups.hpp"\n'),
    ("unknown-room", "measure/attic/bad.cpp", "int x;\n"),
    ("layer", "measure/tfdb_measure/bad.py", "from tfdb.recordings import loading\n"),
    ("third-party", "measure/tfdb_measure/bad.py", "import rich\n"),
    ("function-length", "measure/tfdb_measure/bad.py", LONG_PYTHON),
]


def test_a_room_that_uses_a_later_one_is_caught(tree: Path) -> None:
    path = tree / "layers.toml"
    text = path.read_text(encoding="utf-8").replace("\ndata = []", '\ndata = ["store"]')
    write(path, text)
    assert [violation.rule for violation in layers.violations(tree)] == ["circle"]


@pytest.mark.parametrize(
    ("rule", "name", "text"), SEEDED, ids=[f"{rule}-{i}" for i, (rule, _, _) in enumerate(SEEDED)]
)
def test_a_seeded_violation_is_caught(tree: Path, rule: str, name: str, text: str) -> None:
    write(tree / name, text)
    found = layers.violations(tree)
    assert [(violation.rule, violation.path) for violation in found] == [(rule, name)]


ALLOWED = [
    ("core/tfdb/graph/good.cpp", "// memory_order is written in sync\n"),
    ("core/tfdb/txn/good.sched.cpp", '#include "tfdb/store/naive_model.hpp"\n'),
    ("core/tfdb/graph/good.test.cpp", '#include <thread>\n#include "tfdb/testing/check.hpp"\n'),
    (
        "core/tfdb/graph/good.hpp",
        "/// A.\n/// Threads: any.\n/// Guarantee: none.\nclass A {\n};\n",
    ),
    ("core/tfdb/graph/good.hpp", "class Forward;\ntemplate <class T> void f(T);\n"),
    ("src/tfdb/good.py", "def load():\n    from tfdb.recordings import loading\n"),
    ("src/tfdb/cli/checkout_only.py", "import tfdb_measure\n"),
    ("measure/tf2/good.cpp", "#include <tf2/buffer_core.h>\n"),
    ("measure/workload/good.hpp", '#include "tf2/tf2.hpp"\n#include "tfdb/store/buffer.hpp"\n'),
    ("measure/tfdb_measure/command.py", "import click\nfrom tfdb.cli import output\n"),
    ("src/tfdb/cli/good.py", "import click\nfrom tfdb.recordings import loading\n"),
    ("src/tfdb/good.py", 'def f():\n    """' + "Long.\n" * 70 + '"""\n'),
]


@pytest.mark.parametrize(("name", "text"), ALLOWED, ids=range(len(ALLOWED)))
def test_allowed_uses_pass(tree: Path, name: str, text: str) -> None:
    write(tree / name, text)
    assert layers.violations(tree) == []


CPP = """\
#define OPEN {
namespace a {
template <class T>
class B final : public C {
public:
    B(int x) : x_{x}, y_{'{'} {
        f("}");
    }
    int g() const { return [this] { return x_; }(); }
    int table_[2] = {1, 2};
};
enum class Kind { kA, kB };
template <typename T>
auto h(struct tm* t) -> T {
    if (t) {
        return R"(})";
    }
    return 1'000;  // }
}
}
"""


def test_functions_and_classes_are_found_with_their_lines() -> None:
    found = [(b.kind, b.name, b.first, b.last) for b in cpp_source.blocks(CPP)]
    assert found == [
        ("function", "B", 6, 8),
        ("function", "g", 9, 9),
        ("class", "B", 3, 11),
        ("function", "h", 13, 19),
    ]
