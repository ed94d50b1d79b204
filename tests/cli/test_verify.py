"""`tfdb verify`: results, exit codes, unreadable histories."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pathlib import Path

    from conftest import Tool


def operation(name: str, begin: int, end: int, **more: Any) -> dict[str, Any]:
    body = {"process": 0, "thread": sum(map(ord, name)), "id": name, "begin": begin, "end": end}
    return {**body, "status": "committed", **more}


def history(folder: Path, *operations: dict[str, Any]) -> Path:
    path = folder / "run.jsonl"
    lines = [{"tfdb_history": 1, "engine": "silo"}, *operations]
    path.write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8")
    return path


FIRST = operation("first", 1, 2, writes=[{"edge": "a", "value": 1}, {"edge": "b", "value": 2}])
BATCH = operation("batch", 3, 9, writes=[{"edge": "a", "value": 3}, {"edge": "b", "value": 4}])
WHOLE = operation("whole", 4, 8, reads=[{"edge": "a", "value": 3}, {"edge": "b", "value": 4}])
HALF = operation("half", 4, 8, reads=[{"edge": "a", "value": 3}, {"edge": "b", "value": 2}])


def test_a_good_history(tool: Tool, tmp_path: Path) -> None:
    done = tool("verify", history(tmp_path, FIRST, BATCH, WHOLE))
    assert "strictly serializable: 3 transactions, 3 of them committed" in done.out
    body = tool("verify", history(tmp_path, FIRST, BATCH, WHOLE), "--json").json
    assert body["serializable"] is True
    assert body["header"]["engine"] == "silo"
    assert (body["transactions"], body["reads"], body["writes"]) == (3, 2, 4)
    assert body["anomalies"] == []


def test_a_torn_batch(tool: Tool, tmp_path: Path) -> None:
    path = history(tmp_path, FIRST, BATCH, HALF)
    done = tool("verify", path, code=1)
    assert "torn_batch (1): a reader that saw some writes of a commit" in done.out
    assert "half saw 3 of a, written by batch" in done.out
    assert "half saw 2 of b, not 4, which batch wrote" in done.out
    assert "not strictly serializable" in done.out
    body = tool("verify", path, "--json", code=1).json
    assert body["serializable"] is False
    (anomaly,) = body["anomalies"]
    assert anomaly["name"] == "torn_batch"
    assert set(anomaly["transactions"]) == {"half", "batch"}


def test_undecided_does_not_pass(tool: Tool, tmp_path: Path) -> None:
    writers = [
        operation(f"w{i}", 3, 99, thread=i, writes=[{"edge": "a", "value": 10 + i}])
        for i in range(6)
    ]
    readers = [
        operation(
            f"r{i}", 20 - 2 * i, 21 - 2 * i, thread=10 + i, reads=[{"edge": "a", "value": 10 + i}]
        )
        for i in range(4)
    ]
    path = history(tmp_path, FIRST, *writers, *readers)
    assert tool("verify", path).code == 0
    done = tool("verify", path, "--steps", 2, code=1)
    assert "undecided: 11 transactions" in done.out
    body = tool("verify", path, "--steps", 2, "--json", code=1).json
    assert body["serializable"] is None
    assert "order of writes to a" in body["undecided"]


def test_errors(tool: Tool, tmp_path: Path) -> None:
    path = history(tmp_path, {**FIRST, "begin": "x"})
    done = tool("verify", path, code=2)
    assert done.error == f"{path}:2: begin 'x' is not an integer"
    done = tool("verify", path, "--json", code=2)
    body = done.json
    assert body["error"]["type"] == "HistoryError"
    assert body["error"]["fields"]["line"] == 2
    assert "did you mean" in tool("verify", tmp_path / "run.json", code=2).error
    path.write_bytes(b"\x00\xff binary")
    assert "no history: the first line" in tool("verify", path, code=2).error
    assert "--steps" in tool("verify", path, "--steps", 0, code=2).error
