"""Robot models: hand-computed poses, real robots, and files that must be refused."""

import copy
import math
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import tfdb
from tfdb.data.poses import rotation_matrices
from tfdb.robots import RobotModel, load_urdf, parse_urdf

HALF = math.sqrt(0.5)

ARM = """<?xml version="1.0"?>
<robot name="arm" xmlns:xacro="http://ros.org/wiki/xacro">
  <link name="base"/>
  <link name="upper"><visual><origin xyz="9 9 9"/></visual></link>
  <link name="slider"/> <link name="wheel"/> <link name="tool"/> <link name="follower"/>
  <joint name="lift" type="prismatic">
    <parent link="base"/> <child link="slider"/>
    <origin xyz="0 0 1" rpy="0 1.5707963267948966 0"/>
    <axis xyz="0 0 2"/> <limit lower="-1" upper="2" velocity="0.5" effort="10"/>
  </joint>
  <joint name="shoulder" type="revolute">
    <origin xyz="1 2 3" rpy="0 0 1.5707963267948966"/>
    <parent link="slider"/> <child link="upper"/> <axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" velocity="1" effort="1"/>
  </joint>
  <joint name="spin" type="continuous">
    <parent link="upper"/> <child link="wheel"/> <limit velocity="9" effort="2"/>
  </joint>
  <joint name="mount" type="fixed">
    <parent link="wheel"/> <child link="tool"/> <origin xyz=" 0.5  0 0 "/>
  </joint>
  <joint name="mimic" type="revolute">
    <parent link="base"/> <child link="follower"/> <axis xyz="0 0 1"/>
    <mimic joint="shoulder" multiplier="-2" offset="0.5"/>
  </joint>
  <transmission name="t"><joint name="lift"/></transmission>
</robot>
"""


def pose(*values: float) -> npt.NDArray[np.float64]:
    return np.array(values)


def test_structure() -> None:
    model = parse_urdf(ARM)
    assert (model.name, model.root) == ("arm", "base")
    assert model.links == ("base", "upper", "slider", "wheel", "tool", "follower")
    assert list(model.joints) == ["lift", "shoulder", "spin", "mount", "mimic"]
    assert model.movable == ("lift", "shoulder", "spin")
    lift, spin, follower = (model.joints[name] for name in ("lift", "spin", "mimic"))
    assert (lift.parent, lift.child, lift.axis) == ("base", "slider", (0, 0, 1))
    assert lift.limits is not None
    assert (lift.limits.lower, lift.limits.upper) == (-1, 2)
    assert (lift.limits.velocity, lift.limits.effort) == (0.5, 10)
    assert spin.axis == (1, 0, 0)
    assert spin.limits is not None
    assert (spin.limits.lower, spin.limits.upper) == (-math.inf, math.inf)
    assert follower.mimic is not None
    assert (follower.mimic.joint, follower.mimic.multiplier) == ("shoulder", -2)
    assert repr(model) == "RobotModel('arm', 6 links, 5 joints, root 'base')"


def test_forward_kinematics_by_hand() -> None:
    found = parse_urdf(ARM).forward_kinematics({"lift": 0.25, "shoulder": math.pi / 2, "spin": 3.0})
    # The slider's z points along the base's x, so lifting moves along x.
    assert np.allclose(found["lift"], pose(0.25, 0, 1, 0, HALF, 0, HALF), atol=1e-15)
    # A quarter about z, then a quarter about y as turned by it.
    assert np.allclose(found["shoulder"], pose(1, 2, 3, -0.5, 0.5, 0.5, 0.5), atol=1e-15)
    assert np.allclose(found["spin"], pose(0, 0, 0, math.sin(1.5), 0, 0, math.cos(1.5)))
    assert np.array_equal(found["mount"], pose(0.5, 0, 0, 0, 0, 0, 1))
    half = (-2 * math.pi / 2 + 0.5) / 2
    assert np.allclose(found["mimic"], pose(0, 0, 0, 0, 0, math.sin(half), math.cos(half)))


