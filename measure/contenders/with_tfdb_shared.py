"""A store that processes share: what lookups, waits, followers and deaths cost there."""

from __future__ import annotations

import asyncio
import itertools
import json
import os
import random
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import scenario
import with_tfdb

import tfdb
from tfdb.player.player import Player
from tfdb.player.tape import tape_of
from tfdb.recordings.open_recordings import OpenRecordings
from tfdb.recordings.selection import Selection

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

POSE = ((1.0, 2.0, 3.0), (0.0, 0.0, 0.6, 0.8))
BETWEEN = 0.003  # seconds between commits: whoever waits is asleep again by then


def per_commit(
    buffer: tfdb.Buffer, stamps: Iterator[int], count: int, clock: Callable[[], int]
) -> float:
    """Nanoseconds of that clock for a commit of one transform: the median of five runs."""
    found = []
    for _ in range(5):
        begin = clock()
        for stamp in itertools.islice(stamps, count):
            buffer.set_transform("clock", "busy", stamp, *POSE)
        found.append((clock() - begin) / count)
    return statistics.median(found)


@contextmanager
def child(work: Callable[[], None]) -> Iterator[int]:
    """Do `work` in a forked process for as long as the block lasts."""
    pid = os.fork()
    if pid == 0:
        work()
        os._exit(0)
    try:
        yield pid
    finally:
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)


def read_all(address: str) -> None:
    """Read what the page's server sends, until somebody ends it."""
    from websockets.sync.client import connect  # noqa: PLC0415 - for this row alone

    with connect(address.replace("http:", "ws:") + "live", max_size=None) as viewer:
        for _ in viewer:
            pass


def counts_of(address: str) -> dict[str, int]:
    """Return the counts of the page's server."""
    with urllib.request.urlopen(f"{address}metrics") as answer:
        lines = answer.read().decode().splitlines()
    pairs = (line.split() for line in lines if line.startswith("tfdb_view_"))
    return {name.removeprefix("tfdb_view_"): int(value) for name, value in pairs}


def cpu_of(pid: int) -> float:
    """Seconds of CPU that a process has taken."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@contextmanager
def recorded(messages: int, period: int, frames: int) -> Iterator[OpenRecordings]:
    """Open a recording with so many messages, each with a transform of so many frames."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "recording.mcap"
        with tfdb.recordings.RecordingWriter(path) as writer:
            for i in range(messages):
                stamp = 10**12 + i * period
                rows = [tfdb.TransformStamped("map", f"f{j}", stamp, *POSE) for j in range(frames)]
                data = tfdb.encode_tf_message(rows, writer.encoding)
                writer.write(data, stamp, topic="/tf")
        with OpenRecordings(path, Selection()) as recordings:
            yield recordings


def write_commits(path: Path, folder: Path, seconds: int) -> None:
    """Write what a recorder writes of 100 commits a second, of ten transforms each."""
    from tfdb.recorder.mcap_file import McapFile  # noqa: PLC0415 - for these rows alone

    buffer = tfdb.Buffer()
    file = McapFile(path, folder, sync=False)
    with buffer.snapshot() as state:
        first = state.state_bytes()
    file.write(10**12, (0, None, None, first), is_state=True)
    for i in range(100 * seconds):
        stamp = 10**12 + i * 10**7
        rows = [tfdb.TransformStamped("map", f"f{j}", stamp, *POSE) for j in range(10)]
        file.write(stamp, (i + 1, tfdb.encode_tf_message(rows), None, None))
        if i % 50 == 49:
            file.flush()
    file.close()


def jumps_in(recordings: OpenRecordings, end: float, count: int) -> list[float]:
    """Milliseconds for jumps to random times between 15 s and the end."""
    found: list[float] = []
    choice = random.Random(1)

    class Timed(Player):
        def _jump_to(self, at: int) -> None:
            began = time.perf_counter()
            super()._jump_to(at)
            found.append(1e3 * (time.perf_counter() - began))

    with tfdb.Buffer() as buffer:
        player = Timed(buffer, tape_of(recordings)[0], paused=True)
        player.seek(end)
        for _ in range(count):
            player.seek(choice.uniform(15.0, end))
        player.stop()
        player.run()
    return found[1:]  # the first one reads all


