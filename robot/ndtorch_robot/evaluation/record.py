"""What happened in a drive, frame by frame."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from ndtorch.navigation import NavigatorState, StereoRig, Strips
from ndtorch_robot.navigator_runner import NavigatorRunner
from ndtorch_robot.ports import DriveCommand, Observer, Step, StereoFrames

KEPT_ROWS = 900
"""Frames whose rows are kept for the space-time plot: the first half minute."""

Floats = npt.NDArray[np.float64]
Pose = tuple[float, float, float]


@dataclass
class Record:
    """Lists that grow by one entry a frame; `array` makes them arrays.

    Attributes:
        time: s.
        pose: true x, y, heading, for the scorer.
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

    time: list[float] = field(default_factory=list)
    pose: list[tuple[float, float, float]] = field(default_factory=list)
    believed: list[tuple[float, float, float]] = field(default_factory=list)
    located: list[tuple[float, float, float]] = field(default_factory=list)
    command: list[DriveCommand] = field(default_factory=list)
    sides: list[Floats] = field(default_factory=list)
    difference: list[float] = field(default_factory=list)
    mode: list[int] = field(default_factory=list)
    ranges: list[npt.NDArray[np.float32]] = field(default_factory=list)
    rows: list[npt.NDArray[np.uint8]] = field(default_factory=list)
    placed: list[int] = field(default_factory=list)

    def add(
        self,
        frames: StereoFrames,
        state: NavigatorState,
        mode: int,
        command: DriveCommand,
        pose: tuple[float, float, float],
        rig: StereoRig,
    ) -> None:
        self.time.append(frames.time)
        self.pose.append(pose)
        for poses, pose_ in ((self.believed, state.pose), (self.located, state.place)):
            poses.append((float(pose_.x), float(pose_.y), float(pose_.heading)))
        self.command.append(command)
        self.sides.append(np.asarray(state.sides, np.float64))
        self.difference.append(float(state.difference))
        self.mode.append(mode)
        r = state.ranges
        found = (r.left_range, r.left_angle, r.right_angle, r.valid)
        self.ranges.append(np.stack(found).astype(np.float32))
        if len(self.rows) < KEPT_ROWS:
            self.rows.append(np.stack([grey_row(frame, rig) for frame in (frames.left, frames.right)]))

    def observer(self, runner: NavigatorRunner, pose: Callable[[], Pose]) -> Observer:
        """Keeps every step in which the navigator was asked."""

        def keep(step: Step) -> None:
            if step.placed is not None:
                self.placed.append(len(self.time))
            if step.frames is not None and step.state is not None:
                self.add(step.frames, step.state, runner.mode(), step.sent, pose(), runner.rig)

        return keep

    def array(self, name: str) -> Floats:
        return np.array(getattr(self, name), dtype=np.float64)

    @property
    def turns(self) -> int:
        """Number of turns begun ahead: a curve after a straight, or after one to the other side."""
        if not self.command:
            return 0
        speed, curvature = self.array("command").T
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


def range_columns(ranges: npt.NDArray[np.float32], rig: StereoRig, linear: bool) -> tuple[Floats, Floats]:
    """Columns at which ranged features were seen in the left and the right row; NaN where there was none."""
    columns = []
    for part in (1, 2):
        angle = ranges[:, part].astype(np.float64)
        position = angle / rig.pixel_angle if linear else np.tan(angle) * rig.focal
        columns.append(np.where(ranges[:, 3] > 0, rig.center[0] - position, math.nan))
    return columns[0], columns[1]
