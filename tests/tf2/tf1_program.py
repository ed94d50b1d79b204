"""One program of tf, for Debian's tf and for `tfdb.tf2.tf1`: a list of all that it answered.

Run by itself it takes Debian's, and prints the answers as JSON. It knows nothing of tfdb.
"""

import json
import math
import random
import sys

SEED = 20260812
FRAMES = {"base": "map", "lidar": "base", "camera": "base", "lens": "camera"}


def quaternion(chance):
    found = [chance.gauss(0, 1) for _ in range(4)]
    length = math.sqrt(sum(each * each for each in found))
    return [each / length for each in found]


def fill(target, values, names="xyz"):
    for name, value in zip(names, values, strict=True):
        setattr(target, name, value)


def plain(value):
    """An answer as JSON has it."""
    if hasattr(value, "to_nsec"):
        return value.to_nsec()
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, (list, tuple)):
        return [plain(each) for each in value]
    if hasattr(value, "header"):
        names = ("point", "vector", "quaternion", "pose", "points")
        inside = next(getattr(value, name) for name in names if hasattr(value, name))
        return [plain(value.header.stamp), value.header.frame_id, plain(inside)]
    if hasattr(value, "position"):
        return [plain(value.position), plain(value.orientation)]
    if hasattr(value, "w"):
        sign = -1 if value.w < 0 else 1
        return [sign * each for each in (value.x, value.y, value.z, value.w)]
    if hasattr(value, "z"):
        return [value.x, value.y, value.z]
    return bool(value) if isinstance(value, (bool, int)) else value


class Program:
    """tf, the classes of its messages, of its times and durations; and random questions."""

    def __init__(self, tf, classes, clouds, time, duration):
        self.tf, self.classes, self.clouds, self.time = tf, classes, clouds, time
        self.chance = random.Random(SEED)
        self.transformer = tf.TransformerROS(True, duration(5, 0))
        self.answers = []

    def ask(self, name, *arguments):
        """Note what a call answers, or the name of its exception and its text."""
        try:
            answer = plain(getattr(self.transformer, name)(*arguments))
            if name.startswith("lookupTransform") and answer[1][3] < 0:
                answer[1] = [-each for each in answer[1]]
        except self.tf.Exception as error:
            kinds = (self.tf.ConnectivityException, self.tf.LookupException)
            kinds += (self.tf.ExtrapolationException, self.tf.Exception)
            kind = next(each for each in kinds if isinstance(error, each))
            answer = [kind.__name__, str(error)]
        self.answers.append([name, answer])

    def store(self):
        for second in range(1, 8):
            for child, parent in FRAMES.items():
                made = self.classes.TransformStamped()
                made.header.frame_id, made.child_frame_id = parent, child
                made.header.stamp = self.time(second, self.chance.randrange(5) * 10**8)
                fill(made.transform.translation, [self.chance.gauss(0, 3) for _ in range(3)])
                fill(made.transform.rotation, quaternion(self.chance), "xyzw")
                self.transformer.setTransform(made)
        made.header.frame_id, made.child_frame_id = "other", "island"
        self.transformer.setTransform(made, "someone")

    def names(self, count):
        every = ["map", *FRAMES, "island", "nowhere"]
        return [self.chance.choice(["", "", "/"]) + self.chance.choice(every) for _ in range(count)]

    def when(self):
        return self.time(self.chance.randrange(10), self.chance.randrange(10) * 10**8)

    def look_up(self):
        target, source, fixed = self.names(3)
        at, then = self.when(), self.when()
        if target.strip("/") != source.strip("/"):
            self.ask("lookupTransform", target, source, at)
            self.ask("canTransform", target, source, at)
            self.ask("getLatestCommonTime", target, source)
        if len({each.strip("/") for each in (target, source, fixed)}) == 3:
            self.ask("lookupTransformFull", target, at, source, then, fixed)
            self.ask("canTransformFull", target, at, source, then, fixed)

    def transform(self):
        target, source = self.chance.sample(["map", *FRAMES], 2)
        numbers = [self.chance.gauss(0, 2) for _ in range(3)]
        for kind in ("Point", "Vector3", "Quaternion", "Pose", "PointCloud"):
            package = self.clouds if kind == "PointCloud" else self.classes
            name = kind if kind == "PointCloud" else kind + "Stamped"
            made = getattr(package, name)()
            made.header.frame_id, made.header.stamp = source, self.when()
            if kind == "Point":
                fill(made.point, numbers)
            elif kind == "Vector3":
                fill(made.vector, numbers)
            elif kind == "Quaternion":
                fill(made.quaternion, quaternion(self.chance), "xyzw")
            elif kind == "Pose":
                fill(made.pose.position, numbers)
                fill(made.pose.orientation, quaternion(self.chance), "xyzw")
            else:
                point = self.classes.Point32()
                fill(point, numbers)
                made.points = [point, point]
            self.ask("transform" + kind, target, made)
        self.ask("asMatrix", target, made.header)

    def run(self):
        self.ask("allFramesAsDot")
        self.ask("getFrameStrings")
        self.store()
        for name in ("map", *FRAMES, "island", "other", "nowhere"):
            self.ask("frameExists", name)
        self.ask("getTFPrefix")
        for _ in range(400):
            self.look_up()
            self.transform()
        for _ in range(10):
            numbers = [self.chance.gauss(0, 2) for _ in range(7)]
            self.ask("fromTranslationRotation", numbers[:3], numbers[3:])
        self.ask("fromTranslationRotation", numbers[:3], [0, 0, 0, 0])
        self.transformer.clear()
        self.ask("lookupTransform", "map", "base", self.time(0, 0))
        self.ask("lookupTransform", "map", "base", self.time(3, 0))
        return self.answers


