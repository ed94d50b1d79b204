"""Shapes of a robot model: which meshes are found and read, and what the server serves of them."""

from __future__ import annotations

import json
import os
import warnings
from typing import TYPE_CHECKING

import numpy as np
import pytest

import tfdb
from tests.view.served import serving
from tfdb.cli.graph import Live
from tfdb.view import shapes as module
from tfdb.view.model import Model
from tfdb.view.shapes import BadMesh, Shapes, read_mesh, read_shapes, read_stl

if TYPE_CHECKING:
    from pathlib import Path

CORNERS = np.arange(18, dtype=np.float32).reshape(2, 3, 3)


def binary(corners: np.ndarray = CORNERS, head: bytes = b"") -> bytes:
    rows = np.zeros(len(corners), module._TRIANGLE)
    rows["corners"] = corners
    return head.ljust(80, b" ") + len(corners).to_bytes(4, "little") + rows.tobytes()


def text(corners: np.ndarray = CORNERS) -> bytes:
    lines = ["solid thing"]
    for triangle in corners:
        lines += ["facet normal 0 0 1", "outer loop"]
        lines += ["vertex {:g} {:g} {:g}".format(*corner) for corner in triangle]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid thing"]).encode()


def urdf(*meshes: str) -> str:
    visuals = "".join(
        f'<visual><geometry><mesh filename="{name}"/></geometry></visual>' for name in meshes
    )
    return f'<robot name="r"><link name="base">{visuals}</link></robot>'


@pytest.mark.parametrize(
    "raw",
    [binary(), binary(head=b"solid by a bad exporter"), binary() + b"more", text()],
    ids=["binary", "binary that begins with solid", "binary with more behind", "text"],
)
def test_stl_files_of_all_kinds_are_read(raw: bytes) -> None:
    assert read_stl(raw).tobytes() == CORNERS.astype("<f4").tobytes()


@pytest.mark.parametrize(
    ("raw", "reason"),
    [
        (b"", "no STL file"),
        (b"\x00" * 84, "no triangle in it"),
        (binary()[:-1], "no STL file"),
        (b"root:x:0:0:root:/root:/bin/bash\n" * 10, "no STL file"),
        (b"solid\nendsolid", "no triangle in it"),
        (b"solid\nvertex 1 2 3\nvertex 1 2 3\n", "a triangle in it lacks corners"),
        (b"solid\n" + b"vertex 1 2 x\n" * 3, "numbers in it cannot be read"),
        (b"solid\n" + b"vertex 1 2 1e99\n" * 3, "numbers in it are not finite"),
        (b"solid\n" + b"vertex 1 2 " + b"9" * 1000, "no triangle in it"),
        (binary(CORNERS * np.float32("nan")), "numbers in it are not finite"),
        (b" " * 80 + b"\xff" * 4 + b" " * 50, "no STL file"),
    ],
)
def test_other_files_than_stl_are_refused(raw: bytes, reason: str) -> None:
    with pytest.raises(BadMesh, match=f"^{reason}$"):
        read_stl(raw)


def test_random_bytes_are_read_or_refused() -> None:
    rng = np.random.default_rng(5)
    for _ in range(2000):
        raw = bytearray(binary() if rng.random() < 0.5 else text())
        for _ in range(rng.integers(1, 8)):
            raw[rng.integers(len(raw))] = rng.integers(256)
        try:
            found = read_stl(bytes(raw[: rng.integers(1, len(raw) + 1)]))
        except BadMesh:
            continue
        assert np.isfinite(found).all()


