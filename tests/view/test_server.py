"""The server of the page: what viewers get, what they may ask, whom it serves."""

from __future__ import annotations

import json
import os
import random
import re
import socket
from contextlib import ExitStack, suppress
from typing import TYPE_CHECKING

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

import tfdb
from tests.view.served import PATIENCE, Served, Viewer, serving
from tfdb.cli.graph import Live
from tfdb.judging import Event, Expectation
from tfdb.judging.events import EVENT_KINDS
from tfdb.view import server
from tfdb.view.metrics import Metric, write_metrics
from tfdb.view.model import Model

if TYPE_CHECKING:
    from collections.abc import Iterator

S = 1_000_000_000
T0 = 100 * S
TURN = (0.0, 0.6, 0.0, 0.8)
FILES = ("", "app.js", "scene.js", "shapes.js", "tree.js", "three.js", "style.css", "favicon.svg")


def robot() -> tfdb.Buffer:
    """A base that moves on a map, a camera on it, and an arm."""
    buf = tfdb.Buffer(history=60)
    buf.set_static_transform("base", "camera", (0.2, 0.0, 1.1), TURN, authority="urdf")
    for step in range(20):
        buf.set_transforms(
            [
                tfdb.TransformStamped("map", "base", T0 + step * S // 10, (step, 0, 0), TURN),
                tfdb.TransformStamped("base", "arm", T0 + step * S // 10, (0, step, 0), TURN),
            ],
            authority="ekf",
        )
    return buf


@pytest.fixture
def buf() -> tfdb.Buffer:
    return robot()


@pytest.fixture
def served(buf: tfdb.Buffer) -> Iterator[Served]:
    with serving(Model(buf, "shm:robot", live=Live(buf))) as made:
        yield made


def test_a_viewer_gets_the_source_the_tree_all_poses_and_the_facts(served: Served) -> None:
    with served.connect() as viewer:
        hello = viewer.receive()
        assert (hello["type"], hello["source"], hello["live"]) == ("hello", "shm:robot", True)
        tree = viewer.receive()
        assert tree["names"] == ["map", "base", "arm", "camera"]
        assert tree["parents"] == [-1, 0, 1, 1]
        assert tree["static"] == {"3": [0.2, 0.0, 1.1, 0.0, 0.6, 0.0, 0.8]}
        whole = viewer.receive()
        assert (whole.kind, whole.topology, whole.rows) == (2, tree["topology"], [1, 2])
        assert viewer.pose_of(whole, "base")[:3] == [19, 0, 0]
        facts = viewer.receive()
        assert facts["rows"] == [1, 2]
        assert facts["newest"] == [str(T0 + 19 * S // 10)] * 2
        assert facts["rate"] == [1000, 1000]  # hundredths of Hz
        assert facts["gap"] == [1000, 1000]  # tenths of ms
        assert (facts["start"], facts["end"]) == (str(T0), str(T0 + 19 * S // 10))
        names = [facts["authorities"][each] for each in facts["authority"]]
        assert names == ["", "ekf", "ekf", "urdf"]


def test_only_changed_edges_are_sent_after_a_commit(buf: tfdb.Buffer, served: Served) -> None:
    with served.connect() as viewer:
        viewer.until_text("facts")
        buf.set_transform("base", "arm", T0 + 3 * S, (0, 7, 0), TURN)
        poses = viewer.until_poses()
        assert (poses.kind, poses.rows) == (1, [2])
        assert viewer.pose_of(poses, "arm")[:3] == [0, 7, 0]


def test_nothing_is_sent_while_no_commit_comes(served: Served) -> None:
    with served.connect() as viewer:
        viewer.until_text("facts")
        before = served.metrics()
        with pytest.raises(TimeoutError):
            viewer.connection.recv(timeout=1.0)
        assert served.metrics()["sent_bytes_total"] == before["sent_bytes_total"]


def test_frames_that_come_go_and_move_make_a_new_tree_and_an_event(
    buf: tfdb.Buffer, served: Served
) -> None:
    with served.connect() as viewer:
        viewer.until_text("facts")
        buf.set_transform("map", "arm", T0 + 3 * S, (5, 5, 5), TURN)
        viewer.until_text("tree")
        assert viewer.tree["parents"] == [-1, 0, 0, 2]  # map, arm, base, camera
        assert viewer.pose_of(viewer.until_poses(), "arm")[:3] == [5, 5, 5]
        assert viewer.until_text("event")["text"] == "arm: parent base -> map"
        buf.set_static_transform("camera", "lens", (0, 0, 0.1), TURN)
        assert "lens" in viewer.until_text("tree")["names"]
        assert viewer.until_text("event")["text"] == "1 frame: 'lens'"
        buf.remove_frames("lens")
        assert "lens" not in viewer.until_text("tree")["names"]
        assert viewer.until_text("event")["kind"] == "removed"


def test_a_viewer_of_the_past_is_answered_alone(buf: tfdb.Buffer, served: Served) -> None:
    with served.connect() as viewer, served.connect() as other:
        viewer.until_text("facts")
        other.until_text("facts")
        viewer.ask("at", stamp=str(T0 + S // 20))
        past = viewer.until_poses()
        assert (past.kind, past.stamp) == (3, T0 + S // 20)
        assert viewer.pose_of(past, "base")[:3] == [0.5, 0, 0]
        buf.set_transform("map", "base", T0 + 3 * S, (30, 0, 0), TURN)
        assert other.until_poses().kind == 1
        viewer.ask("at", stamp=None)
        whole = viewer.until_poses()
        assert whole.kind == 2
        assert viewer.pose_of(whole, "base")[:3] == [30, 0, 0]


def test_poses_are_missing_where_an_edge_has_no_data(served: Served) -> None:
    with served.connect() as viewer:
        viewer.ask("at", stamp="5")
        poses = viewer.until_poses(lambda each: each.kind == 3)
        assert np.isnan(poses.poses).all()


def test_the_newest_question_counts(served: Served) -> None:
    with served.connect() as viewer:
        for step in range(400):
            viewer.ask("at", stamp=str(T0 + step * 1_000_000))
        viewer.until_poses(lambda each: each.kind == 3 and each.stamp == T0 + 399_000_000)


def test_the_tree_of_the_past_is_sent_where_it_was_another(
    buf: tfdb.Buffer, served: Served
) -> None:
    buf.set_transform("map", "arm", T0 + 3 * S, (5, 5, 5), TURN)
    with served.connect() as viewer:
        viewer.until_text("facts")
        now = viewer.tree
        viewer.ask("at", stamp=str(T0 + S))
        then = viewer.until_text("tree")
        assert then["parents"] == [-1, 0, 1, 1]
        assert viewer.until_poses().topology == then["topology"]
        viewer.ask("at", stamp=None)
        assert viewer.until_text("tree") == now


def test_a_lookup_is_answered_with_report_gaps_trail_and_python(
    buf: tfdb.Buffer, served: Served
) -> None:
    with served.connect() as viewer:
        viewer.ask("lookup", id=7, target="map", source="camera", stamp=None, trail=1)
        answer = viewer.until_text("answer")
        assert (answer["id"], answer["ok"]) == (7, True)
        assert [edge["used"] for edge in answer["edges"]] == ["static", "latest"]
        found = buf.lookup_latest_transform("map", "camera")
        assert answer["pose"] == found.pose.tolist()
        assert answer["rpy"] == found.rpy.tolist()
        assert answer["python"] == "T = buf.lookup_latest_transform('map', 'camera')"
        assert len(answer["trail"]) > 10
        stamp = str(T0 + S // 20)
        viewer.ask("lookup", id=8, target="map", source="base", stamp=stamp)
        answer = viewer.until_text("answer")
        assert answer["pose"][0] == 0.5
        assert answer["edges"][0]["before"] == str(T0)
        assert answer["gaps"]["period"] == pytest.approx(0.1)
        assert answer["python"] == f"T = buf.lookup_transform('map', 'base', {stamp})"


def ages(viewer: Viewer, stamp: int | None) -> dict[str, float]:
    """Return the ages of the edges between map and tool."""
    text = None if stamp is None else str(stamp)
    viewer.ask("lookup", id=1, target="map", source="tool", stamp=text)
    return {edge["child"]: edge["age"] for edge in viewer.until_text("answer")["edges"]}


def silent_robot(buf: tfdb.Buffer) -> tfdb.Buffer:
    """A base that goes on for 20 s after its tool has stopped."""
    for step in range(201):
        buf.set_transform("map", "base", T0 + step * S // 10, (step, 0, 0), TURN)
        if step <= 1:
            buf.set_transform("base", "tool", T0 + step * S // 10, (0, step, 0), TURN)
    return buf


def test_live_ages_count_to_now_by_the_clock_of_the_store() -> None:
    buf = silent_robot(tfdb.Buffer(history=60))
    buf.clock.pause()
    buf.clock.seek(T0 + 21 * S)
    with serving(Model(buf, "shm:robot", live=Live(buf))) as served, served.connect() as viewer:
        facts = viewer.until_text("facts")
        assert (facts["now"], facts["clock"], facts["speed"]) == (str(T0 + 21 * S), True, 0)
        assert ages(viewer, None) == {"base": 1.0, "tool": 20.9}
        assert ages(viewer, T0 + S // 20) == {"base": 0.05, "tool": 0.05}
        buf.clock.seek(T0 + 22 * S)
        buf.clock.resume()
        buf.clock.speed = 0.5
        facts = viewer.until(lambda each: isinstance(each, dict) and each.get("speed") == 0.5)
        assert int(facts["now"]) >= T0 + 22 * S


def test_live_ages_count_to_now_by_the_clock_given_to_the_buffer() -> None:
    buf = silent_robot(tfdb.Buffer(history=60, clock=lambda: T0 + 25 * S))
    with serving(Model(buf, "shm:robot", live=Live(buf))) as served, served.connect() as viewer:
        assert viewer.until_text("facts")["now"] == str(T0 + 25 * S)
        assert ages(viewer, None) == {"base": 5.0, "tool": 24.9}


def test_ages_of_a_recording_count_to_the_stamp() -> None:
    buf = silent_robot(tfdb.Buffer(history=60))
    with serving(Model(buf, "drive.mcap")) as served, served.connect() as viewer:
        assert ages(viewer, None) == {"base": 0.0, "tool": 0.0}
        assert ages(viewer, T0 + S // 20) == {"base": 0.05, "tool": 0.05}


def test_a_lookup_without_an_answer_gives_the_reason(served: Served) -> None:
    with served.connect() as viewer:
        viewer.ask("lookup", id=1, target="map", source="bsae", stamp=None)
        answer = viewer.until_text("answer")
        assert not answer["ok"]
        assert "'bsae'" in answer["text"]
        viewer.ask("lookup", id=2, target="map", source="base", stamp="5")
        assert (
            "extrapolation by 99.999999995 s into the past" in viewer.until_text("answer")["text"]
        )


def test_poses_far_from_their_parent_keep_a_tenth_of_a_millimetre() -> None:
    buf = tfdb.Buffer()
    buf.set_transform("utm", "base", T0, (431_000.12345, 5_400_000.54321, 10.0), TURN)
    with serving(Model(buf, "shm:far", live=Live(buf))) as served, served.connect() as viewer:
        pose = viewer.pose_of(viewer.until_poses(), "base")
        assert pose[:3] == pytest.approx([431_000.12345, 5_400_000.54321, 10.0], abs=1e-4)


def test_a_recording_is_shown_with_its_gaps() -> None:
    buf = robot()
    buf.set_transform("map", "base", T0 + 9 * S, (0, 0, 0), TURN)
    with serving(Model(buf, "drive.mcap", opening="buf = 1")) as served, served.connect() as viewer:
        hello = viewer.receive()
        assert not hello["live"]
        assert [event["text"] for event in hello["events"]] == ["base: no sample for 7.1 s"]
        viewer.ask("lookup", id=1, target="map", source="base", stamp=None)
        assert viewer.until_text("answer")["python"].startswith("import tfdb\n\nbuf = 1\nT = buf.")


def test_broken_expectations_are_facts_and_events(buf: tfdb.Buffer) -> None:
    expected = tfdb.Expectations([Expectation("map", "base", max_step=0.5)], clock="arrival")
    model = Model(buf, "shm:robot", live=Live(buf), expected=expected)
    with serving(model) as served, served.connect() as viewer:
        assert viewer.receive()["judged"]
        viewer.until_text("facts")
        buf.set_transform("map", "base", T0 + 3 * S, (300, 0, 0), TURN)
        event = viewer.until_text("event")
        assert (event["kind"], event["severity"], event["frame"]) == ("step", "error", "base")
        facts = viewer.until(lambda each: isinstance(each, dict) and bool(each.get("broken")))
        assert facts["broken"][0][:2] == ["base", "error"]


SAMPLE = re.compile(r'([a-z_]+)(?:\{((?:[a-z]+="(?:[^"\\\n]|\\[\\"n])*",?)+)\})? (\S+)')
LABEL = re.compile(r'([a-z]+)="((?:[^"\\\n]|\\[\\"n])*)"')


def read_metrics(text: str) -> dict[str, list[tuple[dict[str, str], float]]]:
    """Read OpenMetrics strictly: samples by metric, each after its type and its meaning."""
    assert text.endswith("# EOF\n")
    found: dict[str, list[tuple[dict[str, str], float]]] = {}
    name = kind = ""
    for line in text.removesuffix("# EOF\n").splitlines():
        if line.startswith("# TYPE "):
            _, _, name, kind = line.split()
            assert name not in found
            assert kind in ("gauge", "counter")
            found[name] = []
        elif line.startswith("#"):
            assert line.split()[:3] in (["#", "HELP", name], ["#", "UNIT", name])
        else:
            match = SAMPLE.fullmatch(line)
            assert match, line
            assert match[1] == name + ("_total" if kind == "counter" else "")
            labels = {
                key: re.sub(r"\\(.)", lambda each: "\n" if each[1] == "n" else each[1], value)
                for key, value in LABEL.findall(match[2] or "")
            }
            assert labels not in [known for known, _ in found[name]]
            found[name].append((labels, float(match[3])))
    return found


def test_metrics_count_broken_expectations_and_give_ages() -> None:
    buf = tfdb.Buffer(history=60)
    buf.clock.pause()
    buf.clock.seek(T0 + 21 * S)
    silent_robot(buf)
    expected = tfdb.Expectations([Expectation("map", "base", max_step=2)], clock="arrival")
    model = Model(buf, "shm:robot", live=Live(buf), expected=expected)
    with serving(model) as served, served.connect() as viewer:
        viewer.until_text("facts")
        buf.set_transform("map", "base", T0 + 21 * S, (300, 0, 0), TURN)
        viewer.until_text("event")
        status, headers, body = served.get("/metrics", Accept=server.OPEN_METRICS)
    assert (status, headers["Content-Type"]) == (200, server.OPEN_METRICS_TYPE)
    found = read_metrics(body.decode())
    assert found["tfdb_edge_age_seconds"] == [
        ({"parent": "map", "child": "base"}, 0.0),
        ({"parent": "base", "child": "tool"}, 20.9),
    ]
    begun = {labels["kind"]: count for labels, count in found["tfdb_expectations_begun"]}
    assert list(begun) == list(EVENT_KINDS)
    assert {kind for kind, count in begun.items() if count} == {"step"}
    broken = {
        (each["kind"], each["severity"]): count for each, count in found["tfdb_expectations_broken"]
    }
    assert {key for key, count in broken.items() if count} == {("step", "error")}
    assert found["tfdb_view_viewers"] == [({}, 1.0)]


def test_labels_of_metrics_keep_any_name(buf: tfdb.Buffer) -> None:
    names = ['say "hi"', "back\\slash", "\\n", 'end\\"', "Grüße", "a,b}"]
    for name in names:
        buf.set_transform("map", name, T0, (0, 0, 0), TURN)
    with serving(Model(buf, "shm:robot", live=Live(buf))) as served:
        _, headers, body = served.get("/metrics")
    assert headers["Content-Type"] == server.PROMETHEUS_TYPE
    found = read_metrics(body.decode())
    assert "tfdb_expectations_broken" not in found
    ages = found["tfdb_edge_age_seconds"]
    assert {labels["child"] for labels, _ in ages} == {*names, "base", "arm"}
    labels = {"text": 'one\ntwo\\n"'}
    text = write_metrics([Metric("a_b", "gauge", "Meaning.", [(labels, 1)])])
    assert read_metrics(text) == {"a_b": [(labels, 1.0)]}


def test_metrics_of_a_recording_count_its_events(buf: tfdb.Buffer) -> None:
    expected = tfdb.Expectations([Expectation("map", "base", deadline=1)])
    event = Event("deadline", "warning", True, T0, T0, "map", "base")
    with serving(Model(buf, "a.mcap", expected=expected, events=[event])) as served:
        found = read_metrics(served.get("/metrics")[2].decode())
    assert ({"kind": "deadline"}, 1.0) in found["tfdb_expectations_begun"]
    assert all(count == 0 for _, count in found["tfdb_expectations_broken"])
    assert "tfdb_edge_age_seconds" not in found


RUBBISH = [
    "",
    "no json",
    "[]",
    "null",
    "[" * 60_000,
    "9" * 60_000,
    b"\x00\x01",
    "{}",
    '{"type": 1}',
    '{"type": []}',
    '{"type": "hello"}',
    '{"type": "at"}',
    '{"type": "at", "stamp": 1}',
    '{"type": "at", "stamp": 1e999}',
    '{"type": "at", "stamp": "-1"}',
    '{"type": "at", "stamp": "1.5"}',
    '{"type": "at", "stamp": "\u0661"}',
    '{"type": "at", "stamp": "9223372036854775808"}',
    '{"type": "rate"}',
    '{"type": "rate", "hz": 0}',
    '{"type": "rate", "hz": true}',
    '{"type": "rate", "hz": 61}',
    '{"type": "lookup"}',
    '{"type": "lookup", "id": 1}',
    '{"type": "lookup", "id": "1", "target": "a", "source": "b", "stamp": null}',
    '{"type": "lookup", "id": 1, "target": 5, "source": "b", "stamp": null}',
    '{"type": "lookup", "id": 1, "target": "a", "source": "", "stamp": null}',
    '{"type": "lookup", "id": 1, "target": "a", "source": "b", "stamp": null, "trail": NaN}',
    '{"type": "lookup", "id": 1, "target": "a", "source": "b", "stamp": null, "trail": -1}',
]


def test_each_wrong_message_is_answered_and_the_viewer_stays(served: Served) -> None:
    with served.connect() as viewer:
        viewer.until_text("facts")
        for message in RUBBISH:
            viewer.connection.send(message)
            error = viewer.receive()
            assert error["type"] == "error", message
            assert len(error["text"]) < 200
        for name in ("\ud800", "a\x00b", "x" * 5000, "\u202e"):
            body = {"type": "lookup", "id": 1, "target": name, "source": name, "stamp": None}
            viewer.connection.send(json.dumps(body))
            assert not viewer.until_text("answer")["ok"]
        viewer.ask("lookup", id=2, target="map", source="base", stamp=None)
        assert viewer.until_text("answer")["ok"]


def test_random_messages_break_nothing(served: Served) -> None:
    rng = random.Random(1)
    keys = ["type", "stamp", "hz", "id", "target", "source", "trail", "x"]
    values = ["at", "lookup", "rate", None, "1", "map", "base", 1, -1, 2**70, 0.5, True, [], {}]
    with served.connect() as viewer:
        for _ in range(300):
            body = {rng.choice(keys): rng.choice(values) for _ in range(rng.randrange(7))}
            viewer.connection.send(json.dumps(body))
        viewer.ask("lookup", id=12345, target="map", source="base", stamp=None)
        viewer.until(lambda each: isinstance(each, dict) and each.get("id") == 12345)


def test_a_message_over_the_limit_ends_that_viewer_alone(served: Served) -> None:
    with served.connect() as viewer, served.connect() as other:
        with suppress(ConnectionClosed):
            viewer.connection.send("x" * (1 << 17))
            viewer.until_text("error")
        other.ask("lookup", id=1, target="map", source="base", stamp=None)
        assert other.until_text("answer")["ok"]


def test_a_viewer_that_does_not_read_misses_ticks_and_delays_no_other() -> None:
    buf = tfdb.Buffer(history=5)
    names = [f"frame_{number}" for number in range(4000)]
    poses = np.tile([0.0, 0, 0, *TURN], (len(names), 1))

    def move(step: int) -> None:
        poses[:, 0] = step
        stamps = np.full(len(names), T0 + step * 1_000_000)
        buf.set_transforms(tfdb.Columns(["map"] * len(names), names, stamps, poses))

    move(0)
    with ExitStack() as stack:
        served = stack.enter_context(serving(Model(buf, "shm:many", live=Live(buf)), hz=60))
        viewer = stack.enter_context(served.connect())
        # It takes what the sockets of both sides take, then nothing.
        lazy = stack.enter_context(served.connect(max_queue=1))
        step = 0
        while served.metrics()["dropped_total"] == 0:
            step += 1
            move(step)
            viewer.until_poses(lambda each, step=step: each.poses[0, 0] == step)
        assert step < 2000
        buf.set_static_transform("map", "extra", (1, 2, 3), TURN)
        viewer.until_text("event")
        step += 1
        move(step)
        viewer.until_poses(lambda each: each.poses[0, 0] == step)
        # It reads again: what was sent before, then the newest poses, all of them.
        last = lazy.until_poses(lambda each: each.poses[-1, 0] == step)
        assert last.kind == 2
        assert len(last.rows) == len(names)
        assert "extra" in lazy.tree["names"]
        assert lazy.until_text("event")["text"] == "1 frame: 'extra'"
        assert lazy.until_text("facts")["topology"] == last.topology


def test_a_store_without_waits_is_followed() -> None:
    buf = tfdb.Buffer(history=10, concurrency="2pl-no-wait")
    buf.set_transform("map", "base", T0, (1, 2, 3), TURN)
    with serving(Model(buf, "x", live=Live(buf))) as served, served.connect() as viewer:
        viewer.until_text("facts")
        buf.set_transform("map", "base", T0 + S, (4, 5, 6), TURN)
        poses = viewer.until_poses(lambda each: each.poses[0, 0] == 4)
        assert poses.rows == [1]


def test_a_slow_rate_gives_all_poses_in_the_end(buf: tfdb.Buffer, served: Served) -> None:
    with served.connect() as viewer:
        viewer.ask("rate", hz=2)
        viewer.ask("lookup", id=1, target="map", source="base", stamp=None)
        viewer.until_text("answer")
        for step in range(50):
            buf.set_transform("base", "arm", T0 + 3 * S + step, (0, step, 0), TURN)
        found = viewer.until_poses(lambda each: each.poses[-1, 1] == 49)
        assert (found.kind, found.rows) == (2, [1, 2])


def test_thirty_two_viewers_are_served_and_no_more(buf: tfdb.Buffer, served: Served) -> None:
    with ExitStack() as stack:
        viewers = [stack.enter_context(served.connect()) for _ in range(server.VIEWERS)]
        for viewer in viewers:
            viewer.until_text("facts")
        with pytest.raises(InvalidStatus) as refused, served.connect():
            pass
        assert refused.value.response.status_code == 503
        assert b"32 viewers are already connected" in (refused.value.response.body or b"")
        buf.set_transform("base", "arm", T0 + 3 * S, (0, 7, 0), TURN)
        assert {viewer.until_poses().kind for viewer in viewers} == {1}


def test_the_files_are_a_fixed_table(served: Served) -> None:
    for name in FILES:
        status, headers, body = served.get(name)
        assert status == 200
        assert body
        assert headers["Content-Security-Policy"].startswith("default-src 'self'")
        assert headers["X-Content-Type-Options"] == "nosniff"
    for name in ("model.py", "../model.py", "%2e%2e/model.py", "page/app.js", "app.js/", "//"):
        assert served.get(name)[0] == 404, name


@pytest.mark.parametrize("method", ["HEAD", "POST", "PUT", "DELETE", "OPTIONS"])
@pytest.mark.parametrize("path", ["/", "/metrics", "/live"])
def test_other_methods_than_get_are_refused(served: Served, path: str, method: str) -> None:
    status, headers, _ = served.get(path, method)
    assert (status, headers["Allow"]) == (405, "GET")


@pytest.mark.parametrize("host", ["evil.example", "evil.example:80", "127.0.0.1.evil.example", ""])
def test_a_foreign_host_is_refused(served: Served, host: str) -> None:
    assert served.get("/", Host=host)[0] == 403
    with pytest.raises(InvalidStatus) as refused, served.connect(additional_headers={"Host": host}):
        pass
    assert refused.value.response.status_code in (400, 403)


@pytest.mark.parametrize("host", ["localhost:1", "[::1]:8", "192.168.0.9", "Robot.local:80"])
def test_addresses_and_allowed_names_are_hosts(buf: tfdb.Buffer, host: str) -> None:
    with serving(Model(buf, "x", live=Live(buf)), names=["robot.LOCAL"]) as served:
        assert served.get("/", Host=host)[0] == 200


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "", "http://127.0.0.1", "http://localhost:1"]
)
def test_a_foreign_origin_is_refused(served: Served, origin: str) -> None:
    with (
        pytest.raises(InvalidStatus) as refused,
        served.connect(additional_headers={"Origin": origin}),
    ):
        pass
    assert refused.value.response.status_code == 403


def test_the_own_origin_is_served(served: Served) -> None:
    with served.connect(origin=served.base.removesuffix("/")) as viewer:
        assert viewer.receive()["type"] == "hello"


def test_another_address_than_loopback_demands_the_token(buf: tfdb.Buffer) -> None:
    with serving(Model(buf, "x", live=Live(buf)), host="0.0.0.0") as served:
        base, _, token = served.address.partition("?token=")
        assert len(token) >= 32
        assert base.split(":")[1] == f"//{socket.gethostname()}"
        served.address = f"http://127.0.0.1:{base.rsplit(':', 1)[1]}"
        for path in (
            "/",
            "/app.js",
            "/metrics",
            "/live",
            "/?token=",
            "/?token=wrong",
            "/?token=%ff",
        ):
            status, headers, body = served.get(path)
            assert status == 401, path
            assert "Set-Cookie" not in headers
            assert token.encode() not in body
        with pytest.raises(InvalidStatus), served.connect():
            pass
        status, headers, _ = served.get(f"/?token={token}")
        assert status == 200
        cookie = headers["Set-Cookie"]
        assert "HttpOnly" in cookie
        assert "SameSite=Strict" in cookie
        cookie = cookie.partition(";")[0]
        assert served.get("/app.js", Cookie=f"other=1; {cookie}")[0] == 200
        assert served.get("/app.js", Cookie=cookie.replace(token, token[:-1]))[0] == 401
        assert served.get("/app.js", Cookie=f"other={token}")[0] == 401
        with served.connect(additional_headers={"Cookie": cookie}) as viewer:
            assert viewer.receive()["type"] == "hello"


RAW = [
    b"",
    b"\r\n\r\n",
    b"GET / HTTP/1.1\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n",
    b"GET //[ HTTP/1.1\r\nHost: [\r\n\r\n",
    b"GET /?token=\xff HTTP/1.1\r\nHost: 127.0.0.1\r\nCookie: \xff=\xff\r\n\r\n",
    b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 5\r\n\r\nhello",
    b"GET /live HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\n\r\n",
    b"A" * 100_000,
    bytes(range(256)),
]


@pytest.mark.parametrize("data", RAW, ids=range(len(RAW)))
def test_requests_that_are_no_http_end_only_their_connection(served: Served, data: bytes) -> None:
    host, port = served.base.removeprefix("http://").rstrip("/").split(":")
    with served.connect() as viewer:
        raw = socket.create_connection((host, int(port)), PATIENCE)
        with raw, suppress(ConnectionError):
            raw.sendall(data)
            raw.shutdown(socket.SHUT_WR)
            answer = raw.recv(1000)
            assert not answer.startswith(b"HTTP/1.1 5")
            assert not answer.startswith(b"HTTP/1.1 2")
        viewer.ask("lookup", id=1, target="map", source="base", stamp=None)
        assert viewer.until_text("answer")["ok"]


def test_the_removal_of_a_store_reaches_viewers_and_ends_the_server() -> None:
    name = f"test-view-{os.getpid()}"
    with tfdb.Buffer.open(name) as robot:
        robot.set_transform("map", "base", T0, (1, 0, 0), TURN)
        live = Live(tfdb.Buffer.open(name, create=False, mode="r"))
        model = Model(live.store, f"shm:{name}", live=live)
        with serving(model, expects_error=True) as served, served.connect() as viewer:
            viewer.until_text("facts")
            tfdb.Buffer.unlink(name)
            error = viewer.until_text("error")
            assert error["ends"]
            assert name in error["text"]
            assert served.ended.wait(PATIENCE)
            assert isinstance(served.error, tfdb.errors.NoSuchStore)


def test_a_cleared_store_goes_on(buf: tfdb.Buffer, served: Served) -> None:
    with served.connect() as viewer:
        viewer.until_text("facts")
        buf.clear()
        assert np.isnan(viewer.until_poses().poses).all()
        buf.set_transform("map", "base", 5, (1, 2, 3), TURN)
        poses = viewer.until_poses(lambda each: not np.isnan(each.poses).all())
        assert viewer.pose_of(poses, "base")[:3] == [1, 2, 3]


def test_an_empty_store_is_shown_and_fills(served: Served) -> None:
    buf = tfdb.Buffer()
    with serving(Model(buf, "shm:new", live=Live(buf))) as new, new.connect() as viewer:
        assert viewer.until_text("tree")["names"] == []
        assert viewer.until_text("facts")["end"] is None
        buf.set_transform("map", "base", T0, (1, 2, 3), TURN)
        assert viewer.until_text("tree")["names"] == ["map", "base"]
