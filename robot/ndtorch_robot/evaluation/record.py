"""What happened in a drive, frame by frame."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from ndtorch.navigation import StereoRig, Strips
from ndtorch_robot.navigator_runner import NavigatorRunner
from ndtorch_robot.ports import DriveCommand, Step

KEPT_ROWS = 900
"""Frames whose rows are kept for the space-time plot: the first half minute."""

Floats = npt.NDArray[np.float64]
Pose = tuple[float, float, float]


class Record:
    """An observer that keeps every step in which the navigator was asked; `array` makes its lists arrays.

    Args:
        runner: of the car.
        true_pose: for the scorer.

    Attributes:
        time: s.
        pose: true x, y, heading.
        believed: the same by dead reckoning.
        located: the same as corrected by the localiser; by dead reckoning where there is none.
        command: speed and curvature sent.
        sides: speed estimates, left and right.
        difference: what the controller weighed; see its `trace`.
        mode: of the controller.
        ranges: left range, left angle, right angle, valid, each `[n]`.
        rows: both grey rows, uint8 `[2, W]`, of the first `KEPT_ROWS` frames.
        placed: numbers of the frames before which the car was moved to another place; the first is the start.
    """

    def __init__(self, runner: NavigatorRunner, true_pose: Callable[[], Pose]) -> None:
        self.runner, self.true_pose = runner, true_pose
        self.time: list[float] = []
        self.pose: list[Pose] = []
        self.believed: list[Pose] = []
        self.located: list[Pose] = []
        self.command: list[DriveCommand] = []
        self.sides: list[Floats] = []
        self.difference: list[float] = []
        self.mode: list[int] = []
        self.ranges: list[npt.NDArray[np.float32]] = []
        self.rows: list[npt.NDArray[np.uint8]] = []
        self.placed: list[int] = []

    def __call__(self, step: Step) -> None:
        frames, state = step.frames, step.state
        if step.placed is not None:
            self.placed.append(len(self.time))
        if frames is None or state is None:
            return
        self.time.append(frames.time)
        self.pose.append(self.true_pose())
        for poses, pose in ((self.believed, state.pose), (self.located, state.place)):
            poses.append((float(pose.x), float(pose.y), float(pose.heading)))
        self.command.append(step.sent)
        self.sides.append(np.asarray(state.sides, np.float64))
        self.difference.append(float(state.difference))
        self.mode.append(self.runner.mode())
        r = state.ranges
        self.ranges.append(np.stack((r.left_range, r.left_angle, r.right_angle, r.valid)).astype(np.float32))
        if len(self.rows) < KEPT_ROWS:
            self.rows.append(np.stack([grey_row(frame, self.runner.rig) for frame in (frames.left, frames.right)]))

    def array(self, name: str) -> Floats:
        """One of the lists; poses are `[T, 3]`."""
        values = np.array(getattr(self, name), dtype=np.float64)
        return values.reshape(-1, 3) if name in ("pose", "believed", "located") else values

    @property
    def turns(self) -> int:
        """Number of turns begun ahead: a curve after a straight, or after one to the other side."""
        speed, curvature = self.array("command").reshape(-1, 2).T
        side = np.where(speed > 0, np.sign(curvature), 0.0)
        return int(((side != 0) & (side != np.concatenate(([0.0], side[:-1])))).sum())

    @property
    def distance(self) -> float:
        """Metres driven, without being carried."""
        steps = np.hypot(*np.diff(self.array("pose")[:, :2], axis=0).T)
        steps[np.array(self.placed[1:], dtype=np.int64) - 1] = 0.0
        return float(steps.sum())

    def track(self, name: str = "pose") -> Floats:
        """Places of a list of poses as a line `[T, 2]`, with NaN where the car was carried."""
        line = self.array(name)[:, :2].copy()
        line[np.array(self.placed[1:], dtype=np.int64)] = np.nan
        return line


def pose_error(poses: Floats, true: Floats) -> tuple[Floats, Floats]:
    """How far poses `[T, 3]` are from the true ones, m, and how far they are turned, degrees, without sign."""
    x, y, heading = (poses - true).T
    return np.hypot(x, y), np.degrees(np.abs(np.angle(np.exp(1j * heading))))


def grey_row(frame: Strips | object, rig: StereoRig) -> npt.NDArray[np.uint8]:
    row = frame.row if isinstance(frame, Strips) else frame[..., rig.row : rig.row + 1, :]  # type: ignore[index]
    grey: npt.NDArray[np.uint8] = np.rint(row[0, :, 0].numpy().mean(0, dtype=np.float32)).astype(np.uint8)
    return grey
