"""Readers never see half of a batch, and a snapshot does not change.

A writer moves `odom` in the map by +s and `base` in odom by -s, in one batch, as fast as it can.
So in every committed state the base is at the origin. Readers check that.
"""

import threading

import tfdb

ROUNDS = 20_000

buf = tfdb.Buffer(history=None)
stamp = tfdb.stamp("1.0")


def batch(shift: float) -> list[tfdb.TransformStamped]:
    return [
        tfdb.TransformStamped("map", "odom", stamp, (shift, 0, 0), (0, 0, 0, 1)),
        tfdb.TransformStamped("odom", "base", stamp, (-shift, 0, 0), (0, 0, 0, 1)),
    ]


buf.set_transforms(batch(0.0))
done = threading.Event()


def write() -> None:
    for i in range(1, ROUNDS):
        buf.set_transforms(batch(float(i)))
    done.set()


writer = threading.Thread(target=write)
writer.start()
reads = torn = 0
while not done.is_set() or reads < 1000:
    torn += buf.lookup_transform("map", "base", stamp).translation[0] != 0.0
    reads += 1
writer.join()
print(f"{reads} reads beside the writer, {torn} of them torn")
assert torn == 0

# A snapshot returns the same transform, however much is written meanwhile.
with buf.snapshot() as snap:
    held = snap.lookup_transform("map", "odom", stamp).translation[0]
    buf.set_transforms(batch(-1.0))
    assert snap.lookup_transform("map", "odom", stamp).translation[0] == held
    print("snapshot of commit", snap.commit, "still has odom at", held)
T = buf.lookup_transform("map", "odom")
print("the store, at commit", buf.commit, "has it at", T.translation[0])