def test_roll_pitch_yaw_turn_about_fixed_axes() -> None:
    roll, pitch, yaw = 0.3, -0.7, 1.9
    text = ARM.replace('xyz=" 0.5  0 0 "', f'rpy="{roll} {pitch} {yaw}"')
    quaternion = np.array(parse_urdf(text).joints["mount"].origin[3:])

    def turn(angle: float, first: int, second: int) -> npt.NDArray[np.float64]:
        matrix = np.eye(3)
        matrix[first, first] = matrix[second, second] = math.cos(angle)
        matrix[second, first], matrix[first, second] = math.sin(angle), -math.sin(angle)
        return matrix

    expected = turn(yaw, 0, 1) @ turn(pitch, 2, 0) @ turn(roll, 1, 2)
    assert np.allclose(rotation_matrices(quaternion[np.newaxis])[0], expected, atol=1e-15)


def test_only_determined_joints_have_poses() -> None:
    model = parse_urdf(ARM)
    assert set(model.forward_kinematics({})) == {"mount"}
    assert set(model.forward_kinematics({"spin": 1})) == {"mount", "spin"}
    # The given position of a mimic joint wins over its leader's.
    found = model.forward_kinematics({"shoulder": 1.0, "mimic": 0.0})
    assert np.allclose(found["mimic"], pose(0, 0, 0, 0, 0, 0, 1))


def test_many_states_at_once_equal_one_by_one() -> None:
    model = parse_urdf(ARM)
    rng = np.random.default_rng(3)
    states = {name: rng.normal(size=100) for name in model.movable}
    states["lift"] = 0.75
    together = model.forward_kinematics(states)
    for index in range(100):
        state = {name: np.broadcast_to(value, 100)[index] for name, value in states.items()}
        for name, single in model.forward_kinematics(state).items():
            assert together[name].shape == (100, 7)
            assert np.array_equal(together[name][index], single)


WIDE = """<robot name="base"><link name="world"/><link name="cart"/><link name="drone"/>
<joint name="drive" type="planar"><parent link="world"/><child link="cart"/>
  <origin xyz="1 0 0" rpy="0 0 1.5707963267948966"/><axis xyz="{axis}"/></joint>
<joint name="fly" type="floating"><parent link="cart"/><child link="drone"/>
  <origin xyz="0 0 1" rpy="0 0 3.141592653589793"/></joint>
</robot>"""


def test_planar_and_floating_joints() -> None:
    model = parse_urdf(WIDE.format(axis="0 0 1"))
    state = {"drive": (2, 3, math.pi / 2), "fly": (1, 2, 3, HALF, 0, 0, HALF)}
    found = model.forward_kinematics(state)
    assert np.allclose(found["drive"], pose(-2, 2, 0, 0, 0, 1, 0), atol=1e-15)
    assert np.allclose(found["fly"], pose(-1, -2, 4, 0, HALF, HALF, 0), atol=1e-15)
    many = {name: np.tile(np.array(value, dtype=float), (4, 1)) for name, value in state.items()}
    for name, poses in model.forward_kinematics(many).items():
        assert np.allclose(poses, found[name], atol=1e-15)
        assert poses.shape == (4, 7)


@pytest.mark.parametrize(
    ("axis", "moved"), [("0 0 1", (2, 3, 0)), ("1 0 0", (0, 3, -2)), ("0 0 -1", (2, -3, 0))]
)
def test_plane_of_a_planar_joint(axis: str, moved: tuple[float, float, float]) -> None:
    text = WIDE.format(axis=axis).replace('rpy="0 0 1.5707963267948966"', "")
    found = parse_urdf(text).forward_kinematics({"drive": (2, 3, 0.0)})["drive"]
    assert np.allclose(found, pose(moved[0] + 1, moved[1], moved[2], 0, 0, 0, 1), atol=1e-15)


