"""Every call takes every form of a pose; scipy judges the rotations."""

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


def by_batch(*args: Any, **named: Any) -> tfdb.Transform:
    buf = tfdb.Buffer()
    buf.set_transforms([tfdb.TransformStamped("map", "base", STAMP, *args, **named)])
    return buf.lookup_transform("map", "base", STAMP)


DOORS: list[Callable[..., tfdb.Transform]] = [
    by_set, by_set_static, by_transaction, by_static_transaction, by_reparent, by_constructor,
    by_batch,
]  # fmt: skip


@pytest.mark.parametrize("door", DOORS, ids=lambda door: door.__name__)
def test_every_call_takes_every_form(door: Callable[..., tfdb.Transform]) -> None:
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
    (GOOD @ np.diag([1, 1.01, 1, 1]), r"not orthogonal unit vectors: the error is 0\.00996"),
    (GOOD @ (np.eye(4) + 0.1 * np.eye(4, k=1) * [[1], [0], [0], [0]]), r"error is 0\.0995"),
    (changed(r3c3=2.0), r"its last row must be 0 0 0 1, but differs by 1$"),
    (GOOD.T, r"its last row must be 0 0 0 1, .*transpose the matrix"),
    (2 * np.eye(4), r"its last row must be 0 0 0 1, but differs by 1$"),
    (changed(r1c1=np.nan), r"it contains nan"),
    (changed(r0c3=np.inf), r"it contains inf"),
]


@pytest.mark.parametrize(("matrix", "told"), BAD)
def test_non_rigid_matrices_are_refused_with_their_error(matrix: Matrix, told: str) -> None:
    for door in DOORS:
        with pytest.raises(tfdb.errors.InvalidTransform, match=told):
            door(matrix)
    with pytest.raises(tfdb.errors.InvalidTransform, match=told):
        tfdb.Transform.from_matrix(matrix, "map", "base")
    with pytest.raises(tfdb.errors.InvalidTransform, match=told.replace("^", "")) as error:
        tfdb.Columns("map", "base", [1, 2], matrices=np.array([GOOD, matrix]))
    assert error.value.index == 1


def test_rounded_matrices_are_taken() -> None:
    for _, _, matrix in POSES:
        printed = np.round(matrix, 4)
        found = tfdb.Transform.from_matrix(printed, "map", "base")
        assert np.abs(found.matrix - matrix).max() < 2e-4
        assert np.linalg.norm(found.rotation) == pytest.approx(1.0, abs=1e-15)


def rigid(matrix: Matrix) -> list[Callable[[], Any]]:
    """Every way in for a matrix."""
    return [
        lambda: tfdb.Transform.from_matrix(matrix, "map", "base").rotation,
        lambda: by_set(matrix).rotation,
        lambda: tfdb.Columns("map", "base", [5], matrices=[matrix]).poses[0, 3:],
        lambda: tfdb.Trajectory("map", "base", [5], matrices=[matrix]).rotations[0],
    ]


def test_one_rule_for_every_matrix_and_the_nearest_rotation() -> None:
    rng = np.random.default_rng(12)
    for _, _, matrix in POSES[::8]:
        off = matrix.copy()
        off[:3, :3] @= np.eye(3) + rng.uniform(-1, 1, (3, 3)) * 0.0012
        left, _, right = np.linalg.svd(off[:3, :3])
        nearest = Rotation.from_matrix(left @ right)
        for way in rigid(off):
            found = way()
            assert (Rotation.from_quat(found).inv() * nearest).magnitude() < 1e-14
            assert found[3] >= 0
        stretched, tilted, moved = matrix.copy(), matrix.copy(), matrix.copy()
        stretched[:3, :3] *= 1.0051
        tilted[:3, 0] += 0.0055 * tilted[:3, 1]
        moved[3, 0] = 2e-6
        for wrong in (stretched, tilted, moved):
            for way in rigid(wrong):
                with pytest.raises(
                    tfdb.errors.InvalidTransform, match="is not a rigid transform: it"
                ):
                    way()


