"""Read, decide, write: a gripper takes a cup only if it still is where it was seen.

Two arms plan to grasp the same cup, and somebody pushes it about. Between looking and taking,
anything may happen: a transaction does both as one step.
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
    seen = tx.lookup_transform("map", "cup")  # T[map<-cup], as of now
    if seen.report.edges[0].parent != "table":
        return f"{gripper}: too late, it is in the {seen.report.edges[0].parent}"
    moved = np.linalg.norm(seen.translation - planned)
    if moved > 0.01:
        return f"{gripper}: it was moved by {moved * 100:.0f} cm, plan again"
    # From that stamp on it moves with the gripper; where it is does not change.
    tx.reparent("cup", gripper, seen.stamp, authority=gripper)
    return f"{gripper}: got it"


# Planned for where it was seen; then somebody pushed it by 5 cm.
planned = buf.lookup_transform("map", "cup").translation
buf.set_transform("table", "cup", start + 1_000_000, (0.15, 0, 0), (0, 0, 0, 1), authority="camera")
print(buf.run(lambda tx: grasp(tx, "left_gripper", planned)))

# Now both know better, and try at once. Whoever commits second reads again, and sees it is gone.
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

# The cup is where it was, and hangs on the gripper from then on.
owner = buf.frame_info("cup").parent
T = buf.lookup_transform("map", "cup")
assert np.allclose(T.translation, planned)
print(f"the cup moves with the {owner}, still at {T.translation}")

# By hand: the end of the block commits; an exception or abort() leaves nothing behind.
with buf.transaction() as tx:
    tx.set_static_transform("map", "shelf", (2.0, 2.0, 1.5))
    print("in the transaction the shelf is there:", tx.can_transform("map", "shelf"))
    tx.abort()
print("and then:", buf.frame_exists("shelf"))
