"""Trajectory files: accepted and refused contents, and round trips."""

import os
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tfdb
from tfdb.data.poses import rotation_matrices
from tfdb.trajectories import write_npz
from tfdb.trajectories.writing import write_trajectory

HALF = np.sqrt(0.5)


def random_trajectory(count: int = 200) -> tfdb.Trajectory:
    rng = np.random.default_rng(7)
    poses = rng.normal(size=(count, 7))
    poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
    stamps = np.cumsum(rng.integers(1, 2**40, count)) + 1_700_000_000_000_000_000
    return tfdb.Trajectory("map", "base", stamps.astype(np.int64), poses)


def test_tum(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text(
        "# a comment\r\n\n1311868163.8697 1 2 3 0 0 0.7071067811865476 0.7071067811865476\r\n"
        "  1311868163.870000001\t-1.5e0 2 3 0 0 0 -1 \n"
    )
    found = tfdb.Trajectory.read(path, target="map", source="camera")
    assert (found.target, found.source) == ("map", "camera")
    assert found.stamps.tolist() == [1311868163869700000, 1311868163870000001]
    assert np.allclose(found.poses, [[1, 2, 3, 0, 0, HALF, HALF], [-1.5, 2, 3, 0, 0, 0, -1]])


def test_euroc(tmp_path: Path) -> None:
    path = tmp_path / "data.csv"
    rest = ",0.1" * 9
    path.write_text(
        "#timestamp, p_RS_R_x [m], p_RS_R_y [m], ...\n"
        f"1403636580838555648,4.6,-1.7,0.6,0.5,-0.5,0.5,-0.5{rest}\n"
        f"1403636580843555648, 4.7, -1.8, 0.7, 1, 0, 0, 0{rest}\n"
    )
    found = tfdb.Trajectory.read(path)
    assert found.stamps.tolist() == [1403636580838555648, 1403636580843555648]
    assert found.poses.tolist() == [
        [4.6, -1.7, 0.6, -0.5, 0.5, -0.5, 0.5],
        [4.7, -1.8, 0.7, 0, 0, 0, 1],
    ]


def test_euroc_with_a_heading_without_hash(tmp_path: Path) -> None:
    path = tmp_path / "data.csv"
    path.write_text("timestamp,x,y,z,qw,qx,qy,qz\n5,1,2,3,1,0,0,0\n")
    assert tfdb.Trajectory.read(path, "euroc").poses.tolist() == [[1, 2, 3, 0, 0, 0, 1]]


def test_kitti(tmp_path: Path) -> None:
    path = tmp_path / "00.txt"
    path.write_text("1 0 0 1 0 1 0 2 0 0 1 3\n0 -1 0 4 1 0 0 5 0 0 1 6\n")
    times = tmp_path / "00_times.txt"
    times.write_text("0.000000e+00\n1.037359e-01\n")
    for found in (tfdb.Trajectory.read(path), tfdb.Trajectory.read(path, "kitti", times=times)):
        assert found.stamps.tolist() == [0, 103735900]
        assert np.allclose(found.poses, [[1, 2, 3, 0, 0, 0, 1], [4, 5, 6, 0, 0, HALF, HALF]])


def test_times_beside_the_poses(tmp_path: Path) -> None:
    (tmp_path / "poses.txt").write_text("1 0 0 1 0 1 0 2 0 0 1 3\n")
    (tmp_path / "times.txt").write_text("2.5\n")
    assert tfdb.Trajectory.read(tmp_path / "poses.txt").stamps.tolist() == [2_500_000_000]


def test_real_tum_file(shared_data: Path) -> None:
    path = shared_data / "trajectories" / "fr2_desk_groundtruth.txt"
    rows = [line.split() for line in path.read_text().splitlines() if not line.startswith("#")]
    unique = {row[0]: row for row in rows}
    with pytest.warns(tfdb.TfdbWarning, match="20,957 rows, 1 with a repeated stamp"):
        found = tfdb.Trajectory.read(path)
    # One stamp of this file is there twice; as in a store, the later line counts.
    assert len(rows) == 20957
    assert len(found) == len(unique) == 20956
    for index, row in enumerate(unique.values()):
        whole, fraction = row[0].split(".")
        assert found.stamps[index] == int(whole) * 10**9 + int(fraction) * 10**5
    raw = np.array([[float(x) for x in row[1:]] for row in unique.values()])
    raw[:, 3:] /= np.linalg.norm(raw[:, 3:], axis=1, keepdims=True)
    assert np.abs(found.poses - raw).max() < 1e-15


def test_real_kitti_file(shared_data: Path) -> None:
    path = shared_data / "trajectories" / "KITTI_00_gt.txt"
    found = tfdb.Trajectory.read(path)
    raw = np.loadtxt(path).reshape(-1, 3, 4)
    assert len(found) == len(raw) == 4541
    assert np.array_equal(found.poses[:, :3], raw[:, :, 3])
    # The file has seven digits.
    assert np.abs(rotation_matrices(found.poses[:, 3:]) - raw[:, :, :3]).max() < 1e-5
    assert found.stamps[1] == 103735900


@pytest.mark.parametrize("format", ["tum", "euroc", "csv"])
def test_round_trip_is_exact(tmp_path: Path, format: str) -> None:  # noqa: A002
    trajectory = random_trajectory()
    path = tmp_path / "trajectory.any"
    write_trajectory(path, trajectory, format)
    found = tfdb.Trajectory.read(path)
    assert np.array_equal(found.stamps, trajectory.stamps)
    assert np.array_equal(found.poses, trajectory.poses)


def test_kitti_round_trip(tmp_path: Path) -> None:
    trajectory = random_trajectory()
    write_trajectory(tmp_path / "a.txt", trajectory, "kitti")
    found = tfdb.Trajectory.read(tmp_path / "a.txt")
    assert np.array_equal(found.stamps, trajectory.stamps)
    signs = np.where(trajectory.poses[:, 6:] < 0, -1, 1)
    assert np.abs(found.poses[:, 3:] - signs * trajectory.poses[:, 3:]).max() < 1e-14
    assert np.array_equal(found.poses[:, :3], trajectory.poses[:, :3])


def test_npz(tmp_path: Path) -> None:
    trajectory = random_trajectory()
    write_npz(tmp_path / "a.npz", trajectory)
    with np.load(tmp_path / "a.npz") as found:
        assert np.array_equal(found["stamps"], trajectory.stamps)
        assert np.array_equal(found["poses"], trajectory.poses)


def test_npz_is_read_again(tmp_path: Path) -> None:
    trajectory = random_trajectory()
    path = tmp_path / "a.bin"  # the name does not matter
    write_npz(path, trajectory)
    for found in (
        tfdb.Trajectory.read(path),
        tfdb.Trajectory.read(path, "npz", target="m", source="b"),
    ):
        assert np.array_equal(found.stamps, trajectory.stamps)
        assert np.array_equal(found.poses, trajectory.poses)
    assert (found.target, found.source) == ("m", "b")


@pytest.mark.parametrize(
    ("arrays", "reason"),
    [
        ({"stamps": np.array([1, 2])}, "without the array 'poses'"),
        ({"stamps": np.array([1.5]), "poses": np.ones((1, 7))}, "integer nanoseconds"),
        ({"stamps": np.array([1]), "poses": np.eye(7)[5:]}, "1 stamps, but 2 poses"),
        ({"stamps": np.array([2, 1]), "poses": np.ones((2, 7))}, "must increase"),
        ({"stamps": np.array([1]), "poses": np.ones((1, 7))}, r"poses\[0\] = .* not a rigid"),
        ({"stamps": np.array([-1]), "poses": np.eye(7)[6:]}, r"stamps\[0\] = -1 is not a stamp"),
        ({"stamps": np.array([1]), "poses": np.array([{}])}, "damaged or cut short"),
        ({"stamps": np.empty(0), "poses": np.empty((0, 7))}, "no pose in it"),
    ],
)
def test_bad_npz(tmp_path: Path, arrays: dict[str, np.ndarray], reason: str) -> None:
    path = tmp_path / "a.npz"
    np.savez(path, **arrays)
    with pytest.raises(tfdb.errors.TrajectoryError, match=reason) as caught:
        tfdb.Trajectory.read(path)
    assert caught.value.path == str(path)


def test_repeated_stamps_are_counted(tmp_path: Path) -> None:
    path = tmp_path / "a.tum"
    lines = [f"{second} {x} 0 0 0 0 0.6 0.8" for second, x in ((1, 1), (2, 2), (2, 3), (2, 4))]
    path.write_text("\n".join(lines))
    with pytest.warns(tfdb.TfdbWarning, match="4 rows, 2 with a repeated stamp, 2 with another"):
        found = tfdb.Trajectory.read(path)
    assert found.repeated == 2
    assert found.stamps.tolist() == [1_000_000_000, 2_000_000_000]
    assert found.poses[1, 0] == 4
    assert random_trajectory().repeated == 0


@pytest.mark.parametrize("name", ["a.tum", "a.txt", "a.csv", "a.npz"])
def test_format_by_name(tmp_path: Path, name: str) -> None:
    write_trajectory(tmp_path / name, random_trajectory(3))
    assert (tmp_path / name).stat().st_size > 100


def test_unknown_format_by_name(tmp_path: Path) -> None:
    with pytest.raises(tfdb.errors.TrajectoryError, match="got 'xyz'"):
        write_trajectory(tmp_path / "a.xyz", random_trajectory(3))
    assert not (tmp_path / "a.xyz").exists()


def test_kitti_with_three_digits(tmp_path: Path) -> None:
    matrices = random_trajectory(50).matrices
    (tmp_path / "a_times.txt").write_text("".join(f"{second}\n" for second in range(50)))
    rows = (" ".join(f"{number:.3f}" for number in each[:3].flat) for each in matrices)
    (tmp_path / "a.txt").write_text("\n".join(rows))
    found = tfdb.Trajectory.read(tmp_path / "a.txt")
    assert np.abs(found.matrices - matrices).max() < 1.5e-3


TURN = "5,1,2,3,0,0,0.6,0.8"  # a stamp in ns, x y z, and a quaternion x y z w
NAMED = [
    ("stamp_ns,x,y,z,qx,qy,qz,qw", TURN),
    ("# stamp_ns, x, y, z, qx, qy, qz, qw", TURN),
    ("stamp_ns,x,y,z,qw,qx,qy,qz", "5,1,2,3,0.8,0,0,0.6"),
    ("x,y,z,stamp_ns,qw,qz,qy,qx", "1,2,3,5,0.8,0.6,0,0"),
    (",stamp_ns,x,y,z,qx,qy,qz,qw,speed", f"0,{TURN},7.5"),
    ('"stamp_ns","x","y","z","qx","qy","qz","qw"', TURN),
]


@pytest.mark.parametrize(("heading", "row"), NAMED)
@pytest.mark.parametrize("format_", [None, "csv"])
def test_a_header_names_the_columns(tmp_path: Path, heading: str, row: str, format_: Any) -> None:
    path = tmp_path / "a.csv"
    path.write_text(f"{heading}\n{row}\n")
    found = tfdb.Trajectory.read(path, format_)
    assert found.stamps.tolist() == [5]
    assert found.poses.tolist() == [[1, 2, 3, 0, 0, 0.6, 0.8]]


def test_a_comment_is_not_a_header(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(
        "# of stamp_ns, made by x\n#timestamp,p_x,p_y,p_z,q_w,q_x,q_y,q_z\n5,1,2,3,0.8,0,0,0.6\n"
    )
    assert tfdb.Trajectory.read(path).poses.tolist() == [[1, 2, 3, 0, 0, 0.6, 0.8]]
    path.write_text("# qx qy qz qw, not qw qx qy qz\n1 1 2 3 0 0 0.6 0.8\n")
    assert tfdb.Trajectory.read(path).poses.tolist() == [[1, 2, 3, 0, 0, 0.6, 0.8]]


@pytest.mark.parametrize(
    ("text", "format_", "reason"),
    [
        (
            f"timestamp,tx,ty,tz,qx,qy,qz,qw\n{TURN}\n",
            "euroc",
            "order x y z w, but format 'euroc' has w x",
        ),
        (
            f"#time, x, y, z, q_x, q_y, q_z, q_w\n{TURN}\n",
            "euroc",
            "order x y z w, but format 'euroc'",
        ),
        (
            f"#when, x, y, z, q_x, q_y, q_z, q_w\n{TURN}\n",
            None,
            "order x y z w, but format 'euroc'",
        ),
        (f"stamp_ns,x,y,z,qx,qy,qz,qw\n{TURN}\n", "euroc", "order x y z w, but format 'euroc'"),
        (
            f"#time,q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []\n{TURN}\n",
            "csv",
            "but format 'csv' has x y z w",
        ),
        (
            "# a\n# timestamp x y z qw qx qy qz\n5 1 2 3 .8 0 0 .6\n",
            "tum",
            "but format 'tum' has x y z w",
        ),
        ("stamp_ns,x,y,z,qx,qy,qz\n5,1,2,3,0,0,0\n", None, "names no quaternion"),
        ("stamp_ns,x,y,z,qx,qy,qz,qw,x\n5,1,2,3,0,0,0,1,2\n", None, "must name each axis once"),
        (f"a,b\nc,d\n{TURN}\n", "csv", "2 columns instead of"),
        (f"{TURN}\nnan,1,2,3,0,0,0.6,0.8\n", "csv", "'nan' is not an integer"),
    ],
)
def test_a_contradicting_header_is_refused(
    tmp_path: Path, text: str, format_: Any, reason: str
) -> None:
    path = tmp_path / "a.txt"
    path.write_text(text)
    with pytest.raises(tfdb.errors.TrajectoryError, match=reason):
        tfdb.Trajectory.read(path, format_)


FORMATS = ["tum", "euroc", "kitti", "csv", "npz", "parquet"]


def with_holes() -> tfdb.Trajectory:
    whole = random_trajectory(9)
    poses = whole.poses.copy()
    poses[[0, 3, 4, 8]] = np.nan
    return tfdb.Trajectory("map", "base", whole.stamps, poses)


@pytest.mark.parametrize("format_", FORMATS)
def test_missing_poses_in_a_file(tmp_path: Path, format_: Any) -> None:
    path, there = with_holes(), with_holes()[with_holes().valid]
    file = (
        tmp_path / f"a.{'txt' if format_ == 'kitti' else 'csv' if format_ == 'euroc' else format_}"
    )
    write_trajectory(file, path, format_)
    found = tfdb.Trajectory.read(file, target="map", source="base")
    if format_ == "kitti":  # by way of matrices: up to the sign of the quaternions
        assert np.array_equal(found.stamps, there.stamps)
        assert np.abs(found.matrices - there.matrices).max() < 1e-14
    else:
        assert found == (path if format_ in ("csv", "npz", "parquet") else there)
    loaded = tfdb.load(file)
    names = (path.target, path.source) if format_ == "parquet" else ("world", "body")
    assert np.array_equal(loaded.trajectory(*names).stamps, there.stamps)


@pytest.mark.parametrize("name", ["a.csv", "a.npz", "a.parquet"])
def test_a_file_without_any_pose_that_is_there(tmp_path: Path, name: str) -> None:
    nowhere = tfdb.Trajectory("map", "base", [1, 2, 3], np.full((3, 7), np.nan))
    write_trajectory(tmp_path / name, nowhere)
    assert tfdb.Trajectory.read(tmp_path / name, target="map", source="base") == nowhere
    with pytest.raises(tfdb.errors.TrajectoryError, match="no pose in it: all its rows are NaN"):
        tfdb.load(tmp_path / name)


@pytest.mark.parametrize("name", ["a.tum", "a.csv", "a.npz", "a.parquet"])
def test_poses_of_a_long_chain_are_read_to_the_last_bit(tmp_path: Path, name: str) -> None:
    """A product of many quaternions is of unit length only up to rounding."""
    rng = np.random.default_rng(5)
    buf = tfdb.Buffer(history=None)
    for link in range(60):
        poses = rng.normal(size=(20, 7))
        poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
        buf.set_transforms(tfdb.Columns(f"f{link}", f"f{link + 1}", np.arange(20), poses))
    path = buf.trajectory("f0", "f60")
    norms = np.linalg.norm(path.poses[:, 3:], axis=1)
    assert np.abs(norms - 1).max() > 1e-15
    assert tfdb.Trajectory("f0", "f60", path.stamps, path.poses) == path
    write_trajectory(tmp_path / name, path)
    assert tfdb.Trajectory.read(tmp_path / name, target="f0", source="f60") == path


def test_empty_fields_are_a_missing_pose(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(f"stamp_ns,x,y,z,qx,qy,qz,qw\n4,,,,,,,\n{TURN}\n6{',NaN' * 7}\n")
    assert tfdb.Trajectory.read(path).valid.tolist() == [False, True, False]
    path.write_text(f"stamp_ns,x,y,z,qx,qy,qz,qw\n4,1,,,,,,\n{TURN}\n")
    with pytest.raises(tfdb.errors.TrajectoryError, match="'' is not a number") as caught:
        tfdb.Trajectory.read(path)
    assert caught.value.line == 2


@pytest.mark.parametrize("format_", FORMATS)
def test_from_a_pipe(tmp_path: Path, format_: Any) -> None:
    path = random_trajectory(9)
    write_trajectory(tmp_path / "a", path, format_)
    os.mkfifo(tmp_path / "pipe")
    found: list[tfdb.Trajectory] = []
    times = tmp_path / "a_times.txt" if format_ == "kitti" else None

    def read() -> None:
        found.append(tfdb.Trajectory.read(tmp_path / "pipe", format_, times=times))

    reader = threading.Thread(target=read, daemon=True)
    reader.start()
    (tmp_path / "pipe").write_bytes((tmp_path / "a").read_bytes())
    reader.join(30)
    assert np.array_equal(found[0].stamps, path.stamps)


UNIT = "0 0 0 0 0 0 1"
BAD_TUM = [
    (f"1.0 {UNIT}\n0.5 {UNIT}\n", 2, "stamp 0.5 s follows 1 s: sort"),
    (f"1.0 {UNIT}\n# x\n2.0 0 0 0 0 0 1\n", 3, "7 columns"),
    (f"1.0 {UNIT}\n2.0 0 0 zero 0 0 0 1\n", 2, "'zero' is not a number"),
    (f"1.0 {UNIT}\nabc {UNIT}\n", 2, "'abc' is not a number of seconds"),
    (f"-1.0 {UNIT}\n", 1, "negative"),
    ("1.0 0 0 0 0 0 0 nan\n", 1, "not a finite number"),
    ("1.0 0 inf 0 0 0 0 1\n", 1, "not a finite number"),
    ("1.0 0 1_0 0 0 0 0 1\n", 1, "not a finite number"),
    ("1.0 0 0 0 0 0 0 1.01\n", 1, "the quaternion has length 1.01, not 1"),
    ("1.0 0 0 0 0 0 0 0\n", 1, "the quaternion has length 0, not 1"),
    ("1.0 0 0 0 1e200 0 0 1e200\n", 1, "the quaternion has length inf, not 1"),
    (f"99999999999 {UNIT}\n", 1, "too large for seconds, and not a date in another unit"),
    (f"1 {UNIT}\n2 {UNIT}\n99999999999 {UNIT}\n", 3, "stamp_unit= (--stamp-unit) sets another"),
    ("", None, "no pose"),
    ("# only a comment\n\n", None, "no pose"),
    ("1 2 3\n", 1, "no known format has 3 columns"),
    ("1,2,3\n", 1, "no known format has 3 columns"),
]


@pytest.mark.parametrize(("text", "line", "reason"), BAD_TUM)
def test_bad_lines(tmp_path: Path, text: str, line: int | None, reason: str) -> None:
    path = tmp_path / "bad.txt"
    path.write_text(text)
    with pytest.raises(tfdb.errors.TrajectoryError) as caught:
        tfdb.Trajectory.read(path)
    assert (caught.value.path, caught.value.line) == (str(path), line)
    assert reason in str(caught.value.reason)
    assert str(caught.value).startswith(f"{path}{'' if line is None else f':{line}'}: ")


BAD_EUROC = [
    ("1.5,0,0,0,1,0,0,0\n", 1, "8 columns by commas without a header match several formats"),
    ("2,0,0,0,1,0,0,0\n2.5,0,0,0,1,0,0,0\n", 2, "not an integer number of nanoseconds"),
    ("2,0,0,0,1,0,0,0\n1,0,0,0,1,0,0,0\n", 2, "follows 0.000000002 s"),
    ("2,0,0,0,1,0,0,0\n3,0,0,0,1,0,0\n", 2, "7 columns"),
    ("x,y\nx,y\n", 1, "names no position"),
]


@pytest.mark.parametrize(("text", "line", "reason"), BAD_EUROC)
def test_bad_euroc(tmp_path: Path, text: str, line: int, reason: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(tfdb.errors.TrajectoryError) as caught:
        tfdb.Trajectory.read(path)
    assert caught.value.line == line
    assert reason in str(caught.value.reason)


IDENTITY = "1 0 0 0 0 1 0 0 0 0 1 0\n"
BAD_KITTI = [
    (IDENTITY, None, None, "neither"),
    (IDENTITY * 2, "1.0\n", None, "2 poses, but 1 stamps"),
    (IDENTITY + "1 0\n", "1\n2\n", 2, "2 columns instead of the 12"),
    (IDENTITY + "2 0 0 0 0 1 0 0 0 0 1 0\n", "1\n2\n", 2, "not a rotation"),
    (IDENTITY + "-1 0 0 0 0 1 0 0 0 0 1 0\n", "1\n2\n", 2, "not a rotation"),
    ("1e200 0 0 0 0 1e200 0 0 0 0 1e200 0\n", "1\n", 1, "not a rotation"),
    (IDENTITY * 2, "2\n1\n", 2, "stamp 1 s follows 2 s"),
    (IDENTITY * 2, "1\n1\n", 2, "stamp 1 s follows 1 s"),
    (IDENTITY, "one\n", 1, "not a number of seconds"),
]


@pytest.mark.parametrize(("poses", "times", "line", "reason"), BAD_KITTI)
def test_bad_kitti(
    tmp_path: Path, poses: str, times: str | None, line: int | None, reason: str
) -> None:
    (tmp_path / "p.txt").write_text(poses)
    if times is not None:
        (tmp_path / "p_times.txt").write_text(times)
    with pytest.raises(tfdb.errors.TrajectoryError) as caught:
        tfdb.Trajectory.read(tmp_path / "p.txt")
    assert caught.value.line == line
    assert reason in str(caught.value.reason)


def test_not_text(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_bytes(b"\x89MCAP0\r\n\0\0")
    with pytest.raises(tfdb.errors.TrajectoryError, match="binary file"):
        tfdb.Trajectory.read(path)
    path.write_bytes(b"# a\n# b\n1.0 \xff\n")
    with pytest.raises(tfdb.errors.TrajectoryError, match="not UTF-8") as caught:
        tfdb.Trajectory.read(path)
    assert caught.value.line == 3


def test_wrong_arguments(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text(f"1.0 {UNIT}\n")
    with pytest.raises(tfdb.errors.TrajectoryError, match="got 'bag'"):
        tfdb.Trajectory.read(path, "bag")  # type: ignore[arg-type]
    with pytest.raises(tfdb.errors.TrajectoryError, match="belongs to KITTI"):
        tfdb.Trajectory.read(path, times=path)
    with pytest.raises(FileNotFoundError):
        tfdb.Trajectory.read(tmp_path / "none.txt")


def test_set_trajectory() -> None:
    trajectory = random_trajectory()
    buffer = tfdb.Buffer(history=None)
    assert buffer.set_trajectory("map", "base", trajectory, authority="file") == 1
    stamps, poses, parents = buffer.samples("base")
    assert np.array_equal(stamps, trajectory.stamps)
    assert np.abs(poses - trajectory.poses).max() < 1e-15
    assert set(parents) == {"map"}
    assert buffer.frame_info("base").authority == "file"


def test_set_trajectory_leaves_missing_poses_out() -> None:
    path, buffer = with_holes(), tfdb.Buffer(history=None)
    buffer.set_trajectory("map", "base", path)
    assert buffer.trajectory("map", "base") == path[path.valid]


def test_into_a_buffer_that_forgets() -> None:
    poses = random_trajectory(100).poses
    path = tfdb.Trajectory("map", "base", np.arange(100) * 1_000_000_000, poses)
    buffer = tfdb.Buffer(history=9.5)
    with pytest.warns(tfdb.TfdbWarning, match=r"90 samples are not kept.*history of 9.5 s") as said:
        buffer.set_trajectory("map", "base", path)
    assert said[0].filename == __file__
    assert buffer.frame_info("base").samples == 10
    tfdb.Buffer(history=None).set_trajectory("map", "base", path)
    tfdb.Buffer(history=99).set_trajectory("map", "base", path)


def test_set_trajectory_is_all_or_nothing() -> None:
    buffer = tfdb.Buffer(history=None)
    buffer.set_static_transform("map", "base", (1, 2, 3))
    with pytest.raises(tfdb.errors.StaticConflict):
        buffer.set_trajectory("map", "base", random_trajectory())
    assert buffer.commit == 1
    assert buffer.frames() == ["base", "map"]