def test_a_matrix_that_is_missing() -> None:
    holes = np.stack([GOOD, np.full((4, 4), np.nan), GOOD])
    made = tfdb.Trajectory("map", "base", [1, 2, 3], matrices=holes)
    assert made.valid.tolist() == [True, False, True]
    with pytest.raises(
        tfdb.errors.InvalidTransform, match=r"matrices\[1\] .*: it contains nan"
    ) as error:
        tfdb.Columns("map", "base", [1, 2, 3], matrices=holes)
    assert error.value.index == 1


def test_masked_values_are_missing() -> None:
    poses = np.array([[1.0, 2, 3, 0, 0, 0.6, 0.8]] * 2)
    hidden = np.ma.array(poses, mask=[[False] * 7, [True] * 7])
    assert tfdb.Trajectory("map", "base", [1, 2], hidden).valid.tolist() == [True, False]
    assert np.isnan(tfdb.Columns("map", "base", [1, 2], hidden).poses[1]).all()
    buf = tfdb.Buffer(history=None)
    buf.set_transforms(tfdb.Columns("map", "base", [1, 2], poses))
    points = np.ma.array([[1.0, 0, 0], [2, 0, 0]], mask=[[True] * 3, [False] * 3])
    for moved in (
        buf.transform_points("map", "base", points, [1, 2]),
        buf.lookup_transform("map", "base", 2).apply(points),
    ):
        assert np.isnan(moved[0]).all()
        assert moved[1].tolist() == pytest.approx([1.56, 3.92, 3.0])
    stamps = np.ma.array([1, 2], mask=[True, False])
    for call in (
        lambda: tfdb.Trajectory("map", "base", stamps, poses),
        lambda: buf.lookup_transforms("map", "base", stamps),
        lambda: buf.set_transforms(tfdb.Columns("map", "base", stamps, poses)),
        lambda: buf.transform_points("map", "base", poses[:, :3], stamps),
    ):
        with pytest.raises(tfdb.errors.InvalidArray, match=r"masked: give values\[~values.mask\]"):
            call()
    with pytest.raises(tfdb.TfdbError):
        by_constructor(np.ma.array([1.0, 2, 3], mask=[True, False, False]))
    bare = np.ma.array([1, 2])
    assert len(buf.lookup_transforms("map", "base", bare)) == 2


@pytest.mark.parametrize("kind", [complex, str, bytes, "M8[s]"])
def test_values_must_be_real_numbers(kind: Any) -> None:
    values = np.array([[1, 2, 3, 0, 0, 0, 1]]).astype(kind)
    matrices = np.eye(4, dtype=int)[np.newaxis].astype(kind)
    for call in (
        lambda: tfdb.Trajectory("map", "base", [1], values),
        lambda: tfdb.Columns("map", "base", [1], values),
        lambda: tfdb.Columns("map", "base", [1], translations=values[:, :3], rotations=[[0] * 4]),
        lambda: tfdb.Trajectory("map", "base", [1], matrices=matrices),
        lambda: tfdb.Columns("map", "base", [1], matrices=matrices),
        lambda: tfdb.Transform.from_matrix(matrices[0], "map", "base"),
    ):
        with pytest.raises(tfdb.errors.InvalidArray, match="float64"):
            call()


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
        with pytest.raises(tfdb.errors.InvalidArray):
            door(*args, **named)
    for named in ({"rpy": (0, 0, np.nan)}, {"wxyz": (1, 1, 0, 0)}, {"wxyz": (np.inf, 0, 0, 0)}):
        with pytest.raises(tfdb.errors.InvalidTransform):
            door((1, 2, 3), **named)
    for named in (
        {"rotation": (0, 0, 0, 1), "rpy": (0, 0, 0)},
        {"rpy": (0, 0, 0), "wxyz": (1, 0, 0, 0)},
    ):
        with pytest.raises(tfdb.InvalidArgument, match="and wxyz exclude each other"):
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


def test_a_refused_call_stores_nothing() -> None:
    buf = tfdb.Buffer()
    for args, named in REFUSED:
        with pytest.raises(tfdb.errors.InvalidArray):
            buf.set_transform("map", "base", STAMP, *args, **named)
    assert (buf.commit, buf.frames()) == (0, [])


