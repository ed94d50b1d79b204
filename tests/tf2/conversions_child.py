"""Runs conversions of Debian's tf2_geometry_msgs and tf2_sensor_msgs, with PyKDL.

One JSON list per line in, [function, message, transform], one JSON answer per line out. Started by
test_real_conversions.py with the system's Python, which knows nothing of tfdb.
"""

import json
import sys

import geometry_msgs.msg
import rospy
import sensor_msgs.msg
import tf2_geometry_msgs
import tf2_ros
import tf2_sensor_msgs

PACKAGES = (geometry_msgs.msg, sensor_msgs.msg)
FUNCTIONS = {
    **vars(tf2_geometry_msgs),
    **vars(tf2_sensor_msgs),
    "as_vector": lambda given, _: tf2_ros.convert(given, geometry_msgs.msg.Vector3Stamped),
}


def message(values):
    """A message of its members by name; `type` is that of its class, bytes are latin-1."""
    if isinstance(values, list):
        return [message(each) for each in values]
    if not isinstance(values, dict):
        return values
    values = dict(values)
    if "secs" in values:
        return rospy.Time(values["secs"], values["nsecs"])
    name = values.pop("type", None)
    kind = next((getattr(each, name) for each in PACKAGES if hasattr(each, name or "")), None)
    if kind is None:
        from std_msgs.msg import Header

        kind = Header
    made = kind()
    for member, value in values.items():
        setattr(made, member, value.encode("latin-1") if member == "data" else message(value))
    return made


def plain(value):
    """The other way round."""
    if isinstance(value, bytes):
        return value.decode("latin-1")
    if isinstance(value, (list, tuple)):
        return [plain(each) for each in value]
    if hasattr(value, "secs"):
        return {"secs": value.secs, "nsecs": value.nsecs}
    if hasattr(value, "__slots__"):
        return {name: plain(getattr(value, name)) for name in value.__slots__}
    return value


def main():
    for line in sys.stdin:
        function, given, transform = json.loads(line)
        transform = message(transform)
        made = FUNCTIONS[function](message(given), transform)
        answer = {"made": plain(made), "aliased": made.header is transform.header}
        sys.stdout.write(json.dumps(answer) + "\n")


if __name__ == "__main__":
    main()
