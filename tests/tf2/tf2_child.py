"""Runs operations on Debian's real tf2_py: one JSON list per line in, one JSON list per line out.

Started by real_tf2.py with the system's Python, which knows nothing of tfdb.
"""

import json
import os
import re
import sys
import tempfile

import rospy
import tf2_py
from geometry_msgs.msg import TransformStamped

SECOND = 10**9
LOGGED = re.compile(r"(?:Warning|Error): +(.*?)\n +at line ", re.DOTALL)


def time(stamp):
    return rospy.Time(stamp // SECOND, stamp % SECOND)


def message(parent, child, stamp, pose):
    made = TransformStamped()
    made.header.frame_id, made.child_frame_id, made.header.stamp = parent, child, time(stamp)
    move, turn = made.transform.translation, made.transform.rotation
    move.x, move.y, move.z, turn.x, turn.y, turn.z, turn.w = pose
    return made


def plain(found):
    move, turn = found.transform.translation, found.transform.rotation
    pose = [move.x, move.y, move.z, turn.x, turn.y, turn.z, turn.w]
    return [found.header.frame_id, found.child_frame_id, found.header.stamp.to_nsec(), pose]


class Child:
    def __init__(self, log):
        self.log = log
        self.core = None

    def new(self, cache_time):
        self.core = tf2_py.BufferCore(rospy.Duration(cache_time // SECOND, cache_time % SECOND))

    def set(self, static, parent, child, stamp, pose, authority):
        """The first that tf2 logs of it, without its level and its place in the sources."""
        self.log.read()
        write = self.core.set_transform_static if static else self.core.set_transform
        write(message(parent, child, stamp, pose), authority)
        logged = LOGGED.search(self.log.read().decode())
        return logged[1] if logged else ""

    def get(self, target, source, stamp):
        return plain(self.core.lookup_transform_core(target, source, time(stamp)))

    def full(self, target, target_stamp, source, source_stamp, fixed):
        times = time(target_stamp), time(source_stamp)
        return plain(
            self.core.lookup_transform_full_core(target, times[0], source, times[1], fixed)
        )

    def can(self, target, source, stamp):
        return self.core.can_transform_core(target, source, time(stamp))

    def canfull(self, target, target_stamp, source, source_stamp, fixed):
        times = time(target_stamp), time(source_stamp)
        return self.core.can_transform_full_core(target, times[0], source, times[1], fixed)

    def latest(self, target, source):
        return self.core.get_latest_common_time(target, source).to_nsec()

    def clear(self):
        self.core.clear()

    def chain(self, target, target_stamp, source, source_stamp, fixed):
        times = time(target_stamp), time(source_stamp)
        return self.core._chain(target, times[0], source, times[1], fixed)

    def exists(self, name):
        return self.core._frameExists(name)

    def frames(self):
        return sorted(self.core._getFrameStrings())

    def yaml(self):
        return self.core.all_frames_as_yaml()

    def string(self):
        return self.core.all_frames_as_string()

    def dot(self, *stamp):
        return self.core._allFramesAsDot(*[time(each) for each in stamp])


def main():
    with tempfile.TemporaryFile() as log:
        os.dup2(log.fileno(), 2)
        with os.fdopen(os.dup(log.fileno()), "rb", buffering=0) as reader:
            run(reader)


def run(log):
    child = Child(Appended(log))
    for line in sys.stdin:
        verb, *arguments = json.loads(line)
        try:
            answer = ["ok", getattr(child, verb)(*arguments)]
        except Exception as error:
            answer = [type(error).__name__, str(error)]
        sys.stdout.write(json.dumps(answer) + "\n")


class Appended:
    """What was written to a file since the last look."""

    def __init__(self, file):
        self.file, self.seen = file, 0

    def read(self):
        found = os.pread(self.file.fileno(), 1 << 20, self.seen)
        self.seen += len(found)
        return found


if __name__ == "__main__":
    main()
