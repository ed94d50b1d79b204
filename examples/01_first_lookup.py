"""Store a few transforms, ask for one, move a point.

A stored transform maps points of the child into the parent; lookup_transform(target, source, time)
gives T[target<-source], which maps points of the source into the target.
"""

import tfdb

buf = tfdb.Buffer()  # keeps the last 10 s of each edge
start = tfdb.stamp("100.0")  # stamps are integer nanoseconds

# The camera sits 20 cm ahead of the base and 1.1 m above it, for ever.
buf.set_static_transform("base", "camera", (0.2, 0.0, 1.1))

# The base drives along x of the map, half a metre a second, reported ten times a second.
for i in range(11):
    buf.set_transform("map", "base", start + i * 100_000_000, (0.05 * i, 0, 0), (0, 0, 0, 1))

# Between two samples: linear in translation, slerp in rotation.
T = buf.lookup_transform("map", "camera", start + 250_000_000)
print(T)
print("the camera is at", T.translation, "in the map")
print("a point 1 m ahead of the camera is at", T.apply((1.0, 0.0, 0.0)))
print("and back:", T.inverse().apply(T.apply((1.0, 0.0, 0.0))))
print(T.report)

# Without a time: the newest stamp at which every moving edge of the path has data.
print("newest:", buf.lookup_transform("map", "camera").stamp)
