"""Compares tfdb's URDF reader with yourdfpy on real robots: every link's pose, random joint states.

Needs tfdb and yourdfpy, which weighs 375 MB with what it needs and is therefore no dependency:

    python3 -m venv /tmp/oracle && /tmp/oracle/bin/pip install yourdfpy . && \
        /tmp/oracle/bin/python tests/robots/compare_with_yourdfpy.py FOLDER/*.urdf
"""

from __future__ import annotations

import argparse
import logging
import math
import sys
import time
from typing import TYPE_CHECKING

import numpy as np
import yourdfpy

from tfdb.data.poses import rotation_matrices
from tfdb.robots.urdf import load_urdf

if TYPE_CHECKING:
    from tfdb.robots.robot_model import RobotModel

STATES = 50
TOLERANCE = 1e-12


def random_states(model: RobotModel, seed: int) -> dict[str, np.ndarray]:
    """Positions within the limits; planar and floating joints rest: yourdfpy cannot move them."""
    rng = np.random.default_rng(seed)
    states: dict[str, np.ndarray] = {}
    for name in model.movable:
        joint = model.joints[name]
        if joint.width == 7:
            states[name] = np.tile([0.0, 0, 0, 0, 0, 0, 1], (STATES, 1))
        elif joint.width == 3:
            states[name] = np.zeros((STATES, 3))
        else:
            limits = joint.limits
            low, high = (limits.lower, limits.upper) if limits else (-math.pi, math.pi)
            states[name] = rng.uniform(max(low, -math.pi), min(high, math.pi), STATES)
    return states


def our_links(model: RobotModel, states: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """T[root<-link] of every link, shape (STATES, 4, 4)."""
    joints = {}
    for name, poses in model.forward_kinematics(states).items():
        matrices = np.zeros((STATES, 4, 4))
        matrices[:, :3, :3] = rotation_matrices(poses[:, 3:])
        matrices[:, :3, 3] = poses[:, :3]
        matrices[:, 3, 3] = 1
        joints[model.joints[name].child] = (model.joints[name].parent, matrices)
    links = {model.root: np.tile(np.eye(4), (STATES, 1, 1))}
    while len(links) < len(model.links):
        for child, (parent, matrices) in joints.items():
            if parent in links and child not in links:
                links[child] = links[parent] @ matrices
    return links


def compare(path: str, seed: int) -> float:
    """Greatest difference of any element of any link's matrix."""
    started = time.perf_counter()
    model = load_urdf(path)
    ours_took = time.perf_counter() - started
    states = random_states(model, seed)
    ours = our_links(model, states)
    started = time.perf_counter()
    theirs = yourdfpy.URDF.load(path, load_meshes=False, build_scene_graph=True)
    theirs_took = time.perf_counter() - started
    worst = 0.0
    for index in range(STATES):
        theirs.update_cfg({name: states[name][index] for name in theirs.actuated_joint_names})
        for link in model.links:
            difference = np.abs(theirs.get_transform(link, model.root) - ours[link][index]).max()
            worst = max(worst, float(difference))
    print(
        f"{path.rsplit('/', 1)[-1]:28} {len(model.links):4} links  {STATES} states  "
        f"worst {worst:.1e}  read in {ours_took * 1e3:6.1f} ms, "
        f"by yourdfpy in {theirs_took * 1e3:7.1f} ms"
    )
    return worst


def main() -> int:
    """Exit code 0 when all agree to 1e-12."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="+")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    logging.disable(logging.WARNING)
    print(f"seed {options.seed}, yourdfpy {yourdfpy.__version__}")
    worst = max(compare(path, options.seed) for path in options.files)
    return 0 if worst <= TOLERANCE else 1


if __name__ == "__main__":
    sys.exit(main())
