"""Draw the pictures of docs/howto/view.md and the README: `python tools/draw_view_pictures.py`.

Chromium shows the page without a screen; Debian's package `chromium` has it.
"""

from __future__ import annotations

import io
import itertools
import math
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image

import tfdb
from tfdb.cli.graph import Live
from tfdb.view.model import Model
from tfdb.view.shapes import read_shapes

if TYPE_CHECKING:
    from tests.view.chromium import Browser, Page

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))
FOLDER = ROOT / "docs" / "howto" / "view"
MOVING = ROOT / "docs" / "pictures" / "view.webp"
STEPS = 48
"""Of the moving picture, ten a second."""
COLOURS = 200
FRAMES = 2000
SILENT = 40


def save(png: bytes, path: Path) -> None:
    """Save a screenshot with few colours."""
    Image.open(io.BytesIO(png)).convert("RGB").quantize(COLOURS).save(path, optimize=True)


def play(page: Page) -> None:
    """Save a moving picture: the recording is played while the camera turns."""
    page.resize(1200, 720)
    page.run("tfdb.scene.center(tfdb.state.rowOf.get('torso_lift_link'))")
    pictures = []
    for step in range(STEPS):
        page.run(f"tfdb.goTo(tfdb.state.start + {2_000_000_000 + step * 120_000_000}n)")
        page.until("!tfdb.state.waits && tfdb.state.shownAt === tfdb.state.at")
        page.run(
            "(({camera, controls}) => { const {x, y} = controls.target; const angle = "
            f"{0.9 * math.sin(2 * math.pi * step / STEPS) - 0.9:.4f};"
            "camera.position.set(x + 2.6 * Math.cos(angle), y + 2.6 * Math.sin(angle), 2.2);"
            "controls.update(); tfdb.scene.redraw(); })(tfdb.scene)"
        )
        page.until("!tfdb.scene.isDirty")
        shot = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
        pictures.append(shot.resize((900, 540), Image.Resampling.LANCZOS))
    first, *rest = pictures
    first.save(
        MOVING, save_all=True, append_images=rest, duration=100, loop=0, quality=40, method=6
    )


GREY, WHITE, BLUE = "0.35 0.38 0.42 1", "0.85 0.87 0.9 1", "0.2 0.45 0.8 1"
BODY = [
    ("base_link", 'box size="0.66 0.66 0.22"', "0 0 0.16", "0 0 0", GREY),
    ("base_link", 'box size="0.34 0.5 0.5"', "-0.16 0 0.5", "0 0 0", WHITE),
    ("torso_lift_link", 'box size="0.26 0.5 0.36"', "-0.05 0 -0.15", "0 0 0", WHITE),
    ("head_pan_link", 'cylinder radius="0.09" length="0.12"', "0 0 0.02", "0 0 0", GREY),
    (
        "head_tilt_link",
        'mesh filename="head.stl" scale=".12 .2 .12"',
        "0.04 0 0.1",
        "0 0 0",
        WHITE,
    ),
]
ARM = [
    ("shoulder_pan_link", 'cylinder radius="0.12" length="0.34"', "0 0 -0.02", "0 0 0", WHITE),
    ("upper_arm_link", 'cylinder radius="0.07" length="0.36"', "0.2 0 0", "0 1.5708 0", BLUE),
    ("elbow_flex_link", 'sphere radius="0.085"', "0 0 0", "0 0 0", GREY),
    ("forearm_link", 'cylinder radius="0.055" length="0.28"', "0.16 0 0", "0 1.5708 0", BLUE),
    ("wrist_flex_link", 'sphere radius="0.055"', "0 0 0", "0 0 0", GREY),
    ("gripper_palm_link", 'box size="0.1 0.11 0.06"', "0.09 0 0", "0 0 0", WHITE),
    ("gripper_l_finger_link", 'box size="0.09 0.02 0.03"', "0.05 0.01 0", "0 0 0", GREY),
    ("gripper_r_finger_link", 'box size="0.09 0.02 0.03"', "0.05 -0.01 0", "0 0 0", GREY),
]
"""Of the robot of pr2.bag, about: link, shape, place, turn, colour."""


def write_robot(folder: Path) -> Path:
    """Write a robot model; its mesh is an octahedron."""
    links: dict[str, str] = {}
    arms = [(f"{side}_{name}", *rest) for side in "lr" for name, *rest in ARM]
    for name, shape, xyz, rpy, rgba in [*BODY, *arms]:
        links[name] = links.get(name, "") + (
            f'<visual><origin xyz="{xyz}" rpy="{rpy}"/><geometry><{shape}/></geometry>'
            f'<material name="{rgba}"><color rgba="{rgba}"/></material></visual>'
        )
    first, *others = links
    text = "".join(f'<link name="{name}">{visuals}</link>' for name, visuals in links.items())
    for name in others:
        ends = f'<parent link="{first}"/><child link="{name}"/>'
        text += f'<joint name="{name}" type="fixed">{ends}</joint>'
    signs = itertools.product((-1, 1), repeat=3)
    corners = [((x, 0, 0), (0, y, 0), (0, 0, z)) for x, y, z in signs]
    lines = [f"vertex {' '.join(map(str, corner))}" for each in corners for corner in each]
    (folder / "head.stl").write_text("\n".join(["solid head", *lines]))
    path = folder / "robot.urdf"
    path.write_text(f'<robot name="robot">{text}</robot>')
    return path


