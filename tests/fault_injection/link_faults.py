"""A serial link with faults by name."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from ndtorch_robot.sim.stepped_world import Cable, SteppedWorld, good_cable

DAMAGE = {"20 % of bytes": 0.2, "3 % of bytes": 0.03, "single bytes": 0.0003}
"""Share of bytes with a flipped bit: in nearly every frame, in every third, or in one every three seconds."""

APART = 1.0
"""Seconds without damage after a single byte: the board stops at four refused frames within a second."""

LOST = 0.03
"""Share of writes that are lost, of those of which only some are."""

DELAY = 0.3
"""Seconds by which delayed bytes arrive late."""


class FaultyLink:
    """The link between a simulated world and its board.

    Args:
        world: whose link it is.
        seed: of the random damage.
    """

    def __init__(self, world: SteppedWorld, seed: int) -> None:
        self.world, self.random = world, np.random.default_rng((seed, 8))
        self.queue: deque[tuple[float, bytes]] = deque()

    def inject(self, fault: str) -> None:
        """Begin a fault of `tests.fault_injection.faults`."""
        if fault == "board restarts":
            self.world.restart_board()
        changes: dict[str, tuple[Cable, Cable]] = {
            "cable pulled": (self.nothing, self.nothing),
            "nothing from the board": (good_cable, self.nothing),
            "nothing to the board": (self.nothing, good_cable),
            "bytes to the board delayed": (self.delayed, good_cable),
            "single writes lost": (self.some_lost, self.some_lost),
            "single bytes damaged": (self.damaged("single bytes"), self.damaged("single bytes")),
        }
        for share in ("20 % of bytes", "3 % of bytes"):
            changes[f"{share} to the board damaged"] = (self.damaged(share), good_cable)
            changes[f"{share} from the board damaged"] = (good_cable, self.damaged(share))
        self.world.up, self.world.down = changes.get(fault, (good_cable, good_cable))

    def clear(self) -> None:
        """End the fault."""
        self.world.up = self.world.down = good_cable
        self.queue.clear()

    def nothing(self, data: bytes, now: float) -> bytes:
        return b""

    def some_lost(self, data: bytes, now: float) -> bytes:
        return b"" if self.random.random() < LOST else data

    def delayed(self, data: bytes, now: float) -> bytes:
        self.queue.append((now + DELAY, data))
        arrived = b""
        while self.queue and self.queue[0][0] <= now:
            arrived += self.queue.popleft()[1]
        return arrived

    def damaged(self, share: str) -> Cable:
        """A link that flips one bit in this share of its bytes; single bytes are `APART`."""
        good_until = -math.inf

        def damage(data: bytes, now: float) -> bytes:
            nonlocal good_until
            damaged = self.random.random(len(data)) < DAMAGE[share]
            if share == "single bytes" and damaged.any():
                damaged &= (np.arange(len(data)) == damaged.argmax()) & (now >= good_until)
                good_until = max(good_until, now + APART) if damaged.any() else good_until
            bits = (1 << self.random.integers(0, 8, len(data))).astype(np.uint8)
            return bytes(np.frombuffer(data, np.uint8) ^ np.where(damaged, bits, 0).astype(np.uint8))

        return damage
