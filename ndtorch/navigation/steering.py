"""How a navigator steers frame by frame, and where it takes the car to be meanwhile."""

from __future__ import annotations

from typing import Any, NamedTuple

import torch
from torch import Tensor

from ndtorch.navigation.controllers.contract import Command, Controller, in_time, ranges_at, stack_commands
from ndtorch.navigation.localisation.localiser import Localiser
from ndtorch.navigation.localisation.state import LocaliserState, frame_pose
from ndtorch.navigation.mapping.range_log import FramePose
from ndtorch.navigation.odometry import DeadReckoning, Pose
from ndtorch.navigation.proximity.schedule import ProximitySchedule
from ndtorch.navigation.ranging import Ranges
from ndtorch.navigation.rig import Rect
from ndtorch.navigation.state import NavigatorState, place_of
from ndtorch.navigation.strips import grey_pair


class Steering(NamedTuple):
    """Those parts of a `Navigator` that steer.

    Attributes:
        row: what is read of a frame for the localiser.
        size: height and width of a frame, pixels.
    """

    controller: Controller
    reckoning: DeadReckoning
    near: ProximitySchedule | None
    localiser: Localiser | None
    row: Rect
    size: tuple[int, int]

    def locate(self, left: Tensor, right: Tensor, pose: Pose, located: LocaliserState | None) -> LocaliserState | None:
        """Correct the pose of a frame, whose rows are `[1, C, H, W]`; None where there is no localiser."""
        if self.localiser is None:
            return None
        rows = None
        if self.localiser.due(located):
            rows = grey_pair(left, right, self.row, self.row, self.size).squeeze(-2)[..., 0, :, :]
        new: LocaliserState = self.localiser(rows, pose, located)
        return new

    def steer(
        self,
        seen: Tensor,
        ranges: Ranges,
        state: NavigatorState | None,
        driven: Command | None,
        start: Pose | None = None,
        eyes: tuple[tuple[Tensor, Tensor], tuple[Tensor, Tensor]] | None = None,
    ) -> tuple[Command, Any, Pose, Pose, LocaliserState | None, list[FramePose | None] | None]:
        """Frame by frame, because what is done at one frame is what was driven on the way to the next.

        Returns commands, the controller's state, the corrected poses, the last one of dead reckoning, the localiser's
        state, and the frame poses of all frames.
        """
        still = torch.zeros_like(ranges.x[..., 0, 0])
        pose = state.pose if state else start or Pose(still, still, still)
        last = state.command if state else Command(still, still)
        dim = ranges.x.ndim - 2
        control = state.control if state else self.controller.start(seen.select(dim, 0), pose)
        commands, poses, frames = [], [], []
        located = state.located if state else None
        for t in range(ranges.x.shape[-2]):
            if driven is not None:
                last = Command(driven.speed[..., t], driven.curvature[..., t])
            pose = self.reckoning.step(pose, last.speed, last.curvature)
            begins = state is None or (t == 0 and state.fields is None)
            if eyes is not None and self.near is not None and self.near.due(self.controller, last, control, begins):
                fields, rows = (tuple(eye[..., t, :, :, :] for eye in part) for part in eyes)
                control = self.near.report(self.controller, control, pose, fields, rows)  # type: ignore[arg-type]
            if eyes is not None and self.localiser is not None:
                left, right = (eye[..., t : t + 1, :, :, :] for eye in eyes[1])
                located = self.locate(left, right, pose, located)
            place = place_of(pose, located)
            if located is not None:
                frames.append(frame_pose(located))
                control = self.controller.told_place(control, pose, place if located.relocalisation is None else None)
            last, control = self.controller.step(seen.select(dim, t), ranges_at(ranges, t), pose, last, control)
            if eyes is not None and self.near is not None and not pose.x.ndim:
                rows = tuple(eye[..., t, :, :, :] for eye in eyes[1])
                control = self.near.while_driving(self.controller, control, pose, rows)  # type: ignore[arg-type]
            commands.append(last)
            poses.append(place)
        return (
            stack_commands(commands),
            control,
            Pose(*(in_time(parts) for parts in zip(*poses, strict=True))),
            pose,
            located,
            frames if located is not None else None,
        )
