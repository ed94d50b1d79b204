"""The exports of each module of tf2's packages, as import statements.

`install()` makes modules of these statements. `tests/tf2/test_exports.py` compares them with the
real packages. A name is missing where the package that it comes from is not installed.
"""

from __future__ import annotations

import ast
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Any

from tfdb.ros import msgs
from tfdb.ros.ros_messages import installed

from . import stand_ins

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from tfdb.ros import Flavor

__all__ = ["find_export", "import_all", "statements_of"]

TF2_PY = "from tfdb.tf2.buffer_core import BufferCore\nfrom tfdb.tf2.exceptions import *"
TF2_ROS = """
from tf2_py import *
from tf2_ros.buffer_interface import *
from tf2_ros.buffer import *
from tf2_ros.buffer_client import *
from tf2_ros.transform_listener import *
from tf2_ros.transform_broadcaster import *
from tf2_ros.static_transform_broadcaster import *
from tfdb.tf2 import BufferServer, FilterFailureReason, MessageFilter, TransformableResult
"""
TF1 = {
    "tf": """
from tf2_ros import TransformException as Exception
from tf2_ros import ConnectivityException, ExtrapolationException, LookupException
from tf.listener import Transformer, TransformListener, TransformerROS
from tf.broadcaster import TransformBroadcaster
""",
    "tf.broadcaster": """
import geometry_msgs.msg
import rospy
import tf2_ros.transform_broadcaster
from tfdb.tf2.tf1.broadcaster import TransformBroadcaster
""",
    "tf.listener": """
import geometry_msgs.msg
import numpy
import rospy
import sensor_msgs.msg
import tf2_ros
import yaml
from tf import transformations
from tfdb.tf2.tf1.listener import *
""",
    "tf.msg": "from tfdb.tf2.unused_names import tfMessage",
    "tf.transformations": """
import math
import numpy
import warnings
from tfdb.tf2.tf1.transformations import *
""",
}
ROS1 = {
    "tf2_py": "from tf2_py._tf2 import *",
    "tf2_py._tf2": TF2_PY,
    "tf2_ros": TF2_ROS,
    "tf2_ros.buffer": """
import rosgraph.masterapi
import rospy
import tf2_py as tf2
import tf2_ros
from geometry_msgs.msg import TransformStamped
from tf2_msgs.srv import FrameGraph, FrameGraphResponse
from tfdb.tf2.buffer import Buffer
from tfdb.tf2.unused_names import DEFAULT_CAN_TRANSFORM_POLLING_SCALE
""",
    "tf2_ros.buffer_client": """
import actionlib
import rospy
import tf2_py as tf2
import tf2_ros
from actionlib_msgs.msg import GoalStatus
from tf2_msgs.msg import LookupTransformAction, LookupTransformGoal
from tfdb.tf2.buffer_client import BufferClient
""",
    "tf2_ros.buffer_interface": """
import rospy
import tf2_py as tf2
import tf2_ros
from copy import deepcopy
from geometry_msgs.msg import TransformStamped
from std_msgs.msg import Header
from tfdb.tf2 import BufferInterface, ConvertRegistration, NotImplementedException, Stamped
from tfdb.tf2 import TransformRegistration, TypeException, convert
""",
    "tf2_ros.static_transform_broadcaster": """
import rospy
from geometry_msgs.msg import TransformStamped
from tf2_msgs.msg import TFMessage
from tfdb.tf2.static_transform_broadcaster import StaticTransformBroadcaster
""",
    "tf2_ros.transform_broadcaster": """
import rospy
from geometry_msgs.msg import TransformStamped
from tf2_msgs.msg import TFMessage
from tfdb.tf2.transform_broadcaster import TransformBroadcaster
""",
    "tf2_ros.transform_listener": """
import rospy
import threading
from tf2_msgs.msg import TFMessage
from tfdb.tf2.transform_listener import StaticTransformListener, TransformListener
""",
    "tf2_geometry_msgs": "from tf2_geometry_msgs.tf2_geometry_msgs import *",
    "tf2_geometry_msgs.tf2_geometry_msgs": """
import copy
import PyKDL
import rospy
import tf2_ros
from geometry_msgs.msg import PointStamped, PoseStamped, Vector3Stamped, WrenchStamped
from tfdb.tf2.tf2_geometry_msgs import *
""",
    "tf2_sensor_msgs": "from tf2_sensor_msgs.tf2_sensor_msgs import *",
    "tf2_sensor_msgs.tf2_sensor_msgs": """
import PyKDL
import rospy
import tf2_ros
from sensor_msgs.msg import PointCloud2
from sensor_msgs.point_cloud2 import create_cloud, read_points
from tfdb.tf2.tf2_sensor_msgs import *
""",
    "tf2_kdl": "from tf2_kdl.tf2_kdl import *",
    "tf2_kdl.tf2_kdl": """
import PyKDL
import rospy
import tf2_ros
from geometry_msgs.msg import PointStamped
from tfdb.tf2.tf2_kdl import *
""",
}
ROS2 = {
    "tf2_py": "from rpyutils import add_dll_directories_from_env\nfrom tf2_py._tf2_py import *",
    # Programs use `rclpy.time` after `import rclpy, tf2_py`.
    "tf2_py._tf2_py": f"from rclpy.time import Time as _Time\n{TF2_PY}",
    "tf2_ros": TF2_ROS,
    "tf2_ros.buffer": """
import rclpy
import tf2_py as tf2
import tf2_ros
import threading
from geometry_msgs.msg import TransformStamped
from rclpy.clock import JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.task import Future
from rclpy.time import Time
from tf2_msgs.srv import FrameGraph
from time import sleep
from typing import Any, Callable, List, Optional, Tuple, TypeVar
from tfdb.tf2.buffer import Buffer
from tfdb.tf2.unused_names import FrameGraphSrvRequest, FrameGraphSrvResponse
""",
    "tf2_ros.buffer_client": """
import builtin_interfaces.msg
import tf2_py as tf2
import tf2_ros
import threading
import warnings
from geometry_msgs.msg import TransformStamped
from rclpy.action.client import ActionClient
from rclpy.clock import Clock
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.time import Time
from tf2_msgs.action import LookupTransform
from time import sleep
from typing import TypeVar
from tfdb.tf2.buffer_client import BufferClient
from tfdb.tf2.unused_names import LookupTransformGoal, LookupTransformResult
""",
    "tf2_ros.buffer_interface": """
import rclpy
import tf2_py as tf2
import tf2_ros
from copy import deepcopy
from geometry_msgs.msg import PointStamped, PoseStamped, PoseWithCovarianceStamped
from geometry_msgs.msg import TransformStamped, Vector3Stamped
from rclpy.duration import Duration
from rclpy.time import Time
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header
from typing import Any, Callable, Optional, Tuple, TypeVar, Union
from tfdb.tf2 import BufferInterface, ConvertRegistration, NotImplementedException, Stamped
from tfdb.tf2 import TransformRegistration, TypeException, convert
from tfdb.tf2.unused_names import MsgStamped, PyKDLType
from tfdb.tf2.unused_names import TransformableObject, TransformableObjectType
""",
    "tf2_ros.static_transform_broadcaster": """
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile
from tf2_msgs.msg import TFMessage
from typing import List, Optional, Union
from tfdb.tf2.static_transform_broadcaster import StaticTransformBroadcaster
""",
    "tf2_ros.transform_broadcaster": """
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile
from tf2_msgs.msg import TFMessage
from typing import List, Optional, Union
from tfdb.tf2.transform_broadcaster import TransformBroadcaster
""",
    "tf2_ros.transform_listener": """
import tf2_ros
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile
from tf2_msgs.msg import TFMessage
from tf2_ros.buffer import Buffer
from threading import Thread
from typing import Optional, Union
from tfdb.tf2.transform_listener import StaticTransformListener, TransformListener
from tfdb.tf2.unused_names import DEFAULT_STATIC_TF_TOPIC, DEFAULT_TF_TOPIC
""",
    "tf2_geometry_msgs": "from tf2_geometry_msgs.tf2_geometry_msgs import *",
    "tf2_geometry_msgs.tf2_geometry_msgs": """
import numpy as np
import tf2_ros
from geometry_msgs.msg import Point, Point32, PointStamped, PolygonStamped, Pose, PoseStamped
from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped, Vector3Stamped
from geometry_msgs.msg import WrenchStamped
from typing import Iterable, Optional, Tuple
from tfdb.tf2.tf2_geometry_msgs import *
""",
    "tf2_sensor_msgs": "from tf2_sensor_msgs.tf2_sensor_msgs import *",
    "tf2_sensor_msgs.tf2_sensor_msgs": """
import numpy as np
import tf2_ros
from geometry_msgs.msg import Transform, TransformStamped
from numpy.lib.recfunctions import structured_to_unstructured, unstructured_to_structured
from sensor_msgs.msg import PointCloud2
from sensor_msgs_py.point_cloud2 import create_cloud, read_points
from std_msgs.msg import Header
from typing import Union
from tfdb.tf2.tf2_sensor_msgs import *
""",
    "tf2_kdl": "from tf2_kdl.tf2_kdl import *",
    "tf2_kdl.tf2_kdl": """
import PyKDL
import tf2_ros
from geometry_msgs.msg import PointStamped
from tfdb.tf2.tf2_kdl import *
""",
}
OF_EITHER = {"tf2_py._tf2": TF2_PY, "tf2_py._tf2_py": TF2_PY, **TF1}
"""Modules that programs of either side of ROS find."""