def test_into_a_store() -> None:
    model = parse_urdf(ARM)
    buffer = tfdb.Buffer(history=None)
    assert model.set_static(buffer, authority="urdf") == 1
    assert model.set_joint_state(buffer, 5, {"lift": 0.25, "shoulder": 0.0, "spin": 0.0}) == 2
    assert buffer.frame_info("tool").is_static
    assert buffer.frame_info("tool").authority == "urdf"
    # base -> slider -> upper -> wheel -> tool: half a metre along the upper arm's x.
    tool = buffer.lookup_transform("base", "tool", 5)
    assert np.allclose(tool.translation, (3.25, 2.5, 0.0), atol=1e-14)
    assert buffer.lookup_transform("base", "follower", 5).rotation[2] == pytest.approx(
        math.sin(0.25)
    )


def test_many_states_into_a_store_in_one_commit() -> None:
    model = parse_urdf(ARM)
    stamps = np.arange(50) * 1_000_000 + 7
    angles = np.linspace(0, 1, 50)
    state = {"lift": 0.5, "shoulder": angles, "spin": -angles}
    together, single = tfdb.Buffer(history=None), tfdb.Buffer(history=None)
    assert model.set_joint_states(together, stamps, state) == 1
    for index, stamp in enumerate(stamps):
        values = {name: np.broadcast_to(value, 50)[index] for name, value in state.items()}
        assert model.set_joint_state(single, int(stamp), values) == index + 1
    for frame in ("slider", "upper", "wheel", "follower"):
        for left, right in zip(together.samples(frame), single.samples(frame), strict=True):
            assert np.array_equal(left, right)


BAD_STATES = [
    ({"elbow": 1.0}, "no joint 'elbow'"),
    ({"mount": 1.0}, "'mount' is fixed"),
    ({"lift": math.nan}, "not finite"),
    ({"lift": "far"}, "is not a number"),
    ({"lift": [[1.0]]}, "needs 1 number"),
    ({"lift": [1.0, 2.0], "spin": [1.0, 2.0, 3.0]}, "equal lengths"),
    ({}, "no position of a moving joint"),
]


@pytest.mark.parametrize(("state", "reason"), BAD_STATES)
def test_bad_states_store_nothing(state: dict[str, npt.ArrayLike], reason: str) -> None:
    model = parse_urdf(ARM)
    buffer = tfdb.Buffer()
    with pytest.raises(tfdb.InvalidArgument, match=reason):
        model.set_joint_state(buffer, 5, state)
    with pytest.raises(tfdb.InvalidArgument, match=reason):
        model.set_joint_states(buffer, [5, 6], state)
    assert buffer.commit == 0


def test_a_joint_state_that_is_not_a_mapping_stores_nothing() -> None:
    model, buf = parse_urdf(ARM), tfdb.Buffer()
    wrong: Any = [0.5]
    with pytest.raises(tfdb.InvalidArgument, match=r"must map joint names to .*, got \[0.5\]"):
        model.set_joint_state(buf, tfdb.stamp("1"), wrong)
    with pytest.raises(tfdb.InvalidArgument, match="must map joint names to positions"):
        model.set_joint_states(buf, [tfdb.stamp("1")], wrong)
    assert buf.commit == 0


def test_bad_stamps_store_nothing() -> None:
    model = parse_urdf(ARM)
    buffer = tfdb.Buffer()
    with pytest.raises(tfdb.InvalidArgument, match="must be one position"):
        model.set_joint_state(buffer, 5, {"lift": [1.0, 2.0]})
    with pytest.raises(tfdb.InvalidArgument, match="do not match 3 stamps"):
        model.set_joint_states(buffer, [5, 6, 7], {"lift": [1.0, 2.0]})
    with pytest.raises(tfdb.InvalidArgument, match="shape"):
        model.set_joint_states(buffer, [[5]], {"lift": [1.0]})  # type: ignore[list-item]
    with pytest.raises(tfdb.InvalidStamp):
        model.set_joint_state(buffer, 1.5, {"lift": 1.0})  # type: ignore[arg-type]
    with pytest.raises(tfdb.errors.InvalidArray):
        model.set_joint_states(buffer, np.array([1.5]), {"lift": 1.0})  # type: ignore[arg-type]
    wide = parse_urdf(WIDE.format(axis="0 0 1"))
    with pytest.raises(tfdb.InvalidArgument, match=r"'drive' \(planar\) needs 3 number"):
        wide.set_joint_state(buffer, 5, {"drive": (1, 2)})
    with pytest.raises(tfdb.errors.InvalidTransform):
        wide.set_joint_state(buffer, 5, {"fly": (1, 2, 3, 0, 0, 0, 2)})
    assert buffer.commit == 0


