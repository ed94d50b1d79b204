"""Every form of a pose, through every door that takes one; scipy judges the rotations."""

from __future__ import annotations

import copy
import pickle
import warnings
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial.transform import Rotation

import tfdb

if TYPE_CHECKING:
    from collections.abc import Callable

Matrix = npt.NDArray[np.float64]
RNG = np.random.default_rng(20261123)
STAMP = 5_000_000_000


def random_poses(count: int) -> list[tuple[Matrix, Rotation, Matrix]]:
    """Translations, rotations and matrices; half turns and quarter turns among them."""
    turns = [*Rotation.random(count, random_state=7), *Rotation.create_group("O")]
    made = []
    for turn in turns:
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = turn.as_matrix(), RNG.uniform(-9, 9, 3)
        made.append((matrix[:3, 3].copy(), turn, matrix))
    return made


POSES = random_poses(60)


class Quaternion:
    """Has x, y, z and w, as a message of ROS."""

    def __init__(self, x: float, y: float, z: float, w: float) -> None:
        self.x, self.y, self.z, self.w = x, y, z, w


def forms(move: Matrix, turn: Rotation, matrix: Matrix) -> list[tuple[tuple[Any, ...], Any]]:
    """The same pose as arguments, positional and by name, in every form."""
    quat = turn.as_quat()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a gimbal lock
        rpy = turn.as_euler("xyz")
    return [
        ((move, quat), {}),
        ((tuple(move), turn), {}),
        ((move, Quaternion(*quat)), {}),
        ((move,), {"rotation": turn}),
        ((move,), {"rpy": rpy}),
        ((list(move),), {"wxyz": np.roll(quat, 1)}),
        ((move,), {"wxyz": tuple(np.roll(quat, 1).tolist())}),
        ((matrix,), {}),
        ((np.asfortranarray(matrix),), {}),
        ((matrix.tolist(),), {}),
        ((np.concatenate([move, quat]),), {}),
        (([*move.tolist(), *quat.tolist()],), {}),
        ((tfdb.Transform.from_matrix(matrix, target="map", source="base"),), {}),
        ((tfdb.Transform("map", "base", move, turn).to_msg().transform,), {}),
    ]


def by_set(*args: Any, **named: Any) -> tfdb.Transform:
    buf = tfdb.Buffer()
    buf.set_transform("map", "base", STAMP, *args, **named)
    return buf.lookup_transform("map", "base", STAMP)


def by_set_static(*args: Any, **named: Any) -> tfdb.Transform:
    buf = tfdb.Buffer()
    buf.set_static_transform("map", "base", *args, **named)
    return buf.lookup_transform("map", "base", STAMP)


def by_transaction(*args: Any, **named: Any) -> tfdb.Transform:
    buf = tfdb.Buffer()
    with buf.transaction() as tx:
        tx.set_transform("map", "base", STAMP, *args, **named)
    return buf.lookup_transform("map", "base", STAMP)


def by_static_transaction(*args: Any, **named: Any) -> tfdb.Transform:
    buf = tfdb.Buffer()
    with buf.transaction() as tx:
        tx.set_static_transform("map", "base", *args, **named)
    return buf.lookup_transform("map", "base", STAMP)


def by_reparent(*args: Any, **named: Any) -> tfdb.Transform:
    buf = tfdb.Buffer()
    buf.set_transform("odom", "base", 1, (7, 8, 9), (0, 0, 0.6, 0.8))
    names = ("translation", "rotation")
    with buf.transaction() as tx:
        given = dict(zip(names, args, strict=False)) | named
        tx.reparent("base", "map", STAMP, **given)
    return buf.lookup_transform("map", "base", STAMP)


def by_constructor(*args: Any, **named: Any) -> tfdb.Transform:
    return tfdb.Transform("map", "base", *args, stamp=STAMP, **named)


DOORS: list[Callable[..., tfdb.Transform]] = [
    by_set, by_set_static, by_transaction, by_static_transaction, by_reparent, by_constructor,
]  # fmt: skip


