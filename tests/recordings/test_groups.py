"""Several sources of one edge: two robots in a recording, /tf beside /tf_old, relayed topics."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import tfdb
from tfdb.recordings import Recording, containers, follow_recording

from .conftest import Message

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from .conftest import Recorder

CASES = Path(__file__).resolve().parents[1] / "cases"
ROBOTS = CASES / "two_robots.mcap"
OLD = CASES / "tf_and_tf_old.mcap"
HALF = 1_700_000_000_500_000_000
START = 1_700_000_000_000_000_000
STEP = 20_000_000
TURN = (0.0, 0.6, 0.0, 0.8)


def driven(
    topic: str,
    *,
    x: float = 0.0,
    child: str = "base",
    parent: str = "odom",
    rows: range = range(50),
    turn: Sequence[float] = TURN,
    later: int = 0,
) -> list[Message]:
    """Make messages of one edge, 20 ms and 0.1 m apart; `later` is added to the stamps (ns)."""
    return [
        Message(
            topic,
            START + row * STEP + later + 1,
            [(parent, child, START + row * STEP + later, (x + 0.1 * row, 2, 3, *turn))],
        )
        for row in rows
    ]


def printed(number: float) -> float:
    """Return a number as written with six decimals."""
    return float(f"{number:f}")


def rounded(messages: list[Message], rounding: Callable[[float], Any]) -> list[Message]:
    """Return the messages with rounded numbers in their poses."""
    return [
        replace(
            one,
            transforms=[
                (parent, child, stamp, [float(rounding(part)) for part in pose])
                for parent, child, stamp, pose in one.transforms
            ],
        )
        for one in messages
    ]


def fixed(topic: str, x: float = 1.0, child: str = "laser") -> list[Message]:
    return [Message(topic, START, [("base", child, 0, (x, 0.2, 0.3, *TURN))])]


def written(recorder: Recorder, path: Path, *parts: list[Message]) -> Path:
    """Write a bag of the messages, sorted by receive time."""
    messages = sorted((one for part in parts for one in part), key=lambda one: one.received)
    path.mkdir(exist_ok=True)
    return recorder.bag(path / "made.bag", messages)


@pytest.mark.parametrize(
    ("path", "spaces", "frames"),
    [
        (
            ROBOTS,
            {
                "/robot1": ("/robot1/tf", "/robot1/tf_static"),
                "/robot2": ("/robot2/tf", "/robot2/tf_static"),
            },
            ("base_link", "laser"),
        ),
        (OLD, {"/": ("/tf", "/tf_static"), "/tf_old": ("/tf_old",)}, ("base_link",)),
    ],
)
def test_groups_that_disagree_are_refused(
    path: Path, spaces: dict[str, tuple[str, ...]], frames: tuple[str, ...]
) -> None:
    buffer = tfdb.Buffer(history=None)
    with pytest.raises(tfdb.errors.MixedSources) as caught:
        buffer.load(path)
    error = caught.value
    assert isinstance(error, tfdb.errors.RecordingError)
    assert (error.groups, error.frames, error.path) == (spaces, frames, str(path))
    for topics in spaces.values():
        assert " with ".join(topics) in str(error)
    for way in ("topics=", "--topic", "by_namespace=True", "--by-namespace", "mix=True", "--mix"):
        assert way in str(error)
    assert buffer.commit == 0
    assert buffer.frames() == []
    assert pickle.loads(pickle.dumps(error)).groups == spaces


def test_each_way_on_leads_to_its_answer() -> None:
    one = tfdb.load(ROBOTS, topics=["/robot1/tf"])
    assert one.lookup_transform("odom", "base_link", HALF).translation[0] == pytest.approx(0.5)
    apart = tfdb.load(ROBOTS, by_namespace=True)
    found = [
        apart.lookup_transform(f"{robot}/odom", f"{robot}/base_link", HALF).translation[0]
        for robot in ("robot1", "robot2")
    ]
    assert found == pytest.approx([0.5, 50.5])
    assert apart.frame_info("robot2/laser").parent == "robot2/base_link"
    mixed = tfdb.load(ROBOTS, mix=True)
    assert mixed.frames() == ["base_link", "laser", "odom"]
    assert mixed.lookup_transform("odom", "base_link", HALF).translation[0] == pytest.approx(50.5)
    old = tfdb.load(OLD, by_namespace=True)
    assert old.frames() == ["base_link", "laser", "odom", "tf_old/base_link", "tf_old/odom"]


def test_topics_that_are_named_are_mixed_as_asked() -> None:
    assert tfdb.load(ROBOTS, topics=["/robot1/tf", "/robot2/tf"]).frames() == ["base_link", "odom"]
    renamed = tfdb.load(ROBOTS, topics={"/robot1/tf": "tf"})
    assert renamed.lookup_transform("odom", "base_link", HALF).translation[0] == pytest.approx(0.5)


def test_excluded_topics_do_not_disagree(recorder: Recorder, tmp_path: Path) -> None:
    buffer = tfdb.load(ROBOTS, exclude="/robot2/*")
    assert buffer.lookup_transform("odom", "base_link", HALF).translation[0] == pytest.approx(0.5)
    late = driven("/b/tf", x=9, rows=range(40, 60))
    path = written(recorder, tmp_path, driven("/a/tf"), late)
    with pytest.raises(tfdb.errors.MixedSources):
        tfdb.load(path)
    assert tfdb.load(path, end=START + 39 * STEP).frame_info("base").samples == 40


def test_frames_without_the_edge_do_not_disagree(recorder: Recorder, tmp_path: Path) -> None:
    path = written(
        recorder,
        tmp_path,
        driven("/a/tf"),
        driven("/b/tf", x=9),
        driven("/b/tf", child="arm", parent="rail"),
    )
    with pytest.raises(tfdb.errors.MixedSources):
        tfdb.load(path)
    assert tfdb.load(path, frames=["arm", "rail"]).frames() == ["arm", "rail"]


def test_groups_without_a_common_child_load_into_one_tree(
    recorder: Recorder, tmp_path: Path
) -> None:
    path = written(
        recorder,
        tmp_path,
        driven("/tf", child="base"),
        driven("/robot2/tf", child="robot2/base", x=5),
        fixed("/tf_static"),
    )
    buffer = tfdb.load(path)
    assert buffer.frames() == ["base", "laser", "odom", "robot2/base"]
    found = buffer.lookup_transform("base", "robot2/base", START).translation
    assert np.linalg.norm(found) == pytest.approx(5)


@pytest.mark.parametrize(
    "relay",
    [
        driven("/relay"),
        driven("/relay", rows=range(0, 50, 5)),
        driven("/relay", rows=range(10, 50)),
        driven("/relay", rows=range(10, 60)),
        driven("/robot/tf"),
        [*driven("/robot/tf"), *fixed("/robot/tf_static")],
        driven("/relay", turn=tuple(-part for part in TURN)),
        driven("/relay", x=1e-9),
    ],
    ids=[
        "all",
        "throttled",
        "late",
        "longer",
        "namespace",
        "static",
        "other sign",
        "nearly",
    ],
)
def test_a_topic_that_relays_another_agrees_with_it(
    relay: list[Message], recorder: Recorder, tmp_path: Path
) -> None:
    parts = driven("/tf"), fixed("/tf_static")
    path = written(recorder, tmp_path, *parts, relay)
    buffer = tfdb.load(path)
    assert buffer.frames() == ["base", "laser", "odom"]
    assert buffer.lookup_transform("odom", "base", START + 7 * STEP).translation[0] == (
        pytest.approx(0.7)
    )


@pytest.mark.parametrize("rounding", [np.float32, printed])
def test_a_relay_that_rounds_agrees(
    rounding: Callable[[float], Any], recorder: Recorder, tmp_path: Path
) -> None:
    turn = np.array([0.3, -0.5, 0.7, 0.2]) / np.linalg.norm([0.3, -0.5, 0.7, 0.2])
    moving = [driven(topic, x=2000 / 3, turn=turn) for topic in ("/tf", "/robot/tf")]
    static = [fixed(topic, 2000 / 7) for topic in ("/tf_static", "/robot/tf_static")]
    relay = rounded([*moving[1], *static[1]], rounding)
    path = written(recorder, tmp_path, moving[0], static[0], relay)
    assert tfdb.load(path).frames() == ["base", "laser", "odom"]


@pytest.mark.parametrize(
    "other",
    [
        driven("/relay", x=1e-4),
        driven("/relay", parent="map"),
        driven("/relay", rows=range(100, 120)),
        fixed("/robot/tf_static", 1.5),
        driven("/relay", child="laser", parent="base"),
        [*driven("/relay", rows=range(49)), *driven("/relay", rows=range(49, 50), x=0.5)],
    ],
    ids=["pose", "parent", "later", "static", "static and moving", "last"],
)
def test_another_pose_parent_kind_or_time_is_another_source(
    other: list[Message], recorder: Recorder, tmp_path: Path
) -> None:
    path = written(recorder, tmp_path, driven("/tf"), fixed("/tf_static"), other)
    with pytest.raises(tfdb.errors.MixedSources):
        tfdb.load(path)


def test_static_and_moving_samples_of_one_pose_agree(recorder: Recorder, tmp_path: Path) -> None:
    repeated = [
        Message("/old", START + row, [("base", "laser", START + row, (1.0, 0.2, 0.3, *TURN))])
        for row in range(5)
    ]
    path = written(recorder, tmp_path, driven("/tf"), fixed("/tf_static"), repeated)
    with pytest.warns(tfdb.TfdbWarning, match="StaticConflict"):
        buffer = tfdb.load(path)
    assert buffer.frame_info("laser").is_static


def test_every_group_that_disagrees_is_named(recorder: Recorder, tmp_path: Path) -> None:
    robots = [driven(f"/robot{number}/tf", x=number) for number in range(8)]
    path = written(recorder, tmp_path, *robots, driven("/other/tf", child="else"))
    with pytest.raises(tfdb.errors.MixedSources, match=r"8 groups.* and 3 more") as caught:
        tfdb.load(path)
    assert list(caught.value.groups or ()) == [f"/robot{number}" for number in range(8)]


def test_damaged_messages_do_not_hide_the_others(recorder: Recorder, tmp_path: Path) -> None:
    bad = Message("/b/tf", START, [("odom", "", START, (1, 2, 3, *TURN))])
    path = written(recorder, tmp_path, driven("/a/tf"), driven("/b/tf", x=3), [bad])
    with pytest.raises(tfdb.errors.MixedSources, match="base"):
        tfdb.load(path)


def test_files_of_one_recording_are_judged_together(recorder: Recorder, tmp_path: Path) -> None:
    paths = [
        recorder.bag(tmp_path / f"{name}.bag", driven(f"/{name}/tf", x=x))
        for name, x in (("left", 0), ("right", 4))
    ]
    with pytest.raises(tfdb.errors.MixedSources) as caught:
        tfdb.load(paths)
    assert caught.value.path == f"{paths[0]}, {paths[1]}"
    assert tfdb.load(paths, by_namespace=True).frames() == [
        "left/base",
        "left/odom",
        "right/base",
        "right/odom",
    ]


def test_other_options_are_about_the_names_with_their_prefix() -> None:
    buffer = tfdb.load(
        ROBOTS,
        by_namespace=True,
        frames=["robot1/odom", "robot1/base_link"],
        rename={"robot1/odom": "start"},
        prefix="run3/",
        start="+0.5",
    )
    assert buffer.frames() == ["run3/robot1/base_link", "run3/start"]
    found = buffer.lookup_transform("run3/start", "run3/robot1/base_link", HALF).translation
    assert found[0] == pytest.approx(0.5)
    assert tfdb.load(ROBOTS, by_namespace=True, exclude="robot2/*").frames() == [
        "robot1/base_link",
        "robot1/laser",
        "robot1/odom",
    ]


def test_options_have_separate_caches(tmp_path: Path) -> None:
    path = tmp_path / "robots.mcap"
    path.write_bytes(ROBOTS.read_bytes())
    found = [
        tfdb.load(path, cache=True, **how).frames()
        for _ in range(2)
        for how in ({"mix": True}, {"by_namespace": True})
    ]
    assert [len(frames) for frames in found] == [3, 6, 3, 6]
    with pytest.raises(tfdb.errors.MixedSources):
        tfdb.load(path, cache=True)


def test_options_that_contradict_are_refused() -> None:
    with pytest.raises(tfdb.InvalidArgument, match="mix and by_namespace exclude each other"):
        tfdb.load(ROBOTS, mix=True, by_namespace=True)


def test_prefixes_of_groups_that_make_one_name_are_refused(
    recorder: Recorder, tmp_path: Path
) -> None:
    plain = driven("/tf", parent="robot1/odom", child="robot1/base")
    path = written(recorder, tmp_path, plain, driven("/robot1/tf", x=50.0))
    with pytest.raises(tfdb.errors.MixedSources, match="get the same frame names") as caught:
        tfdb.load(path, by_namespace=True)
    assert caught.value.frames == ("robot1/base",)
    assert caught.value.groups == {"/": ("/tf",), "/robot1": ("/robot1/tf",)}
    assert tfdb.load(path).frames() == ["base", "odom", "robot1/base", "robot1/odom"]


def test_a_model_belongs_to_one_robot() -> None:
    model = tfdb.robots.parse_urdf('<robot name="r"><link name="base_link"/></robot>')
    with pytest.raises(tfdb.InvalidArgument, match="one robot"):
        tfdb.load(ROBOTS, by_namespace=True, urdf=model)


@pytest.mark.parametrize(
    ("topic", "prefix"),
    [
        ("/tf", ""),
        ("tf_static", ""),
        ("/robot1/tf", "robot1/"),
        ("/fleet/robot1/tf_static", "fleet/robot1/"),
        ("/tf_old", "tf_old/"),
        ("/tf_old_static", "tf_old/"),
        ("/robot1/transforms", "robot1/transforms/"),
    ],
)
def test_the_prefix_of_a_group(topic: str, prefix: str) -> None:
    assert containers.prefix_of_topic(topic, transforms=True) == prefix


def test_topics_with_one_prefix_are_groups_of_their_own(recorder: Recorder, tmp_path: Path) -> None:
    path = written(recorder, tmp_path, driven("/tf_old"), driven("/tf_old/tf", x=7))
    with pytest.raises(tfdb.errors.MixedSources, match="2 groups") as caught:
        tfdb.load(path)
    assert caught.value.groups == {"/tf_old": ("/tf_old",), "/tf_old/tf": ("/tf_old/tf",)}
    assert "--by-namespace" not in str(caught.value)
    with pytest.raises(tfdb.errors.MixedSources, match="get the same frame names"):
        tfdb.load(path, by_namespace=True)
    assert tfdb.load(path, topics="/tf_old/tf").frame_info("base").samples == 50
    relay = written(recorder, tmp_path / "relay", driven("/tf_old"), driven("/tf_old/tf"))
    assert tfdb.load(relay, by_namespace=True).frames() == ["tf_old/base", "tf_old/odom"]


def test_a_topic_of_poses_belongs_to_its_namespace() -> None:
    assert containers.prefix_of_topic("/robot1/odom", transforms=False) == "robot1/"
    assert containers.prefix_of_topic("/odom", transforms=False) == ""


def test_one_group_is_not_read_before(monkeypatch: pytest.MonkeyPatch) -> None:
    reads = []
    real = Recording.read

    def read(self: Recording, *rest: Any) -> Any:
        reads.append(self.path)
        return real(self, *rest)

    monkeypatch.setattr(Recording, "read", read)
    tfdb.load(CASES / "two_auth.mcap")
    assert len(reads) == 1


def followed(path: Path, **options: Any) -> tfdb.Buffer:
    """Return the store after following a complete file."""
    buffer = tfdb.Buffer(history=None)
    follow_recording(buffer, path, **options)
    return buffer


@pytest.mark.parametrize(
    ("path", "other"), [(ROBOTS, "/robot2/*"), (OLD, "/tf_old")], ids=["robots", "old"]
)
def test_a_growing_recording_is_judged_by_the_same_rule(path: Path, other: str) -> None:
    buffer = tfdb.Buffer(history=None)
    with pytest.raises(tfdb.errors.MixedSources) as caught:
        follow_recording(buffer, path)
    with pytest.raises(tfdb.errors.MixedSources) as expected:
        tfdb.load(path)
    assert set(caught.value.groups or ()) == set(expected.value.groups or ())
    assert set(caught.value.frames or ()) <= set(expected.value.frames or ())
    mixed, apart = followed(path, mix=True), followed(path, by_namespace=True)
    assert mixed.frames() == tfdb.load(path, mix=True).frames()
    assert apart.frames() == tfdb.load(path, by_namespace=True).frames()
    assert followed(path, exclude=other).frames() == mixed.frames()


@pytest.mark.parametrize("every", [1, 5])
def test_a_relay_in_a_growing_recording_agrees(
    every: int, recorder: Recorder, tmp_path: Path
) -> None:
    relay = driven("/relay", rows=range(0, 50, every))
    for message in relay:
        message.received += 2
    parts = [*driven("/tf"), *fixed("/tf_static"), *relay, *fixed("/robot/tf_static")]
    folder = recorder.folder(tmp_path / "bag", sorted(parts, key=lambda each: each.received))
    (path,) = folder.glob("*.mcap")
    buffer = followed(path)
    assert buffer.frames() == ["base", "laser", "odom"]
    assert buffer.frame_info("base").samples == 50
    last = driven("/relay", x=0.5, rows=range(49, 50))
    last[0].received += 2
    parts = [*driven("/tf"), *relay, *last]
    folder = recorder.folder(tmp_path / "other", sorted(parts, key=lambda each: each.received))
    (path,) = folder.glob("*.mcap")
    with pytest.raises(tfdb.errors.MixedSources, match="/tf; /relay"):
        followed(path)