ROBOTS = {
    # links, joints, movable, mimicking, root
    "g1_29dof_rev_1_0.urdf": (39, 38, 29, 0, "pelvis"),
    "panda.urdf": (13, 12, 8, 1, "panda_link0"),
    "pr2.urdf": (82, 81, 20, 10, "base_footprint"),
    "tiago_dual.urdf": (130, 129, 101, 0, "base_footprint"),
    "ur5_gripper.urdf": (11, 10, 6, 0, "world"),
}


@pytest.mark.parametrize("name", ROBOTS)
def test_real_robots(shared_data: Path, name: str) -> None:
    model = load_urdf(shared_data / "urdf" / name)
    mimicking = sum(joint.mimic is not None for joint in model.joints.values())
    found = (len(model.links), len(model.joints), len(model.movable), mimicking, model.root)
    assert found == ROBOTS[name]
    buffer = tfdb.Buffer(history=None)
    model.set_static(buffer)
    state = {n: (0, 0, 0, 0, 0, 0, 1) if model.joints[n].width == 7 else 0.1 for n in model.movable}
    model.set_joint_state(buffer, 1, state)
    assert set(buffer.frames()) == set(model.links)
    assert all(buffer.can_transform(model.root, link, 1) for link in model.links)


def test_panda_by_hand(shared_data: Path) -> None:
    model = load_urdf(shared_data / "urdf" / "panda.urdf")
    buffer = tfdb.Buffer(history=None)
    model.set_static(buffer)
    model.set_joint_state(buffer, 1, dict.fromkeys(model.movable, 0.0))
    # Franka's kinematic chain at zero: 0.333 up, 0.316 up, the elbow's 0.0825 out and back, 0.384
    # up, then 0.088 out, and the hand 0.107 down.
    hand = buffer.lookup_transform("panda_link0", "panda_hand", 1)
    assert np.allclose(hand.translation, (0.088, 0, 0.333 + 0.316 + 0.384 - 0.107), atol=1e-6)


def robot(body: str) -> str:
    return f'<robot name="r">\n<link name="a"/><link name="b"/>\n{body}\n</robot>'


def joint(name: str, parent: str, child: str, more: str = "", kind: str = "fixed") -> str:
    links = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="{kind}">{links}{more}</joint>'


def version(number: str, body: str) -> str:
    return robot(body).replace("<robot ", f'<robot version="{number}" ')


