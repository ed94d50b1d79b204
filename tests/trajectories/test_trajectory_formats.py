"""Trajectory files of other programs: correct values, warnings for guesses, or an error."""

from __future__ import annotations

import gzip
import warnings
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import tfdb
from tfdb.data.poses import normalised
from tfdb.trajectories import write_npz
from tfdb.trajectories.writing import write_trajectory

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

START = 1_403_636_580_838_555_648
COUNT = 12
RNG = np.random.default_rng(22)
POSES = RNG.normal(size=(COUNT, 7)).round(6)
POSES[:, 3:] /= np.linalg.norm(POSES[:, 3:], axis=1, keepdims=True)
STAMPS = START + np.arange(COUNT) * 50_000_001
EXPECTED = tfdb.Trajectory("world", "body", STAMPS, POSES)


def seconds(stamp: int) -> str:
    return f"{stamp // 10**9}.{stamp % 10**9:09d}"


def numbers(pose: Sequence[float]) -> list[str]:
    return [repr(float(value)) for value in pose]


def rows(stamp: Callable[[int], str] = seconds, order: Sequence[int] = range(7)) -> list[list[str]]:
    return [
        [stamp(int(when)), *numbers(pose[list(order)])]
        for when, pose in zip(STAMPS, POSES, strict=True)
    ]


W_FIRST = (0, 1, 2, 6, 3, 4, 5)


def write(path: Path, lines: list[list[str]], separator: str = " ", heading: str = "") -> Path:
    text = "".join(separator.join(line) + "\n" for line in lines)
    path.write_text(f"{heading}\n{text}" if heading else text, newline="")
    return path


def same(found: tfdb.Trajectory) -> bool:
    """To the nanosecond and to the last bit."""
    assert found.stamps.tolist() == STAMPS.tolist()
    assert np.array_equal(found.poses, EXPECTED.poses)
    return True


NAMED = {
    "words": (" ", "timestamp tx ty tz qx qy qz qw", seconds, range(7)),
    "evo's comment": (" ", "# timestamp tx ty tz qx qy qz qw", seconds, range(7)),
    "w first": (" ", "# timestamp x y z qw qx qy qz", seconds, W_FIRST),
    "w first by words": (" ", "time x y z qw qx qy qz", seconds, W_FIRST),
    "semicolons": (";", "time;x;y;z;qx;qy;qz;qw", seconds, range(7)),
    "tabs": ("\t", "Time\tPosX\tPosY\tPosZ\tQuatX\tQuatY\tQuatZ\tQuatW", seconds, range(7)),
    "commas, w last": (",", "timestamp,x,y,z,qx,qy,qz,qw", seconds, range(7)),
    "seconds, w first": (",", "timestamp,x,y,z,qw,qx,qy,qz", seconds, W_FIRST),
    "euroc": (
        ",",
        "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],"
        "q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []",
        str,
        W_FIRST,
    ),
    "units in brackets": (
        " ",
        "t [ns] x [m] y [m] z [m] qx [-] qy [-] qz [-] qw [-]",
        str,
        range(7),
    ),
    "rostopic": (
        ",",
        "%time,field.pose.position.x,field.pose.position.y,field.pose.position.z,"
        "field.pose.orientation.x,field.pose.orientation.y,field.pose.orientation.z,"
        "field.pose.orientation.w",
        str,
        range(7),
    ),
    "bagpy": (
        ",",
        "time,.pose.position.x,.pose.position.y,.pose.position.z,.pose.orientation.x,"
        ".pose.orientation.y,.pose.orientation.z,.pose.orientation.w",
        seconds,
        range(7),
    ),
    "PlotJuggler": (
        ",",
        "__time,"
        + ",".join(f"/odom/pose/pose/position/{axis}" for axis in "xyz")
        + ","
        + ",".join(f"/odom/pose/pose/orientation/{axis}" for axis in "wxyz"),
        seconds,
        W_FIRST,
    ),
    "tf in PlotJuggler": (
        ",",
        "__time,"
        + ",".join(f"/tf/map/base/translation/{axis}" for axis in "xyz")
        + ","
        + ",".join(f"/tf/map/base/rotation/{axis}" for axis in "xyzw"),
        seconds,
        range(7),
    ),
    "quotes": (
        ",",
        '"stamp_ns","x","y","z","qx","qy","qz","qw"',
        lambda stamp: f'"{stamp}"',
        range(7),
    ),
    "microseconds by name": (
        ",",
        "time_us,x,y,z,qx,qy,qz,qw",
        lambda stamp: f"{stamp // 1000}.{stamp % 1000:03d}",
        range(7),
    ),
}


@pytest.mark.parametrize("name", NAMED)
def test_headings_that_name_all_columns_leave_nothing_to_guess(tmp_path: Path, name: str) -> None:
    separator, heading, stamp, order = NAMED[name]
    assert same(
        tfdb.Trajectory.read(write(tmp_path / "a.txt", rows(stamp, order), separator, heading))
    )


