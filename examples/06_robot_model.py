"""Store the joint states of a URDF robot model, and look up the path of its tool."""

import numpy as np

import tfdb
from tfdb.robots.urdf import parse_urdf

URDF = """
<robot name="arm">
  <link name="base"/> <link name="upper"/> <link name="lower"/> <link name="tool"/>
  <joint name="shoulder" type="revolute">
    <parent link="base"/> <child link="upper"/> <axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" velocity="2" effort="50"/>
  </joint>
  <joint name="elbow" type="revolute">
    <parent link="upper"/> <child link="lower"/> <origin xyz="0.5 0 0"/> <axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" velocity="2" effort="50"/>
  </joint>
  <joint name="mount" type="fixed">
    <parent link="lower"/> <child link="tool"/> <origin xyz="0.4 0 0"/>
  </joint>
</robot>
"""

model = parse_urdf(URDF)
print(model)

buf = tfdb.Buffer(history=None)
model.set_static(buf, authority="urdf")

# 500 joint states in one commit, for which the tool follows a circle of radius 0.1 around (0.6, 0).
angle = np.linspace(0.0, 2 * np.pi, 500)
x, y = 0.6 + 0.1 * np.cos(angle), 0.1 * np.sin(angle)
elbow = np.arccos((x**2 + y**2 - 0.5**2 - 0.4**2) / (2 * 0.5 * 0.4))
shoulder = np.arctan2(y, x) - np.arctan2(0.4 * np.sin(elbow), 0.5 + 0.4 * np.cos(elbow))
stamps = tfdb.stamp("10.0") + np.arange(500) * 10_000_000
model.set_joint_states(buf, stamps, {"shoulder": shoulder, "elbow": elbow})

poses = buf.lookup_transforms("base", "tool", stamps)
off = np.hypot(poses[:, 0] - 0.6, poses[:, 1]) - 0.1
print(f"largest distance of the tool from the circle: {np.abs(off).max():.1e} m")

speed = buf.lookup_velocity("base", "tool", int(stamps[250]), interval=0.02)
print("speed of the tool:", f"{np.linalg.norm(speed.linear):.3f}", "m/s")