def statements_of(flavor: Flavor) -> dict[str, str]:
    """Import statements of each module of tf2's packages on a side of ROS, by the module's name."""
    return {**OF_EITHER, **(ROS1 if flavor == "ros1" else ROS2)}


def import_all(statements: str) -> tuple[dict[str, Any], dict[str, str]]:
    """Execute import statements; return the objects by name, and the reason of each missing name.

    Raises ImportError for a failed `from module import *`.
    """
    found: dict[str, Any] = {}
    missing: dict[str, str] = {}
    for _, name, take in _imports(statements):
        try:
            found |= take()
        except (ImportError, AttributeError) as error:
            if name == "*":
                raise
            missing[name] = str(error)
    return found, missing


def find_export(name: str) -> Any:
    """Return an export of `tf2_ros` from another package; AttributeError."""
    flavor = installed()
    if flavor is None:
        for stand_in in (stand_ins, msgs):
            if name in stand_in.__all__:
                return getattr(stand_in, name)
        flavor = "ros2"
    modules = statements_of(flavor)
    for module in modules:
        if module.startswith("tf2_ros."):
            for source, given, take in _imports(modules[module]):
                if given == name and source not in modules:
                    return take()[name]
    raise AttributeError(f"module 'tfdb.tf2' has no attribute {name!r}")