@pytest.mark.parametrize("door", DOORS, ids=lambda door: door.__name__)
def test_every_form_through_every_door(door: Callable[..., tfdb.Transform]) -> None:
    for move, turn, matrix in POSES[:: len(POSES) // 12]:
        for args, named in forms(move, turn, matrix):
            found = door(*args, **named)
            np.testing.assert_allclose(found.matrix, matrix, rtol=0, atol=1e-14)
            back = found.inverse().matrix
            np.testing.assert_allclose(back, np.linalg.inv(matrix), rtol=0, atol=1e-13)


def test_matrices_and_angles_are_those_of_scipy() -> None:
    for move, turn, matrix in POSES:
        made = tfdb.Transform.from_matrix(matrix, "map", "base", STAMP)
        assert (made.target, made.source, made.stamp) == ("map", "base", STAMP)
        np.testing.assert_array_equal(made.translation, move)
        np.testing.assert_allclose(made.matrix, matrix, rtol=0, atol=1e-15)
        assert (Rotation.from_quat(made.rotation).inv() * turn).magnitude() < 1e-15
        rolled = Rotation.from_euler("xyz", made.rpy)
        assert (rolled.inv() * turn).magnitude() < 1e-8  # at 90 degrees of pitch angles are poor
        assert tfdb.Transform("map", "base", move, rpy=made.rpy).rpy == pytest.approx(
            made.rpy, abs=1e-7
        )
    rpy = (0.3, -0.4, 2.5)
    made = tfdb.Transform("a", "b", (0, 0, 0), rpy=rpy)
    assert made.rpy == pytest.approx(rpy, abs=1e-15)
    np.testing.assert_allclose(made.matrix[:3, :3], Rotation.from_euler("xyz", rpy).as_matrix())


def test_columns_of_matrices_and_rotations() -> None:
    moves = np.array([move for move, _, _ in POSES])
    turns = Rotation.concatenate([turn for _, turn, _ in POSES])
    matrices = np.array([matrix for _, _, matrix in POSES])
    stamps = np.arange(len(POSES)) * 1000
    for columns in (
        tfdb.Columns("map", "base", stamps, matrices=matrices),
        tfdb.Columns("map", "base", stamps, matrices=matrices.tolist()),
        tfdb.Columns("map", "base", stamps, translations=moves, rotations=turns),
    ):
        buf = tfdb.Buffer(history=None)
        buf.set_transforms(columns)
        found = buf.lookup_transforms("map", "base", stamps, layout="matrix")
        np.testing.assert_allclose(found, matrices, rtol=0, atol=2e-15)
    batch = [
        tfdb.TransformStamped("map", "base", stamp, move, turn)
        for stamp, (move, turn, _) in zip(stamps.tolist(), POSES, strict=True)
    ]
    buf = tfdb.Buffer(history=None)
    buf.set_transforms(batch)
    found = buf.lookup_transforms("map", "base", stamps, layout="matrix")
    np.testing.assert_allclose(found, matrices, rtol=0, atol=2e-15)


GOOD = POSES[0][2]


def changed(**at: float) -> Matrix:
    """The good matrix with other entries: `r0c1=2.0`."""
    made = GOOD.copy()
    for place, value in at.items():
        made[int(place[1]), int(place[3])] = value
    return made


BAD: list[tuple[Matrix, str]] = [
    (GOOD * [[2], [2], [2], [1]], r"it scales by 2\b"),
    (GOOD @ np.diag([1, 1, -1, 1]), r"its determinant is -1\b"),
    (np.diag([0.0, 0, 0, 1]), r"its determinant is 0\b"),
    (GOOD @ np.diag([1, 1.01, 1, 1]), r"off right angles or the same length by 0\.00996"),
    (GOOD @ (np.eye(4) + 0.1 * np.eye(4, k=1) * [[1], [0], [0], [0]]), r"by 0\.0995"),
    (changed(r3c3=2.0), r"its last row is off 0 0 0 1 by 1$"),
    (GOOD.T, r"its last row is off 0 0 0 1 by .*has to be transposed"),
    (changed(r1c1=np.nan), r"it holds nan"),
    (changed(r0c3=np.inf), r"it holds inf"),
]


@pytest.mark.parametrize(("matrix", "told"), BAD)
def test_what_is_not_rigid_is_refused_and_by_how_much(matrix: Matrix, told: str) -> None:
    for door in DOORS:
        with pytest.raises(tfdb.InvalidTransform, match=told):
            door(matrix)
    with pytest.raises(tfdb.InvalidTransform, match=told):
        tfdb.Transform.from_matrix(matrix, "map", "base")
    with pytest.raises(tfdb.InvalidTransform, match=told.replace("^", "")) as error:
        tfdb.Columns("map", "base", [1, 2], matrices=np.array([GOOD, matrix]))
    assert error.value.index == 1


def test_rounded_matrices_are_taken() -> None:
    for _, _, matrix in POSES:
        printed = np.round(matrix, 4)
        found = tfdb.Transform.from_matrix(printed, "map", "base")
        assert np.abs(found.matrix - matrix).max() < 2e-4
        assert np.linalg.norm(found.rotation) == pytest.approx(1.0, abs=1e-15)


REFUSED: list[tuple[tuple[Any, ...], dict[str, Any]]] = [
    ((GOOD[:3],), {}),
    ((np.eye(3),), {}),
    ((np.zeros((2, 4, 4)),), {}),
    ((GOOD.tolist()[:3],), {}),
    (([[1, 2], [3]],), {}),
    ((np.zeros(6),), {}),
    (((1, 2, 3, 4),), {}),
    ((POSES[0][1],), {}),
    ((Rotation.random(2, random_state=1),), {}),
    (((1, 2, 3), Rotation.random(2, random_state=1)), {}),
    (((1, 2, 3),), {"rpy": (1, 2)}),
    (((1, 2, 3),), {"rpy": "abc"}),
    (((1, 2, 3),), {"wxyz": (1, 0, 0)}),
    (((1, 2, 3),), {"wxyz": Quaternion(0, 0, 0, 1)}),
    (((1, 2, 3),), {"wxyz": POSES[0][1]}),
    ((GOOD, (0, 0, 0, 1)), {}),
    ((GOOD,), {"rpy": (0, 0, 0)}),
]


@pytest.mark.parametrize("door", DOORS, ids=lambda door: door.__name__)
def test_other_shapes_are_refused(door: Callable[..., tfdb.Transform]) -> None:
    for args, named in REFUSED:
        with pytest.raises(tfdb.InvalidArray):
            door(*args, **named)
    for named in ({"rpy": (0, 0, np.nan)}, {"wxyz": (1, 1, 0, 0)}, {"wxyz": (np.inf, 0, 0, 0)}):
        with pytest.raises(tfdb.InvalidTransform):
            door((1, 2, 3), **named)
    for named in (
        {"rotation": (0, 0, 0, 1), "rpy": (0, 0, 0)},
        {"rpy": (0, 0, 0), "wxyz": (1, 0, 0, 0)},
    ):
        with pytest.raises(tfdb.InvalidArgument, match="give one of rotation"):
            door((1, 2, 3), **named)


@pytest.mark.parametrize("door", DOORS, ids=lambda door: door.__name__)
def test_a_transform_goes_between_its_own_frames_only(
    door: Callable[..., tfdb.Transform],
) -> None:
    there = tfdb.Transform.from_matrix(GOOD, target="map", source="base")
    assert door(there).pose == pytest.approx(there.pose)
    with pytest.raises(tfdb.InvalidArgument, match=r"T\[base<-map\] was given for T\[map<-base\]"):
        door(there.inverse())
    assert door(there.inverse().inverse().pose).pose == pytest.approx(there.pose, abs=1e-12)


def test_nothing_is_stored_of_what_is_refused() -> None:
    buf = tfdb.Buffer()
    for args, named in REFUSED:
        with pytest.raises(tfdb.InvalidArray):
            buf.set_transform("map", "base", STAMP, *args, **named)
    assert (buf.commit, buf.frames()) == (0, [])


class Raising:
    """A rotation whose as_quat fails."""

    def as_quat(self) -> Any:
        raise ZeroDivisionError


def test_objects_that_only_look_like_rotations() -> None:
    for turned in (Raising(), type("Odd", (), {"as_quat": lambda _: "abc"})()):
        with pytest.raises(tfdb.InvalidArray, match="rotation"):
            tfdb.Transform("a", "b", (1, 2, 3), turned)


def test_a_translation_alone_is_not_rotated() -> None:
    for door in DOORS:
        assert door((1, 2, 3)).pose.tolist() == [1, 2, 3, 0, 0, 0, 1]
        assert door((1, 2, 3), rotation=None, rpy=None, wxyz=None).translation.tolist() == [1, 2, 3]


def test_messages_and_copies() -> None:
    for move, turn, matrix in POSES[:5]:
        made = tfdb.Transform.from_matrix(matrix, "map", "base", STAMP + 7)
        message = made.to_msg()
        assert (message.header.frame_id, message.child_frame_id) == ("map", "base")
        assert tfdb.stamp(message.header.stamp) == STAMP + 7
        buf = tfdb.Buffer()
        buf.set_transforms([message])
        np.testing.assert_allclose(
            buf.lookup_transform("map", "base").matrix, matrix, rtol=0, atol=1e-15
        )
        assert pickle.loads(pickle.dumps(made)) == made == copy.deepcopy(made)
        assert turn.as_quat().shape == (4,)
        assert move.shape == (3,)


def test_a_notebook_shows_a_transform_and_escapes_its_names() -> None:
    buf = tfdb.Buffer()
    name = "<script>alert('x')</script>&\""
    buf.set_transform("map", name, STAMP, (1, 2, 3), rpy=(0, 0, 0.5))
    shown = buf.lookup_transform("map", name)._repr_html_()
    assert "<script" not in shown
    assert "&lt;script&gt;" in shown
    assert "0.5" in shown
    assert shown.count("<table>") == shown.count("</table>") == 2
