"""Whether the car may be steered by new frames: their time, their rate, and the camera monitor."""

from __future__ import annotations

import math

from ndtorch.navigation import StereoRig
from ndtorch.navigation.body import rig_in_units
from ndtorch.navigation.stereo.rig import Rect
from ndtorch_robot.camera_monitor.limits import CameraLimits
from ndtorch_robot.camera_monitor.monitor import CameraMonitor
from ndtorch_robot.faults import CameraError, Fault, FaultKind
from ndtorch_robot.ports import StereoFrames


class FrameCheck:
    """Judges frames for the safety layer.

    Beyond `CameraMonitor`, with less patience, it checks the age of frames, times in the future, and the frame rate.

    Args:
        rig: the camera pair.
        rate: frames a second that the navigator relies on.
        max_age: s.
        patience: frames in a row that must look wrong before a camera is black or frozen: 4 are 0.13 s.
        joint_freeze: both images standing still together is a fault as well. Not for rendered images, which have no
            noise and may stay equal to the bit before a blank wall.
        limits: see `CameraLimits`.
        floor: rectangles of both images that see the floor; see `CameraMonitor`.
        unit: of the body, m: all lengths of the monitor are those of the car of [A].
    """

    SLOW = 1.6
    """Periods between two frames from which the second is late; two late frames in a row are a slow camera."""

    def __init__(
        self,
        rig: StereoRig,
        rate: float,
        max_age: float,
        patience: int = 4,
        joint_freeze: bool = True,
        limits: CameraLimits | None = None,
        floor: tuple[Rect, Rect] | None = None,
        unit: float = 1.0,
    ) -> None:
        self.rate, self.max_age, self.unit = rate, max_age, unit
        self.monitor = CameraMonitor(rig_in_units(rig, unit), patience, joint_freeze, rate, limits, floor)
        self.time = -math.inf
        self.late = 0

    def judge(
        self, frames: StereoFrames, speed: float, now: float, curvature: float = 0.0, commanded: float = 0.0
    ) -> Fault | None:
        """What is wrong with new frames; speed and curvature are of the car since the last ones, m/s and 1/m.

        Args:
            now: on the clock of the frames, s.
            commanded: speed that the car was sent last, m/s.
        """
        if not math.isfinite(frames.time) or frames.time > now + 0.01:
            return Fault(FaultKind.TIMES, f"the time of the frames is {frames.time - now:.3f} s ahead")
        age = now - frames.time
        if age > self.max_age:
            self.time = frames.time
            return Fault(FaultKind.AGE, f"the frames are {age:.3f} s old")
        gap, self.time = frames.time - self.time, frames.time
        self.late = self.late + 1 if self.SLOW / self.rate < gap < math.inf else 0
        try:
            self.monitor.check(frames, speed / self.unit, curvature * self.unit, commanded / self.unit)
        except CameraError as error:
            return Fault(error.kind, str(error))
        if self.late < 2:
            return None
        return Fault(FaultKind.SLOW, f"the cameras give {1 / gap:.0f} frames a second, {self.rate:.0f} are wanted")
