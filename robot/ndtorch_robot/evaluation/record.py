"""What happened in a drive, frame by frame."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from ndtorch.navigation import StereoRig, Strips
from ndtorch_robot.navigator_runner import NavigatorRunner
from ndtorch_robot.ports import Step

KEPT_ROWS = 900
"""Frames whose rows are kept for the space-time plot: the first half minute."""

Floats = npt.NDArray[np.float64]
Pose = tuple[float, float, float]

POSES = ("pose", "believed", "located")
"""True poses, those by dead reckoning, and those of the localiser, or by dead reckoning where there is none."""
NAMES = ("time", *POSES, "command", "sides", "difference", "mode", "ranges")


class Record:
    """An observer that keeps every step in which the navigator was asked.

    Attributes:
        values: of every step by name, see `NAMES`; ranges are left range, left angle, right angle, valid, `[4, n]`.
        rows: both grey rows, uint8 `[2, W]`, of the first `KEPT_ROWS` frames.
        placed: numbers of the frames before which the car was moved to another place; the first is the start.
    """

    def __init__(self, runner: NavigatorRunner, true_pose: Callable[[], Pose]) -> None:
        self.runner, self.true_pose = runner, true_pose
        self.values: dict[str, list[Any]] = {name: [] for name in NAMES}
        self.rows: list[npt.NDArray[np.uint8]] = []
        self.placed: list[int] = []

    def __call__(self, step: Step) -> None:
        frames, state = step.frames, step.state
        if step.placed is not None:
            self.placed.append(len(self.values["time"]))
        if frames is None or state is None:
            return
        poses = self.true_pose(), *(tuple(map(float, pose)) for pose in (state.pose, state.place))
        r = state.ranges
        ranges = np.stack((r.left_range, r.left_angle, r.right_angle, r.valid)).astype(np.float32)
        motion = np.asarray(state.sides, np.float64), float(state.difference)
        values = (frames.time, *poses, step.sent, *motion, self.runner.mode(), ranges)
        for name, value in zip(NAMES, values, strict=True):
            self.values[name].append(value)
        if len(self.rows) < KEPT_ROWS:
            self.rows.append(np.stack([grey_row(frame, self.runner.rig) for frame in frames[:2]]))

    def array(self, name: str) -> Floats:
        """The values of all steps; poses are `[T, 3]`."""
        values = np.array(self.values[name], dtype=np.float64)
        return values.reshape(-1, 3) if name in POSES else values

    @property
    def turns(self) -> int:
        """Number of turns begun ahead: a curve after a straight, or after one to the other side."""
        speed, curvature = self.array("command").reshape(-1, 2).T
        side = np.where(speed > 0, np.sign(curvature), 0.0)
        return int(((side != 0) & (side != np.concatenate(([0.0], side[:-1])))).sum())

    def track(self, name: str = "pose") -> Floats:
        """Places of a list of poses as a line `[T, 2]`, with NaN where the car was carried."""
        line = self.array(name)[:, :2].copy()
        line[np.array(self.placed[1:], dtype=np.int64)] = np.nan
        return line

    @property
    def distance(self) -> float:
        """Metres driven, without being carried."""
        steps = np.hypot(*np.diff(self.array("pose")[:, :2], axis=0).T)
        steps[np.array(self.placed[1:], dtype=np.int64) - 1] = 0.0
        return float(steps.sum())


def pose_error(poses: Floats, true: Floats) -> tuple[Floats, Floats]:
    """How far poses `[T, 3]` are from the true ones, m, and how far they are turned, degrees, without sign."""
    x, y, heading = (poses - true).T
    return np.hypot(x, y), np.degrees(np.abs(np.angle(np.exp(1j * heading))))


def grey_row(frame: Strips | object, rig: StereoRig) -> npt.NDArray[np.uint8]:
    row = frame.row if isinstance(frame, Strips) else frame[..., rig.row : rig.row + 1, :]  # type: ignore[index]
    grey: npt.NDArray[np.uint8] = np.rint(row[0, :, 0].numpy().mean(0, dtype=np.float32)).astype(np.uint8)
    return grey
