"""The intended differences of `tfdb.tf2` from tf2; the tests read this list."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["DIFFERENCES", "Difference"]


@dataclass(frozen=True, slots=True)
class Difference:
    """One intended difference."""

    tf2: str
    """The behaviour of tf2; [1] or [2]: in ROS 1 or ROS 2 only."""
    ours: str
    """The behaviour of `tfdb.tf2`."""
    reason: str
    """The reason."""


DIFFERENCES: dict[str, Difference] = {
    "same_frame": Difference(
        "for target == source the result is the identity, whether or not the frame exists",
        "the name is checked like any other",
        "a misspelt frame is an error",
    ),
    "loops": Difference(
        "a loop is stored, and some lookups find it after 1000 steps; a chain of 1001 edges "
        "counts as a loop",
        "the transform that would close a loop is refused (TF_LOOP); chains may have any length",
        "one wrong transform should not break a valid tree",
    ),
    "infinite": Difference(
        "an infinite translation is stored, and lookups return NaN",
        "refused like NaN (TF_NAN_INPUT)",
        "it is not a rigid transform",
    ),
    "quaternion": Difference(
        "[1] a quaternion of nearly unit length is returned unchanged; [2] any length is "
        "normalised without a warning",
        "[1] normalises what upstream stores. [2] normalises any length except 0. It logs each "
        "edge once if the squared length of a quaternion differs from 1 by more than 0.01 "
        "(TF_DENORMALIZED_QUATERNION)",
        "lookups return rotations, and the log names the wrong publisher",
    ),
    "names": Difference(
        "any text can name a frame; the frame NO_PARENT is lost",
        "control characters (U+0000 to U+001F, U+007F) and names above 1024 bytes are refused "
        "(TF_BAD_FRAME_ID); NO_PARENT is an ordinary name",
        "such names corrupt printed output",
    ),
    "stamps": Difference(
        "[2] negative stamps are stored",
        "refused (TF_BAD_STAMP); lookups at negative stamps work on static paths",
        "a store has no data before 0",
    ),
    "late_stamps": Difference(
        "stamps after 2043-01-25 are stored",
        "refused (TF_BAD_STAMP)",
        "the largest stamp of a store is 2**61 - 1 ns",
    ),
    "stamp_zero": Difference(
        "an edge whose newest stamp is 0 does not count for the latest common time",
        "it counts",
        "0 is a valid stamp",
    ),
    "refused_parent": Difference(
        "the parent of a transform that was refused as TF_OLD_DATA becomes a frame",
        "nothing is stored",
        "a refused transform leaves no trace",
    ),
    "repeated_parent": Difference(
        "[1] the parent of a transform that was refused as TF_REPEATED_DATA becomes a frame",
        "nothing is stored",
        "a refused transform leaves no trace",
    ),
    "can_says_first": Difference(
        "[1] can_transform names both unknown frames",
        "the first one",
        "lookups also name the first one",
    ),
    "sign": Difference(
        "the full form may return a quaternion q or its negative -q",
        "the sign may differ from tf2's",
        "q and -q are the same rotation",
    ),
    "can_says_why": Difference(
        "[1] can_transform gives no reason for empty names and slashes, and a wrong one for "
        "names of the full form",
        "the reason names the first wrong argument",
        "a reason should name the cause",
    ),
    "latest_common_time": Difference(
        "frames in two trees raise TransformException",
        "they raise its subclass ConnectivityException",
        "lookups raise the same exception",
    ),
    "chain": Difference(
        "[1] _chain continues above the common ancestor, and unknown names give an empty list "
        "or NO_PARENT; [2] omits the last frame",
        "the frames of the path from source to target, both included; names are checked",
        "these are the frames of the path",
    ),
    "listings": Difference(
        "frames are listed in the order of their first use, without quotes; the legend of the "
        "picture is at a random root",
        "sorted by name, quoted or escaped as YAML and DOT require; each root has the legend",
        "the listings can be parsed for any names",
    ),
    "same_stamp": Difference(
        "[2] keeps all samples of one stamp, and the lookup decides which one is used",
        "the last written sample is used",
        "an edge has one pose at a stamp",
    ),
    "future_result": Difference(
        "[2] the result of Humble's futures is True, that of later versions the transform",
        "the transform",
        "programs for Humble still see a true value",
    ),
    "future_before": Difference(
        "[2] result() and exception() of an unfinished future return None",
        "the same in programs of rclpy; elsewhere they wait if a timeout is given, "
        "otherwise they raise InvalidStateError",
        "None is not a transform, and a wait without a limit could hang",
    ),
    "future_loop": Difference(
        "[2] an awaited future keeps an asyncio loop busy",
        "the loop sleeps until the transform arrives",
        "tfdb does not poll",
    ),
    "clock_back": Difference(
        "[1] if simulated time goes back during a wait, rospy raises "
        "ROSTimeMovedBackwardsException",
        "the wait continues; if the time goes back by more than 3 s, the wait ends as at its "
        "timeout",
        "tf2 intends this, but rospy.sleep raises first",
    ),
    "nanoseconds": Difference(
        "[1] times pass through float seconds, which loses up to 120 ns",
        "integers throughout",
        "stamps are exact",
    ),
    "pruning": Difference(
        "[2] old samples stay for one more write",
        "samples older than the cache are dropped at once",
        "the cache has the length that was set",
    ),
    "numbers": Difference(
        "a number in place of a Time or Duration raises TypeError",
        "an integer is a time in nanoseconds, and 0 the latest common time. A number is a "
        "duration in seconds, as in `Buffer(10)` and `timeout=0.5`",
        "programs without ROS have no class for times",
    ),
    "arguments": Difference(
        "wrong arguments raise TypeError with Python's text; [1] `set_transform` takes no "
        "keywords, `clear` and `all_frames_as_yaml` ignore all arguments",
        "all arguments can be keywords; TypeError names the wrong ones",
        "a misspelt argument is an error",
    ),
    "wrong_message": Difference(
        "[1] a message of the wrong class raises AttributeError late, as does a tuple or "
        "generator in `sendTransform`; `set_transform(None, ...)` crashes the process",
        "an error that is both TypeError and AttributeError names the argument before anything "
        "is sent; `sendTransform` takes any iterable of transforms",
        "a wrong argument must not crash a process",
    ),
    "registered": Difference(
        "[1] `transform` and `convert` raise TypeException, 'if not loaded or supported', until "
        "the package of the type is imported. [1] and [2] raise it for subclasses of registered "
        "types",
        "types of geometry_msgs and sensor_msgs are always registered. Subclasses are transformed "
        "like their base class. For other types TypeException has the text of [2], 'is not loaded "
        "or supported'",
        "the conversions are part of tfdb.tf2",
    ),
    "cache_time": Difference(
        "a negative cache_time is accepted, and no sample is kept",
        "InvalidArgumentException",
        "a negative length has no meaning",
    ),
    "conversion_header": Difference(
        "do_transform_* puts the transform's own header object into the result; [2] "
        "do_transform_vector3 sets the translation of the given transform to 0",
        "the header is copied, and arguments stay unchanged",
        "a later change of one message must not change another",
    ),
    "conversion_transform": Difference(
        "do_transform_* takes any quaternion: [1] scales by its length; [2] normalises it, and "
        "reads length 0 as the identity",
        "InvalidArgumentException unless it is finite and of unit length, as in set_transform",
        "it is not a rigid transform",
    ),
    "conversion_orientation": Difference(
        "[1] an orientation without unit length becomes another rotation",
        "it is normalised; length 0, the default of [1]'s messages, is read as the identity, as "
        "in [2]",
        "programs that need only the position omit the orientation",
    ),
    "conversion_type": Difference(
        "convert, and `transform` with a new_type, return a message of geometry_msgs unchanged "
        "if another of its types is requested",
        "TypeException",
        "the result would have the wrong type",
    ),
    "cloud_layout": Difference(
        "[1] takes the first three numbers of each point as x, y, z. [1] and [2] drop the "
        "padding after the last field, rows and the byte order",
        "fields are found by name, and the layout is kept to the byte",
        "other data must not change",
    ),
    "cloud_normals": Difference(
        "normals are not rotated",
        "normal_x, normal_y, normal_z and nx, ny, nz are rotated",
        "they are directions in the cloud's frame",
    ),
    "cloud_refused": Difference(
        "[1] takes clouds without x, y, z; [2] raises AssertionError",
        "InvalidArgumentException with the text of [2]; also for data shorter than the header "
        "requires, and for fields outside a point",
        "python -O removes assertions",
    ),
    "covariance": Difference(
        "[1] has no PoseWithCovarianceStamped; [2] rotates the blocks of its covariance",
        "both behave as [2]. transform_covariance takes a `lever_arm`, for the covariance of "
        "another "
        "point of the body or of a twist about the frame's origin",
        "x, y, z are the position of the pose itself, so a change of frame alone has no lever arm",
    ),
    "tf1_twist": Difference(
        "tf's lookupTwistFull multiplies two vectors member by member in place of their cross "
        "product. A point beside the axis of a rotating frame has no speed",
        "it has its correct speed; both forms of lookupTwist return velocities on the axes of "
        "the reference frame",
        "this is the correct velocity",
    ),
    "tf1_wait": Difference(
        "tf's waitForTransform raises tf.Exception unless setUsingDedicatedThread was called",
        "it waits",
        "any thread that stores the transform wakes it",
    ),
    "exports": Difference(
        "modules also export private names (`tf.transformations._EPS`) and the features of "
        "`__future__`",
        "these are omitted. A star import of tf2_ros also gives BufferServer, MessageFilter, "
        "FilterFailureReason, TransformableResult, StaticTransformListener and three kinds of "
        "ExtrapolationException",
        "private names are not part of tf2's interface, and tfdb offers more",
    ),
}
"""By name."""
