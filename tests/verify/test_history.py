"""The format of histories; errors name the line and the reason."""

from __future__ import annotations

import json
import random
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tfdb_measure.verify import (
    HistoryError,
    Read,
    Transaction,
    Unseen,
    Write,
    check,
    load_history,
    parse_history,
)
from verify.serial import Shape, random_history

if TYPE_CHECKING:
    from pathlib import Path

UNSEEN = Unseen.UNSEEN
HEADER = '{"tfdb_history": 1, "engine": "silo"}'
GOOD: dict[str, Any] = {
    "process": 0,
    "thread": 2,
    "id": "2-17",
    "begin": 120,
    "end": 190,
    "status": "committed",
    "reads": [
        {"edge": "base", "kind": "latest", "value": 41},
        {"edge": "arm", "kind": "at", "stamp": 30, "before": 17, "after": None, "own": 1},
        {"edge": "tool", "value": None},
        {"edge": "tool", "kind": "at", "stamp": 30, "after": "v"},
    ],
    "writes": [
        {"edge": "base", "value": 57, "stamp": 40, "parent": "map"},
        {"edge": "tool", "value": "58", "op": "remove"},
    ],
    "commit": 9,
    "as_of": 8,
}


def parse(*bodies: Any) -> list[Transaction]:
    return parse_history([HEADER, *(json.dumps(body) for body in bodies)], "run.jsonl").transactions


def refuse(*bodies: Any, line: int = 2) -> str:
    with pytest.raises(HistoryError) as caught:
        parse(*bodies)
    error = caught.value
    assert (error.path, error.line) == ("run.jsonl", line)
    assert str(error) == f"run.jsonl:{line}: {error.reason}"
    return str(error.reason)


def test_every_field() -> None:
    (one,) = parse(GOOD)
    assert one == Transaction(
        "2-17",
        120,
        190,
        (
            Read("base", None, 41),
            Read("arm", 30, 17, None, 1),
            Read("tool", None, None),
            Read("tool", 30, UNSEEN, "v"),
        ),
        (Write("base", 57, 40, "map"), Write("tool", "58", None, None, True)),
        "committed",
        0,
        2,
        9,
        8,
        2,
    )


def test_the_header_is_kept_and_empty_lines_are_skipped(tmp_path: Path) -> None:
    path = tmp_path / "run.jsonl"
    path.write_text(f"{HEADER}\n\n{json.dumps(GOOD)}\n\n", encoding="utf-8")
    history = load_history(path)
    assert history.header["engine"] == "silo"
    assert len(history.transactions) == 1


@pytest.mark.parametrize(
    "text", ["", "{}", "[1]", "no", '{"tfdb_history": 2}', '{"tfdb_history": true}', "[" * 100_000]
)
def test_without_its_header(text: str) -> None:
    with pytest.raises(HistoryError) as caught:
        parse_history([text], "run.jsonl")
    assert caught.value.line == 1


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"begin": None}, "begin None is not an integer"),
        ({"begin": 1.5}, "begin 1.5 is not an integer"),
        ({"begin": True}, "begin True is not an integer"),
        ({"begin": 191}, "ends at 190, before it begins at 191"),
        ({"status": "done"}, "status 'done' is none of committed, aborted, unknown"),
        ({"id": None}, "id None is neither text nor integer"),
        ({"id": 1.0}, "id 1.0 is neither text nor integer"),
        ({"thread": "a"}, "thread 'a' is not an integer"),
        ({"commit": "9"}, "commit '9' is not an integer"),
        ({"as_of": []}, "as_of [] is not an integer"),
        ({"reads": {}}, "reads is not a list: {}"),
        ({"reads": [7]}, "a read that is not a JSON object: 7"),
        ({"reads": [{"value": 1}]}, "edge None of a read is not a text"),
        ({"reads": [{"edge": "a"}]}, "without its value"),
        ({"reads": [{"edge": "a", "value": [1]}]}, "value [1] is neither text nor integer"),
        ({"reads": [{"edge": "a", "kind": "any", "value": 1}]}, "kind 'any' is neither"),
        ({"reads": [{"edge": "a", "kind": "at", "stamp": 3}]}, "with neither before nor after"),
        ({"reads": [{"edge": "a", "kind": "at", "before": 3}]}, "no stamp"),
        ({"reads": [{"edge": "a", "value": 1, "own": 3}]}, "own 3 is not a number from 0 to 2"),
        ({"writes": None}, "writes is not a list: None"),
        ({"writes": [{"edge": "a"}]}, "value of a write None is neither"),
        ({"writes": [{"edge": "a", "value": 1, "op": "make"}]}, "op 'make' is neither"),
        ({"writes": [{"edge": "a", "value": 1, "parent": 4}]}, "parent 4 is not a text"),
        ({"writes": [{"edge": "a", "value": 1, "stamp": "x"}]}, "stamp 'x' is not an integer"),
    ],
)
def test_refused(change: dict[str, Any], reason: str) -> None:
    body = {**GOOD, "reads": [], **change}
    assert reason in refuse(body)


