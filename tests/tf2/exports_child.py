"""Prints what modules offer: `exports_child.py [--tfdb] MODULE ...`.

`--tfdb`: after `tfdb.tf2.install()`. JSON: by module its names in `dir()`, and those that a star
import gives; without dunder names and features of `__future__`. A module that cannot be imported
is left out. Knows nothing of the tests.
"""

import __future__

import importlib
import json
import sys


def counted(names, module):
    return sorted(
        name
        for name in names
        if not name.startswith("__") and not isinstance(getattr(module, name), __future__._Feature)
    )


def main():
    arguments = sys.argv[1:]
    if arguments[0] == "--tfdb":
        from tfdb import tf2

        tf2.install()
        arguments = arguments[1:]
    found = {}
    for name in arguments:
        try:
            module = importlib.import_module(name)
        except ImportError:
            continue
        star = {}
        exec(f"from {name} import *", star)
        found[name] = {"dir": counted(dir(module), module), "star": counted(star, module)}
    json.dump(found, sys.stdout)


main()
