"""Network namespaces joined by a relay that loses, delays, doubles and reorders their packets.

Each namespace has one tunnel device. The relay has the other ends, and is their only connection.
"""

from __future__ import annotations

import fcntl
import heapq
import os
import random
import select
import struct
import subprocess
import threading
import time
from contextlib import ExitStack
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from typing import Self

_SET_DEVICE = 0x400454CA
_TUNNEL_WITHOUT_HEADER = 0x1001
_LONGEST_PACKET = 1 << 16
_IDLE = 0.05
"""Seconds between two checks for the end."""


class BadNetwork:
    """Namespaces numbered from 0. Threads: one that chooses faults, and the relay's.

    Raises OSError or CalledProcessError if this process may not create namespaces.
    """

    def __init__(self, count: int, seed: int) -> None:
        self.loss = self.delay = self.reorder = self.double = 0.0
        """Loss, reordering and doubling: fractions of the packets. Delay: seconds, one way."""
        self.mute: set[int] = set()
        """Namespaces whose packets are all lost."""
        self.deaf: set[int] = set()
        """Namespaces to which all packets are lost."""
        self.packets = self.lost = 0
        self._draw = random.Random(seed)
        self._ends: list[int] = []
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        with ExitStack() as made:
            for number in range(count):
                self._add(number, made)
            self._made = made.pop_all()
        self._thread.start()

    def address(self, number: int) -> str:
        """Return the IPv4 address of a namespace."""
        return f"10.77.0.{number + 1}"

    def within(self, number: int) -> list[str]:
        """Return the start of a command line that runs in a namespace."""
        return ["ip", "netns", "exec", self._name(number)]

    def mend(self) -> None:
        """End all faults."""
        self.loss = self.delay = self.reorder = self.double = 0.0
        self.mute, self.deaf = set(), set()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._closing.set()
        self._thread.join()
        self._made.close()

    def _name(self, number: int) -> str:
        return f"tfdb{os.getpid()}.{number}"

    def _add(self, number: int, made: ExitStack) -> None:
        name = self._name(number)
        _ip("netns", "add", name)
        made.callback(_ip, "netns", "del", name)
        end = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
        made.callback(os.close, end)
        device = struct.pack("16sH22x", name.encode(), _TUNNEL_WITHOUT_HEADER)
        fcntl.ioctl(end, _SET_DEVICE, device)
        _ip("link", "set", name, "netns", name)
        _ip("-n", name, "addr", "add", f"{self.address(number)}/24", "dev", name)
        for each in (name, "lo"):
            _ip("-n", name, "link", "set", each, "up")
        self._ends.append(end)

    # -- the relay ---------------------------------------------------------------------------------

    def _run(self) -> None:
        under_way: list[tuple[float, int, int, bytes]] = []
        numbers = {end: number for number, end in enumerate(self._ends)}
        while not self._closing.is_set():
            left = under_way[0][0] - time.monotonic() if under_way else _IDLE
            ready, _, _ = select.select(self._ends, [], [], min(max(left, 0.0), _IDLE))
            for end in ready:
                packet = os.read(end, _LONGEST_PACKET)
                to = packet[19] - 1
                if packet[0] >> 4 == 4 and to < len(self._ends):
                    self._take(numbers[end], to, packet, under_way)
            while under_way and under_way[0][0] <= time.monotonic():
                _, _, to, packet = heapq.heappop(under_way)
                if to not in self.deaf:
                    os.write(self._ends[to], packet)

    def _take(
        self, sender: int, to: int, packet: bytes, under_way: list[tuple[float, int, int, bytes]]
    ) -> None:
        self.packets += 1
        if sender in self.mute or self._draw.random() < self.loss:
            self.lost += 1
            return
        for _ in range(1 + (self._draw.random() < self.double)):
            due = time.monotonic() + self.delay
            if self._draw.random() < self.reorder:
                due += self._draw.uniform(0.0, 0.05)
            heapq.heappush(under_way, (due, self.packets, to, packet))


def _ip(*arguments: str) -> None:
    subprocess.run(["ip", *arguments], check=True, capture_output=True)
