"""The bindings call only what Python's stable ABI has, for the wheel for 3.12 and later.

The checkout of another Python compiles with all of its headers, and does not see the difference.
"""

from __future__ import annotations

import re
from pathlib import Path

import abi3info
from abi3info.models import PyVersion

BINDINGS = Path(__file__).resolve().parents[2] / "bindings"
FUNCTIONS = {symbol.name: function.added for symbol, function in abi3info.FUNCTIONS.items()}
# Macros of the stable ABI that are made of its functions.
MACROS = re.compile(r"Py[A-Za-z]+_(Check|CheckExact|TypeCheck|New|NewVar)|PyInit_\w+")
# What only other wheels compile: up to `#else` or `#endif`, or from there on.
OTHERS = re.compile(
    r"#ifndef Py_LIMITED_API\n.*?(?=#else|#endif)"
    r"|#if defined\(Py_LIMITED_API\)\n(?P<ours>.*?)#(?:elif|else).*?(?=#endif)",
    re.DOTALL,
)


def strangers(text: str) -> list[str]:
    """What a source calls or looks into that the stable ABI of Python 3.12 does not have."""
    text = re.sub(r"//.*", "", text)
    text = OTHERS.sub(lambda found: found["ours"] or "", text)
    called = re.findall(r"\b_?Py[A-Z][a-z]\w*_\w+(?=\()", text)
    unknown = [
        name
        for name in called
        if not MACROS.fullmatch(name) and FUNCTIONS.get(name, PyVersion(99, 0)) > PyVersion(3, 12)
    ]
    return unknown + re.findall(r"->(?:tp|ob|nb|sq|mp)_\w+", text)


def test_a_stranger_is_found() -> None:
    assert strangers("auto* name = Py_TYPE(x)->tp_name;") == ["->tp_name"]
    assert strangers("f(PyObject_CallOneArg(f, x)); PyObject_CallNoArgs(f);") == [
        "PyObject_CallOneArg"
    ]
    assert strangers("PyUnicode_EqualToUTF8(x, y)") == ["PyUnicode_EqualToUTF8"]  # since 3.13
    assert strangers("PyList_Check(x); PyTuple_Size(x); PyType_GetName(x);  // x->ob_type") == []


def test_code_of_other_wheels_is_not_checked() -> None:
    limited = "#if defined(Py_LIMITED_API)\nPyTuple_Size(x);\n#else\nPyTuple_GET_ITEM(x);\n#endif\n"
    assert strangers(limited) == []
    assert strangers(limited.replace("Size", "GET_SIZE")) == ["PyTuple_GET_SIZE"]
    assert strangers("#ifndef Py_LIMITED_API\nx->tp_name;\n#else\ny->tp_call;\n#endif\n") == [
        "->tp_call"
    ]


def test_the_bindings_call_none() -> None:
    sources = sorted(BINDINGS.rglob("*.?pp"))
    assert sources
    found = {path.name: strangers(path.read_text(encoding="utf-8")) for path in sources}
    assert {name: names for name, names in found.items() if names} == {}
