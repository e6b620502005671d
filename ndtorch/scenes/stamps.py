"""Time stamps of frames: the rate that they show, a clock of constant rate by them, and which frame came when."""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from ndtorch.scenes.readers import Frame, Image

JUMP_S = 10.0
"""Seconds between two frames that are a gap in the recording, not a picture that stood still."""
JUMP_INTERVALS = 50
"""Frame intervals that such a gap is longer than."""
BACK_S = 1.0
"""Seconds that stamps go back where another recording begins."""
SAME_RATE = 0.02
"""A declared rate this near to the measured one is the exact one."""


class SourceFrames(NamedTuple):
    """The decoded frames of a source, from its first on: frame n is the n-th that any reader of it counts.

    Attributes:
        stamp: seconds as the source has them, `[n]`.
        tick: place on the clock of the frames that were delivered, `[n]`: whole where a frame was shown first, between
            the neighbours where it was left out, NaN before the first frame that was asked for.
        names: file names, of a folder.
    """

    stamp: np.ndarray[Any, np.dtype[np.float64]]
    tick: np.ndarray[Any, np.dtype[np.float64]]
    names: Sequence[str] | None = None


class FrameLog:
    """Which frame of a source was delivered when; 16 bytes a frame."""

    def __init__(self, names: Sequence[str] | None = None) -> None:
        self.names, self._stamps, self._ticks = names, array("d"), array("d")

    def __len__(self) -> int:
        return len(self._stamps)

    def add(self, stamp: float, tick: float) -> None:
        """Note the next frame of the source."""
        self._stamps.append(stamp)
        self._ticks.append(tick)

    @property
    def last(self) -> float:
        """Stamp of the latest frame, NaN before any."""
        return self._stamps[-1] if self._stamps else math.nan

    def frames(self) -> SourceFrames:
        """What was noted so far."""
        return SourceFrames(np.array(self._stamps), np.array(self._ticks), self.names)


def rate_of(stamps: Sequence[float], declared: Iterable[float]) -> float:
    """Frames a second by time stamps: the mean of the intervals near their median; 0 where there are too few.

    Args:
        stamps: in the order in which frames are shown, seconds.
        declared: rates that the container claims; one that agrees is taken as it is, since stamps are rounded.

    >>> rate_of([0.0, 0.033, 0.067, 0.1], (1000.0, 29.97))
    29.97
    """
    steps = np.diff(np.asarray(stamps, dtype=np.float64))
    steps = steps[np.isfinite(steps) & (steps > 0)]
    if len(steps) == 0:
        return 0.0
    middle = float(np.median(steps))
    rate = 1 / float(steps[np.abs(steps - middle) <= max(0.25 * middle, 0.0011)].mean())
    return next((one for one in declared if abs(one - rate) <= SAME_RATE * rate), rate)


def paced(
    frames: Iterable[Frame],
    fps: float,
    log: FrameLog,
    timed: bool = True,
    start: int = 0,
    on_jump: Callable[[int, float, float], None] | None = None,
) -> Iterator[Image]:
    """The frame that is to be seen at every tick of a clock, by the frames' own time stamps.

    With a constant rate that is every frame once: stamps may be off by up to half of a tick. Where frames come too
    seldom the latest is repeated, where too many, some are left out. A gap in the stamps is a cut: the clock goes on.

    Args:
        frames: from the first of the source on.
        fps: ticks a second.
        log: where every frame is noted.
        timed: whether stamps count; else every frame is a tick.
        start: number of the frame at tick 0.
        on_jump: called with the number of the frame after a gap, its seconds, and the time on the clock.
    """
    shown: Frame | None = None
    time = before = offset = 0.0
    ticks, noted = 0, True
    for number, frame in enumerate(frames):
        if number < start:
            log.add(frame.stamp, math.nan)
            continue
        if not timed:
            log.add(frame.stamp, ticks)
            ticks += 1
            yield frame.image
            continue
        if shown is None:
            offset = frame.stamp
        else:
            step = frame.stamp - shown.stamp
            if step > max(JUMP_S, JUMP_INTERVALS / fps) or step < -max(BACK_S, 3 / fps):
                offset = frame.stamp - time - 1 / fps
                if on_jump is not None:
                    on_jump(number, step, time + 1 / fps)
            # A stamp that does not go on says nothing.
            now = frame.stamp - offset
            time = now if now > time else time + 1 / fps
            while (ticks + 0.5) / fps <= time:
                if not noted:
                    log.add(shown.stamp, ticks)
                    noted = True
                yield shown.image
                ticks += 1
            if not noted:
                log.add(shown.stamp, min(max(before * fps, ticks - 1.0), float(ticks)))
        shown, noted, before = frame, False, time
    if shown is not None:
        log.add(shown.stamp, ticks)
        yield shown.image


def ticks_of(stamps: Sequence[float], fps: float, start: int = 0) -> int:
    """Number of frames that `paced` gives for frames with these stamps."""
    nothing = np.zeros((0, 0), np.uint8)
    return sum(1 for _ in paced((Frame(nothing, stamp) for stamp in stamps), fps, FrameLog(), start=start))
