"""The page in a real browser: what it shows, asks for and does."""

from __future__ import annotations

import io
import os
import threading
import time
from typing import TYPE_CHECKING

import numpy as np
import pytest

import tfdb
from tests.view.chromium import READY, Browser, Page, chromium, find_chromium
from tests.view.served import Served, serving
from tfdb.cli.graph import Live
from tfdb.view.model import Model
from tfdb.view.shapes import read_shapes

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

S = 1_000_000_000
TURN = (0.0, 0.6, 0.0, 0.8)
FILES = [
    "",
    "app.js",
    "favicon.svg",
    "live",
    "scene.js",
    "shapes.js",
    "style.css",
    "three.js",
    "tree.js",
]


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """One browser for all tests here."""
    program = find_chromium()
    if program is None:
        reason = "chromium is missing: apt-get install chromium"
        if os.environ.get("CI") == "true":
            pytest.fail(reason)
        pytest.skip(reason)
    with chromium(program) as made:
        yield made


def robot(began: int = 100 * S) -> tfdb.Buffer:
    """A base that moves on a map for 2 s, a camera on it, and an arm."""
    buf = tfdb.Buffer(history=1000)
    buf.set_static_transform("base", "camera", (0.2, 0.0, 1.1), TURN, authority="urdf")
    for step in range(21):
        move(buf, began + step * S // 10, step / 10)
    return buf


def move(buf: tfdb.Buffer, stamp: int, x: float) -> None:
    buf.set_transforms(
        [
            tfdb.TransformStamped("map", "base", stamp, (x, 0, 0), TURN),
            tfdb.TransformStamped("base", "arm", stamp, (0, 0.5, 0.2), TURN),
        ],
        authority="ekf",
    )


@pytest.fixture
def buf() -> tfdb.Buffer:
    return robot()


@pytest.fixture
def served(buf: tfdb.Buffer) -> Iterator[Served]:
    with serving(Model(buf, "shm:robot", live=Live(buf))) as made:
        yield made


@pytest.fixture
def page(browser: Browser, served: Served) -> Iterator[Page]:
    with browser.page() as made:
        made.open(served.address)
        made.until(READY)
        yield made
        assert made.errors == []


def rows(page: Page) -> list[str]:
    """Return the names of the rows in sight."""
    found = page.run(
        "[...document.querySelectorAll('.row')].sort((a, b) => a.offsetTop - b.offsetTop)"
        ".map((each) => each.querySelector('.name').textContent)"
    )
    return list(found)


def place(page: Page, name: str) -> list[float]:
    """Return where a frame is drawn, in the fixed frame."""
    found = page.run(
        f"[...tfdb.world.places.slice(3 * tfdb.state.rowOf.get({name!r}),"
        f" 3 * tfdb.state.rowOf.get({name!r}) + 3)]"
    )
    return [round(value, 6) for value in found]


def test_the_page_lists_the_tree_and_places_frames(page: Page, buf: tfdb.Buffer) -> None:
    assert rows(page) == ["map", "base", "arm", "camera"]
    assert page.run("document.title") == "shm:robot · tfdb"
    camera = buf.lookup_latest_transform("map", "camera").translation
    assert place(page, "camera") == pytest.approx(camera.tolist(), abs=1e-5)


def test_the_page_asks_for_the_fixed_table_alone(page: Page, served: Served) -> None:
    asked = {each.replace("ws:", "http:") for each in page.requests}
    assert asked == {served.base + name for name in FILES}


def test_a_commit_moves_the_frame(page: Page, buf: tfdb.Buffer) -> None:
    move(buf, 103 * S, 7.5)
    page.until("tfdb.world.places[3 * tfdb.state.rowOf.get('base')] === 7.5")


def test_pixels_follow_a_motion(page: Page, buf: tfdb.Buffer) -> None:
    image = pytest.importorskip("PIL.Image")

    def shown() -> np.ndarray:
        picture = image.open(io.BytesIO(page.screenshot())).convert("RGB")
        return np.asarray(picture, dtype=int)

    page.run("tfdb.scene.showsNames = false, tfdb.scene.trail = [], tfdb.scene.redraw()")
    page.run("tfdb.focus(tfdb.state.rowOf.get('map'))")
    page.until("tfdb.state.answered > 0 || tfdb.state.fixed === 'map'")

    def reddest() -> float:
        """The middle column of strongly coloured pixels of the scene."""
        x, y, width, height = page.run(
            "(({x, y, width, height}) => [x, y, width, height])"
            "(document.getElementById('scene').getBoundingClientRect())"
        )
        scene = shown()[round(y) + 50 : round(y + height) - 30, round(x) : round(x + width)]
        colored = scene.max(axis=2) - scene.min(axis=2) > 90
        return float(np.flatnonzero(colored.any(axis=0)).max())

    page.run("tfdb.scene.camera.position.set(0, -20, 0.1)")
    page.run("tfdb.scene.controls.target.set(0, 0, 0), tfdb.scene.controls.update()")
    columns = []
    for stamp, x in ((103 * S, 1.0), (104 * S, 3.0), (105 * S, 5.0)):
        move(buf, stamp, x)
        page.until(f"tfdb.world.places[3 * tfdb.state.rowOf.get('base')] === {x}")
        page.until("!tfdb.scene.isDirty")
        columns.append(reddest())
    # Seen from -y at a distance of 20 m, x goes to the right.
    first, second, third = columns
    assert second - first > 20
    assert third - second == pytest.approx(second - first, rel=0.2)


def test_the_slider_shows_a_stamp_and_live_returns(page: Page, buf: tfdb.Buffer) -> None:
    page.run(
        "(() => { const slider = document.getElementById('slider'); slider.value = 2500;"
        "slider.dispatchEvent(new Event('input')); slider.dispatchEvent(new Event('change')); })()"
    )
    page.until("tfdb.state.shownAt === 100500000000n")
    assert place(page, "base")[0] == 0.5
    assert "interpolated" in page.run("document.getElementById('mode').textContent")
    move(buf, 103 * S, 9.0)
    page.key("l")
    page.until("tfdb.world.places[3 * tfdb.state.rowOf.get('base')] === 9")
    assert "newest" in page.run("document.getElementById('mode').textContent")


def test_play_goes_on_to_the_end_and_is_live_again(page: Page) -> None:
    page.run("tfdb.goTo(101500000000n)")
    page.until("tfdb.state.shownAt === 101500000000n")
    page.press("#play")
    page.until("tfdb.state.at === null")
    page.until("tfdb.world.places[3 * tfdb.state.rowOf.get('base')] === 2")


def test_a_search_lists_matches_and_enter_chooses(page: Page) -> None:
    page.key("/")
    page.type("cam")
    page.until("document.querySelectorAll('.row').length === 1")
    assert rows(page) == ["camera"]
    page.key("Enter")
    page.until("tfdb.state.chosen === 'camera' && tfdb.state.answer")
    shown = page.run("document.getElementById('details').textContent")
    assert "xyz (m)" in shown
    assert "buf.lookup_latest_transform('map', 'camera')" in shown
    spoken = page.until("document.getElementById('spoken').textContent")
    assert spoken.startswith(
        "camera, static, child of base, by urdf: x 3.11, y 0.00, z 0.12 metres in map"
    )


def test_keys_move_and_fold_in_the_tree(page: Page) -> None:
    page.press("#tree")
    page.run("document.getElementById('tree').focus()")
    page.key("Home")
    page.key("ArrowDown")
    page.until("tfdb.state.chosen === 'base'")
    page.key("ArrowLeft")
    page.until("document.querySelectorAll('.row').length === 2")
    assert rows(page) == ["map", "base"]
    page.key("ArrowRight")
    page.key("ArrowRight")
    page.until("tfdb.state.chosen === 'arm'")


def test_another_fixed_frame_places_all_in_it(page: Page, buf: tfdb.Buffer) -> None:
    page.run("tfdb.focus(tfdb.state.rowOf.get('camera'))")
    page.key("x")
    page.until("tfdb.state.fixed === 'camera'")
    expected = buf.lookup_latest_transform("camera", "arm").translation.tolist()
    assert place(page, "arm") == pytest.approx(expected, abs=1e-5)
    assert place(page, "camera") == pytest.approx([0, 0, 0], abs=1e-9)


def test_a_click_in_the_scene_chooses_the_frame(page: Page) -> None:
    page.until("!tfdb.scene.isDirty")
    x, y = page.run(
        "(({x, y}) => [x + tfdb.scene.screen[2 * tfdb.state.rowOf.get('arm')],"
        " y + tfdb.scene.screen[2 * tfdb.state.rowOf.get('arm') + 1]])"
        "(document.getElementById('scene').getBoundingClientRect())"
    )
    page.click(x, y)
    page.until("tfdb.state.chosen === 'arm'")


def test_a_frame_moves_to_another_parent_while_it_is_looked_at(
    page: Page, buf: tfdb.Buffer
) -> None:
    page.run("tfdb.focus(tfdb.state.rowOf.get('arm'))")
    buf.set_transform("map", "arm", 103 * S, (5, 5, 5), TURN)
    page.until("tfdb.world.places[3 * tfdb.state.rowOf.get('arm')] === 5")
    assert page.run("tfdb.world.names[tfdb.world.parents[tfdb.state.rowOf.get('arm')]]") == "map"
    assert page.run("tfdb.state.chosen") == "arm"
    page.until("document.getElementById('events').textContent.includes('parent base -> map')")
    # Before, it had the other parent.
    page.run("tfdb.goTo(101000000000n)")
    page.until("tfdb.world.names[tfdb.world.parents[tfdb.state.rowOf.get('arm')]] === 'base'")


def test_a_long_age_is_whole(browser: Browser) -> None:
    buf = tfdb.Buffer(history=None)
    buf.clock.pause()
    buf.clock.seek(80_001 * S)
    for stamp in (15_000, 16_001):
        buf.set_transform("map", "a_frame_with_a_name_that_is_long", stamp * S, (1, 0, 0), TURN)
    buf.set_transform("map", "base", 80_000 * S, (1, 0, 0), TURN)
    with serving(Model(buf, "shm:x", live=Live(buf))) as served, browser.page() as page:
        page.open(served.address, 900, 600)
        page.until("document.querySelectorAll('.row').length === 3 && tfdb.state.facts")
        page.until("document.querySelector('#tree').innerText.includes('17 h 46 min')")
        assert page.run(
            "[...document.querySelectorAll('.row > :not(:first-child)')]"
            ".every((each) => each.scrollWidth <= each.clientWidth)"
        )


def test_late_edges_stand_out(browser: Browser) -> None:
    buf = tfdb.Buffer(history=60)
    now = time.time_ns()
    for step in range(100):
        stamp = now - 20 * S + step * S // 10
        buf.set_transform("map", "silent", stamp, (1, 0, step), TURN)
    with serving(Model(buf, "shm:x", live=Live(buf))) as served, browser.page() as page:
        page.open(served.address)
        page.until("tfdb.world.states[tfdb.state.rowOf.get('silent')] === 'silent'")
        page.until(
            "document.querySelector('#filters [data-state=silent]').textContent === '■ 1 silent'"
        )
        page.press("#filters [data-state=silent]")
        page.until("document.querySelectorAll('.row').length === 1")
        assert rows(page) == ["silent"]


def test_the_report_gives_a_silent_edge_the_age_of_the_tree(browser: Browser) -> None:
    buf = robot()
    for step in range(200):
        buf.set_transform("map", "base", 103 * S + step * S // 10, (step, 0, 0), TURN)
    buf.clock.pause()
    buf.clock.seek(123 * S)
    with serving(Model(buf, "shm:x", live=Live(buf))) as served, browser.page() as page:
        page.open(served.address)
        page.until(READY)
        page.run("tfdb.focus(tfdb.state.rowOf.get('arm'))")
        page.until("document.querySelector('.report')")
        report = page.run("document.querySelector('.report').innerText")
        assert "arm\nnewest sample, age 21 s" in report
        assert "base\nnewest sample, age 100 ms" in report
        assert page.run("document.querySelector('.report .silent').textContent").endswith("21 s")
        words = page.run("document.querySelector('.report + p').textContent")
        assert words == "age: from the stamp of the edge's newest sample to now"
        page.run("tfdb.goTo(100250000000n)")
        page.until("document.querySelector('.report').innerText.includes('interpolated')")
        report = page.run("document.querySelector('.report').innerText")
        assert "arm\ninterpolated, gap 100 ms, age 50 ms" in report
        words = page.run("document.querySelector('.report + p').textContent")
        assert words == "age: from the sample to the shown stamp"
        assert page.errors == []


def test_two_viewers_see_the_same_and_one_may_look_back(
    browser: Browser, served: Served, page: Page, buf: tfdb.Buffer
) -> None:
    with browser.page() as other:
        other.open(served.address)
        other.until(READY)
        other.run("tfdb.goTo(100000000000n)")
        other.until("tfdb.state.shownAt !== null")
        move(buf, 103 * S, 8.0)
        page.until("tfdb.world.places[3 * tfdb.state.rowOf.get('base')] === 8")
        assert place(other, "base")[0] == 0
        assert other.errors == []


def test_the_page_reconnects_after_a_restart(browser: Browser) -> None:
    buf = robot()
    with browser.page() as page:
        with serving(Model(buf, "shm:robot", live=Live(buf))) as served:
            port = int(served.base.rsplit(":", 1)[1].rstrip("/"))
            page.open(served.address)
            page.until(READY)
            page.run("tfdb.focus(tfdb.state.rowOf.get('arm'))")
        page.until("!document.getElementById('banner').hidden")
        move(buf, 103 * S, 6.0)
        with serving(Model(buf, "shm:robot", live=Live(buf)), port=port):
            page.until("document.getElementById('banner').hidden")
            page.until("tfdb.world.places[3 * tfdb.state.rowOf.get('base')] === 6")
            assert page.run("tfdb.state.chosen") == "arm"


def test_a_recording_is_played_from_the_start(browser: Browser) -> None:
    with serving(Model(robot(), "drive.mcap")) as served, browser.page() as page:
        page.open(served.address)
        page.until(READY)
        assert place(page, "base")[0] == 2
        page.press("#play")
        page.until("tfdb.state.shownAt !== null && tfdb.state.shownAt < 101500000000n")
        page.until("!tfdb.state.plays")
        page.until("tfdb.world.places[3 * tfdb.state.rowOf.get('base')] === 2")
        assert page.errors == []


ROBOT = """<robot name="r">
<link name="base"><visual>
  <origin xyz="0 0 1" rpy="0 0 1.5707963267948966"/><geometry><box size="1 2 3"/></geometry>
  <material name="red"><color rgba="1 0 0 1"/></material></visual></link>
<link name="arm">
  <visual><geometry><mesh filename="arm.stl" scale="2 2 2"/></geometry></visual>
  <visual><geometry><cylinder radius="0.1" length="1"/></geometry></visual>
  <visual><geometry><sphere radius="0.3"/></geometry></visual></link>
<link name="elsewhere"><visual><geometry><sphere radius="0.3"/></geometry></visual></link>
<joint name="a" type="fixed"><parent link="base"/><child link="arm"/></joint>
<joint name="b" type="fixed"><parent link="base"/><child link="elsewhere"/></joint>
</robot>"""


def test_the_shapes_of_a_robot_are_drawn_where_its_links_are(
    browser: Browser, buf: tfdb.Buffer, tmp_path: Path
) -> None:
    (tmp_path / "robot.urdf").write_text(ROBOT)
    (tmp_path / "arm.stl").write_text("solid\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n")
    shapes = read_shapes(str(tmp_path / "robot.urdf"))
    model = Model(buf, "shm:robot", live=Live(buf))
    with serving(model, shapes=shapes) as served, browser.page() as page:
        page.open(served.address)
        page.until(READY)
        page.until("tfdb.scene.shapes.drawn === 4")  # no frame is elsewhere
        page.until("document.getElementById('scale').textContent.endsWith(' · 4 of 5 shapes')")
        asked = {each.replace("ws:", "http:") for each in page.requests}
        assert asked == {served.base + name for name in (*FILES, "shapes.json", "mesh/0")}
        matrices = page.run("tfdb.scene.shapes.all.map(({mesh}) => [...mesh.matrix.elements])")
        base = buf.lookup_latest_transform("map", "base").matrix
        local = np.array([[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 1], [0, 0, 0, 1]])
        assert np.allclose(np.reshape(matrices[0], (4, 4)).T, base @ local, atol=1e-6)
        arm = buf.lookup_latest_transform("map", "arm").matrix
        scaled = arm @ np.diag([2, 2, 2, 1])
        assert np.allclose(np.reshape(matrices[1], (4, 4)).T, scaled, atol=1e-6)
        corners = page.run("[...tfdb.scene.shapes.all[1].mesh.geometry.attributes.position.array]")
        assert corners == [0, 0, 0, 1, 0, 0, 0, 1, 0]
        # A cylinder is long along z.
        ends = page.run(
            "(({geometry}) => { geometry.computeBoundingBox();"
            " const {min, max} = geometry.boundingBox;"
            " return [max.x - min.x, max.y - min.y, max.z - min.z]; })"
            "(tfdb.scene.shapes.all[2].mesh)"
        )
        assert ends == pytest.approx([0.2, 0.2, 1.0], abs=1e-3)
        red = red_pixels(page)
        page.key("s")
        page.until("tfdb.scene.shapes.drawn === 0 && !tfdb.scene.isDirty")
        assert page.run("document.getElementById('shapes').getAttribute('aria-pressed')") == "false"
        assert red > 2 * red_pixels(page) + 1000  # those of axes stay
        page.press("#shapes")
        page.until("tfdb.scene.shapes.drawn === 4")
        move(buf, 103 * S, 30.0)
        page.until("tfdb.scene.shapes.all[0].mesh.matrix.elements[12] > 29")
        assert page.errors == []


def red_pixels(page: Page) -> int:
    """Count strongly red pixels."""
    image = pytest.importorskip("PIL.Image")
    page.until("!tfdb.scene.isDirty")
    picture = np.asarray(image.open(io.BytesIO(page.screenshot())).convert("RGB"), dtype=int)
    return int((picture[..., 0] - picture[..., 1:].max(axis=2) > 90).sum())


def test_the_button_for_shapes_is_hidden_without_a_robot(page: Page) -> None:
    assert page.run("document.getElementById('shapes').hidden")
    page.key("?")
    assert "shapes of the robot" in page.run("document.getElementById('keys').textContent")


def test_maps_far_from_the_origin_are_drawn_exactly(browser: Browser) -> None:
    buf = tfdb.Buffer()
    buf.set_transform("utm", "base", S, (431_000.125, 5_400_000.5, 10.0), TURN)
    buf.set_transform("base", "arm", S, (0.0, 0.01, 0.0), (0, 0, 0, 1))
    with serving(Model(buf, "shm:far", live=Live(buf))) as served, browser.page() as page:
        page.open(served.address)
        page.until(READY)
        arm, base = place(page, "arm"), place(page, "base")
        assert arm[1] - base[1] == pytest.approx(0.01, abs=1e-5)
        assert page.run("tfdb.scene.origin") == [215500, 2700000, 5]


def test_two_thousand_frames_are_drawn_by_the_rows_in_sight(browser: Browser) -> None:
    buf = tfdb.Buffer(history=5)
    names = [f"robot_{each // 10}/link_{each % 10}" for each in range(2000)]
    parents = ["map" if each % 10 == 0 else names[each - 1] for each in range(2000)]
    poses = np.tile([0.1, 0.0, 0.2, *TURN], (2000, 1))
    stop = threading.Event()

    def feed() -> None:
        while not stop.wait(0.2):
            stamps = np.full(2000, time.time_ns())
            buf.set_transforms(tfdb.Columns(parents, names, stamps, poses))

    thread = threading.Thread(target=feed)
    thread.start()
    try:
        while not buf.commit:
            time.sleep(0.01)
        with serving(Model(buf, "shm:many", live=Live(buf))) as served, browser.page() as page:
            page.open(served.address)
            page.until("tfdb.scene.drawn > 2 && tfdb.state.drawn === 2001")
            assert page.run("document.querySelectorAll('.row').length") < 60
            page.run("tfdb.focus(tfdb.state.rowOf.get('robot_150/link_9'))")
            page.until("tfdb.state.answer && tfdb.state.answer.ok")
            assert "robot_150/link_9" in rows(page)
            # The indent leaves each name its room.
            narrow = page.run(
                "Math.min(...[...document.querySelectorAll('.row .name')]"
                ".map((each) => each.clientWidth))"
            )
            assert narrow > 90
            assert page.errors == []
    finally:
        stop.set()
        thread.join()


def test_a_token_opens_the_page_and_leaves_its_address(browser: Browser) -> None:
    buf = robot()
    with serving(Model(buf, "x", live=Live(buf)), host="0.0.0.0") as served, browser.page() as page:
        port, _, token = served.address.rsplit(":", 1)[1].partition("/")
        page.open(f"http://127.0.0.1:{port}/{token}")
        page.until(READY)
        assert page.run("location.href") == f"http://127.0.0.1:{port}/"
        assert page.run("document.cookie") == ""  # scripts cannot read it
        page.call("Page.reload")
        page.until(READY)