def test_meshes_are_found_beside_the_file_and_in_packages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def put(path: str) -> None:
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_bytes(binary())

    places = ["own/meshes/a.STL", "sibling/b.stl", "ws/one/c.stl", "two/d.stl", "pre/share/x/e.stl"]
    for each in (*places, "own/urdf/f.stl", "own/urdf/g h.stl"):
        put(each)
    model = tmp_path / "own/urdf/robot.urdf"
    model.write_text(urdf())
    path = os.pathsep.join([str(tmp_path / "ws"), "", str(tmp_path / "two")])
    monkeypatch.setenv("ROS_PACKAGE_PATH", path)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "pre"))
    names = [
        "package://own/meshes/a.STL",
        "package://sibling/b.stl",
        "package://one/c.stl",
        "package://two/d.stl",
        "package://x/e.stl",
        "f.stl",
        f"file://{tmp_path}/own/urdf/g%20h.stl",
    ]
    for name in names:
        assert len(read_mesh(name, str(model))) == 2
    for name in ("package://", "package://own", "package://own/x.stl", "nowhere.stl", "/dev/zero"):
        with pytest.raises(BadMesh, match="no such file"):
            read_mesh(name, str(model))


def test_a_missing_or_bad_mesh_makes_one_warning_and_the_rest_is_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "MOST_BYTES", 1000)
    (tmp_path / "good.stl").write_bytes(binary())
    (tmp_path / "bad.stl").write_bytes(b"no")
    (tmp_path / "large.stl").write_bytes(b"0" * 2000)
    (tmp_path / "scene.dae").write_bytes(b"<xml/>")
    (tmp_path / "folder.stl").mkdir()
    model = tmp_path / "robot.urdf"
    names = ["good.stl", "bad.stl", "a.stl", "a.stl", "folder.stl", "scene.dae", "large.stl"]
    model.write_text(urdf(*names, "good.stl"))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = read_shapes(str(model))
    assert [str(each.message).removeprefix(f"{model}: ") for each in caught] == [
        "1 mesh file not shown, no STL file: bad.stl",
        "2 mesh files not shown, no such file beside the URDF or in ROS_PACKAGE_PATH, "
        "AMENT_PREFIX_PATH: a.stl, folder.stl",
        "1 mesh file not shown, .dae is not read, only .stl: scene.dae",
        "1 mesh file not shown, larger than 0 MiB: large.stl",
    ]
    assert [each["mesh"] for each in json.loads(found.text)] == [0, 0]
    assert found.meshes == (CORNERS.astype("<f4").tobytes(),)


def test_shapes_and_triangles_are_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in "abc":
        (tmp_path / f"{name}.stl").write_bytes(binary())
    model = tmp_path / "robot.urdf"
    model.write_text(urdf("a.stl", "b.stl", "c.stl", "a.stl", "a.stl"))
    monkeypatch.setattr(module, "MOST_TRIANGLES", 4)
    monkeypatch.setattr(module, "MOST_SHAPES", 4)
    with pytest.warns(tfdb.TfdbWarning) as caught:
        found = read_shapes(str(model))
    assert len(json.loads(found.text)) == 3
    assert [str(each.message).partition(": ")[2] for each in caught] == [
        "1 mesh file not shown, all meshes together have more than 4 triangles: c.stl",
        "1 shape not shown, beyond the first 4",
    ]


def test_shapes_are_served_by_number_and_nothing_else_is() -> None:
    buf = tfdb.Buffer()
    buf.set_transform("map", "base", 1, (0, 0, 0), (0, 0, 0, 1))
    shapes = Shapes(b"[]", (b"one", b"two"))
    model = Model(buf, "shm:x", live=Live(buf))
    with serving(model, shapes=shapes) as served, served.connect() as viewer:
        assert viewer.receive()["shapes"] == shapes.mark
        status, headers, body = served.get("/shapes.json")
        assert (status, headers["Content-Type"], body) == (200, "application/json", b"[]")
        assert served.get("/mesh/1")[2] == b"two"
        for path in ("/mesh/2", "/mesh/-1", "/mesh/01", "/mesh/1/", "/mesh/../app.js", "/mesh"):
            assert served.get(path)[0] == 404
    with serving(model) as served, served.connect() as viewer:
        assert viewer.receive()["shapes"] == ""
        assert served.get("/shapes.json")[0] == 404
    assert Shapes(b"[]", (b"one", b"owt")).mark != shapes.mark
