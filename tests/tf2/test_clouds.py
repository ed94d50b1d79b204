"""PointCloud2 of every layout against a loop over the points; invalid clouds."""

from __future__ import annotations

import copy
import struct
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

import tfdb
from tf2 import conversions
from tfdb import tf2
from tfdb.tf2 import clouds, msgs

Field = msgs.PointField
LETTERS = {1: "b", 2: "B", 3: "h", 4: "H", 5: "i", 6: "I", 7: "f", 8: "d"}
STAMP = msgs.Time(1_700_000_000, 123_456_789)
NORMAL = ("normal_x", "normal_y", "normal_z")
SECOND = 1_000_000_000


@dataclass
class Layout:
    """Where the numbers of a random cloud lie."""

    fields: list[Field] = field(default_factory=list)
    order: str = "<"
    point_step: int = 0

    def place(self, point: int, field_: Field, row_step: int, width: int) -> tuple[str, int]:
        row, column = divmod(point, width)
        at = row * row_step + column * self.point_step + field_.offset
        return self.order + LETTERS[field_.datatype], at


def random_layout(random: np.random.Generator) -> Layout:
    """Fields in any order with gaps between them."""
    made = Layout(order=str(random.choice(["<", ">"])))
    names = ["x", "y", "z", "intensity", "ring", "_"]
    kinds = {"intensity": 7, "ring": 4, "_": 2}
    for normal in (NORMAL, ("nx", "ny", "nz")):
        if random.random() < 0.4:
            names += normal
    wide = random.random()
    for name in random.permutation(names):
        kind = kinds.get(name) or (7 if random.random() < wide else 8)
        made.point_step += int(random.integers(0, 4))
        count = int(random.integers(0, 2)) if name in "xyz" else 1
        made.fields.append(Field(str(name), made.point_step, kind, count))
        made.point_step += struct.calcsize(LETTERS[kind])
    made.fields.append(Field("_", 0, 2, 1))
    made.fields = [made.fields[i] for i in random.permutation(len(made.fields))]
    made.point_step += int(random.integers(0, 5))
    return made


def random_cloud(random: np.random.Generator) -> tuple[Layout, msgs.PointCloud2]:
    layout = random_layout(random)
    height, width = (int(random.integers(0, 4)), int(random.integers(0, 6)))
    row_step = width * layout.point_step + int(random.integers(0, 9))
    data = bytearray(random.bytes(height * row_step + int(random.integers(0, 9))))
    for point in range(height * width):
        for each in layout.fields:
            if each.datatype in {7, 8}:
                value = np.nan if random.random() < 0.1 else random.normal() * 10
                letter, at = layout.place(point, each, row_step, width)
                struct.pack_into(letter, data, at, value)
    header = msgs.Header(STAMP, "lidar")
    big = layout.order == ">"
    shape = (height, width, layout.fields, big, layout.point_step, row_step)
    return layout, msgs.PointCloud2(header, *shape, bytes(data), is_dense=False)


def expected(layout: Layout, cloud: msgs.PointCloud2, by: np.ndarray) -> bytes:
    """Bytes of the transformed cloud, one point after the other."""
    data = bytearray(cloud.data)
    fields = {each.name: each for each in cloud.fields}
    for point in range(cloud.height * cloud.width):
        for names, shift in ((("x", "y", "z"), 1.0), (NORMAL, 0.0), (("nx", "ny", "nz"), 0.0)):
            if not all(name in fields for name in names):
                continue
            at = [layout.place(point, fields[name], cloud.row_step, cloud.width) for name in names]
            found = [struct.unpack_from(letter, cloud.data, offset)[0] for letter, offset in at]
            for (letter, offset), value in zip(at, by @ [*found, shift], strict=False):
                struct.pack_into(letter, data, offset, value)
    return bytes(data)