AB = joint("j", "a", "b")
BOMB = """<!DOCTYPE robot [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;"><!ENTITY c "&b;&b;&b;">]>
<robot name="&c;"><link name="a"/></robot>"""
OUTSIDE = """<?xml version="1.0"?>
<!DOCTYPE robot [<!ENTITY x SYSTEM "file:///etc/passwd">]><robot><link name="&x;"/></robot>"""
BAD_MODELS = [
    (BOMB, 1, "document type"),
    (OUTSIDE, 2, "document type"),
    ("<!DOCTYPE robot SYSTEM 'http://127.0.0.1/x.dtd'><robot/>", 1, "document type"),
    ("", 1, "not well-formed XML: no element found"),
    ("not xml", 1, "not well-formed"),
    ("<robot>\n<link name='a'>\n</robot>", 3, "not well-formed XML: mismatched tag"),
    ("<robot name='&undeclared;'/>", 1, "not well-formed XML: undefined entity"),
    ("<robot><link name='a' name='b'/></robot>", 1, "duplicate attribute"),
    ("<?xml version='1.0' encoding='klingon'?><robot/>", 1, "encoding"),
    ("<robot>" + "<x>" * 500 + "</x>" * 500 + "</robot>", 1, "nested deeper than 200"),
    ("<sdf><link name='a'/></sdf>", 1, "the root element is <sdf>"),
    ("<robot/>", 1, "no link"),
    ("<robot>\n<link/></robot>", 2, "a link without a name"),
    (robot('<xacro:include filename="x"/>'), 3, "xacro"),
    (robot(AB + '<link name="a"/>'), 3, "link 'a' is defined twice"),
    (robot(AB + joint("j", "b", "a")), 3, "joint 'j' is defined twice"),
    (robot(""), 2, "2 links have no parent, only the root may: 'a', 'b'"),
    (robot(AB + "\n" + joint("k", "b", "a")), 4, "loop: a -> b -> a"),
    (robot(joint("j", "a", "a") + joint("k", "a", "b")), 3, "loop: a -> a"),
    (
        robot(AB + '<link name="c"/>\n' + joint("k", "c", "b")),
        4,
        "two parents, by joints 'j' and 'k'",
    ),
    (robot(joint("j", "a", "c")), 3, "no child link 'c'"),
    (robot(joint("j", "c", "b")), 3, "no parent link 'c'"),
    (robot('<joint name="j" type="fixed"><child link="b"/></joint>'), 3, "names no parent link"),
    (robot('<joint name="j" type="fixed"><parent link="a"/><child/></joint>'), 3, "no child link"),
    (robot(joint("j", "a", "b", kind="ball")), 3, "unknown type 'ball'"),
    (robot('<joint name="j"><parent link="a"/><child link="b"/></joint>'), 3, "unknown type ''"),
    (robot(joint("j", "a", "b", '<origin xyz="0 0"/>')), 3, "not three numbers"),
    (robot(joint("j", "a", "b", '<origin xyz="0 0 x"/>')), 3, "'x' is not a finite number"),
    (robot(joint("j", "a", "b", '<origin rpy="0 nan 0"/>')), 3, "'nan' is not a finite number"),
    (robot(joint("j", "a", "b", '<origin rpy="0 0 1_0"/>')), 3, "'1_0' is not a finite number"),
    (robot(joint("j", "a", "b", '<axis xyz="0 0 0"/>', "revolute")), 3, "axis is zero"),
    (
        robot(joint("j", "a", "b", '<limit lower="2" upper="1"/>', "revolute")),
        3,
        "lower limit 2.0 above upper limit 1.0",
    ),
    (robot(joint("j", "a", "b", '<mimic joint="k"/>', "revolute")), 3, "'k', which does not exist"),
    (robot(joint("j", "a", "b", '<mimic joint="j"/>', "revolute")), 3, "mimic joints follow each"),
    (robot(joint("j", "a", "b", "<mimic/>", "revolute")), 3, "has a <mimic> without a joint name"),
    (robot(joint("j", "a", "b", "<mimic/>")), 3, "has a <mimic> without a joint name"),
    (robot(joint("j", "a", "b", '<mimic joint="k"/>', "planar")), 3, "is planar and cannot mimic"),
    (
        version("1.1", joint("j", "a", "b", '<origin rpy="0 0 0" quat_xyzw="0 0 0 1"/>')),
        3,
        "both rpy and quat_xyzw",
    ),
    (version("1.1", joint("j", "a", "b", '<origin quat_xyzw="0 0 1"/>')), 3, "not four numbers"),
    (version("1.2", joint("j", "a", "b", '<origin quat_xyzw="0 0 0 0"/>')), 3, "unit length: 0"),
    (version("1.1", joint("j", "a", "b", '<origin quat_xyzw="0 0 nan 1"/>')), 3, "'nan' is not"),
]


