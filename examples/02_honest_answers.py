"""See which samples a lookup used, and refuse lookups across gaps or into the future."""

import tfdb

buf = tfdb.Buffer(history=None)
start = tfdb.stamp("10.0")
for step in (0, 1, 2, 20, 21):  # tenths of a second, with a gap of 1.8 s
    buf.set_transform("odom", "base", start + step * 100_000_000, (step, 0, 0), (0, 0, 0, 1))
in_the_gap = start + 1_000_000_000

print("-- as in tf2: interpolated, however far apart the samples are")
print(buf.lookup_transform("odom", "base", in_the_gap).report)

print("-- only if the samples are at most half a second apart")
try:
    buf.lookup_transform("odom", "base", in_the_gap, tfdb.Interpolate(max_gap=0.5))
except tfdb.errors.GapTooLarge as error:
    print("refused:", error)
    print("fields:", error.edge, error.before, error.after, error.limit)

print("-- other policies")
print(buf.lookup_transform("odom", "base", in_the_gap, tfdb.Previous()).translation)
print(buf.lookup_transform("odom", "base", in_the_gap, tfdb.Nearest(tolerance=1.0)).translation)
print(buf.can_transform("odom", "base", in_the_gap, tfdb.Exact()))

print("-- after the last sample: refused without the policy Extrapolate")
late = start + 2_200_000_000
try:
    buf.lookup_transform("odom", "base", late)
except tfdb.Extrapolation as error:
    print("refused:", error)
print(buf.lookup_transform("odom", "base", late, tfdb.Extrapolate(max=0.2)).report)

print("-- the reason in words")
print(buf.explain("odom", "base", late))
