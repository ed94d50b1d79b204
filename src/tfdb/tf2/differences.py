"""Where `tfdb.tf2` differs from tf2 on purpose: the one list, which the tests read."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["DIFFERENCES", "Difference"]


@dataclass(frozen=True, slots=True)
class Difference:
    """One thing that is meant to be otherwise."""

    tf2: str
    """What tf2 does; [1] or [2]: of that side of ROS alone."""
    ours: str
    """What is done here."""
    reason: str
    """Why."""


DIFFERENCES: dict[str, Difference] = {
    "same_frame": Difference(
        "target == source gives the identity for any text, also for no frame at all",
        "the name is checked as any other",
        "a misspelt frame is an error",
    ),
    "loops": Difference(
        "a loop is stored, and found after 1000 steps of some lookups; a chain of 1001 edges is "
        "called a loop",
        "the transform that would close a loop is refused (TF_LOOP); chains have no longest length",
        "one bad transform must not spoil a tree that is whole",
    ),
    "infinite": Difference(
        "an infinite translation is stored, lookups give NaN",
        "refused as NaN is (TF_NAN_INPUT)",
        "it is not a transform",
    ),
    "quaternion": Difference(
        "[1] one that is nearly of length one comes back as it came; [2] normalises any length "
        "without a word",
        "[1] normalises what upstream stores; [2] normalises any length but 0, and logs each edge "
        "once whose quaternion is more than 0.01 off in its square (TF_DENORMALIZED_QUATERNION)",
        "lookups return rotations; a wrong publisher is named",
    ),
    "names": Difference(
        "any text may name a frame; the frame NO_PARENT is lost",
        "control characters (U+0000 to U+001F, U+007F) and names beyond 1024 bytes are refused "
        "(TF_BAD_FRAME_ID); NO_PARENT is a name like others",
        "such names break what is printed",
    ),
    "stamps": Difference(
        "[2] negative stamps are stored",
        "refused (TF_BAD_STAMP); they may be asked for, and static paths have an answer there",
        "a store has no data before 0",
    ),
    "late_stamps": Difference(
        "stamps beyond the year 2043 are stored",
        "refused (TF_BAD_STAMP)",
        "a store has stamps up to 2**61 - 1 ns",
    ),
    "stamp_zero": Difference(
        "an edge whose newest stamp is 0 does not count for the latest common time",
        "it does",
        "0 is a stamp; of other edges at 0 nothing is guessed",
    ),
    "refused_parent": Difference(
        "the parent of a transform that was refused as TF_OLD_DATA is a frame from then on",
        "nothing of it is stored",
        "what is refused leaves nothing behind",
    ),
    "repeated_parent": Difference(
        "[1] so is that of one that was refused as TF_REPEATED_DATA",
        "nothing of it is stored",
        "what is refused leaves nothing behind",
    ),
    "can_says_first": Difference(
        "[1] can_transform says of both names that they do not exist",
        "of the first one",
        "as lookups do",
    ),
    "sign": Difference(
        "the full form gives the one or the other of the two quaternions of a rotation",
        "so does this one, not always the same one",
        "both are the rotation",
    ),
    "can_says_why": Difference(
        "[1] can_transform says nothing of empty names and slashes, and of the full form's names "
        "more than is true",
        "it says of the first wrong name what is wrong",
        "a reason is there to be read",
    ),
    "latest_common_time": Difference(
        "two trees raise TransformException",
        "its subclass ConnectivityException",
        "as lookups do",
    ),
    "chain": Difference(
        "[1] _chain goes on above the meeting point, and unknown names give an empty list or "
        "NO_PARENT; [2] leaves out the last frame",
        "the frames of the path from source to target, both included; names are checked",
        "it is the chain",
    ),
    "listings": Difference(
        "frames are listed in the order of their first use, names are not quoted, in the picture's "
        "legend one of the roots is chosen by chance",
        "sorted by name, quoted or escaped where YAML and DOT need it, each root has the legend",
        "the listings can be parsed whatever the names are",
    ),
    "same_stamp": Difference(
        "[2] keeps all values of one stamp: which one is found depends on what is asked",
        "the last value that was written counts",
        "one stamp has one value",
    ),
    "future_result": Difference(
        "[2] the result of Humble's futures is True, that of later ones the transform",
        "the transform, always",
        "a message is true as well",
    ),
    "future_before": Difference(
        "[2] result() and exception() of a future that is not done return None",
        "so they do in programs of rclpy; elsewhere they raise InvalidStateError, and wait only "
        "where they get a timeout",
        "None is not a transform, and a wait without an end would hang",
    ),
    "future_loop": Difference(
        "[2] an awaited future keeps a loop of asyncio busy",
        "the loop sleeps until the transform comes",
        "nothing polls",
    ),
    "nanoseconds": Difference(
        "[1] times pass through seconds as floats, which loses up to 120 ns of today's",
        "they are integers throughout",
        "a stamp is exact",
    ),
    "pruning": Difference(
        "[2] forgets old samples one write late",
        "what is older than the cache is gone at once",
        "the length of the cache is what was said",
    ),
    "numbers": Difference(
        "a number in place of a Time or Duration raises TypeError",
        "an integer is a time in nanoseconds, so 0 is the latest common time; a number is a "
        "duration in seconds, as in `Buffer(10)` and `timeout=0.5`",
        "programs without ROS have no class for times",
    ),
    "arguments": Difference(
        "arguments that do not fit raise TypeError in Python's words; [1] `set_transform` takes "
        "none by name, `clear` and `all_frames_as_yaml` ignore any",
        "all can be given by name; those that do not fit raise TypeError, which names them",
        "a misspelt argument is an error",
    ),
    "wrong_message": Difference(
        "[1] a message of the wrong class raises AttributeError late, as does a tuple or generator "
        "in `sendTransform`; `set_transform(None, ...)` ends the process",
        "an error that is TypeError and AttributeError names the argument before anything is sent; "
        "`sendTransform` takes any iterable of transforms",
        "a process must not end by a wrong argument",
    ),
    "registered": Difference(
        "[1] `transform` and `convert` raise TypeException, 'if not loaded or supported', until "
        "the package of the type is imported",
        "messages of geometry_msgs and sensor_msgs are registered from the start; of other types "
        "TypeException says 'is not loaded or supported', as in [2]",
        "the conversions are part of tfdb.tf2",
    ),
    "cache_time": Difference(
        "a negative cache_time is taken, and nothing is ever kept",
        "InvalidArgumentException",
        "it is a mistake",
    ),
    "conversion_header": Difference(
        "do_transform_* gives the result the transform's own header; [2] do_transform_vector3 sets "
        "the translation of the given transform to 0",
        "a copy; what was given stays as it is",
        "a later change of one message must not change another",
    ),
    "conversion_transform": Difference(
        "do_transform_* takes any quaternion: [1] stretches by its length, [2] makes it of length "
        "one, and the identity of one of length 0",
        "InvalidArgumentException unless it is finite and of length one, as set_transform has it",
        "it is not a transform",
    ),
    "conversion_orientation": Difference(
        "[1] an orientation of a length other than one comes back as another rotation",
        "with length one; one of length 0, which [1]'s messages have by default, counts as the "
        "identity, as in [2]",
        "programs that care for the position alone leave it out",
    ),
    "conversion_type": Difference(
        "convert, and `transform` with a new_type, give a message of geometry_msgs back as it is "
        "where another of them is asked for",
        "TypeException",
        "it is not what was asked for",
    ),
    "cloud_layout": Difference(
        "[1] takes the first three numbers of each point for x, y, z; [1] and [2] drop padding "
        "behind the last field, rows and the order of bytes",
        "fields are found by name, the layout stays to the byte",
        "what is not transformed is not changed",
    ),
    "cloud_normals": Difference(
        "normals are kept as they are",
        "normal_x, normal_y, normal_z and nx, ny, nz are turned",
        "they are directions in the cloud's frame",
    ),
    "cloud_refused": Difference(
        "[1] takes clouds without x, y, z; [2] raises AssertionError",
        "InvalidArgumentException with [2]'s words, also for data that are shorter than the header "
        "says and fields outside a point",
        "asserts vanish with python -O",
    ),
    "covariance": Difference(
        "[1] has no PoseWithCovarianceStamped; [2] turns the blocks of its covariance",
        "as [2], for both; transform_covariance takes a `lever_arm` for the covariance of another "
        "point of the same body, or of a twist about the frame's origin",
        "x, y, z are the place of the pose itself, so a change of frame alone has no lever arm",
    ),
    "tf1_twist": Difference(
        "tf's lookupTwistFull multiplies two vectors member by member where their cross product "
        "belongs: a point beside the axis of a turning frame has no speed",
        "it has; both lookupTwist give velocities on the axes of the reference frame",
        "it is the velocity",
    ),
    "tf1_wait": Difference(
        "tf's waitForTransform raises tf.Exception unless setUsingDedicatedThread was called",
        "it waits",
        "any thread that brings the transform wakes it",
    ),
    "exports": Difference(
        "modules also have private names (`tf.transformations._EPS`) and the features of "
        "`__future__`",
        "these are left out; a star import of tf2_ros gives BufferServer, MessageFilter, "
        "FilterFailureReason, TransformableResult, StaticTransformListener and three kinds of "
        "ExtrapolationException as well",
        "private names are not tf2's interface; tfdb offers more",
    ),
}
"""By name."""