VARIANTS: dict[str, Callable[[str], str]] = {
    "CRLF": lambda text: text.replace("\n", "\r\n"),
    "CR": lambda text: text.replace("\n", "\r"),
    "byte order mark": lambda text: "\ufeff" + text,
    "blank lines": lambda text: text.replace("\n", "\n\n \n", 5),
    "comments of MATLAB and C": lambda text: f"% made by x\n// and y\n{text}",
    "comments between": lambda text: text.replace("\n", "\n# 1 2 3\n"),
    "no end of line": lambda text: text.rstrip("\n"),
    "blanks around": lambda text: "".join(f"  {line} \n" for line in text.splitlines()),
}


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("name", ["words", "w first", "semicolons", "tabs", "euroc", "PlotJuggler"])
def test_text_as_other_systems_write_it(tmp_path: Path, name: str, variant: str) -> None:
    separator, heading, stamp, order = NAMED[name]
    path = write(tmp_path / "a.txt", rows(stamp, order), separator, heading)
    path.write_bytes(VARIANTS[variant](path.read_text()).encode())
    assert same(tfdb.Trajectory.read(path))


@pytest.mark.parametrize("name", ["semicolons", "commas, w last", "euroc", "PlotJuggler"])
@pytest.mark.parametrize("on_heading", [False, True])
def test_separators_behind_the_last_column(tmp_path: Path, name: str, on_heading: bool) -> None:
    separator, heading, stamp, order = NAMED[name]
    lines = [[*line, ""] for line in rows(stamp, order)]
    if on_heading:
        heading += separator
    assert same(tfdb.Trajectory.read(write(tmp_path / "a.csv", lines, separator, heading)))


def test_the_stamp_of_the_header_goes_before_the_time_of_reception(tmp_path: Path) -> None:
    """As `rostopic echo -p` writes odometry."""
    heading = "%time,field.header.seq,field.header.stamp,field.header.frame_id"
    heading += "".join(f",field.pose.pose.position.{axis}" for axis in "xyz")
    heading += "".join(f",field.pose.pose.orientation.{axis}" for axis in "xyzw")
    heading += ",field.pose.covariance0,field.twist.twist.linear.x"
    lines = [
        [str(int(when) + 7 * 10**6), "3", when, "map", *pose, "0.5", "1"]
        for when, *pose in rows(str)
    ]
    path = write(tmp_path / "a.csv", lines, ",", heading)
    with pytest.warns(tfdb.TfdbWarning, match="columns taken: field.header.stamp, field.pose.pose"):
        assert same(tfdb.Trajectory.read(path))


DATASETS = {
    "Newer College": (
        "#sec,nsec,x,y,z,qx,qy,qz,qw",
        lambda when: f"{when // 10**9},{when % 10**9}",
        range(7),
    ),
    "maplab": (
        "timestamp [ns], p_G_I x [m], p_G_I y [m], p_G_I z [m], q_G_I w, q_G_I x, q_G_I y, q_G_I z",
        str,
        W_FIRST,
    ),
}


@pytest.mark.parametrize("name", DATASETS)
def test_tables_of_datasets(tmp_path: Path, name: str) -> None:
    heading, stamp, order = DATASETS[name]
    assert same(tfdb.Trajectory.read(write(tmp_path / "a.csv", rows(stamp, order), ",", heading)))


def test_names_behind_the_pose(tmp_path: Path) -> None:
    """As RTAB-Map and Kimera write them."""
    lines = [[*row, str(at)] for at, row in enumerate(rows())]
    heading = "#timestamp x y z qx qy qz qw id"
    assert same(tfdb.Trajectory.read(write(tmp_path / "a.txt", lines, " ", heading)))
    heading = "#timestamp,x,y,z,qw,qx,qy,qz,vx,vy,vz,bgx,bgy,bgz,bax,bay,baz"
    lines = [[*row, *"123456789"] for row in rows(str, W_FIRST)]
    assert same(tfdb.Trajectory.read(write(tmp_path / "a.csv", lines, ",", heading)))


def test_stamps_in_two_columns(tmp_path: Path) -> None:
    """As bagpy and ros2 topic echo --csv have them, the time of reception beside."""
    heading = "Time,header.seq,header.stamp.secs,header.stamp.nsecs,header.frame_id"
    heading += "".join(f",pose.pose.position.{axis}" for axis in "xyz")
    heading += "".join(f",pose.pose.orientation.{axis}" for axis in "xyzw")
    heading += ",pose.covariance_0,twist.twist.linear.x,twist.twist.angular.z"
    lines = [
        [f"{when / 1e9 + 7:.6f}", "3", *map(str, divmod(when, 10**9)), "map", *pose, *"512"]
        for when, (_, *pose) in zip(STAMPS.tolist(), rows(), strict=True)
    ]
    path = write(tmp_path / "a.csv", lines, ",", heading)
    with pytest.warns(tfdb.TfdbWarning, match="taken: header.stamp.secs, header.stamp.nsecs, pose"):
        assert same(tfdb.Trajectory.read(path))
    lines[3][3] = "1000000000"
    write(path, lines, ",", heading)
    with pytest.raises(tfdb.errors.TrajectoryError, match="more than a second") as caught:
        tfdb.Trajectory.read(path)
    assert caught.value.line == 5