def numbers(cloud: msgs.PointCloud2, layout: Layout) -> np.ndarray:
    """All floating point numbers of a cloud; its other bytes are compared as they are."""
    found = []
    for point in range(cloud.height * cloud.width):
        for each in cloud.fields:
            if each.datatype in {7, 8}:
                letter, at = layout.place(point, each, cloud.row_step, cloud.width)
                found.append(struct.unpack_from(letter, cloud.data, at)[0])
    return np.array(found)


def blanked(cloud: msgs.PointCloud2, layout: Layout) -> bytes:
    """The bytes of a cloud without those of its places and normals."""
    data = bytearray(cloud.data)
    for point in range(cloud.height * cloud.width):
        for each in cloud.fields:
            if each.name in {"x", "y", "z", *NORMAL, "nx", "ny", "nz"}:
                letter, at = layout.place(point, each, cloud.row_step, cloud.width)
                struct.pack_into(letter, data, at, 0.0)
    return bytes(data)


def of(random: np.random.Generator) -> msgs.TransformStamped:
    return conversions.Geometry(msgs, STAMP, random).transform()


def matrix(transform: msgs.TransformStamped) -> np.ndarray:
    return conversions.matrix(transform.transform.translation, transform.transform.rotation)


@pytest.mark.parametrize("seed", range(60))
def test_random_layouts(seed: int) -> None:
    random = np.random.default_rng(seed)
    layout, cloud = random_cloud(random)
    transform = of(random)
    before = copy.deepcopy(cloud), copy.deepcopy(transform)
    made = clouds.do_transform_cloud(cloud, transform)
    assert (cloud, transform) == before
    conversions.check_own(made, cloud, transform)
    again = copy.copy(cloud)
    again.data = expected(layout, cloud, matrix(transform))
    assert len(made.data) == len(cloud.data)
    assert blanked(made, layout) == blanked(cloud, layout)
    found, wanted = numbers(made, layout), numbers(again, layout)
    assert np.allclose(found, wanted, rtol=1e-6, atol=1e-5, equal_nan=True), seed
    again.data, again.header = made.data, made.header
    assert made == again


def simple(count: int = 3, kind: int = Field.FLOAT32, **more: Any) -> msgs.PointCloud2:
    """A cloud of x, y, z and a time, all of one type, in one row."""
    size = struct.calcsize(LETTERS[kind])
    fields = [Field(name, size * i, kind, 1) for i, name in enumerate(("x", "y", "z", "t"))]
    values = np.random.default_rng(5).normal(size=(count, 4)).astype(LETTERS[kind])
    step = 4 * size
    made = msgs.PointCloud2(msgs.Header(STAMP, "lidar"), 1, count, fields, point_step=step)
    made.row_step, made.data = step * count, values.tobytes()
    for name, value in more.items():
        setattr(made, name, value)
    return made


def test_float64_keeps_its_digits() -> None:
    cloud = simple(kind=Field.FLOAT64)
    transform = of(np.random.default_rng(6))
    there = clouds.do_transform_cloud(cloud, transform)
    inside = transform.transform
    inverse = tfdb.Transform("a", "b", inside.translation, inside.rotation).inverse()
    back = clouds.do_transform_cloud(there, inverse)
    found, given = (np.frombuffer(each.data) for each in (back, cloud))
    assert np.allclose(found, given, rtol=0, atol=1e-12)
    assert not np.allclose(np.frombuffer(there.data), given, rtol=0, atol=0.1)


def test_a_cloud_through_the_interface() -> None:
    transform = of(np.random.default_rng(7))
    cloud = simple(header=msgs.Header(STAMP, "source"))
    made = conversions.Looking(transform).transform(cloud, "target")
    assert made == clouds.do_transform_cloud(cloud, transform)
    assert made.header == transform.header


def test_one_row_without_a_row_step() -> None:
    """Drivers leave it 0, and nothing depends on it."""
    transform = of(np.random.default_rng(8))
    found = clouds.do_transform_cloud(simple(row_step=0), transform)
    assert found.data == clouds.do_transform_cloud(simple(), transform).data


