"""A rospy program that also uses tfdb: the commands of rospy_child.py, and some for tfdb.

It runs in the Python that has tfdb, with Debian's ROS packages at the end of its path.
"""

import pickle
import sys

sys.path.append("/usr/lib/python3/dist-packages")

import rospy
import rospy_child
import tf2_ros
from geometry_msgs.msg import TransformStamped

import tfdb
from tfdb import tf2
from tfdb.ros import node_for

NODES, OPENED, TIMES = [], {}, []


def our_node():
    NODES.append(node_for())
    return [NODES[-1].name, type(NODES[-1]).__name__]


def too_early():
    from tfdb.ros.rospy_node import RospyNode

    try:
        RospyNode()
    except tfdb.errors.NotSupported as error:
        return str(error)
    return ""


def our_listen(topic, kind):
    key = f"ours {topic}"
    heard, callers = rospy_child.HEARD.setdefault(key, []), rospy_child.CALLERS.setdefault(key, [])

    def called(data, publisher):
        with rospy_child.ARRIVED:
            heard.append(bytes(data).hex())
            callers.append(publisher)
            rospy_child.ARRIVED.notify_all()

    OPENED[key] = NODES[-1].subscribe(topic, kind, called)


def our_advertise(topic, kind, latched):
    OPENED[topic] = NODES[-1].advertise(topic, kind, latched=latched)


def our_send(topic, texts):
    for text in texts:
        OPENED[topic].publish(bytes.fromhex(text))


def our_subscribers(topic):
    return OPENED[topic].subscribers


def our_service(name, text):
    answer = len(text).to_bytes(4, "little") + text.encode()
    OPENED[name] = NODES[-1].serve(name, "tf2_msgs/FrameGraph", lambda request: request + answer)


def our_clock():
    def called(now):
        with rospy_child.ARRIVED:
            TIMES.append(now)
            rospy_child.ARRIVED.notify_all()

    NODES[-1].on_clock(called)
    return [NODES[-1].simulated, NODES[-1].now()]


def our_times(count, seconds):
    with rospy_child.ARRIVED:
        rospy_child.ARRIVED.wait_for(lambda: len(TIMES) >= count, seconds)
        return [TIMES, NODES[-1].now()]


def our_end():
    """Return the error of a closed node, and the last calls of its clock callbacks."""
    NODES[-1].close()
    try:
        NODES[-1].advertise("x", "tf2_msgs/TFMessage")
    except tfdb.errors.NodeClosed as error:
        return [str(error), NODES[-1].closed, len(TIMES)]
    return []


def their_view(topic, kind):
    """Return a message that the program's subscriber shares with tfdb's."""
    seen = []

    def called(message):
        with rospy_child.ARRIVED:
            seen.append(message)
            rospy_child.ARRIVED.notify_all()

    OPENED[f"theirs {topic}"] = (rospy.Subscriber(topic, rospy_child.class_of(kind), called), seen)


def what_they_saw(topic, kind, seconds):
    seen = OPENED[f"theirs {topic}"][1]
    with rospy_child.ARRIVED:
        rospy_child.ARRIVED.wait_for(lambda: seen, seconds)
    message = seen[0]
    before = rospy_child.bytes_of(message).hex()
    copied = pickle.loads(pickle.dumps(message))
    found = [isinstance(message, rospy_child.class_of(kind)), message.transforms[0].child_frame_id]
    message.transforms[0].child_frame_id = "changed"
    return [before, *found, rospy_child.bytes_of(message).hex(), rospy_child.bytes_of(copied).hex()]


def our_server(name):
    """Start tfdb's BufferServer in rospy."""
    buffer = tf2.Buffer(flavor="ros1", debug=False)
    OPENED[name] = (buffer, tf2.BufferServer(buffer, name))


def buffers(whose):
    """Create a buffer of tfdb or tf2 for each letter; return whether each offers its tree."""
    made = []
    for who in whose:
        made.append((tf2 if who == "o" else tf2_ros).Buffer())
        placed = TransformStamped(child_frame_id=f"{who}{len(made)}")
        placed.header.frame_id = "map"
        placed.transform.rotation.w = 1.0
        made[-1].set_transform_static(placed, "test")
    OPENED["buffers"] = made
    return [hasattr(buffer, "frame_server") for buffer in made]


def our_transform(name, text):
    OPENED[name][0].buffer.ingest(bytes.fromhex(text), encoding="ros1")


def our_look_up(name, arguments, seconds):
    """Return the result of tfdb's BufferClient in rospy."""
    client = tf2.BufferClient(name)
    try:
        return [
            "ok",
            rospy_child.fields_of(client.lookup_transform(*arguments, rospy.Duration(seconds))),
        ]
    except tf2.TransformException as error:
        return [type(error).__name__, str(error)]


def error_of(verb, *arguments):
    try:
        globals()[verb](*arguments)
    except tfdb.TfdbError as error:
        return [type(error).__name__, str(error)]
    return None


if __name__ == "__main__":
    vars(rospy_child).update({name: value for name, value in globals().items() if name[0] != "_"})
    rospy_child.main()