class Raising:
    """A rotation whose as_quat fails."""

    def as_quat(self) -> Any:
        raise ZeroDivisionError


def test_objects_that_only_look_like_rotations() -> None:
    for turned in (Raising(), type("Odd", (), {"as_quat": lambda _: "abc"})()):
        with pytest.raises(tfdb.errors.InvalidArray, match="rotation"):
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


@pytest.mark.parametrize("door", DOORS, ids=lambda door: door.__name__)
def test_every_call_refuses_other_types_of_numbers(
    door: Callable[..., tfdb.Transform],
) -> None:
    dates = np.array([1, 2, 3], "datetime64[s]")
    others = (dates, np.array([1, 2, 3j]), np.array(["1", "2", "3"]), np.full(3, 10**400, object))
    for wrong in (b"123", b"1234567", np.eye(4) * 1j, *others):
        with pytest.raises(tfdb.errors.InvalidArray):
            door(wrong)
        with pytest.raises(tfdb.errors.InvalidArray):
            door((0, 0, 0), rpy=wrong)
    whole = np.ma.array([1.0, 2.0, 3.0], mask=False)
    np.testing.assert_array_equal(door(whole).translation, [1, 2, 3])
    with pytest.raises(tfdb.errors.InvalidTransform):
        door(np.ma.array([1.0, 2.0, 3.0], mask=[False, True, False]))


@pytest.mark.parametrize("door", DOORS, ids=lambda door: door.__name__)
def test_named_transforms_are_stored_between_their_frames_only(
    door: Callable[..., tfdb.Transform],
) -> None:
    there = tfdb.TransformStamped("map", "base", 0, (1, 2, 3), (0, 0, 0.6, 0.8))
    np.testing.assert_allclose(door(there).pose, (1, 2, 3, 0, 0, 0.6, 0.8))
    for wrong in (("base", "map"), ("map", "tool")):
        with pytest.raises(tfdb.InvalidArgument, match="was given for T"):
            door(tfdb.TransformStamped(*wrong, 0, (1, 2, 3)))
        with pytest.raises(tfdb.InvalidArgument, match="was given for T"):
            door(tfdb.Transform(*wrong, (1, 2, 3)))


def test_a_whole_pose_has_no_rotation_beside_it() -> None:
    with pytest.raises(tfdb.errors.InvalidArray, match="a whole pose without a rotation beside it"):
        tfdb.Transform("map", "base", np.eye(4), (0, 0, 0, 1))


def test_a_stamped_transform_of_any_form_has_translation_and_rotation() -> None:
    for move, turn, matrix in POSES[:5]:
        made = tfdb.TransformStamped("map", "base", STAMP, matrix)
        np.testing.assert_allclose(made.translation, move)
        assert (Rotation.from_quat(made.rotation).inv() * turn).magnitude() < 1e-14
        for again in (copy.copy(made), pickle.loads(pickle.dumps(made))):
            assert again == made
            assert hash(again) == hash(made)
        message = tfdb.encode_tf_message([made])
        assert tfdb.decode_tf_message(message)[0].translation == pytest.approx(move)
    with pytest.raises(tfdb.InvalidArgument, match="exclude each other; pass one"):
        tfdb.TransformStamped("a", "b", 0, (1, 2, 3), (0, 0, 0, 1), rpy=(0, 0, 0))


def test_transforms_with_arrays_are_compared_number_by_number() -> None:
    def made(*move: float, turn: Any = (0, 0, 0.6, 0.8)) -> tfdb.TransformStamped:
        return tfdb.TransformStamped("a", "b", 5, np.array(move), turn)

    assert made(1, 2, 3) == made(1, 2, 3)
    assert made(1, 2, 3) == tfdb.TransformStamped("a", "b", 5, [1, 2, 3], (0, 0, 0.6, 0.8))
    assert made(1, 2, 3) == made(1, 2, 3, turn=np.array([0, 0, 0.6, 0.8]))
    assert made(1, 2, 3) != made(1, 2, 4)
    assert made(1, 2, 3) != made(1, 2, 3, turn=(0, 0, 0.8, 0.6))
    assert made(1, 2, 3) != "a"
    plain = tfdb.TransformStamped("a", "b", 5, (1, 2, 3), (0, 0, 0.6, 0.8))
    assert len({plain, tfdb.TransformStamped("a", "b", 5, (1, 2, 3), (0, 0, 0.6, 0.8))}) == 1