class Contender(with_tfdb.Contender):
    """Holds one chain in a store of that name."""

    name: str

    def make(self, name: str, chain: int, samples: int, max_frames: int = 100) -> None:
        """Fill a new store."""
        self.name = name
        self.max_frames = max_frames
        self.setup(chain, samples)
        poses = [scenario.moving_pose(edge, 0.5) for edge in range(chain)]
        self.edges = [
            (parent, child, pose[:3], pose[3:])
            for (parent, child), pose in zip(itertools.pairwise(self.names), poses, strict=True)
        ]
        self.operations["set_transform, each edge in turn"] = self.set_in_turn

    def empty_buffer(self) -> tfdb.Buffer:
        return tfdb.Buffer.open(
            self.name, create=True, history=10.0, max_frames=self.max_frames, size=1 << 28
        )

    def join(self, name: str, chain: int, samples: int) -> None:
        """Open what another process has filled, to read."""
        self.name = name
        self.buffer = tfdb.Buffer.open(name, create=False, mode="r")
        self.names = scenario.names(chain)
        self.mid = scenario.mid_stamps(samples)
        self.operations = {"lookup mid": self.lookup_mid}

    def remove(self) -> None:
        tfdb.Buffer.unlink(self.name)

    def attach(self, rounds: int) -> list[float]:
        """Milliseconds from opening the store to the first answer."""
        found = []
        for _ in range(rounds):
            begin = time.perf_counter_ns()
            buffer = tfdb.Buffer.open(self.name, create=False, mode="r")
            buffer.lookup_transform(self.names[0], self.names[-1])
            found.append(1e-6 * (time.perf_counter_ns() - begin))
            buffer.close()
        return found

    def readers(self, count: int, seconds: float) -> float:
        """Lookups per second, of so many processes together."""
        reading, writing = os.pipe()

        def read() -> None:
            buffer = tfdb.Buffer.open(self.name, create=False, mode="r")
            lookup, target, source = buffer.lookup_transform, self.names[0], self.names[-1]
            done, end = 0, time.perf_counter() + seconds
            while time.perf_counter() < end:
                for stamp in self.mid[:256]:
                    lookup(target, source, stamp)
                done += 256
            os.write(writing, done.to_bytes(8, "little"))
            os._exit(0)

        pids = []
        for _ in range(count):
            pid = os.fork()
            if pid == 0:
                read()
            pids.append(pid)
        total = sum(int.from_bytes(os.read(reading, 8), "little") for _ in range(count))
        for pid in pids:
            os.waitpid(pid, 0)
        os.close(reading)
        os.close(writing)
        return total / seconds

    def tick(self, count: int) -> None:
        """Commit now and then; the stamp says when."""
        for _ in range(count):
            time.sleep(BETWEEN)
            self.buffer.set_transform("clock", "tick", time.perf_counter_ns(), *POSE)

    def delay(self) -> float:
        """Milliseconds since the newest tick."""
        tick = self.buffer.lookup_latest_transform("clock", "tick").stamp
        return 1e-6 * (time.perf_counter_ns() - tick)

    def wakes(self, count: int) -> list[float]:
        """Milliseconds from another process's commit to a thread that waits for it."""
        found = []
        with child(lambda: self.tick(2 * count)):
            seen = self.buffer.commit
            for _ in range(count):
                seen = self.buffer.wait_for_commit(seen)
                found.append(self.delay())
        return found

    def wakes_of_coroutine(self, count: int) -> list[float]:
        """The same to a coroutine."""

        async def wait() -> list[float]:
            found = []
            seen = self.buffer.commit
            for _ in range(count):
                seen = await self.buffer.wait_for_commit_async(seen)
                found.append(self.delay())
            return found

        with child(lambda: self.tick(2 * count)):
            return asyncio.run(wait())

    def follow(self) -> None:
        """Read every change, until somebody ends it."""
        buffer = tfdb.Buffer.open(self.name, create=False, mode="r")
        seen = buffer.commit
        while True:
            buffer.wait_for_commit(seen)
            try:
                for changes in buffer.changes(seen, limit=1000):
                    seen = changes.commit
            except tfdb.errors.FeedLapped:
                seen = buffer.commit

    def commits(self, count: int) -> float:
        """CPU nanoseconds of this process for each commit of one transform."""
        stamps = itertools.count(time.perf_counter_ns())
        return per_commit(self.buffer, stamps, count, time.process_time_ns)

    def commits_beside_followers(self, followers: int, count: int) -> float:
        """The same while so many processes follow the store."""
        if followers == 0:
            return self.commits(count)
        with child(self.follow):
            return self.commits_beside_followers(followers - 1, count)

    def write_steadily(self) -> None:
        """Commit ten transforms 10,000 times a second, until somebody ends it."""
        buffer = tfdb.Buffer.open(self.name, create=False)
        children = [f"followed{i}" for i in range(10)]
        rows = np.tile([1.0, 2.0, 3.0, 0.0, 0.0, 0.6, 0.8], (10, 1))
        begin, done = time.perf_counter(), 0
        while True:
            due = int(10_000 * (time.perf_counter() - begin))
            for _ in range(due - done):
                stamps = [time.perf_counter_ns()] * 10
                buffer.set_transforms(tfdb.Columns("clock", children, stamps, rows))
            done = due
            time.sleep(0.0005)

    def follow_share(self, how: str, seconds: float) -> float:
        """Percent of a core that a stream takes for 100,000 transforms/s of another process."""
        with child(self.write_steadily), self.buffer.follow("followed0") as first:
            next(first)
            with self.buffer.follow() as stream:
                found = 0
                begin, used = time.perf_counter(), time.process_time()
                rows = stream.batches() if how == "batches" else stream
                while (passed := time.perf_counter() - begin) < seconds:
                    item = next(rows)
                    found += len(item.stored) if how == "batches" else 1
                used = time.process_time() - used
                if found < 90_000 * passed or stream.missed or stream.gone:
                    raise RuntimeError(f"{found} transforms of {passed:.3f} s were read")
                return 100 * used / passed

    def record_share(self, seconds: float) -> tuple[float, int, int]:
        """Percent of a core that a recorder takes for 100,000 transforms/s of another process.

        Also the bytes of its file, and those of mcap's own writer for the same messages.
        """
        from mcap.reader import NonSeekingReader  # noqa: PLC0415 - for this row alone
        from mcap.writer import CompressionType, Writer  # noqa: PLC0415

        with tempfile.TemporaryDirectory() as folder, child(self.write_steadily):
            path, again = Path(folder) / "drive.mcap", Path(folder) / "again.mcap"
            begin, used = time.perf_counter(), time.process_time()
            with tfdb.Recorder(self.buffer, path) as recorder:
                recorder.wait(seconds)
            used, passed = time.process_time() - used, time.perf_counter() - begin
            if recorder.lost or recorder.commits < 9_000 * passed:
                raise RuntimeError(f"{recorder.commits} commits, {recorder.lost} lost")
            with path.open("rb") as file, again.open("wb") as other:
                writer = Writer(other, compression=CompressionType.ZSTD)
                writer.start("ros2", "mcap")
                ids: dict[int, int] = {}
                every = NonSeekingReader(file).iter_messages(log_time_order=False)
                for schema, channel, each in every:
                    if schema is not None and channel.id not in ids:
                        named = schema.name, schema.encoding, schema.data
                        topic = channel.topic, channel.message_encoding
                        ids[channel.id] = writer.register_channel(
                            *topic, writer.register_schema(*named), channel.metadata
                        )
                    number = ids[channel.id]
                    times = each.publish_time, each.sequence
                    writer.add_message(number, each.log_time, each.data, *times)
                writer.finish()
            return 100 * used / passed, path.stat().st_size, again.stat().st_size

    def move_many(self, name: str) -> None:
        """Commit 2,000 frames 30 times a second, until somebody ends it."""
        buffer = tfdb.Buffer.open(name, create=False)
        frames = [f"robot{i // 10}/link{i % 10}" for i in range(2000)]
        parents = ["clock" if i % 10 == 0 else frames[i - 1] for i in range(2000)]
        rows = np.tile([1.0, 2.0, 3.0, 0.0, 0.0, 0.6, 0.8], (2000, 1))
        while True:
            began = time.perf_counter()
            rows[:, 0] += 0.001
            stamps = np.full(2000, time.time_ns())
            buffer.set_transforms(tfdb.Columns(parents, frames, stamps, rows))
            time.sleep(max(began + 1 / 30 - time.perf_counter(), 0))

    def view_share(self, viewers: int, seconds: float) -> float:
        """Percent of a core that `tfdb view` takes for 30 ticks a second of 2,000 moving frames."""
        name = f"{self.name}_view"
        words = ["view", f"shm:{name}", "--port", "0", "--no-open", "--json"]
        with ExitStack() as stack:
            stack.enter_context(tfdb.Buffer.open(name))
            stack.callback(tfdb.Buffer.unlink, name)
            stack.enter_context(child(lambda: self.move_many(name)))
            command = [sys.executable, "-m", "tfdb.cli", *words]
            server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
            stack.callback(server.wait)
            stack.callback(server.kill)
            printed = iter(server.stdout or ())
            text = "".join(itertools.takewhile(lambda line: line != "}\n", printed)) + "}"
            address = json.loads(text)["address"]
            for _ in range(viewers):
                stack.enter_context(child(lambda: read_all(address)))
            while counts_of(address)["ticks_total"] < 30:
                time.sleep(0.1)
            ticks, used = counts_of(address)["ticks_total"], cpu_of(server.pid)
            time.sleep(seconds)
            used = cpu_of(server.pid) - used
            ticks = counts_of(address)["ticks_total"] - ticks
        return 100 * used / max(ticks, 1) * 30

    def commits_beside_rules(self, rules: int, count: int) -> float:
        """Nanoseconds of a commit of ten while so many rules are on other frames."""
        with tfdb.Buffer(history=1.0) as buffer:
            for rule in range(rules):
                buffer.set_transform("clock", f"ruled{rule}", 1, *POSE)
                buffer.add_rule(print, ("clock", f"ruled{rule}"))
            children = [f"busy{i}" for i in range(10)]
            rows = np.tile([1.0, 2.0, 3.0, 0.0, 0.0, 0.6, 0.8], (10, 1))
            buffer.rules.drain()
            begin = 0
            for stamp in range(2 * count):  # the first half lets the rules come to rest
                if stamp == count:
                    begin = time.perf_counter_ns()
                buffer.set_transforms(tfdb.Columns("clock", children, [1000 * stamp] * 10, rows))
            took = (time.perf_counter_ns() - begin) / count
            buffer.rules.drain()
        return took

    def fires(self, count: int) -> list[float]:
        """Milliseconds from a commit to the first instruction of a rule's action."""
        found: list[float] = []

        def act(event: tfdb.rules.Event) -> None:
            found.append(1e-6 * (time.perf_counter_ns() - event.transform.stamp))

        with tfdb.Buffer() as buffer:
            buffer.add_rule(act, ("clock", "tick"), fires="always")
            for _ in range(count):
                time.sleep(BETWEEN)
                buffer.set_transform("clock", "tick", time.perf_counter_ns(), *POSE)
            buffer.rules.drain()
        return found

    def fires_of_another_process(self, count: int) -> list[float]:
        """The same where another process commits."""
        found: list[float] = []
        enough = threading.Event()

        def act(event: tfdb.rules.Event) -> None:
            found.append(1e-6 * (time.perf_counter_ns() - event.transform.stamp))
            if len(found) == count:
                enough.set()

        rule = self.buffer.add_rule(act, ("clock", "tick"), fires="always")
        with child(lambda: self.tick(2 * count)):
            enough.wait()
        rule.remove()
        return found

    def late_releases(self, count: int) -> list[float]:
        """Milliseconds from the time of a played message to its commit, 1,000 messages/s."""
        found: list[float] = []

        class Timed(Player):
            def _play(self) -> None:
                due = self._due
                super()._play()
                found.append(1e-6 * (self._clock.now() - due))

        with recorded(count, 10**6, 10) as recordings, tfdb.Buffer() as buffer:
            Timed(buffer, tape_of(recordings)[0]).run()
        return found

    def jumps(self, count: int) -> list[float]:
        """Milliseconds for a jump in a recording of a minute with 1,000 transforms/s."""
        with recorded(6_000, 10**7, 10) as recordings:
            return jumps_in(recordings, 59.0, count)

    def jumps_in_commits(self, count: int) -> list[float]:
        """The same in ten minutes that a recorder wrote."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "drive.mcap"
            write_commits(path, Path(folder), 600)
            with OpenRecordings(path, Selection()) as recordings:
                return jumps_in(recordings, 599.0, count)

    def commits_beside_waits(self, waits: int, count: int) -> float:
        """CPU nanoseconds of this thread for a commit while coroutines wait for other frames."""
        buffer = tfdb.Buffer()
        begun = threading.Event()
        loop = asyncio.new_event_loop()

        async def wait() -> None:
            tasks = [
                asyncio.create_task(buffer.wait_for_transform_async("clock", f"never{i}"))
                for i in range(waits)
            ]
            await asyncio.sleep(0)
            begun.set()
            await asyncio.gather(*tasks, return_exceptions=True)

        thread = threading.Thread(target=lambda: loop.run_until_complete(wait()))
        thread.start()
        begun.wait()
        took = per_commit(buffer, itertools.count(), count, time.thread_time_ns)
        buffer.close()
        thread.join()
        loop.close()
        return took

    def deaths(self, count: int, frames: int) -> dict[str, list[float]]:
        """Milliseconds from a writer's death to the next commit, with so many frames."""
        for first in range(0, frames, 100):
            batch = [
                tfdb.TransformStamped("clock", f"frame{i}", 1, *POSE)
                for i in range(first, first + 100)
            ]
            self.buffer.set_transforms(batch)
        choice = random.Random(1)

        def write() -> None:
            stamp = time.perf_counter_ns()
            while True:
                stamp += 1
                self.buffer.set_transforms(
                    [tfdb.TransformStamped("clock", f"frame{i}", stamp, *POSE) for i in range(10)]
                )

        found: dict[str, list[float]] = {
            "a writer's death": [],
            "a writer's death amid a commit": [],
        }
        while len(found["a writer's death"]) < count:
            repairs = self.buffer.shared.repairs
            with child(write) as pid:
                time.sleep(0.002 + 0.003 * choice.random())
                os.kill(pid, signal.SIGKILL)
                begin = time.perf_counter_ns()
                self.buffer.set_transform("clock", "next", begin, *POSE)
                took = 1e-6 * (time.perf_counter_ns() - begin)
            found["a writer's death"].append(took)
            if self.buffer.shared.repairs > repairs:
                found["a writer's death amid a commit"].append(took)
        return found

    def set_in_turn(self, count: int) -> int:
        turns = max(1, count // len(self.edges))
        for _ in range(turns):
            self.write_each()
        return turns * len(self.edges)

    def write_each(self) -> None:
        """One sample of each edge, each a commit."""
        store, stamp = self.buffer.set_transform, self.next
        for parent, child, translation, rotation in self.edges:
            store(parent, child, stamp, translation, rotation)
        self.next += scenario.PERIOD

    def look_up(self) -> None:
        self.buffer.lookup_transform(self.names[0], self.names[-1])

    def wake(self) -> None:
        """Nothing: what it costs to be woken."""

    def read_all(self) -> None:
        """Read every sample of the chain."""
        for name in self.names[1:]:
            self.buffer.samples(name)

    def memory(self) -> dict[str, int]:
        """This process's proportional share of memory in bytes: the store's, and all."""
        found = {"store": 0, "process": 0}
        of_store = False
        for line in Path("/proc/self/smaps").read_text().splitlines():
            field, *values = line.split()
            if not field.endswith(":"):
                of_store = f"/tfdb.{self.name}" in line
            elif field == "Pss:":
                found["process"] += 1024 * int(values[0])
                found["store"] += 1024 * int(values[0]) * of_store
        return found
