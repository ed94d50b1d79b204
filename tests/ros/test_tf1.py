"""tf's broadcaster and listener on a real graph of ROS 1."""

from __future__ import annotations

import time

import numpy as np

from tfdb.tf2 import msgs, tf1


def test_from_broadcaster_to_listener(ros1: str) -> None:
    broadcaster = tf1.TransformBroadcaster()
    listener = tf1.TransformListener(True, msgs.Duration(60))
    stamp = msgs.Time.from_nanoseconds(time.time_ns())
    pose = (1.0, 2.0, 3.0), (0.0, 0.6, 0.0, 0.8)
    deadline = time.monotonic() + 20
    while True:
        # Until the topic is connected.
        broadcaster.sendTransform(*pose, stamp, "tf1_base", "tf1_map")
        try:
            listener.waitForTransform("/tf1_map", "tf1_base", stamp, msgs.Duration(0, 50_000_000))
        except tf1.Exception:
            assert time.monotonic() < deadline
        else:
            break
    found = listener.lookupTransform("tf1_map", "tf1_base", stamp)
    assert np.allclose(np.concatenate(found), np.concatenate(pose), rtol=0, atol=1e-15)
    assert listener.getLatestCommonTime("tf1_map", "tf1_base").to_nsec() == stamp.nanoseconds
    listener.unregister()
    broadcaster.tf2_broadcaster.close()