@pytest.mark.parametrize(("text", "line", "reason"), BAD_MODELS)
def test_bad_models(tmp_path: Path, text: str, line: int, reason: str) -> None:
    path = tmp_path / "bad.urdf"
    path.write_text(text)
    with pytest.raises(tfdb.errors.ModelError) as caught:
        load_urdf(path)
    assert reason in str(caught.value.reason)
    assert (caught.value.path, caught.value.line) == (str(path), line)
    assert str(caught.value).startswith(f"{path}:{line}: ")


def test_large_files_are_not_read(tmp_path: Path) -> None:
    path = tmp_path / "large.urdf"
    with path.open("wb") as file:
        file.truncate(64 * 1024 * 1024 + 1)
    with pytest.raises(tfdb.errors.ModelError, match="larger than 64 MiB"):
        load_urdf(path)


def test_missing_files(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        load_urdf(tmp_path / "none.urdf")


def test_mimic_chains() -> None:
    chain = robot(
        '<link name="c"/><link name="d"/>'
        + joint("j", "a", "b", kind="prismatic")
        + joint("k", "b", "c", '<mimic joint="j" multiplier="2" offset="1"/>', "prismatic")
        + joint("l", "c", "d", '<mimic joint="k" multiplier="-3" offset="5"/>', "prismatic")
    )
    found = parse_urdf(chain).forward_kinematics({"j": 0.5})
    assert [found[name][0] for name in "jkl"] == [0.5, 2.0, -1.0]


def test_models_are_immutable() -> None:
    model: RobotModel = parse_urdf(ARM.encode())
    with pytest.raises(TypeError):
        model.joints["new"] = model.joints["lift"]  # type: ignore[index]


def test_a_model_goes_to_other_processes() -> None:
    model = parse_urdf(ARM)
    for again in (pickle.loads(pickle.dumps(model)), copy.deepcopy(model)):
        assert (again.name, again.links, again.root) == (model.name, model.links, model.root)
        assert dict(again.joints) == dict(model.joints)
        ours = model.forward_kinematics({"shoulder": 0.3, "lift": 0.2})
        theirs = again.forward_kinematics({"shoulder": 0.3, "lift": 0.2})
        assert ours.keys() == theirs.keys()
        assert all(np.array_equal(ours[name], theirs[name]) for name in ours)


def test_a_model_is_a_tree_of_its_links() -> None:
    model = parse_urdf(ARM.encode())
    same = RobotModel(model.name, model.links, model.joints, model.root)
    assert same.movable == model.movable
    names = list(model.joints)
    fewer = {name: model.joints[name] for name in names[1:]}
    for links, joints, root in (
        (model.links, fewer, model.root),
        (model.links[:-1], model.joints, model.root),
        (model.links, model.joints, model.links[-1]),
        (model.links, model.joints, "nowhere"),
        ((*model.links, "alone"), model.joints, model.root),
        ((*model.links, model.root), model.joints, model.root),
        ("base", {}, "base"),
        (("base",), {"a": 1}, "base"),
    ):
        with pytest.raises(tfdb.InvalidArgument):
            RobotModel("arm", links, joints, root)  # type: ignore[arg-type]


TURNED = (0.2, -0.4, 0.1, 0.88881944173)  # not of unit length in its last digits


@pytest.mark.parametrize("number", ["1.1", "1.2"])
def test_quaternions_of_origins(number: str) -> None:
    origin = f'<origin xyz="3 -2 1" quat_xyzw="{" ".join(map(str, TURNED))}"/>'
    found = parse_urdf(version(number, joint("j", "a", "b", origin))).joints["j"].origin
    assert np.allclose(found, (3, -2, 1, *TURNED), atol=1e-9)
    assert math.isclose(math.hypot(*found[3:]), 1.0, abs_tol=1e-15)


def test_quaternion_of_a_file(tmp_path: Path) -> None:
    path = tmp_path / "quat.urdf"
    path.write_text(
        version(
            "1.1", joint("j", "a", "b", '<origin xyz="0 0 1" quat_xyzw="0 0 .7071068 .7071068"/>')
        )
    )
    buffer = tfdb.Buffer()
    load_urdf(path).set_static(buffer)
    found = buffer.lookup_transform("a", "b", 7)
    assert np.allclose(found.apply(np.array([1.0, 0, 0])), (0, 1, 1), atol=1e-12)


@pytest.mark.parametrize("number", ["", "1.0", "1", "2.0", "one"])
def test_quaternions_need_version_1_1(number: str) -> None:
    origin = '<origin xyz="1 0 0" rpy="0 0 0.5" quat_xyzw="0 0 1 0"/>'
    text = (
        version(number, joint("j", "a", "b", origin))
        if number
        else robot(joint("j", "a", "b", origin))
    )
    with pytest.warns(tfdb.TfdbWarning, match=r"'quat_xyzw' of <origin>: it needs <robot version="):
        model = parse_urdf(text)
    expected = (1, 0, 0, 0, 0, math.sin(0.25), math.cos(0.25))
    assert np.allclose(model.joints["j"].origin, expected, atol=1e-15)


UNKNOWN = [
    ("<joint", '<joint typ="x"', "line 3: attribute 'typ' of <joint> (known are name, type"),
    (
        "<origin",
        '<origin rpy_deg="0 0 90"',
        "'rpy_deg' of <origin> (known are xyz, rpy, quat_xyzw)",
    ),
    ("<axis", '<axis rpy="0 0 1"', "attribute 'rpy' of <axis> (known are xyz)"),
    ("<limit", '<limit min="0"', "attribute 'min' of <limit> (known are lower, upper,"),
    ("<mimic", '<mimic ratio="2"', "attribute 'ratio' of <mimic> (known are joint, multiplier"),
    ("<parent", '<parent joint="x"', "attribute 'joint' of <parent> (known are link)"),
    ("<child", '<child frame="x"', "attribute 'frame' of <child> (known are link)"),
    ('<link name="a"', '<link name="a" parent="b"', "line 2: attribute 'parent' of <link>"),
    ('name="r"', 'name="r" units="mm"', "line 1: attribute 'units' of <robot>"),
    ('name="r"', 'name="r" version="3.0"', "line 1: version='3.0' (known are 1.0, 1.1 and 1.2)"),
    ("<origin", "<orgin", "line 3: <orgin> of <joint> (did you mean <origin>?)"),
    ("<limit", "<limits", "<limits> of <joint> (did you mean <limit>?)"),
]


@pytest.mark.parametrize(("good", "bad", "message"), UNKNOWN)
def test_unknown_attributes_and_elements_are_named(
    tmp_path: Path, recwarn: pytest.WarningsRecorder, good: str, bad: str, message: str
) -> None:
    body = (
        '<origin xyz="1 2 3" rpy="0.1 0.2 0.3"/><axis xyz="0 0 1"/>'
        '<limit lower="-1" upper="1" effort="1" velocity="1"/><mimic joint="m"/>'
    )
    text = robot(
        joint("j", "a", "b", body, "revolute")
        + '<link name="c"/>'
        + joint("m", "b", "c", "", "prismatic")
    )
    path = tmp_path / "unknown.urdf"
    path.write_text(text)
    load_urdf(path)
    assert not recwarn.list
    path.write_text(text.replace(good, bad, 1))
    load_urdf(path)
    (warning,) = recwarn.list
    assert str(warning.message).startswith(f"{path}: ignored: ")
    assert message in str(warning.message)
    assert warning.filename == __file__


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ('<origin xyz="1 2 3" rpy="0.1 0.2 0.3"/>', '<origin xyz="4 5 6"/>'),
        ('<axis xyz="0 0 1"/>', '<axis xyz="0 1 0"/>'),
        ('<limit lower="-1" upper="1"/>', '<limit lower="-2" upper="1"/>'),
        ('<mimic joint="m"/>', '<mimic joint="m" offset="1"/>'),
        ('<parent link="a"/>', '<parent link="c"/>'),
        ('<child link="b"/>', '<child link="c"/>'),
    ],
)
def test_a_second_element_of_a_joint_is_named(
    first: str, second: str, recwarn: pytest.WarningsRecorder
) -> None:
    body = '<origin xyz="1 2 3" rpy="0.1 0.2 0.3"/><axis xyz="0 0 1"/>'
    body += '<limit lower="-1" upper="1"/><mimic joint="m"/>'
    text = robot(
        joint("j", "a", "b", body, "revolute")
        + '<link name="c"/>'
        + joint("m", "b", "c", "", "prismatic")
    )
    plain = parse_urdf(text)
    assert not recwarn.list
    found = parse_urdf(text.replace(first, f"{first}\n{second}", 1))
    (warning,) = recwarn.list
    tag = first.partition(" ")[0]
    assert str(warning.message) == (
        f"<robot_description>: ignored: line 4: another {tag}> of joint 'j' (the first counts)"
    )
    assert found.joints == plain.joints


