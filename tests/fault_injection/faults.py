"""The injected faults, how soon the car must have stopped for each, and the link and the disk that have them."""

from __future__ import annotations

import errno
import math
import os
import time
from collections import deque
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ndtorch_robot.link.simulated import Cable, SimulatedDrive
from ndtorch_robot.ports import Step
from ndtorch_robot.recording import Recorder, open_recording


def good_cable(data: bytes, now: float) -> bytes:
    return data


STOP_DEADLINE = 0.25
"""Seconds after a fault from which no wheel may turn."""

BLIND_DEADLINE = 0.5
"""The same for images without content, which are judged over several frames."""

DAMAGED_LINK_DEADLINE = 1.0
"""The same for a link of which most frames still arrive intact: the board stops at the fourth damaged frame within a
second. Of 20 000 random starts none took longer than 0.84 s."""


class Fault(NamedTuple):
    """One fault of `"camera"`, `"link"`, `"disk"` or `"load"`."""

    part: str
    name: str
    max_reaction_s: float | None  # after which no wheel may turn; None where the car must drive on


FAULTS = (
    Fault("camera", "black", STOP_DEADLINE),
    Fault("camera", "frozen", STOP_DEADLINE),
    Fault("camera", "both frozen", STOP_DEADLINE),
    Fault("camera", "no frames", STOP_DEADLINE),
    Fault("camera", "late", STOP_DEADLINE),
    Fault("camera", "white", BLIND_DEADLINE),
    Fault("camera", "grey", BLIND_DEADLINE),
    Fault("camera", "fogged", BLIND_DEADLINE),
    Fault("camera", "covered", BLIND_DEADLINE),
    Fault("camera", "unequal light", BLIND_DEADLINE),
    Fault("camera", "one grey frame", None),
    Fault("camera", "one lost frame", None),
    Fault("link", "cable pulled", STOP_DEADLINE),
    Fault("link", "nothing from the board", STOP_DEADLINE),
    Fault("link", "nothing to the board", STOP_DEADLINE),
    Fault("link", "20 % of bytes to the board damaged", STOP_DEADLINE),
    Fault("link", "20 % of bytes from the board damaged", STOP_DEADLINE),
    Fault("link", "3 % of bytes to the board damaged", DAMAGED_LINK_DEADLINE),
    Fault("link", "3 % of bytes from the board damaged", DAMAGED_LINK_DEADLINE),
    Fault("link", "bytes to the board delayed", STOP_DEADLINE),
    Fault("link", "board restarts", STOP_DEADLINE),
    Fault("link", "single writes lost", None),
    Fault("link", "single bytes damaged", None),
    Fault("disk", "full", None),
    Fault("disk", "slow", None),
    Fault("load", "loop stalls", STOP_DEADLINE),
    Fault("load", "loop stalls shortly", None),
)
"""All faults; a run injects each as often as the others, in random order."""


DAMAGE = {"20 % of bytes": 0.2, "3 % of bytes": 0.03, "single bytes": 0.0003}
"""Share of bytes with a flipped bit: in nearly every frame, in every third, or in one every three seconds."""

APART, LOST, DELAY = 1.0, 0.03, 0.3
"""Seconds without damage after a single byte: the board stops at four refused frames within a second; share of single
writes that are lost; seconds by which delayed bytes arrive late."""


class FaultyLink:
    """The link between a simulated world and its board."""

    def __init__(self, world: SimulatedDrive, seed: int) -> None:
        self.world, self.random = world, np.random.default_rng((seed, 8))
        self.queue: deque[tuple[float, bytes]] = deque()

    def inject(self, fault: str) -> None:
        """Begin a fault of `tests.fault_injection.faults`."""
        if fault == "board restarts":
            self.world.board.reset(self.world.now())
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


SLOW = 0.6
"""Seconds that each chunk takes on a slow disk."""


class FaultyRecorder(Recorder):
    """A recorder whose disk may be `"full"` or `"slow"`."""

    fault: str | None = None

    def flush(self) -> None:
        if self.fault == "full":
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        if self.fault == "slow":
            time.sleep(SLOW)
        super().flush()


class RecordingCheck:
    """An observer that records for the duration of a disk fault; the file is removed at the end."""

    def __init__(self, file: Path, fault: str, lines: list[str]) -> None:
        file.unlink(missing_ok=True)
        self.recorder = FaultyRecorder(file, report=lines.append)
        self.recorder.fault = fault

    def __call__(self, step: Step) -> None:
        self.recorder(step)

    def end(self) -> str | None:
        """Close the recording; returns what is wrong with it, or None.

        A full disk must have been reported, and all earlier steps must be readable. On a slow disk steps may be
        missing, but each must be counted.
        """
        recorder, fault = self.recorder, self.recorder.fault
        recorder.fault = None
        recorder.close()
        read = sum(1 for _ in open_recording(recorder.path).steps())
        recorder.path.unlink(missing_ok=True)
        if fault == "full" and not recorder.failed:
            return "the full disk was not noticed"
        if fault == "slow" and recorder.failed:
            return f"the slow disk ended the recording: {recorder.failed}"
        if read != recorder.steps:
            return f"{recorder.steps} steps were written and {read} can be read"
        if recorder.steps + recorder.dropped != recorder.number:
            return f"{recorder.number} steps were given, {recorder.steps} written and {recorder.dropped} counted lost"
        return None
