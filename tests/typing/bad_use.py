"""Checked by mypy, never run: each marked line must be an error, and no other."""

from __future__ import annotations

import numpy as np

import tfdb

buffer = tfdb.Buffer()
buffer.lookup_transform("map", "base", 1.5)  # error
buffer.lookup_transform("map", 7)  # error
buffer.lookup_transform("map", "base", 5, "linear")  # error
buffer.set_transform("map", "base", 5)  # error
buffer.set_transform("map", "base", 5, (1, 2, 3), (0, 0, 0, 1), "ekf")  # error
buffer.lookup_transforms("map", "base", [5], layout="euler")  # error
buffer.lookup_transform("map", "base").stamp = 5  # error
buffer.lookup_transform("map", "base") @ 3  # error
tfdb.Buffer(10.0, 5)  # error
tfdb.Buffer(concurrency="mvcc")  # error
tfdb.Buffer(10.0, "silo")  # error
buffer.concurrency = "silo"  # error
buffer.transaction("high")  # error
buffer.transaction().lookup_transform("map", 7)  # error
buffer.transaction().set_transforms([], partial=True)  # error
buffer.transaction().snapshot()  # error
buffer.run(lambda: 5)  # error
buffer.run(lambda tx: tx.closed).upper()  # error
buffer.run(print, 3)  # error
buffer.set_transforms([], partial=True) + 1  # error
buffer.remove_frames(["a", 7])  # error
stamps = np.zeros(5, np.int64)
doubles = np.zeros((5, 3))
found = buffer.lookup_transform("map", "base")
path = buffer.trajectory("map", "base")
buffer.lookup_transform("map", "base", "12.5")  # error
buffer.lookup_transform("map", "base", stamps)  # error
buffer.lookup_transform("map", ("base",))  # error
buffer.lookup_transforms("map", "base", 5)  # error
buffer.transform_points("map", "base", doubles, stamps, out=stamps)  # error
buffer.set_transforms(found)  # error
buffer.set_transform(found, stamp=5)  # error
doubles @ found  # error
found @ doubles  # error
path.at(5.5)  # error
print(path.at(stamps).stamp)  # error
print(path[stamps].stamp)  # error
path @ path  # error
tfdb.stamp(stamps).bit_length()  # error
tfdb.stamp("5").tolist()  # error
tfdb.load("drive.bag", start=5.0)  # error
tfdb.load("drive.bag", exclude=5)  # error
tfdb.load("drive.bag", no_such=5)  # error
tfdb.Buffer().load("drive.bag", keep="5")  # error
tfdb.recordings.Selection(frames=5)  # error
print(tfdb.load("drive.bag").messages)  # error
tfdb.compare(path, found)  # error
tfdb.compare(path, path, align="SE3")  # error
tfdb.compare(buffer, buffer, frames="map")  # error
path.save("path.tum", format="bag")  # error
tfdb.Extrapolate()  # error


class Mine(tfdb.Transform):  # error
    pass
