"""Whether new frames may be steered by: their times, and what they show."""

from __future__ import annotations

import math

from ndtorch.navigation import StereoRig
from ndtorch.navigation.rig import Rect
from ndtorch_robot.ports import StereoFrames
from ndtorch_robot.trouble import Kind, SightError, Wrong
from ndtorch_robot.watching.eye import SightLimits
from ndtorch_robot.watching.watch import CameraWatch


class Sight:
    """Can the frames be steered by? Says why not.

    Beyond `CameraWatch`, with less patience, it looks at their age, at times that lie ahead, at their rate, and at
    both pictures standing still together.

    Args:
        rig: the camera pair.
        rate: frames a second that the navigator counts on.
        age: oldest, s.
        patience: frames in a row that must look wrong before black or frozen is said: 4 are 0.13 s.
        together: both pictures standing still together is a fault as well. Not where pictures are drawn: they have no
            noise, and before a blank wall they may stay the same to the bit.
        limits: what the pictures are judged by.
        floor: rectangles of both images that see the floor; see `CameraWatch`.
    """

    SLOW = 1.6
    """Periods between two frames from which the second is late; two late ones in a row are a camera too slow."""

    def __init__(
        self,
        rig: StereoRig,
        rate: float,
        age: float,
        patience: int = 4,
        together: bool = True,
        limits: SightLimits | None = None,
        floor: tuple[Rect, Rect] | None = None,
    ) -> None:
        self.rate, self.age = rate, age
        self.watch = CameraWatch(rig, patience, together, rate, limits, floor)
        self.time = -math.inf
        self.late = 0

    def judge(
        self, frames: StereoFrames, speed: float, now: float, curvature: float = 0.0, wanted: float = 0.0
    ) -> Wrong | None:
        """Look at new frames; returns what is wrong with them.

        Args:
            speed, curvature: of the car since the last ones, m/s and 1/m.
            now: on the clock of the frames.
            wanted: speed that the car was told to have, m/s.
        """
        if not math.isfinite(frames.time) or frames.time > now + 0.01:
            return Wrong(Kind.TIMES, f"the time of the frames is {frames.time - now:.3f} s ahead")
        old = now - frames.time
        if old > self.age:
            self.time = frames.time
            return Wrong(Kind.AGE, f"the frames are {old:.3f} s old")
        gap, self.time = frames.time - self.time, frames.time
        self.late = self.late + 1 if self.SLOW / self.rate < gap < math.inf else 0
        try:
            self.watch.check(frames, speed, curvature, wanted)
        except SightError as error:
            return Wrong(error.kind, str(error))
        if self.late >= 2:
            return Wrong(Kind.SLOW, f"the cameras give {1 / gap:.0f} frames a second, {self.rate:.0f} are wanted")
        return None
