"""Sub-interpreters are refused and do not change the main one."""

from __future__ import annotations

from .child import printed_by

PROGRAM = """
import tfdb
try:
    import _interpreters as interpreters
    make = lambda: interpreters.create("legacy")
except ImportError:
    import _xxsubinterpreters as interpreters
    make = lambda: interpreters.create(isolated=False)
buf = tfdb.Buffer()
buf.set_transform("map", "base", 5, (1, 2, 3), (0, 0, 0.6, 0.8))
inner = '''
try:
    import tfdb
except ImportError as error:
    assert "main interpreter" in str(error), error
else:
    raise AssertionError("imported")
'''
for _ in range(3):
    other = make()
    failed = interpreters.run_string(other, inner)
    assert failed is None, failed
    interpreters.destroy(other)
    assert buf.lookup_transform("map", "base", 5).pose[2] == 3.0
    try:
        buf.lookup_transform("map", "nowhere", 5)
    except tfdb.UnknownFrame as error:
        assert error.frame == "nowhere"
    assert repr(tfdb.Buffer().snapshot()) == "<tfdb.Snapshot of commit 0>"
    assert buf.memory().frames == 2
print("whole")
"""


def test_the_main_interpreter_stays_whole() -> None:
    assert printed_by("-X", "faulthandler", "-c", PROGRAM) == "whole\n"
