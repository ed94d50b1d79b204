"""tf's surface: one program on Debian's tf and on ours; intended differences; waits."""

from __future__ import annotations

import builtins
import importlib
import json
import math
import subprocess
import sys
import threading
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from compat.tf2_oracle import unavailable
from tf2 import real_tf2, tf1_program
from tfdb.tf2 import msgs, tf1

CHILD = Path(__file__).with_name("tf1_program.py")
SECOND = 1_000_000_000


@cache
def theirs() -> list[Any]:
    """What Debian's tf answers."""
    done = subprocess.run(
        [real_tf2.PYTHON, CHILD],
        env=real_tf2.ENVIRONMENT,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        unavailable(f"no real tf: {done.stderr.strip()[-200:]}; apt-get install python3-tf")
    found: list[Any] = json.loads(done.stdout)
    return found


def close(a: Any, b: Any) -> bool:
    """Equal up to rounding, in all numbers."""
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(map(close, a, b))
    if isinstance(a, float) or isinstance(b, float):
        return math.isclose(a, b, rel_tol=1e-9, abs_tol=1e-9)
    return bool(a == b)


def test_the_module_is_an_attribute_of_the_package() -> None:
    program = "import tfdb.tf2; print(tfdb.tf2.tf1.Transformer.__name__, tfdb.tf2.differences)"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout.startswith("Transformer <module 'tfdb.tf2.differences'")


def test_a_twist_of_one_sample_names_the_stamp_that_was_asked() -> None:
    transformer = tf1.Transformer()
    stored = msgs.TransformStamped(msgs.Header(msgs.Time(12), "map"), "base")
    stored.transform.rotation = msgs.Quaternion(0.0, 0.0, 0.6, 0.8)
    transformer.setTransform(stored)
    with pytest.raises(tf1.ExtrapolationException) as refused:
        transformer.lookupTwist("base", "map", msgs.Time(12), msgs.Duration(0, 500_000_000))
    said = str(refused.value)
    assert "at time 11.500000000, but only time 12.000000000 is in the buffer" in said or (
        "at time 11.500000, but only time 12.000000 is in the buffer" in said
    )
    assert (refused.value.stamp, refused.value.newest) == (11_500_000_000, 12_000_000_000)


def test_transformer_beside_theirs() -> None:
    program = tf1_program.Program(tf1, msgs, msgs, msgs.Time, msgs.Duration)
    ours = json.loads(json.dumps(program.run()))
    real = theirs()[0]
    assert len(ours) == len(real) > 3000
    answered = set()
    for mine, other in zip(ours, real, strict=True):
        name, answer = other
        # Theirs raises the root here: `latest_common_time` in `tfdb.tf2.differences`.
        if name == "getLatestCommonTime" and "TransformException" in str(answer):
            answer = ["ConnectivityException", *answer[1:]]
        assert close(mine, [name, answer]), (tf1_program.SEED, mine, other)
        answered.add((name, "Exception" in str(answer)))
    for name in ("lookupTransform", "lookupTransformFull", "transformPose", "transformPointCloud"):
        assert {(name, True), (name, False)} <= answered


def test_transformations_beside_theirs() -> None:
    pytest.importorskip("transformations")
    ours = tf1_program.Transformations(tf1.transformations, np).run()
    real = theirs()[1]
    assert len(ours) == len(real) > 1000
    for mine, other in zip(ours, real, strict=True):
        assert close(mine, other), (tf1_program.SEED, mine, other)


def test_transformations_without_the_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "tfdb.tf2.tf1.transformations", raising=False)
    monkeypatch.delattr(tf1, "transformations", raising=False)
    whole = builtins.__import__

    def without(name: str, *rest: Any) -> Any:
        if name.startswith("transformations"):
            raise ImportError(name)
        return whole(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(ImportError, match=r"pip install 'tfdb\[tf1\]'"):
        importlib.import_module("tfdb.tf2.tf1.transformations")
    with pytest.raises(AttributeError):
        _ = tf1.nothing


def test_difference_tf1_twist() -> None:
    real, ours = theirs()[2][0], tf1_program.differences(tf1, msgs, msgs.Time, msgs.Duration)[0]
    assert real == pytest.approx(0, abs=1e-9)
    assert ours == pytest.approx(0.4, rel=2e-3)


def test_difference_tf1_wait() -> None:
    real, ours = theirs()[2][1], tf1_program.differences(tf1, msgs, msgs.Time, msgs.Duration)[1]
    assert real.startswith("cannot wait for transform without a dedicated thread")
    assert "4.000000000s into the future" in ours


SHOWN = {name.removeprefix("test_difference_") for name in globals() if "_difference_" in name}


def moving(parent: str, child: str, second: int, pose: Any) -> msgs.TransformStamped:
    x, y, z, *rotation = pose
    header = msgs.Header(msgs.Time(second), parent)
    inside = msgs.Transform(msgs.Vector3(x, y, z), msgs.Quaternion(*rotation))
    return msgs.TransformStamped(header, child, inside)


def test_twist() -> None:
    transformer = tf1.Transformer()
    for second in range(1, 6):
        half = 0.2 * second / 2
        pose = (3.0 * second, 0.0, 0.0, 0.0, 0.0, math.sin(half), math.cos(half))
        transformer.setTransform(moving("map", "base", second, pose))
    interval = msgs.Duration(1)
    linear, angular = transformer.lookupTwist("/base", "map", msgs.Time(3), interval)
    assert np.allclose(linear, (3, 0, 0), atol=1e-9)
    assert np.allclose(angular, (0, 0, 0.2), atol=1e-9)
    args = ("base", "map", "map", (0.0, 2.0, 0.0), "base", msgs.Time(3), interval)
    beside, _ = transformer.lookupTwistFull(*args)
    turned = np.array([-math.sin(0.6), math.cos(0.6)]) * 2
    expected = (3 - 0.2 * turned[1], 0.2 * turned[0], 0)
    assert np.allclose(beside, expected, atol=1e-3)


def test_a_wait_is_woken_by_another_thread() -> None:
    """No thread of its own is needed for it."""
    transformer = tf1.Transformer()
    pose = (1.0, 2.0, 3.0, 0.0, 0.6, 0.0, 0.8)
    begun = threading.Event()

    def write() -> None:
        begun.wait()
        for second in (3, 5):
            transformer.setTransform(moving("map", "base", second, pose))

    writer = threading.Thread(target=write)
    writer.start()
    begun.set()
    transformer.waitForTransform("/map", "/base", msgs.Time(4), msgs.Duration(20))
    full = ("map", msgs.Time(3), "base", msgs.Time(5), "map")
    transformer.waitForTransformFull(*full, msgs.Duration(20))
    writer.join()
    with pytest.raises(tf1.Exception, match=r"1\.0{9}s into the future"):
        transformer.waitForTransform("map", "base", msgs.Time(6), msgs.Duration(0, 1))
    with pytest.raises(tf1.Exception, match="zz"):
        transformer.waitForTransformFull(
            "map", msgs.Time(3), "base", msgs.Time(5), "zz", msgs.Duration(0, 1)
        )
    transformer.setUsingDedicatedThread(1)


def test_names_and_listings() -> None:
    transformer = tf1.TransformerROS()
    transformer.setTransform(moving("map", "base", 3, (1.0, 2.0, 3.0, 0.0, 0.6, 0.0, 0.8)))
    stamp = msgs.Time(3)
    chain = transformer.chain("/map", stamp, "/base", stamp, "map")
    assert chain == ["base", "map"]
    assert transformer.allFramesAsString() == "Frame base exists with parent map.\n"
    assert '"map" -> "base"' in transformer.allFramesAsDot(msgs.Time(4))
    cloud = msgs.PointCloud(msgs.Header(stamp, "base"), [msgs.Point32(1.0, 2.0, 3.0)])
    cloud.channels.append(msgs.ChannelFloat32("intensity", [0.5]))
    made = transformer.transformPointCloud("/map", cloud)
    assert made.header == msgs.Header(stamp, "/map")
    assert made.channels == cloud.channels
    assert made.channels[0] is not cloud.channels[0]