class Transformations:
    """What tf.transformations answers to random arguments."""

    def __init__(self, module, np):
        self.module, self.np = module, np
        self.chance = random.Random(SEED)
        self.found = []

    def note(self, name, value):
        value = self.np.asarray(value, dtype=float)
        if "quaternion" in name and value.shape == (4,) and value[3] < 0:
            value = -value
        self.found.append([name, value.tolist()])

    def call(self, name, *arguments):
        value = getattr(self.module, name)(*arguments)
        self.note(name, value)
        return value

    def run(self):
        for _ in range(50):
            point, vector = [[self.chance.gauss(0, 1) for _ in range(3)] for _ in range(2)]
            angles = [self.chance.uniform(-1.5, 1.5) for _ in range(3)]
            self.quaternions(angles, vector)
            self.matrices(angles, point, vector)
            self.balls(point, vector)
        self.call("clip_matrix", -1, 1, -2, 2, 1, 9, True)
        self.call("identity_matrix")
        return self.found

    def quaternions(self, angles, vector):
        call, chance = self.call, self.chance
        a, b = quaternion(chance), quaternion(chance)
        axes = chance.choice(["sxyz", "rzyx", "syxz", "rxyz", "szyx"])
        call("euler_from_quaternion", a)
        call("euler_from_quaternion", a, axes)
        call("quaternion_from_euler", *angles)
        call("quaternion_from_euler", *angles, axes)
        call("quaternion_about_axis", angles[0], vector)
        call("quaternion_from_matrix", call("quaternion_matrix", a))
        call("quaternion_multiply", a, b)
        call("quaternion_conjugate", a)
        call("quaternion_inverse", [2 * each for each in a])
        call("quaternion_slerp", a, b, chance.random())
        call("random_quaternion", [chance.random() for _ in range(3)])
        call("random_rotation_matrix", [chance.random() for _ in range(3)])
        call("euler_from_matrix", call("euler_matrix", *angles, axes), axes)

    def matrices(self, angles, point, vector):
        call, chance, np = self.call, self.chance, self.np
        turned = call("euler_matrix", *angles)
        moved = call("concatenate_matrices", call("translation_matrix", point), turned)
        call("translation_from_matrix", moved)
        call("inverse_matrix", moved)
        call("is_same_transform", moved, turned)
        call("rotation_matrix", angles[0], vector, point)
        call("reflection_matrix", point, vector)
        call("scale_matrix", chance.random(), point, vector)
        call("scale_matrix", angles[0])
        call("projection_matrix", point, vector)
        call("projection_matrix", point, vector, None, [9.0, 8.0, 7.0])
        call("shear_matrix", angles[0], np.cross(vector, point), point, vector)
        call("orthogonalization_matrix", [3.0, 4.0, 5.0], [80.0, 95.0, 110.0 + angles[0]])
        cloud = np.array([[chance.gauss(0, 1) for _ in range(6)] for _ in range(3)])
        there = turned[:3, :3] @ cloud + np.array([point]).T
        call("superimposition_matrix", cloud, there)
        call("superimposition_matrix", cloud, 2 * there, True, False)
        call("vector_norm", vector)
        call("unit_vector", vector)
        call("compose_matrix", point, None, angles, vector)
        for part in self.module.decompose_matrix(moved):
            self.note("decompose_matrix", part)

    def balls(self, point, vector):
        call, unit_vector = self.call, self.module.unit_vector
        on_ball = call("arcball_map_to_sphere", point[:2], vector[:2], 2.0)
        call("arcball_constrain_to_axis", on_ball, unit_vector(vector))
        call("arcball_nearest_axis", on_ball, [unit_vector(vector), [0.0, 1.0, 0.0]])
        ball = self.module.Arcball(initial=quaternion(self.chance))
        ball.place([320, 320], 320)
        ball.setconstrain(False)
        ball.down([500, 250])
        ball.drag([475, 275])
        self.note("Arcball", ball.matrix())


def differences(tf, classes, time, duration):
    """The speed of a point 2 m beside the axis of a frame that turns 0.2 rad/s; a wait."""
    transformer = tf.Transformer()
    for second in range(1, 6):
        made = classes.TransformStamped()
        made.header.frame_id, made.child_frame_id = "map", "base"
        made.header.stamp = time(second, 0)
        turn = made.transform.rotation
        turn.z, turn.w = math.sin(0.1 * second), math.cos(0.1 * second)
        transformer.setTransform(made)
    point = ("base", "map", "map", (0.0, 2.0, 0.0), "base", time(3, 0), duration(1, 0))
    linear, _ = transformer.lookupTwistFull(*point)
    try:
        transformer.waitForTransform("map", "base", time(9, 0), duration(0, 1))
    except tf.Exception as error:
        return [math.sqrt(sum(each * each for each in linear)), str(error)]
    return None


def main():
    import geometry_msgs.msg
    import numpy as np
    import rospy
    import sensor_msgs.msg
    import tf

    classes = (geometry_msgs.msg, sensor_msgs.msg, rospy.Time, rospy.Duration)
    answers = Program(tf, *classes).run()
    others = differences(tf, classes[0], *classes[2:])
    numbers = Transformations(tf.transformations, np).run()
    json.dump([answers, numbers, others], sys.stdout)


if __name__ == "__main__":
    main()