def _imports(statements: str) -> Iterator[tuple[str, str, Callable[[], dict[str, Any]]]]:
    """Module, name and importing statement of each imported name."""
    for each in ast.parse(statements).body:
        if isinstance(each, ast.ImportFrom):
            source = each.module or ""
            for alias in each.names:
                yield source, alias.asname or alias.name, partial(_from, source, alias)
        elif isinstance(each, ast.Import):
            for alias in each.names:
                name = alias.asname or alias.name.partition(".")[0]
                yield alias.name, name, partial(_module, alias.name, alias.asname)


def _from(source: str, alias: ast.alias) -> dict[str, Any]:
    """`from source import alias`."""
    module = import_module(source)
    if alias.name == "*":
        public = (name for name in vars(module) if not name.startswith("_"))
        return {name: getattr(module, name) for name in getattr(module, "__all__", public)}
    if not hasattr(module, alias.name):  # the name may be a module that was not imported yet
        return {alias.asname or alias.name: import_module(f"{source}.{alias.name}")}
    return {alias.asname or alias.name: getattr(module, alias.name)}


def _module(name: str, given: str | None) -> dict[str, Any]:
    """`import name as given`."""
    module = import_module(name)
    first = name.partition(".")[0]
    return {given: module} if given else {first: import_module(first)}