def draw_shapes(browser: Browser, robot: Model) -> None:
    """Save a picture of a robot's shapes."""
    from tests.view.chromium import READY  # noqa: PLC0415 - of the checkout
    from tests.view.served import serving  # noqa: PLC0415

    with tempfile.TemporaryDirectory() as folder:
        shapes = read_shapes(str(write_robot(Path(folder))))
    with serving(robot, shapes=shapes) as served, browser.page() as page:
        page.open(served.address)
        page.until(READY)
        page.run("tfdb.goTo(tfdb.state.start + 6000000000n)")
        page.until("tfdb.state.shownAt !== null && tfdb.scene.shapes.drawn > 0")
        page.run("tfdb.focus(tfdb.state.rowOf.get('torso_lift_link'))")
        page.until("tfdb.state.answer && tfdb.scene.trail.length")
        page.key("n")
        page.run(
            "(({camera, controls}) => { const {x, y} = controls.target;"
            "camera.position.set(x + 2.4, y - 0.6, 1.5); controls.update(); })(tfdb.scene)"
        )
        page.until("!tfdb.scene.isDirty")
        time.sleep(1)
        save(page.screenshot(), FOLDER / "shapes.png")


def feed(buf: tfdb.Buffer, stop: threading.Event) -> None:
    """Move a fleet of arms; some stop after a while."""
    rng = np.random.default_rng(3)
    names = [f"robot_{each // 10:03}/link_{each % 10}" for each in range(FRAMES)]
    parents = ["map" if each % 10 == 0 else names[each - 1] for each in range(FRAMES)]
    places = rng.normal(size=(FRAMES, 3)) * 0.35
    places[:, 2] = np.abs(places[:, 2])
    robots = np.arange(FRAMES // 10)
    places[::10] = np.stack([robots % 20 * 2.5, robots // 20 * 2.5, 0 * robots], axis=1)
    turns = np.zeros((FRAMES, 4))
    began = time.monotonic()
    while not stop.wait(0.2):
        passed = time.monotonic() - began
        angles = 0.3 * np.sin(passed + np.arange(FRAMES))
        turns[:, 2], turns[:, 3] = np.sin(angles / 2), np.cos(angles / 2)
        moved = slice(0 if passed < 3 else SILENT, FRAMES)
        stamps = np.full(FRAMES, time.time_ns())
        poses = np.hstack([places, turns])
        columns = tfdb.Columns(parents[moved], names[moved], stamps[moved], poses[moved])
        buf.set_transforms(columns, authority="/fleet")


def main() -> None:
    """Draw all pictures."""
    from tests.view.chromium import READY, chromium, find_chromium  # noqa: PLC0415 - of the checkout
    from tests.view.served import serving  # noqa: PLC0415

    program = find_chromium()
    if program is None:
        sys.exit("chromium is missing: apt-get install chromium")
    dark = [{"name": "prefers-color-scheme", "value": "dark"}]
    buf = tfdb.load(ROOT / "examples" / "data" / "pr2.bag")
    robot = Model(buf, "pr2.bag", opening="buf = tfdb.load('pr2.bag')")
    with chromium(program) as browser:
        with serving(robot) as served, browser.page() as page:
            page.call("Emulation.setEmulatedMedia", features=dark)
            page.open(served.address)
            page.until(READY)
            page.run("tfdb.goTo(tfdb.state.start + 6000000000n)")
            page.until("tfdb.state.shownAt !== null")
            page.run("tfdb.focus(tfdb.state.rowOf.get('l_gripper_tool_frame'))")
            page.until("tfdb.state.answer && tfdb.scene.trail.length")
            time.sleep(1)
            save(page.screenshot(), FOLDER / "robot.png")
            play(page)
        draw_shapes(browser, robot)
        store, stop = tfdb.Buffer(history=20), threading.Event()
        thread = threading.Thread(target=feed, args=(store, stop))
        thread.start()
        try:
            while not store.commit:
                time.sleep(0.1)
            many = Model(store, "shm:fleet", live=Live(store))
            with serving(many) as served, browser.page() as page:
                page.open(served.address)
                page.until(
                    f"tfdb.world.states.filter((each) => each === 'silent').length === {SILENT}"
                )
                page.run("tfdb.focus(tfdb.state.rowOf.get('robot_002/link_9'))")
                page.until("tfdb.state.answer")
                time.sleep(1)
                save(page.screenshot(), FOLDER / "many.png")
        finally:
            stop.set()
            thread.join()


if __name__ == "__main__":
    main()