def test_floating_and_planar_joints_are_named_where_they_are_left_out() -> None:
    model = parse_urdf(WIDE.format(axis="0 0 1"))
    with pytest.warns(tfdb.TfdbWarning) as warned:
        model.set_static(tfdb.Buffer())
    assert [str(each.message) for each in warned] == [
        "robot 'base': no sensor_msgs/JointState moves joint 'drive' (planar), 'fly' (floating): "
        "T[world<-cart], T[cart<-drone] must come from /tf, set_transform or "
        "set_joint_state"
    ]
    assert warned[0].filename == __file__


def test_unknown_attributes_are_named_once_and_not_without_end(
    recwarn: pytest.WarningsRecorder,
) -> None:
    many = " ".join(f'k{n}="{n}"' for n in range(8))
    parse_urdf(
        robot(
            joint("j", "a", "b", f'<origin {many} xmlns:i="x" i:note="fine"/>')
            + '<link name="c"/>'
            + joint("k", "b", "c", f"<origin {many}/>")
        )
    )
    (warning,) = recwarn.list
    assert str(warning.message).count("attribute") == 5
    assert str(warning.message).endswith("; and 3 more")


def test_a_fixed_joint_mimics_nothing() -> None:
    text = robot(
        '<link name="c"/>'
        + joint("j", "a", "b", kind="revolute")
        + joint("k", "b", "c", '<origin xyz="1 2 3" rpy="0 0 0.5"/><mimic joint="j"/>')
    )
    model = parse_urdf(text)
    assert model.joints["k"].mimic is None
    assert [each.child for each in model.static_transforms()] == ["c"]
    expected = (1, 2, 3, 0, 0, math.sin(0.25), math.cos(0.25))
    assert np.allclose(model.forward_kinematics({"j": 0.7})["k"], expected, atol=1e-15)


def test_a_mimic_of_a_fixed_joint_stays_at_its_offset() -> None:
    text = robot(
        '<link name="c"/><link name="d"/><link name="e"/>'
        + joint("j", "a", "b", '<origin xyz="1 0 0"/>')
        + joint("k", "b", "c", '<mimic joint="j" multiplier="9" offset="0.25"/>', "prismatic")
        + joint("l", "c", "d", '<mimic joint="k" multiplier="-2" offset="1"/>', "prismatic")
        + joint("m", "d", "e", kind="prismatic")
    )
    model = parse_urdf(text)
    assert model.movable == ("m",)
    found = model.forward_kinematics({})
    assert [found[name][0] for name in "jkl"] == [1, 0.25, 0.5]
    many = model.forward_kinematics({"m": [1.0, 2.0]})
    assert many["l"][:, 0].tolist() == [0.5, 0.5]
    # What the state names goes before.
    assert model.forward_kinematics({"k": 3.0})["l"][0] == -5
    buffer = tfdb.Buffer()
    model.set_static(buffer)
    model.set_joint_states(buffer, [5, 6], {"m": [1.0, 2.0]})
    assert buffer.lookup_transform("a", "e", 6).translation.tolist() == [3.75, 0, 0]
