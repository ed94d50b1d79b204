"""A rospy program: executes each line of its input, and answers it by a line.

It runs in the system's Python, with Debian's ROS and without tfdb.
"""

import importlib
import io
import json
import os
import sys
import threading
import time

import rospy
import tf2_ros
from tf2_msgs.msg import LookupTransformGoal

HEARD = {}
CALLERS = {}
SUBSCRIBERS, PUBLISHERS, SERVICES, CLIENTS = {}, {}, {}, {}
ARRIVED = threading.Condition()
# A part of the error of a BufferClient without a result.
LOST = "Something is likely wrong with the server"


def class_of(kind, part="msg"):
    package, name = kind.split("/")
    return getattr(importlib.import_module(f"{package}.{part}"), name)


def bytes_of(message):
    out = io.BytesIO()
    message.serialize(out)
    return out.getvalue()


class Connections(rospy.SubscribeListener):
    def __init__(self):
        self.count = 0

    def peer_subscribe(self, topic_name, topic_publish, peer_publish):
        with ARRIVED:
            self.count += 1
            ARRIVED.notify_all()


def start(name):
    rospy.init_node(name, disable_signals=True)
    return rospy.get_name()


def listen(topic, kind):
    HEARD[topic], CALLERS[topic] = [], []

    def called(message):
        with ARRIVED:
            HEARD[topic].append(bytes_of(message).hex())
            CALLERS[topic].append(message._connection_header["callerid"])
            ARRIVED.notify_all()

    SUBSCRIBERS[topic] = rospy.Subscriber(topic, class_of(kind), called, tcp_nodelay=True)


def connected_to(topic, seconds):
    """Wait until the subscriber of a topic has a publisher; return whether it has."""
    deadline = time.monotonic() + seconds
    while SUBSCRIBERS[topic].get_num_connections() == 0:
        if time.monotonic() > deadline:
            return False
        time.sleep(0.005)
    return True


def heard(topic, count, seconds):
    with ARRIVED:
        ARRIVED.wait_for(lambda: len(HEARD[topic]) >= count, seconds)
        return [HEARD[topic], CALLERS[topic]]


def advertise(topic, kind, latch, queue_size):
    connections = Connections()
    publisher = rospy.Publisher(
        topic, class_of(kind), subscriber_listener=connections, latch=latch, queue_size=queue_size
    )
    PUBLISHERS[topic] = (publisher, class_of(kind), connections)


def joined(topic, count, seconds):
    connections = PUBLISHERS[topic][2]
    with ARRIVED:
        return ARRIVED.wait_for(lambda: connections.count >= count, seconds)


def send(topic, texts):
    publisher, kind, _ = PUBLISHERS[topic]
    for text in texts:
        publisher.publish(kind().deserialize(bytes.fromhex(text)))


def withdraw(topic):
    PUBLISHERS.pop(topic)[0].unregister()


def serve(name, kind, text):
    service = class_of(kind, "srv")
    SERVICES[name] = rospy.Service(name, service, lambda _: service._response_class(text))


def ask(name, kind):
    """Return the answer of a service: ok and its only field, or the error."""
    rospy.wait_for_service(name, 10)
    try:
        answer = rospy.ServiceProxy(name, class_of(kind, "srv"))()
    except rospy.ServiceException as error:
        return ["error", str(error)]
    return ["ok", getattr(answer, answer.__slots__[0])]


def ask_often(name, kind, count):
    """Return several answers over one connection."""
    proxy = rospy.ServiceProxy(name, class_of(kind, "srv"), persistent=True)
    answers = [proxy() for _ in range(count)]
    proxy.close()
    return [getattr(answer, answer.__slots__[0]) for answer in answers]


def set_parameter(name, value):
    rospy.set_param(name, value)


def delete_parameter(name):
    rospy.delete_param(name)


def fields_of(message):
    move, turn = message.transform.translation, message.transform.rotation
    pose = [move.x, move.y, move.z, turn.x, turn.y, turn.z, turn.w]
    stamp = message.header.stamp.to_nsec()
    return [message.header.frame_id, message.child_frame_id, stamp, pose]


def time_of(nanoseconds):
    return rospy.Time(*divmod(nanoseconds, 1_000_000_000))


def client(server, seconds):
    """Create Debian's BufferClient; return whether a server is connected."""
    CLIENTS[server] = tf2_ros.BufferClient(server)
    return CLIENTS[server].wait_for_server(rospy.Duration(seconds))


def look_up(server, full, arguments, seconds):
    """Return its answer: ok and the fields, or the exception and its text.

    actionlib drops a result that arrives before send_goal returns. The question is sent again
    after such a timeout, at most four times.
    """
    given = [time_of(each) if isinstance(each, int) else each for each in arguments]
    made = CLIENTS[server]
    find = made.lookup_transform_full if full else made.lookup_transform
    for _ in range(5):
        try:
            return ["ok", fields_of(find(*given, rospy.Duration(seconds)))]
        except tf2_ros.TransformException as error:
            answer = [type(error).__name__, str(error)]
        if LOST not in answer[1]:
            break
    return answer


def begin_goal(server, target, source, seconds):
    """Send a goal by actionlib, without waiting for its result."""
    made = CLIENTS[server].client
    made.send_goal(
        LookupTransformGoal(
            target_frame=target, source_frame=source, timeout=rospy.Duration(seconds)
        )
    )


def wait_active(server, seconds):
    """Return the state of the last goal, once it is not pending."""
    deadline = time.monotonic() + seconds
    while CLIENTS[server].client.get_state() == 0 and time.monotonic() < deadline:
        time.sleep(0.005)
    return CLIENTS[server].client.get_state()


def cancel_goal(server, seconds):
    """Cancel the last goal; return its last state."""
    made = CLIENTS[server].client
    made.cancel_goal()
    made.wait_for_result(rospy.Duration(seconds))
    return made.get_state()


def main():
    # rospy's output would mix with the answers.
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "w", buffering=1)
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    for line in sys.stdin:
        verb, *arguments = json.loads(line)
        try:
            answer = ["ok", globals()[verb](*arguments)]
        except Exception as error:
            answer = ["error", f"{type(error).__name__}: {error}"]
        answers.write(json.dumps(answer) + "\n")
    os._exit(0)


if __name__ == "__main__":
    main()