def test_other_columns_are_left_alone(tmp_path: Path) -> None:
    heading = "id;label;time;vx;x;y;z;roll;qx;qy;qz;qw;cov_x"
    lines = [
        ["x", "a b", when, "9", *pose[:3], "nan", *pose[3:], ""] for when, *pose in rows(seconds)
    ]
    assert same(tfdb.Trajectory.read(write(tmp_path / "a.csv", lines, ";", heading)))


UNITS = {"ms": 10**6, "us": 10**3, "ns": 1}


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("digits", [0, 6])
def test_units_of_stamps_by_their_size(tmp_path: Path, unit: Any, digits: int) -> None:
    scale = UNITS[unit]
    stamps = START // scale + np.arange(COUNT) * 50_000_001

    def text(stamp: int) -> str:
        at = (stamp - START) // 50_000_001
        return f"{stamps[at]}" + ("." + "0" * digits if digits else "")

    path = write(tmp_path / "a.txt", rows(text))
    with pytest.warns(tfdb.TfdbWarning, match=f"by their size; stamp_unit='{unit}' .--stamp-unit"):
        found = tfdb.Trajectory.read(path)
    assert found.stamps.tolist() == [int(stamp) * scale for stamp in stamps]
    assert tfdb.Trajectory.read(path, stamp_unit=unit) == found
    assert tfdb.load(path, stamp_unit=unit).trajectory("world", "body") == found


def test_no_stamp_passes_through_a_float(tmp_path: Path) -> None:
    for text, unit, expected in (
        ("1403636580838555649.000000", "ns", 1_403_636_580_838_555_649),
        ("1403636580838555.649", "us", 1_403_636_580_838_555_649),
        ("1403636580838.555649", "ms", 1_403_636_580_838_555_649),
        ("1.403636580838555649e18", "ns", 1_403_636_580_838_555_649),
        ("1.403636580838555649e+09", "s", 1_403_636_580_838_555_649),
        ("1.7e9", "s", 1_700_000_000_000_000_000),
        ("7", "ns", 7),
        ("7.5", "us", 7500),
        ("7.0004", "us", 7000),
    ):
        path = write(tmp_path / "a.txt", [[text, *numbers(POSES[0])]])
        found = tfdb.Trajectory.read(path, stamp_unit=unit)  # type: ignore[arg-type]
        assert found.stamps.tolist() == [expected]


def test_stamps_that_are_hardly_seconds(tmp_path: Path) -> None:
    relative = write(tmp_path / "a.txt", rows(lambda stamp: str(stamp - START)))
    with pytest.warns(tfdb.TfdbWarning, match=r"taken as seconds are 50,000,001 s apart"):
        assert tfdb.Trajectory.read(relative).stamps[1] == 50_000_001 * 10**9
    found = tfdb.Trajectory.read(relative, stamp_unit="ns")
    assert found.stamps.tolist() == (STAMPS - START).tolist()
    late = write(tmp_path / "b.txt", rows(lambda stamp: str(stamp - START + 12 * 10**9)))
    with pytest.raises(
        tfdb.errors.TrajectoryError, match=r"not a date in another unit; set stamp_unit= "
    ):
        tfdb.Trajectory.read(late)
    assert tfdb.Trajectory.read(late, stamp_unit="ns").stamps[0] == 12 * 10**9
    mixed = rows(str)
    mixed[0][0] = seconds(START)
    with pytest.raises(
        tfdb.errors.TrajectoryError, match=r"looks like seconds, .* in line 2 like nano"
    ):
        tfdb.Trajectory.read(write(tmp_path / "c.txt", mixed))
    with pytest.raises(tfdb.errors.TrajectoryError, match=r"stamp_unit must be .*, got 'h'"):
        tfdb.Trajectory.read(late, stamp_unit="h")  # type: ignore[arg-type]
    with pytest.raises(tfdb.InvalidArgument, match="stamp_unit must be 's', 'ms', 'us' or 'ns'"):
        tfdb.load(late, stamp_unit="h")  # type: ignore[arg-type]


