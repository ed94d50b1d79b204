"""Messages that another thread changes while they are read."""

from __future__ import annotations

import threading

import tfdb

FRAMES = 40
TURNED = (0.0, 0.0, 0.6, 0.8)


def test_bytearrays_that_change_during_the_call() -> None:
    """What is stored is one state of each message, however it changes meanwhile."""
    names = [f"of the robot's arm {i}" for i in range(FRAMES)]
    message = bytearray(
        tfdb.encode_tf_message(
            [tfdb.TransformStamped("map", name, 5, (1, 2, 3), TURNED) for name in names]
        )
    )
    good = bytes(message)
    done = threading.Event()

    def change() -> None:
        while not done.is_set():
            for at in range(4, len(message), 7):
                message[at] ^= 0xFF
            message[:] = good

    other = threading.Thread(target=change)
    other.start()
    try:
        for _ in range(20):
            buf = tfdb.Buffer()
            result = buf.ingest_many([message] * 100, encoding="cdr")
            assert result.messages == 100
            assert result.commits + result.refused == 100
            for name in buf.frames():
                assert name.encode()
                assert buf.frame_exists(name)
            buf.ingest_many([memoryview(message)] * 10, encoding="cdr")
    finally:
        done.set()
        other.join()
