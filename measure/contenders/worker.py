"""One contender in a process of its own; tfdb_measure gives it turns.

    python worker.py CONTENDER

Requests come as lines of JSON, answers go out likewise:

    {"do": "setup", "chain": 4, "samples": 11000}        -> {"operations": [...]}
    {"do": "values", "stamps": [...]}                    -> {"poses": [[x y z qx qy qz qw], ...]}
    {"do": "time", "operation": "lookup mid", "count": N} -> {"ns": per operation, "count": N}
    {"do": "call", "function": "load", "arguments": [..]} -> whatever the function returns
    {"do": "begin", "function": "look_up", "per_s": 100}  -> null; it goes on in a thread
    {"do": "end"}                                         -> {"per_s": done, "cpu": percent}

Times are CPU time of this process, so other processes on the core do not count.
"""

from __future__ import annotations

import gc
import importlib
import json
import sys
import time
from typing import Any

from paced import Paced


def timed(contender: Any, operation: str, count: int) -> dict[str, float]:
    """Nanoseconds per operation over `count` of them; a batch of N stamps counts as N."""
    run = contender.operations[operation]
    gc.collect()
    gc.disable()
    start = time.process_time_ns()
    done = run(count) or count
    took = time.process_time_ns() - start
    gc.enable()
    return {"ns": took / done, "count": done}


def answer(contender: Any, request: dict[str, Any]) -> Any:
    """Does what one request asks."""
    match request["do"]:
        case "setup":
            contender.setup(request["chain"], request["samples"])
            return {"operations": list(contender.operations)}
        case "values":
            return {"poses": [list(map(float, contender.pose(s))) for s in request["stamps"]]}
        case "time":
            return timed(contender, request["operation"], request["count"])
        case "call":
            return getattr(contender, request["function"])(*request["arguments"])
        case "begin":
            contender.paced = Paced(getattr(contender, request["function"]), request["per_s"])
            return None
        case "end":
            return contender.paced.end()
        case unknown:
            raise ValueError(unknown)


def main() -> None:
    # Output of the contenders themselves must not mix with the answers.
    answers = sys.stdout
    sys.stdout = sys.stderr
    contender = importlib.import_module(f"with_{sys.argv[1]}").Contender()
    for line in sys.stdin:
        answers.write(json.dumps(answer(contender, json.loads(line))) + "\n")
        answers.flush()


if __name__ == "__main__":
    main()
