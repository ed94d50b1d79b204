"""The looks of links in URDF files."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from tfdb.data.errors import ModelError, TfdbWarning
from tfdb.robots.shapes import Shape, load_shapes

if TYPE_CHECKING:
    from pathlib import Path

HALF = math.sqrt(0.5)
ROBOT = """<robot name="arm" version="1.1">
  <material name="blue"><color rgba="0 0 1 0.5"/></material>
  <link name="base">
    <visual><geometry><box size="1 2 3"/></geometry><material name="blue"/></visual>
    <visual>
      <origin xyz="0 0 1" rpy="0 0 1.5707963267948966"/>
      <geometry><cylinder radius="0.1" length="2"/></geometry>
      <material name="red"><color rgba="2 0 -1 1"/></material>
    </visual>
    <collision><geometry><sphere radius="9"/></geometry></collision>
  </link>
  <link name="tool">
    <visual>
      <origin quat_xyzw="0 0 0 1"/><geometry><sphere radius="0.2"/></geometry>
      <material name="red"/>
    </visual>
    <visual>
      <geometry><mesh filename="package://arm/tool.stl" scale="0.001 0.001 -1"/></geometry>
    </visual>
    <visual><geometry><mesh filename="hand.stl"/></geometry><material name="unknown"/></visual>
  </link>
  <joint name="j" type="fixed"><parent link="base"/><child link="tool"/></joint>
</robot>
"""


def robot(folder: Path, text: str = ROBOT) -> Path:
    path = folder / "robot.urdf"
    path.write_text(text)
    return path


def test_shapes_have_their_link_size_origin_and_color(tmp_path: Path) -> None:
    shapes, notes = load_shapes(robot(tmp_path))
    zero = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    assert notes == []
    assert shapes[0] == Shape("base", "box", (1, 2, 3), zero, (0, 0, 1, 0.5))
    assert shapes[1].origin == pytest.approx((0, 0, 1, 0, 0, HALF, HALF))
    assert (shapes[1].kind, shapes[1].size) == ("cylinder", (0.1, 2))
    assert shapes[1].color == (1, 0, 0, 1)
    assert shapes[2] == Shape("tool", "sphere", (0.2,), zero, (1, 0, 0, 1))
    assert shapes[3] == Shape(
        "tool", "mesh", (0.001, 0.001, -1), zero, None, "package://arm/tool.stl"
    )
    assert shapes[4] == Shape("tool", "mesh", (1, 1, 1), zero, None, "hand.stl")


def test_a_shape_of_no_known_kind_is_noted(tmp_path: Path) -> None:
    text = ROBOT.replace('<sphere radius="0.2"/>', '<capsule radius="0.2" length="1"/>')
    shapes, notes = load_shapes(robot(tmp_path, text))
    assert len(shapes) == 4
    assert notes == ["line 14: <capsule> of link 'tool' (box, cylinder, sphere, mesh)"]


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ('size="1 2 3"', 'size="1 2"', "size='1 2' are not three numbers"),
        ('size="1 2 3"', "", "<box> lacks a size, or has a negative one"),
        ('radius="0.1"', 'radius="-1"', "<cylinder> lacks a size, or has a negative one"),
        ('radius="0.2"', 'radius="nan"', "radius: 'nan' is not a finite number"),
        ('rgba="0 0 1 0.5"', 'rgba="0 0 1"', "rgba='0 0 1' are not four numbers"),
        ('filename="hand.stl"', "", "a mesh of link 'tool' names no file"),
        ('<box size="1 2 3"/>', "", "a visual of link 'base' has no geometry"),
        ('scale="0.001 0.001 -1"', 'scale="1"', "scale='1' are not three numbers"),
        ('<child link="tool"/>', '<child link="x"/>', "joint 'j': no child link 'x'"),
    ],
)
def test_bad_shapes_are_refused_with_their_line(
    tmp_path: Path, old: str, new: str, reason: str
) -> None:
    path = robot(tmp_path, ROBOT.replace(old, new, 1))
    with pytest.raises(ModelError, match=r"robot\.urdf:[0-9]+: ") as caught:
        load_shapes(path)
    assert caught.value.reason == reason


def test_ignored_attributes_of_a_model_make_a_warning(tmp_path: Path) -> None:
    path = robot(tmp_path, ROBOT.replace('<link name="tool">', '<link name="tool" nmae="x">'))
    with pytest.warns(TfdbWarning, match="nmae") as caught:
        load_shapes(path)
    assert caught[0].filename == __file__
