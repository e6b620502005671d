"""When one car checks its proximity, and what its controller gets to know: while stationary, and while driving."""

from __future__ import annotations

from typing import Any

from torch import Tensor, nn

from ndtorch.navigation.controllers.contract import STOPPED, SUPPRESSED, Command, Controller
from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.proximity.check import ProximityCheck
from ndtorch.navigation.stereo.ranging import StereoRanging
from ndtorch.navigation.stereo.strips import Strips, as_frames

STATIONARY = 0.05
"""A slower car is stationary, m/s."""

Pair = tuple[Tensor, Tensor]


class ProximitySchedule(nn.Module):
    """Checks the proximity when the controller needs it, and reports to it.

    Args:
        check: detects obstacles and floor.
        searching: searches the right row for ranges ahead; None if the ranging itself does so.
    """

    def __init__(self, check: ProximityCheck, searching: StereoRanging | None) -> None:
        super().__init__()
        self.check = check
        self.searching = searching

    def due(self, controller: Controller, last: Command, control: Any, begins: bool) -> bool:
        """Whether to check: a stationary car, at the start or because it is blocked."""
        if abs(last.speed) > STATIONARY:
            return False
        return begins or controller.mode(control) in (SUPPRESSED, STOPPED)

    def before_step(
        self, controller: Controller, control: Any, last: Command, pose: Pose, left: Strips, right: Strips, begins: bool
    ) -> Any:
        """The controller's state after the check that precedes a step, if one is due.

        Args:
            last: driven on the path to the pose.
            left, right: frames `[C, H, W]`.
            begins: this is the first frame, or the first one after a fault.
        """
        if not self.due(controller, last, control, begins):
            return control
        obstacles, floor_seen = self.check((left.field, right.field), (left.row, right.row))
        return controller.on_near_obstacles(control, pose, obstacles, self.check.across, floor_seen)

    def while_driving(self, controller: Controller, control: Any, pose: Pose, rows: Pair) -> Any:
        """The controller's state after what it requests while driving; rows are `[C, H, W]`."""
        ahead, near = controller.sensing_requests(control)
        if not (ahead or near):
            return control
        ranges = None
        if ahead and self.searching is not None:
            ranges, _ = self.searching.step(as_frames(*rows), None)
        return controller.on_extra_ranges(control, pose, ranges, self.check.obstacles(rows) if near else None)

    def warm_up(self, frame: Tensor) -> None:
        """Compile or load the check and the search; see `Navigator.warm_up`."""
        rows = (frame, frame)
        self.check(rows, rows)
        if self.searching is not None:
            self.searching.step(as_frames(*rows), None)
