"""Read, decide, write: a gripper takes a cup only if the cup has not moved since the plan.

Two arms plan to grasp the same cup, and a person pushes it. The cup may move between the lookup
and the grasp, so a transaction does both atomically.
"""

import threading

import numpy as np

import tfdb

buf = tfdb.Buffer(history=None)
start = tfdb.stamp("100.0")
buf.set_static_transform("map", "table", (1.0, 0.0, 0.7))
buf.set_static_transform("map", "left_gripper", (0.9, 0.3, 0.9))
buf.set_static_transform("map", "right_gripper", (0.9, -0.3, 0.9), (0, 0, 1, 0))
buf.set_transform("table", "cup", start, (0.1, 0.0, 0.0), (0, 0, 0, 1), authority="camera")


def grasp(tx: tfdb.Transaction, gripper: str, planned: np.ndarray) -> str:
    seen = tx.lookup_transform("map", "cup")  # the current T[map<-cup]
    if seen.report.edges[0].parent != "table":
        return f"{gripper}: too late, the cup is in the {seen.report.edges[0].parent}"
    moved = np.linalg.norm(seen.translation - planned)
    if moved > 0.01:
        return f"{gripper}: the cup moved by {moved * 100:.0f} cm, plan again"
    # From this stamp on, the cup moves with the gripper. Its pose in the map stays the same.
    tx.reparent("cup", gripper, seen.stamp, authority=gripper)
    return f"{gripper}: got it"


# The arm plans for the pose of the cup, then a person pushes the cup by 5 cm.
planned = buf.lookup_transform("map", "cup").translation
buf.set_transform("table", "cup", start + 1_000_000, (0.15, 0, 0), (0, 0, 0, 1), authority="camera")
print(buf.run(lambda tx: grasp(tx, "left_gripper", planned)))

# Both arms plan again and try at once. The later commit conflicts, and its arm finds the cup gone.
planned = buf.lookup_transform("map", "cup").translation
said: list[str] = []


def arm(gripper: str) -> None:
    said.append(buf.run(lambda tx: grasp(tx, gripper, planned)))


arms = [threading.Thread(target=arm, args=(f"{side}_gripper",)) for side in ("left", "right")]
for thread in arms:
    thread.start()
for thread in arms:
    thread.join()
print(*sorted(said, key=len), sep="\n")
assert sorted(line.endswith("got it") for line in said) == [False, True]

# The cup has the same pose as before, but its parent is now the gripper.
owner = buf.frame_info("cup").parent
T = buf.lookup_transform("map", "cup")
assert np.allclose(T.translation, planned)
print(f"the cup moves with the {owner}, still at {T.translation}")

# Without run(): the end of the block commits; an exception or abort() discards all writes.
with buf.transaction() as tx:
    tx.set_static_transform("map", "shelf", (2.0, 2.0, 1.5))
    print("in the transaction, the shelf exists:", tx.can_transform("map", "shelf"))
    tx.abort()
print("after the abort, the shelf exists:", buf.frame_exists("shelf"))
