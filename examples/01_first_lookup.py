"""Store a few transforms, look one up, transform a point.

A stored transform maps points of the child into the parent; lookup_transform(target, source, time)
returns T[target<-source], which maps points of the source into the target.
"""

import tfdb

buf = tfdb.Buffer()  # keeps the last 10 s of each edge
start = tfdb.stamp("100.0")  # stamps are integer nanoseconds

# The camera is fixed 20 cm ahead of the base and 1.1 m above it.
buf.set_static_transform("base", "camera", (0.2, 0.0, 1.1))

# The base drives along the x axis of the map at 0.5 m/s; its pose is stored ten times a second.
for i in range(11):
    buf.set_transform("map", "base", start + i * 100_000_000, (0.05 * i, 0, 0), (0, 0, 0, 1))

# Between two samples, translations are interpolated linearly and rotations by slerp.
T = buf.lookup_transform("map", "camera", start + 250_000_000)
print(T)
print("the camera is at", T.translation, "in the map")
print("a point 1 m ahead of the camera is at", T.apply((1.0, 0.0, 0.0)))
print("and back:", T.inverse().apply(T.apply((1.0, 0.0, 0.0))))
print(T.report)

# Without a stamp, the lookup uses the newest one at which every moving edge has data.
print("newest:", buf.lookup_transform("map", "camera").stamp)
