"""PyPI transform-tree in its own shared memory: one process writes, others read."""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

import scenario
import tf_tree
import with_transform_tree

if TYPE_CHECKING:
    from collections.abc import Callable

# Where its processes meet: the same folder for all that one run of measurements starts.
FOLDER = Path(tempfile.gettempdir(), f"tfdb-measure-tf_tree-{os.getppid()}")
os.environ["TF_TREE_RUNTIME_DIR"] = str(FOLDER)


class Contender(with_transform_tree.Contender):
    """Holds one chain in an arena of that name, or reads it."""

    def make(self, name: str, chain: int, samples: int) -> None:
        """Fill a new arena; it lives as long as this process."""
        FOLDER.mkdir(mode=0o700)
        atexit.register(shutil.rmtree, FOLDER)  # the library leaves its locks there
        self.name = name
        self.setup(chain, samples)
        poses = self._rows([scenario.moving_pose(edge, 0.5) for edge in range(chain)])
        self.edges = list(zip(self.publishers, poses.tolist(), strict=True))
        self.operations["set_transform, each edge in turn"] = self.push_in_turn

    def empty_tree(self, edges: list[tuple[str, str]], samples: int) -> tf_tree.Tree:
        return tf_tree.open(
            name=self.name, mode="rw", create=edges, capacity=samples + 1, interp="lerpslerp"
        )

    def join(self, name: str, chain: int, samples: int) -> None:
        """Attach to what another process has filled, to read."""
        self.name = name
        self.tree = tf_tree.open(name=name)
        self.names = scenario.names(chain)
        self.plan = self.tree.plan(self.names[0], self.names[-1])
        self.mid = scenario.mid_stamps(samples)
        self.operations: dict[str, Callable[[int], int | None]] = {
            "lookup mid": self.plan_at,
            "lookup mid by name": self.lookup,
        }

    def attach(self, rounds: int) -> list[float]:
        """Milliseconds from opening the arena to the first answer."""
        found = []
        for _ in range(rounds):
            begin = time.perf_counter_ns()
            tree = tf_tree.open(name=self.name)
            tree.plan(self.names[0], self.names[-1]).latest()
            found.append(1e-6 * (time.perf_counter_ns() - begin))
            del tree
        return found

    def push_in_turn(self, count: int) -> int:
        turns = max(1, count // len(self.edges))
        for _ in range(turns):
            self.write_each()
        return turns * len(self.edges)

    def write_each(self) -> None:
        """One sample of each edge."""
        for publisher, pose in self.edges:
            publisher.push(self.next, pose)
        self.next += scenario.PERIOD

    def look_up(self) -> None:
        self.plan.latest()