def test_a_single_transform_as_a_batch_is_refused() -> None:
    one = tfdb.TransformStamped("a", "b", 0, (1, 2, 3))
    buf = tfdb.Buffer()
    with pytest.raises(TypeError, match=r"single TransformStamped.*write \[transform\]"):
        buf.set_transforms(one)  # type: ignore[arg-type]
    with buf.transaction() as tx, pytest.raises(TypeError, match="single TransformStamped"):
        tx.set_transforms(one)  # type: ignore[arg-type]
    assert len(buf) == 0


ARRAY_DOORS: list[Callable[[Any], object]] = [
    tfdb.Transform("a", "b", (1, 2, 3)).apply,
    lambda rows: tfdb.Transform.from_matrix(rows, "a", "b"),
    lambda rows: tfdb.Columns("a", "b", [0], rows),
    lambda rows: tfdb.Columns("a", "b", [0], matrices=rows),
    lambda rows: tfdb.Columns("a", "b", [0], translations=rows, rotations=[(0, 0, 0, 1)]),
    lambda rows: tfdb.Trajectory("a", "b", [0], rows),
    lambda rows: tfdb.Trajectory("a", "b", [0], matrices=rows),
]
SHAPES = [(3,), (4, 4), (1, 7), (1, 4, 4), (1, 3), (1, 7), (1, 4, 4)]


@pytest.mark.parametrize(("door", "shape"), list(zip(ARRAY_DOORS, SHAPES, strict=True)))
def test_integers_beyond_all_floats(door: Callable[[Any], object], shape: tuple[int, ...]) -> None:
    with pytest.raises(tfdb.errors.InvalidArray):
        door(np.full(shape, 10**400, object))


def test_masked_stamps_and_rows_are_refused() -> None:
    stamps = np.ma.array([1, 2], mask=[False, True])
    poses = np.tile([1, 2, 3, 0, 0, 0, 1.0], (2, 1))
    buf = tfdb.Buffer(history=None)
    buf.set_transforms(tfdb.Columns("a", "b", [1, 2], poses))
    path = tfdb.Trajectory("a", "b", [1, 2], poses)
    for call in (
        lambda: buf.set_transforms(tfdb.Columns("a", "c", stamps, poses)),
        lambda: buf.lookup_transforms("a", "b", stamps),
        lambda: tfdb.Trajectory("a", "b", stamps, poses),
        lambda: path[np.ma.array([0, 1], mask=[True, False])],
    ):
        with pytest.raises(tfdb.errors.InvalidArray, match="masked"):
            call()
    assert not buf.frame_exists("c")


def test_masks_of_derived_classes_count() -> None:
    class Hiding(np.ma.MaskedArray):  # type: ignore[type-arg]
        pass

    poses = np.tile([1, 2, 3, 0, 0, 0, 1.0], (2, 1))
    hidden = np.ma.array(poses, mask=[[True] * 7, [False] * 7]).view(Hiding)
    assert type(hidden) is Hiding
    assert np.isnan(tfdb.Columns("a", "b", [1, 2], hidden).poses[0]).all()
    with pytest.raises(tfdb.TfdbError):
        tfdb.Transform("a", "b", hidden[0])
    moved = tfdb.Transform("a", "b", (1, 2, 3)).apply(hidden[:, :3])
    assert np.isnan(moved[0]).all()
    assert moved[1].tolist() == [2, 4, 6]


def test_columns_of_two_lengths() -> None:
    with pytest.raises(tfdb.errors.InvalidArray, match="2 translations, but 1 rotations"):
        tfdb.Columns("a", "b", [0, 1], translations=np.zeros((2, 3)), rotations=[(0, 0, 0, 1)])