def test_a_cloud_without_points() -> None:
    transform = of(np.random.default_rng(9))
    for more in ({"width": 0}, {"width": 0, "point_step": 0}, {"height": 0}):
        cloud = simple(data=b"", **more)
        made = clouds.do_transform_cloud(cloud, transform)
        assert (made.data, made.header) == (b"", transform.header)


def without(*names: str) -> msgs.PointCloud2:
    made = simple()
    made.fields = [each for each in made.fields if each.name not in names]
    return made


def changed(name: str, **values: Any) -> msgs.PointCloud2:
    made = simple()
    for each in made.fields:
        if each.name == name:
            for member, value in values.items():
                setattr(each, member, value)
    return made


PHRASE = "Point cloud needs the fields x, y, and z for the transformation"
HOSTILE = {
    "no x": (without("x"), PHRASE + ": x missing among y, z, t"),
    "no fields": (simple(fields=[]), PHRASE + ": x, y, z missing among none"),
    "short": (simple(data=b"\0" * 47), "1 x 3 points need 48 bytes of data, got 47"),
    "no data": (simple(data=b""), "need 48 bytes of data, got 0"),
    "outside": (changed("z", offset=13), "field 'z' at 13 lies outside a point of 16 bytes"),
    "before": (changed("z", offset=-1), "field 'z' at -1 lies outside"),
    "no step": (simple(point_step=0), "lies outside a point of 0 bytes"),
    "rows overlap": (
        simple(height=2, row_step=47, data=b"\0" * 96),
        "2 rows of 3 points of 16 bytes cannot be 47 apart",
    ),
    "negative": (simple(width=-3), "1 rows of -3 points of 16 bytes"),
    "integers": (changed("y", datatype=5), "field 'y' must be FLOAT32 or FLOAT64, got datatype 5"),
    "unknown type": (changed("y", datatype=9), "field 'y' must be FLOAT32 or FLOAT64"),
    "many": (changed("x", count=3), "field 'x' has 3 numbers"),
    "twice": (
        simple(fields=[*simple().fields, Field("x", 12, 7, 1)]),
        "the cloud has two fields 'x'",
    ),
    "overlap": (changed("y", offset=2), "fields 'x' and 'y' overlap"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_clouds_that_are_none(name: str) -> None:
    cloud, text = HOSTILE[name]
    before = copy.deepcopy(cloud)
    with pytest.raises(tf2.InvalidArgumentException) as raised:
        clouds.do_transform_cloud(cloud, of(np.random.default_rng(10)))
    assert text in str(raised.value)
    assert cloud == before


def test_a_place_beyond_float32() -> None:
    cloud = simple(fields=[Field("x", 0, 7, 1), Field("y", 4, 7, 1), Field("z", 8, 8, 1)])
    values = np.zeros(3, [("x", "<f4"), ("y", "<f4"), ("z", "<f8")])
    values["z"] = 1e300
    cloud.data = values.tobytes()
    with pytest.raises(tfdb.errors.InvalidTransform, match="not finite in float32"):
        clouds.do_transform_cloud(cloud, of(np.random.default_rng(11)))


def test_headers_of_any_numbers() -> None:
    """Either an answer of the same size or a typed error, whatever the header says."""
    random = np.random.default_rng(17)
    transform = of(random)
    answered = 0
    for _ in range(3000):
        cloud = simple(int(random.integers(0, 5)))
        sizes = [0, 1, 2, 3, 15, 16, 17, 47, 2**31, 2**32 - 1]
        for name in ("height", "width", "point_step", "row_step"):
            if random.random() < 0.25:
                setattr(cloud, name, int(random.choice(sizes)))
        for each in cloud.fields:
            for name in ("offset", "datatype", "count"):
                if random.random() < 0.03:
                    setattr(each, name, int(random.choice(sizes)))
        cloud.is_bigendian = bool(random.random() < 0.5)
        before = copy.deepcopy(cloud)
        try:
            made = clouds.do_transform_cloud(cloud, transform)
        except (tf2.InvalidArgumentException, tfdb.errors.InvalidTransform):
            pass
        else:
            assert len(made.data) == len(cloud.data)
            answered += 1
        assert cloud == before
    assert 300 < answered < 2700


# One stamp per point


def drive() -> tfdb.Buffer:
    """A robot that turns and moves within 2 s, from the header's stamp on."""
    buffer = tfdb.Buffer(history=None)
    for step in range(21):
        angle = step / 20
        turn = (0.0, np.sin(angle / 2) * 0.6, np.sin(angle / 2) * 0.8, np.cos(angle / 2))
        stamp = STAMP.nanoseconds + step * SECOND // 10
        buffer.set_transform("odom", "base", stamp, (step / 10, 1.0, -angle), turn)
    buffer.set_static_transform("base", "lidar", (0.3, 0.2, 1.0), (0.6, 0.0, 0.0, 0.8))
    return buffer


def timed(kind: int, times: Any) -> tuple[msgs.PointCloud2, np.ndarray]:
    """A cloud of points with the time `t` of each, and normals; and its numbers."""
    kinds = {"x": 7, "y": 7, "z": 7, "t": kind} | dict.fromkeys(NORMAL, 8)
    values = np.zeros(len(times), [(name, "<" + LETTERS[each]) for name, each in kinds.items()])
    random = np.random.default_rng(12)
    for name in ("x", "y", "z", *NORMAL):
        values[name] = random.normal(size=len(times)) * 5
    values["t"] = times
    types = values.dtype.fields
    assert types is not None
    fields = [Field(name, types[name][1], each, 1) for name, each in kinds.items()]
    step = values.dtype.itemsize
    cloud = msgs.PointCloud2(msgs.Header(STAMP, "lidar"), 1, len(times), fields)
    cloud.point_step, cloud.row_step, cloud.data = step, step * len(times), values.tobytes()
    return cloud, values


TIMES = np.linspace(0.05, 1.9, 50)
KINDS = [
    (7, TIMES, {}, 1e-4),
    (8, TIMES, {}, 1e-9),
    (6, (TIMES * 1e9).astype(int), {}, 0),
    (6, (TIMES * 1e6).astype(int), {"unit": "us"}, 1e-6),
    (8, TIMES + STAMP.nanoseconds / 1e9, {"since": "epoch"}, 1e-6),
    (8, TIMES * 1e9 + STAMP.nanoseconds, {"since": "epoch", "unit": "ns"}, 1e-6),
]


@pytest.mark.parametrize(("kind", "times", "how", "off"), KINDS)
@pytest.mark.parametrize("fixed", [None, "odom"])
def test_each_point_at_its_own_stamp(
    kind: int, times: Any, how: dict[str, Any], off: float, fixed: str | None
) -> None:
    buffer = drive()
    cloud, values = timed(kind, times)
    before = copy.deepcopy(cloud)
    target = "odom" if fixed is None else "lidar"
    moment = STAMP.nanoseconds + SECOND
    more = {} if fixed is None else {"fixed_frame": fixed, "target_time": moment}
    made = clouds.deskew_cloud(cloud, buffer, target, time_field="t", **how, **more)
    assert cloud == before
    found = np.frombuffer(made.data, values.dtype)
    for index, seconds in enumerate(TIMES):
        stamp = STAMP.nanoseconds + int(seconds * 1e9)
        move = buffer.lookup_transform("odom", "lidar", stamp)
        if fixed is not None:
            move = buffer.lookup_transform("lidar", "odom", moment) @ move
        place = move.apply([values[name][index] for name in ("x", "y", "z")])
        turned = move.matrix[:3, :3] @ [values[name][index] for name in NORMAL]
        assert np.allclose([found[n][index] for n in ("x", "y", "z")], place, 0, 1e-5 + 20 * off)
        assert np.allclose([found[n][index] for n in NORMAL], turned, 0, 1e-12 + 20 * off)
    assert np.array_equal(found["t"], values["t"])
    stamp = STAMP if fixed is None else msgs.Time.from_nanoseconds(moment)
    assert made.header == msgs.Header(stamp, target)


def test_deskewing_with_a_buffer_or_a_snapshot() -> None:
    """A buffer of either kind and a snapshot; without points nothing is looked up."""
    buffer = drive()
    cloud, _ = timed(8, TIMES)
    core = tf2.BufferCore(buffer=buffer)
    with buffer.snapshot() as snapshot:
        made = [
            clouds.deskew_cloud(cloud, each, "odom", time_field="t")
            for each in (buffer, core, snapshot)
        ]
    assert made[0] == made[1] == made[2] != cloud
    empty, _ = timed(8, [])
    made_of_none = clouds.deskew_cloud(empty, tfdb.Buffer(), "odom", time_field="t")
    assert made_of_none.header.frame_id == "odom"


def test_points_that_are_not_finite_need_no_time() -> None:
    buffer = drive()
    cloud, values = timed(8, np.where(np.arange(50) % 7 == 3, np.nan, TIMES))
    with pytest.raises(
        tf2.InvalidArgumentException, match="'t' of point 3 is not a time: nan"
    ) as at:
        clouds.deskew_cloud(cloud, buffer, "odom", time_field="t")
    assert at.value.index == 3
    values["x"][np.isnan(values["t"])] = np.nan
    cloud.data = values.tobytes()
    whole, _ = timed(8, TIMES)
    found, expected = (
        np.frombuffer(clouds.deskew_cloud(each, buffer, "odom", time_field="t").data, values.dtype)
        for each in (cloud, whole)
    )
    finite = ~np.isnan(values["t"])
    assert np.array_equal(found["z"][finite], expected["z"][finite])
    assert np.isnan(found["z"][~finite]).all()
    values["x"] = np.nan
    cloud.data = values.tobytes()
    made = clouds.deskew_cloud(cloud, buffer, "odom", time_field="t")
    assert made.data == cloud.data


def test_times_that_are_none() -> None:
    buffer = drive()
    cloud, values = timed(8, TIMES)
    for more, text in (
        ({"time_field": "when"}, "no field 'when' among x, y, z, t"),
        ({"time_field": "t", "unit": "min"}, "unit must be 's', 'ms', 'us' or 'ns'"),
        ({"time_field": "t", "since": "noon"}, "since must be 'header' or 'epoch'"),
    ):
        with pytest.raises(tf2.InvalidArgumentException, match=text):
            clouds.deskew_cloud(cloud, buffer, "odom", **more)
    for kind in (8, 6):
        days, _ = timed(kind, TIMES + 1.7e9)
        days.header.stamp = msgs.Time.from_nanoseconds(1_700_000_000 * SECOND)
        with pytest.raises(tf2.InvalidArgumentException, match=r"'t' of point 0.*since='epoch'"):
            clouds.deskew_cloud(days, buffer, "odom", time_field="t", unit="s")
    values["t"][5] = 1e300
    cloud.data = values.tobytes()
    with pytest.raises(tf2.InvalidArgumentException, match="point 5 is not a time"):
        clouds.deskew_cloud(cloud, buffer, "odom", time_field="t")
    values["t"][5] = 3.0
    cloud.data = values.tobytes()
    with pytest.raises(tfdb.Extrapolation) as raised:
        clouds.deskew_cloud(cloud, buffer, "odom", time_field="t")
    assert raised.value.index == 5
    assert not hasattr(raised.value, "__notes__")


def test_times_in_another_unit_than_assumed_are_noted() -> None:
    cloud, _ = timed(7, TIMES * 1e6)
    with pytest.raises(tfdb.Extrapolation) as raised:
        clouds.deskew_cloud(cloud, drive(), "odom", time_field="t")
    (note,) = raised.value.__notes__
    assert "span 1,850,000 s" in note
    assert "unit='us'" in note
