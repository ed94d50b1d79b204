"""What an answer tells about itself, and how to refuse what is not good enough."""

import tfdb

buf = tfdb.Buffer(history=None)
start = tfdb.stamp("10.0")
for step in (0, 1, 2, 20, 21):  # tenths of a second: there is a hole of 1.8 s
    buf.set_transform("odom", "base", start + step * 100_000_000, (step, 0, 0), (0, 0, 0, 1))
in_the_hole = start + 1_000_000_000

print("-- as tf2 would: interpolated, however far apart the samples are")
print(buf.lookup_transform("odom", "base", in_the_hole).report)

print("-- at most half a second apart")
try:
    buf.lookup_transform("odom", "base", in_the_hole, tfdb.Interpolate(max_gap=0.5))
except tfdb.errors.GapTooLarge as error:
    print("refused:", error)
    print("fields:", error.edge, error.before, error.after, error.limit)

print("-- other policies")
print(buf.lookup_transform("odom", "base", in_the_hole, tfdb.Previous()).translation)
print(buf.lookup_transform("odom", "base", in_the_hole, tfdb.Nearest(tolerance=1.0)).translation)
print(buf.can_transform("odom", "base", in_the_hole, tfdb.Exact()))

print("-- beyond the end: never, unless asked for by name")
late = start + 2_200_000_000
try:
    buf.lookup_transform("odom", "base", late)
except tfdb.Extrapolation as error:
    print("refused:", error)
print(buf.lookup_transform("odom", "base", late, tfdb.Extrapolate(max=0.2)).report)

print("-- why not, in words")
print(buf.explain("odom", "base", late))
