#!/usr/bin/python3
"""The ROS 1 nodes behind tools/make_example_recording; run by the system's Python, which has rospy.

upload-model URDF   puts the robot description on the parameter server (and waits for the master)
joints URDF         publishes smooth joint states inside the joints' limits, 25 Hz
odometry            publishes odom -> base_footprint, a robot that drives a weaving curve, 50 Hz
localization        publishes map -> odom, a slow drift with a correction every second, 10 Hz
wait-for-frames     returns when every one of these is heard
"""

from __future__ import annotations

import math
import sys
import time
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import TYPE_CHECKING

import rosgraph
import rospy
import tf2_ros
from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import JointState

if TYPE_CHECKING:
    from collections.abc import Callable

JOINT_HZ, ODOMETRY_HZ, LOCALIZATION_HZ = 25.0, 50.0, 10.0


def wait_for_master(seconds: float = 30.0) -> None:
    """Returns when the master answers; exits with an error when it does not."""
    end = time.monotonic() + seconds
    while not rosgraph.is_master_online():
        if time.monotonic() > end:
            sys.exit("no ROS master at ROS_MASTER_URI")
        time.sleep(0.1)


def upload_model(path: str) -> None:
    """Sets /robot_description from a URDF file."""
    wait_for_master()
    text = Path(path).read_text(encoding="utf-8")
    rosgraph.Master("/make_example_recording").setParam("/robot_description", text)


def moving_joints(path: str) -> list[tuple[str, float, float]]:
    """Name, middle and amplitude (rad or m) of every joint that moves on its own."""
    joints = []
    for joint in ET.parse(path).getroot().findall("joint"):
        if joint.get("type") == "fixed" or joint.find("mimic") is not None:
            continue
        limit = joint.find("limit")
        if joint.get("type") == "continuous" or limit is None:
            lower, upper = -math.pi / 2, math.pi / 2
        else:
            lower, upper = float(limit.get("lower", "0")), float(limit.get("upper", "0"))
        joints.append((joint.get("name", ""), (lower + upper) / 2, 0.35 * (upper - lower)))
    return joints


def joint_position(index: int, middle: float, amplitude: float, t: float) -> float:
    """Two incommensurable sines, another pair for each joint: smooth, never the same pose twice."""
    slow = 2 * math.pi * (0.11 + 0.013 * index)
    fast = 2 * math.pi * (0.37 + 0.007 * index)
    return middle + amplitude * (
        0.8 * math.sin(slow * t + 0.9 * index) + 0.2 * math.sin(fast * t + 2.3 * index)
    )


def run_joints(path: str) -> None:
    """The joint state node."""
    rospy.init_node("joints")
    publisher = rospy.Publisher("joint_states", JointState, queue_size=10)
    joints = moving_joints(path)
    rate = rospy.Rate(JOINT_HZ)
    start = rospy.get_time()
    while not rospy.is_shutdown():
        message = JointState()
        message.header.stamp = rospy.Time.now()
        t = message.header.stamp.to_sec() - start
        message.name = [name for name, _, _ in joints]
        message.position = [joint_position(i, m, a, t) for i, (_, m, a) in enumerate(joints)]
        publisher.publish(message)
        rate.sleep()


def planar(parent: str, child: str, x: float, y: float, yaw: float) -> TransformStamped:
    """T[parent<-child] of a pose in the plane (metres, radians), stamped now."""
    message = TransformStamped()
    message.header.stamp = rospy.Time.now()
    message.header.frame_id, message.child_frame_id = parent, child
    message.transform.translation.x, message.transform.translation.y = x, y
    message.transform.rotation.z = math.sin(yaw / 2)
    message.transform.rotation.w = math.cos(yaw / 2)
    return message


def run_odometry() -> None:
    """The odometry node: unicycle motion, integrated step by step as a wheel odometry does."""
    rospy.init_node("odometry")
    broadcaster = tf2_ros.TransformBroadcaster()
    rate = rospy.Rate(ODOMETRY_HZ)
    x = y = yaw = t = 0.0
    while not rospy.is_shutdown():
        speed = 0.45 + 0.15 * math.sin(0.9 * t)
        turn = 0.55 * math.sin(0.7 * t + 0.4)
        dt = 1.0 / ODOMETRY_HZ
        x += speed * math.cos(yaw + turn * dt / 2) * dt
        y += speed * math.sin(yaw + turn * dt / 2) * dt
        yaw += turn * dt
        t += dt
        broadcaster.sendTransform(planar("odom", "base_footprint", x, y, yaw))
        rate.sleep()


def run_localization() -> None:
    """The localization node: odometry's drift, corrected a little every second."""
    rospy.init_node("localization")
    broadcaster = tf2_ros.TransformBroadcaster()
    rate = rospy.Rate(LOCALIZATION_HZ)
    step = 0
    while not rospy.is_shutdown():
        t, second = step / LOCALIZATION_HZ, int(step / LOCALIZATION_HZ)
        x = 2.5 + 0.012 * t - 0.009 * second
        y = -1.2 + 0.02 * math.sin(0.4 * t) + 0.004 * (second % 3)
        broadcaster.sendTransform(planar("map", "odom", x, y, 0.35 + 0.004 * t - 0.003 * second))
        step += 1
        rate.sleep()


def wait_for_frames() -> None:
    """Waits until the whole tree, from the map to a finger and to the lidar, can be looked up."""
    rospy.init_node("wait_for_frames")
    buffer = tf2_ros.Buffer(debug=False)
    tf2_ros.TransformListener(buffer)
    for frame in ("r_gripper_r_finger_tip_link", "lidar"):
        if not buffer.can_transform("map", frame, rospy.Time(0), rospy.Duration(20)):
            sys.exit(f"no transform from map to {frame} after 20 s")


COMMANDS: dict[str, Callable[..., None]] = {
    "upload-model": upload_model,
    "joints": run_joints,
    "odometry": run_odometry,
    "localization": run_localization,
    "wait-for-frames": wait_for_frames,
}

if __name__ == "__main__":
    try:
        COMMANDS[sys.argv[1]](*sys.argv[2:])
    except rospy.ROSInterruptException:
        sys.exit(0)