def test_missing_keys_are_named() -> None:
    for key in ("begin", "end", "process", "thread"):
        assert refuse({k: v for k, v in GOOD.items() if k != key}) == f"no {key}"


def test_no_json() -> None:
    with pytest.raises(HistoryError, match=r"run.jsonl:3: no JSON object"):
        parse_history([HEADER, json.dumps(GOOD), "{..."], "run.jsonl")
    assert refuse(5) == "no JSON object"


def test_twice_the_same() -> None:
    later = {**GOOD, "begin": 300, "end": 400}
    assert refuse(GOOD, later, line=3) == "id '2-17' is already that of line 2"
    again = {**later, "id": "2-18", "reads": []}
    assert refuse(GOOD, again, line=3) == "value 57 was already written in line 2"


def test_one_thread_does_one_thing_at_a_time() -> None:
    other = {**GOOD, "id": "x", "begin": 150, "reads": [], "writes": []}
    assert refuse(GOOD, other, line=3) == "thread 2 begins 'x' before it has ended '2-17'"
    assert len(parse(GOOD, {**other, "process": 1})) == 2


@given(st.binary(max_size=200))
def test_any_bytes_are_read_or_refused(data: bytes) -> None:
    try:
        parse_history([HEADER, *data.split(b"\n")])
    except HistoryError as error:
        assert error.line


@given(
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.text(max_size=5),
        lambda inner: (
            st.lists(inner, max_size=3)
            | st.dictionaries(st.sampled_from([*GOOD, "edge", "value", "stamp"]), inner, max_size=6)
        ),
    )
)
def test_any_json_is_read_or_refused(body: Any) -> None:
    changed = {**GOOD, **body} if isinstance(body, dict) else body
    try:
        parse(changed)
    except HistoryError as error:
        assert error.line == 2


def written(one: Transaction) -> str:
    """The transaction as a line."""
    reads: list[dict[str, Any]] = []
    for read in one.reads:
        item: dict[str, Any] = {"edge": read.edge, "own": read.own}
        if read.stamp is None:
            item |= {"kind": "latest", "value": read.before}
        else:
            item |= {"kind": "at", "stamp": read.stamp}
            sides = {"before": read.before, "after": read.after}
            item |= {side: value for side, value in sides.items() if value is not UNSEEN}
        reads.append(item)
    writes = [
        {"edge": w.edge, "value": w.value, "stamp": w.stamp, "op": "remove" if w.remove else "set"}
        for w in one.writes
    ]
    body = {
        **{key: getattr(one, key) for key in ("process", "thread", "id", "begin", "end")},
        **{key: getattr(one, key) for key in ("status", "commit")},
        "reads": reads,
        "writes": writes,
    }
    return json.dumps(body)


def test_a_written_history_is_read_back_and_judged() -> None:
    shape = Shape(300, stamps=50, at=0.5, own=0.2, removals=0.05)
    made = random_history(random.Random(3), shape)
    history = parse_history([HEADER, *map(written, made)])
    for one in history.transactions:
        one.line = None
    assert history.transactions == made
    assert check(history).serializable is True
