"""A cable that fails when told to."""

from __future__ import annotations

from collections import deque

import numpy as np

from ndtorch_robot.sim.lockstep_world import Cable, LockstepWorld, good_cable

MOST, MANY, FEW = 0.2, 0.03, 0.0003
"""Share of bytes that are flipped: nearly every frame is damaged, every third, or one in three seconds."""

LOST = 0.03
"""Share of writes that are lost where it is only some of them."""

DELAY = 0.3
"""Seconds by which everything is late."""


class FailingCable:
    """What the cable of a world does to bytes, by the names of `ndtorch_robot.soak.faults`."""

    def __init__(self, world: LockstepWorld, seed: int) -> None:
        self.world, self.random = world, np.random.default_rng((seed, 8))
        self.queue: deque[tuple[float, bytes]] = deque()

    def fail(self, fault: str) -> None:
        """From now on this is wrong."""
        world = self.world
        if fault == "board restarts":
            world.restart_board()
        changes: dict[str, tuple[Cable, Cable]] = {
            "cable pulled": (self.nothing, self.nothing),
            "board not heard": (good_cable, self.nothing),
            "board hears nothing": (self.nothing, good_cable),
            "nearly all damaged on the way there": (self.flipped(MOST), good_cable),
            "nearly all damaged on the way back": (good_cable, self.flipped(MOST)),
            "a third damaged on the way there": (self.flipped(MANY), good_cable),
            "a third damaged on the way back": (good_cable, self.flipped(MANY)),
            "everything late on the way there": (self.late, good_cable),
            "single writes lost": (self.some, self.some),
            "single bytes flipped": (self.flipped(FEW), self.flipped(FEW)),
        }
        world.up, world.down = changes.get(fault, (good_cable, good_cable))

    def mend(self) -> None:
        """All is well again."""
        self.world.up = self.world.down = good_cable
        self.queue.clear()

    def nothing(self, data: bytes, now: float) -> bytes:
        """Nothing comes through."""
        return b""

    def some(self, data: bytes, now: float) -> bytes:
        """Now and then nothing comes through."""
        return b"" if self.random.random() < LOST else data

    def late(self, data: bytes, now: float) -> bytes:
        """Everything comes later."""
        self.queue.append((now + DELAY, data))
        come = b""
        while self.queue and self.queue[0][0] <= now:
            come += self.queue.popleft()[1]
        return come

    def flipped(self, share: float) -> Cable:
        """Bits of some bytes are wrong."""

        def change(data: bytes, now: float) -> bytes:
            if not data:
                return data
            bits = (1 << self.random.integers(0, 8, len(data))).astype(np.uint8)
            wrong = np.where(self.random.random(len(data)) < share, bits, 0).astype(np.uint8)
            return bytes(np.frombuffer(data, np.uint8) ^ wrong)

        return change