@pytest.mark.parametrize("usual", ["s", "ns", "us"])
@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
def test_a_unit_that_changes_within_a_file(tmp_path: Path, usual: str, unit: str) -> None:
    """As where a program was updated while its log went on."""
    digits = {"s": 0, "ms": 3, "us": 6, "ns": 9}

    def text(stamp: int, unit: str) -> str:
        return seconds(stamp) if unit == "s" else str(stamp // 10 ** (9 - digits[unit]))

    lines = rows()
    for at, stamp in enumerate(STAMPS.tolist()):
        lines[at][0] = text(stamp, usual if at < 7 else unit)
    path = write(tmp_path / "a.txt", lines)
    if usual == unit:
        assert len(_read_quietly(path)) == COUNT
        return
    names = {"s": "seconds", "ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}
    with pytest.raises(tfdb.errors.TrajectoryError) as caught:
        tfdb.Trajectory.read(path)
    assert caught.value.line == 8
    assert caught.value.reason == (
        f"stamp {lines[7][0]} looks like {names[unit]}, {lines[6][0]} in line 7 like "
        f"{names[usual]}; salvage=True (--salvage) skips such rows"
    )
    with pytest.warns(tfdb.TfdbWarning, match=r"12 rows, 5 skipped \(line 8: stamp|by their size"):
        found = tfdb.Trajectory.read(path, salvage=True)
    step = 1 if usual in ("s", "ns") else 1000
    assert found.stamps.tolist() == [stamp // step * step for stamp in STAMPS.tolist()[:7]]


def _read_quietly(path: Path) -> tfdb.Trajectory:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tfdb.TfdbWarning)
        return tfdb.Trajectory.read(path)


ZEROS = "zero bytes, as a power cut leaves them"


def kitti(path: Path) -> str:
    """The lines of KITTI poses, with a file of times beside them."""
    path.with_name("times.txt").write_text("".join(f"{n}.5\n" for n in range(COUNT)))
    return "".join(f"1 0 0 {n} 0 0.6 -0.8 2 0 0.8 0.6 3\n" for n in range(COUNT))


FORMATS = {
    "tum": lambda _: "".join(" ".join(line) + "\n" for line in rows()),
    "csv": lambda _: (
        "stamp_ns,x,y,z,qx,qy,qz,qw\n" + "".join(",".join(line) + "\n" for line in rows(str))
    ),
    "euroc": lambda _: "".join(",".join(line) + "\n" for line in rows(str, W_FIRST)),
    "kitti": kitti,
}


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("size", [1, 500, 8192])
@pytest.mark.parametrize("cut", [0, 1, 5])
def test_zero_bytes_at_the_end(tmp_path: Path, form: str, size: int, cut: int) -> None:
    """As a power cut leaves them; a row that ends in them may be cut, and is skipped."""
    path = tmp_path / "a.txt"
    text = FORMATS[form](path)
    path.write_text(text)
    whole = _read_quietly(path)
    path.write_bytes(text.encode()[: len(text) - cut] + b"\0" * size)
    line = text.count("\n") + (cut == 0)
    many = "1 zero byte, as a power cut leaves it" if size == 1 else f"{size:,} {ZEROS}"
    with pytest.raises(tfdb.errors.TrajectoryError) as caught:
        tfdb.Trajectory.read(path)
    assert caught.value.line == line
    assert caught.value.reason == f"{many}; salvage=True (--salvage) skips such rows"
    with pytest.warns(tfdb.TfdbWarning, match="taken as|skipped") as warned:
        found = tfdb.Trajectory.read(path, salvage=True)
    assert any(f"1 skipped (line {line}: {many})" in str(each.message) for each in warned)
    kept = COUNT - (cut > 0)
    assert found.stamps.tolist() == whole.stamps.tolist()[:kept]
    assert np.array_equal(found.poses, whole.poses[:kept])


@pytest.mark.parametrize("place", [0, 3])
def test_zero_bytes_within_a_file(tmp_path: Path, place: int) -> None:
    path = tmp_path / "a.txt"
    lines = [" ".join(line) + "\n" for line in rows()]
    lines[place] = "\0" * 600 + lines[place]
    path.write_text("".join(lines))
    with pytest.raises(tfdb.errors.TrajectoryError, match=f"600 {ZEROS}") as caught:
        tfdb.Trajectory.read(path)
    assert caught.value.line == place + 1
    with pytest.warns(tfdb.TfdbWarning, match="12 rows, 1 skipped"):
        found = tfdb.Trajectory.read(path, salvage=True)
    assert found.stamps.tolist() == np.delete(STAMPS, place).tolist()


@pytest.mark.parametrize("name", ["path", "path.tum", "path.csv.gz"])
def test_a_trajectory_compressed_with_gzip_is_named_as_such(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(gzip.compress(b"0 1 2 3 0 0 0 1\n"))
    with pytest.raises(tfdb.errors.TrajectoryError, match=f"gzip -dc {name} > FILE"):
        tfdb.Trajectory.read(path)


def test_zero_bytes_alone(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_bytes(b"\0" * 5000)
    for salvage in (False, True):
        with pytest.raises(tfdb.errors.TrajectoryError, match=r"all its 5,000 bytes are zero"):
            tfdb.Trajectory.read(path, salvage=salvage)


def test_zero_bytes_in_a_file_of_times(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text(kitti(path))
    times = tmp_path / "times.txt"
    times.write_bytes(times.read_bytes()[:-5] + b"\0" * 100)
    with pytest.raises(tfdb.errors.TrajectoryError, match=f"times.txt:12: 100 {ZEROS}"):
        tfdb.Trajectory.read(path)
    with pytest.warns(tfdb.TfdbWarning, match="12 rows, 1 skipped"):
        assert len(tfdb.Trajectory.read(path, salvage=True)) == COUNT - 1


def test_units_belong_to_text(tmp_path: Path) -> None:
    write_npz(tmp_path / "a.npz", EXPECTED)
    with pytest.raises(
        tfdb.errors.TrajectoryError, match="a unit belongs to stamps in text, not to npz"
    ):
        tfdb.Trajectory.read(tmp_path / "a.npz", stamp_unit="ns")
    buffer = tfdb.Buffer(history=None)
    buffer.set_trajectory("a", "b", EXPECTED)
    tfdb.recordings.write_recording(tmp_path / "a.bag", buffer)
    with pytest.raises(
        tfdb.InvalidArgument, match="stamp_unit is valid for text trajectories only"
    ):
        tfdb.load(tmp_path / "a.bag", stamp_unit="ns")


GUESSED = {
    "index": (" ", [[str(at), *row] for at, row in enumerate(rows())], "index seconds x y z qx"),
    "index from 1": (" ", [[str(at + 1), *row] for at, row in enumerate(rows())], "index seconds"),
    "OpenVINS": (" ", [[*row, *["1e-6"] * 12] for row in rows()], "20 columns: taken as `seconds"),
    "VINS": (
        ",",
        [[*row, "1", "2", "3", ""] for row in rows(str, W_FIRST)],
        "x,y,z,qw,qx,qy,qz,vx",
    ),
    "VINS, loops": (
        ",",
        [[*row, ""] for row in rows(str, W_FIRST)],
        "8 columns without known names",
    ),
}


@pytest.mark.parametrize("name", GUESSED)
def test_a_warning_names_columns_guessed_by_their_number(tmp_path: Path, name: str) -> None:
    separator, lines, said = GUESSED[name]
    path = write(tmp_path / "a.csv", lines, separator)
    with pytest.warns(tfdb.TfdbWarning, match=said):
        assert same(tfdb.Trajectory.read(path))
    report = tfdb.Buffer(history=None).load
    with pytest.warns(tfdb.TfdbWarning, match=said):
        assert report(path).trajectories[0].rows == COUNT


def test_openvins_with_its_heading(tmp_path: Path) -> None:
    heading = "# timestamp(s) tx ty tz qx qy qz qw Pr11 Pr12 Pr13 Pr22 Pr23 Pr33 Pt11 Pt12 Pt13"
    lines = [[*row, *["1e-6"] * 12] for row in rows()]
    assert same(
        tfdb.Trajectory.read(write(tmp_path / "a.txt", lines, " ", f"{heading} Pt22 Pt23 Pt33"))
    )


def test_an_index_without_a_name(tmp_path: Path) -> None:
    lines = [[str(at), *row] for at, row in enumerate(rows())]
    for heading in (" timestamp x y z qx qy qz qw", "timestamp x y z qx qy qz qw"):
        assert same(tfdb.Trajectory.read(write(tmp_path / "a.txt", lines, " ", heading)))
    heading = ",timestamp,x,y,z,qx,qy,qz,qw"
    assert same(tfdb.Trajectory.read(write(tmp_path / "a.csv", lines, ",", heading)))


@pytest.mark.parametrize("format_", ["tum", "euroc"])
def test_a_named_format_does_not_warn(tmp_path: Path, format_: Any) -> None:
    if format_ == "tum":
        for separator in (" ", ",", ";", "\t"):
            assert same(tfdb.Trajectory.read(write(tmp_path / "a", rows(), separator), format_))
    else:
        lines = [[*row, "1", "2", "3", ""] for row in rows(str, W_FIRST)]
        assert same(tfdb.Trajectory.read(write(tmp_path / "a", lines, ","), format_))


AMBIGUOUS = [
    (",", rows(), "8 columns by commas without a header match several formats"),
    (";", rows(), "8 columns by semicolons without a header match several formats"),
    (" ", [["7", *row] for row in rows()], "9 columns by blanks without a header match several"),
    (",", [["7", *row] for row in rows(str)], "9 columns by commas without a header match several"),
    (" ", [[*row, "1", "2", "3"] for row in rows(str)], "11 columns by blanks without a header"),
    (" ", [row[:5] for row in rows()], "no known format has 5 columns"),
]


@pytest.mark.parametrize(("separator", "lines", "reason"), AMBIGUOUS)
def test_ambiguous_columns_are_refused(
    tmp_path: Path, separator: str, lines: list[list[str]], reason: str
) -> None:
    path = write(tmp_path / "a.txt", lines, separator)
    with pytest.raises(tfdb.errors.TrajectoryError) as caught:
        tfdb.Trajectory.read(path)
    assert reason in str(caught.value)
    assert "name the columns in the first line" in str(caught.value)
    assert (caught.value.path, caught.value.line) == (str(path), 1)


HEADINGS = [
    ("time,x,y,z,roll,pitch,yaw,w", "names no quaternion"),
    ("time,a,b,c,qx,qy,qz,qw", "names no position"),
    ("when,x,y,z,qx,qy,qz,qw", "names no time"),
    ("time,x [mm],y [mm],z [mm],qx,qy,qz,qw", "positions are metres, but 'x [mm]' is in 'mm'"),
    ("time,x,y,z,qx,qy,qz", "its header names 7 columns, but its rows have 8"),
    ("time,x,y,z,x,qy,qz,qw", "once"),
]


@pytest.mark.parametrize(("heading", "reason"), HEADINGS)
def test_headings_that_do_not_name_a_pose(tmp_path: Path, heading: str, reason: str) -> None:
    path = write(tmp_path / "a.csv", rows(), ",", heading)
    with pytest.raises(tfdb.errors.TrajectoryError, match=r":1: ") as caught:
        tfdb.Trajectory.read(path)
    assert reason in str(caught.value)


def test_several_poses_and_times(tmp_path: Path) -> None:
    pose = [
        *(f"{{}}/position/{axis}" for axis in "xyz"),
        *(f"{{}}/orientation/{axis}" for axis in "xyzw"),
    ]
    one, two = ([name.format(topic) for name in pose] for topic in ("/odom/pose", "/amcl/pose"))
    lines = [[*row, *row[1:]] for row in rows()]
    path = write(tmp_path / "a.csv", lines, ",", ",".join(["__time", *one, *two]))
    with pytest.raises(
        tfdb.errors.TrajectoryError, match="several poses; keep the columns of one of '/odom"
    ):
        tfdb.Trajectory.read(path)
    lines = [[row[0], row[0], *row[1:]] for row in rows()]
    path = write(tmp_path / "a.csv", lines, ",", ",".join(["time", "stamp", *one]))
    with pytest.raises(
        tfdb.errors.TrajectoryError, match="several times; keep one of 'time', 'stamp'"
    ):
        tfdb.Trajectory.read(path)


def test_decimal_commas_are_refused(tmp_path: Path) -> None:
    for separator in (" ", ";", "\t"):
        for heading in ("", separator.join(("time", "x", "y", "z", "qx", "qy", "qz", "qw"))):
            lines = [[field.replace(".", ",") for field in row] for row in rows()]
            path = write(tmp_path / "a.csv", lines, separator, heading)
            with pytest.raises(
                tfdb.errors.TrajectoryError, match="decimal commas: write"
            ) as caught:
                tfdb.Trajectory.read(path)
            assert caught.value.line == (2 if heading else 1)


def test_utf_16_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", rows())
    path.write_bytes(path.read_text().encode("utf-16"))
    with pytest.raises(tfdb.errors.TrajectoryError, match="UTF-16 text: save it as UTF-8"):
        tfdb.Trajectory.read(path)


def damaged(**changes: Sequence[str]) -> list[list[str]]:
    lines = rows()
    for at, line in changes.items():
        lines[int(at[1:])] = list(line)
    return lines


ROW = rows()[4]
DAMAGE: dict[str, tuple[list[list[str]], str, str]] = {
    "nan": (damaged(_4=[ROW[0], *["nan"] * 7]), ":5: 'nan' is not a finite", "1 skipped (line 5: "),
    "zero": (
        damaged(_4=[*ROW[:4], *"0000"]),
        ":5: the quaternion has length 0",
        "1 skipped (line 5: ",
    ),
    "cut": (damaged(_4=ROW[:6]), ":5: 6 columns instead of", "1 skipped (line 5: 6 columns"),
    "words": (damaged(_4=["[WARN]", "lost", "track"]), ":5: 3 columns", "1 skipped (line 5: 3"),
    "stamp": (damaged(_4=["zero", *ROW[1:]]), ":5: 'zero' is not a number of seconds", "1 skipped"),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_rows_are_skipped_where_salvage_is_asked_for(tmp_path: Path, name: str) -> None:
    lines, reason, told = DAMAGE[name]
    path = write(tmp_path / "a.tum", lines)
    for read in (tfdb.Trajectory.read, tfdb.load):
        with pytest.raises(tfdb.errors.TrajectoryError) as caught:
            read(path)
        assert reason in str(caught.value)
        assert "; salvage=True (--salvage) skips such rows" in str(caught.value)
    rest = [at for at in range(COUNT) if at != 4]
    with pytest.warns(tfdb.TfdbWarning) as warned:
        found = tfdb.Trajectory.read(path, salvage=True)
    assert told in str(warned[0].message)
    assert f"a.tum: {COUNT} rows, " in str(warned[0].message)
    assert found == EXPECTED[rest]
    buffer = tfdb.Buffer(history=None)
    with pytest.warns(tfdb.TfdbWarning, match=r"12 rows, 1 skipped"):
        report = buffer.load(path, salvage=True)
    assert buffer.trajectory("world", "body") == found
    (loss,) = report.lost
    assert (loss.messages, loss.path) == (1, str(path))
    assert loss.bytes == len(" ".join(lines[4])) + 1
    (told_rows,) = report.trajectories
    assert (told_rows.rows, told_rows.poses, told_rows.skipped) == (COUNT, COUNT - 1, 1)


def test_rows_are_sorted_where_salvage_is_asked_for(tmp_path: Path) -> None:
    lines = rows()
    lines[3], lines[7] = lines[7], lines[3]
    path = write(tmp_path / "a.tum", lines)
    with pytest.raises(
        tfdb.errors.TrajectoryError, match=r":5: .*or let salvage=True .--salvage. sort them"
    ):
        tfdb.Trajectory.read(path)
    with pytest.warns(tfdb.TfdbWarning, match="12 rows, 4 out of order, sorted"):
        assert same(tfdb.Trajectory.read(path, salvage=True))
    with pytest.warns(tfdb.TfdbWarning, match="12 rows, 4 out of order, sorted"):
        assert same(tfdb.load(path, salvage=True).trajectory("world", "body"))


def test_quaternions_with_few_digits(tmp_path: Path) -> None:
    lines = [
        [when, *(f"{value:.2f}" for value in pose)]
        for when, pose in zip((seconds(int(stamp)) for stamp in STAMPS), POSES, strict=True)
    ]
    lines[5][4:] = ["0.00", "0.00", "0.00", "0.98"]
    path = write(tmp_path / "a.tum", lines)
    with pytest.raises(
        tfdb.errors.TrajectoryError, match=r":6: .* length 0.98, not 1; salvage=True"
    ):
        tfdb.Trajectory.read(path)
    with pytest.warns(tfdb.TfdbWarning, match="12 rows, 1 with the quaternion normalised"):
        found = tfdb.Trajectory.read(path, salvage=True)
    assert found.poses[5, 3:].tolist() == [0, 0, 0, 1]
    raw = np.array([[float(value) for value in line[1:]] for line in lines])
    assert np.array_equal(found.poses, normalised(raw))
    lines[5][4:] = ["0.00", "0.00", "0.00", "0.90"]
    with pytest.warns(tfdb.TfdbWarning, match="12 rows, 1 skipped .line 6: the quaternion"):
        assert len(tfdb.Trajectory.read(write(path, lines), salvage=True)) == COUNT - 1


def test_a_warning_counts_repeated_stamps(tmp_path: Path) -> None:
    lines = rows()
    same_again, other = list(lines[4]), [*lines[4][:1], "90", *lines[4][2:]]
    path = write(tmp_path / "a.tum", [*lines[:5], same_again, *lines[5:]])
    with pytest.warns(tfdb.TfdbWarning, match=r"13 rows, 1 with a repeated stamp \(the last"):
        assert same(tfdb.Trajectory.read(path))
    path = write(tmp_path / "a.tum", [*lines[:5], other, *lines[5:]])
    buffer = tfdb.Buffer(history=None)
    said = r"13 rows, 1 with a repeated stamp, 1 with another pose \(the last row counts\)"
    with pytest.warns(tfdb.TfdbWarning, match=said):
        report = buffer.load(path)
    (told,) = report.trajectories
    assert (told.rows, told.poses, told.repeated, told.differing) == (13, 12, 1, 1)
    assert buffer.lookup_transform("world", "body", int(STAMPS[4])).translation[0] == 90


def test_salvage_of_whole_files_does_not_warn(tmp_path: Path) -> None:
    for kind in ("tum", "euroc", "csv", "npz", "parquet"):
        path = tmp_path / f"a.{'csv' if kind == 'euroc' else kind}"
        write_trajectory(path, EXPECTED, kind, overwrite=True)  # type: ignore[arg-type]
        assert same(tfdb.Trajectory.read(path, salvage=True))


def test_nothing_that_could_be_salvaged(tmp_path: Path) -> None:
    path = write(tmp_path / "a.tum", [[row[0], *"0000000"] for row in rows()])
    with pytest.raises(
        tfdb.errors.TrajectoryError, match="all 12 rows were skipped, the first at line 1"
    ):
        tfdb.Trajectory.read(path, salvage=True)


@pytest.mark.parametrize("kind", ["npz", "parquet"])
def test_arrays_are_salvaged(tmp_path: Path, kind: str) -> None:
    import polars as pl

    stamps, poses = STAMPS.copy(), POSES.copy()
    stamps[[2, 3]] = stamps[[3, 2]]
    poses[[2, 3]] = poses[[3, 2]]
    poses[6, 3:] = 0
    poses[7] = np.nan
    path = tmp_path / f"a.{kind}"
    if kind == "npz":
        np.savez(path, stamps=stamps, poses=poses)
    else:
        names = ("x", "y", "z", "qx", "qy", "qz", "qw")
        columns = dict(zip(names, poses.T, strict=True))
        pl.DataFrame({"stamp_ns": stamps, **columns}).write_parquet(path)
    with pytest.raises(
        tfdb.errors.TrajectoryError, match=r"salvage=True \(--salvage\) reads the other"
    ):
        tfdb.Trajectory.read(path)
    with pytest.warns(tfdb.TfdbWarning, match="12 rows, 1 out of order, sorted, 1 skipped .row 6"):
        found = tfdb.Trajectory.read(path, salvage=True)
    assert found.stamps.tolist() == [int(s) for at, s in enumerate(STAMPS) if at != 6]
    assert found.valid.sum() == COUNT - 2
    assert np.array_equal(found.poses[found.valid], EXPECTED[[*range(6), *range(8, COUNT)]].poses)


def test_kitti_poses_are_salvaged_with_their_stamps(tmp_path: Path) -> None:
    write_trajectory(tmp_path / "a.txt", EXPECTED, "kitti")
    poses = (tmp_path / "a.txt").read_text().splitlines()
    times = (tmp_path / "a_times.txt").read_text().splitlines()
    poses[2] = " ".join(poses[2].split()[:7])
    poses[5] = " ".join(["2", *poses[5].split()[1:]])
    times[8] = "late"
    (tmp_path / "a.txt").write_text("\n".join(poses))
    (tmp_path / "a_times.txt").write_text("\n".join(times))
    with pytest.raises(
        tfdb.errors.TrajectoryError, match=r"a_times.txt:9: 'late' .* skips such rows"
    ):
        tfdb.Trajectory.read(tmp_path / "a.txt")
    with pytest.warns(tfdb.TfdbWarning, match="12 rows, 3 skipped .line 3: 7 columns"):
        found = tfdb.Trajectory.read(tmp_path / "a.txt", salvage=True)
    rest = [at for at in range(COUNT) if at not in (2, 5, 8)]
    assert found.stamps.tolist() == STAMPS[rest].tolist()
    assert np.abs(found.matrices - EXPECTED[rest].matrices).max() < 1e-14
    with pytest.warns(tfdb.TfdbWarning, match="3 skipped"):
        report = tfdb.Buffer().load(tmp_path / "a.txt", salvage=True)
    assert report.lost[0].bytes == sum(len(poses[at]) + 1 for at in (2, 5, 8))
    (tmp_path / "a_times.txt").write_text("\n".join(times[:8]))
    with pytest.raises(tfdb.errors.TrajectoryError, match="12 poses, but 8 stamps"):
        tfdb.Trajectory.read(tmp_path / "a.txt")
    with pytest.warns(tfdb.TfdbWarning, match="12 rows, 6 skipped"):
        assert len(tfdb.Trajectory.read(tmp_path / "a.txt", salvage=True)) == 6


def test_a_file_that_was_cut_anywhere(tmp_path: Path) -> None:
    """No pose of a row that lacks digits is read where all others have as many."""
    lines = [
        [when, *(f"{value:.9f}" for value in pose)]
        for (when, *_), pose in zip(rows(), POSES, strict=True)
    ]
    whole = write(tmp_path / "whole.tum", lines).read_bytes()
    expected = tfdb.Trajectory.read(tmp_path / "whole.tum")
    path = tmp_path / "cut.tum"
    start = whole.rstrip().rindex(b"\n") + 1
    for end in range(start + 1, len(whole) - 1):
        path.write_bytes(whole[:end])
        with pytest.raises(tfdb.errors.TrajectoryError, match=r":12: .* skips such rows"):
            tfdb.Trajectory.read(path)
        with pytest.warns(tfdb.TfdbWarning, match="12 rows, 1 skipped"):
            assert tfdb.Trajectory.read(path, salvage=True) == expected[:-1]
    path.write_bytes(whole[:-1])
    assert tfdb.Trajectory.read(path) == expected


def test_short_files_by_hand_are_not_cut(tmp_path: Path) -> None:
    path = tmp_path / "a.tum"
    path.write_text(
        "1 1 0 0 0 0 0.6 0.8\n2 1 0 0 0 0 0.6 0.8\n3 1 0 0 0 0 0.8 0.6\n4 0 0 0 0 0 0 1"
    )
    assert len(tfdb.Trajectory.read(path)) == 4
