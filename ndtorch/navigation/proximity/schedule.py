"""When one car checks its proximity, and what its controller gets to know: while stationary, and while driving."""

from __future__ import annotations

from typing import Any

from torch import Tensor, nn

from ndtorch.navigation.controllers.contract import STOPPED, SUPPRESSED, Command, Controller, ranges_at
from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.proximity.check import ProximityCheck
from ndtorch.navigation.row_ranging import RowRanging
from ndtorch.navigation.state import NavigatorState
from ndtorch.navigation.strips import Strips
from ndtorch.navigation.whole_step import Beginning

STATIONARY = 0.05
"""A slower car is stationary, m/s."""

Pair = tuple[Tensor, Tensor]


class ProximitySchedule(nn.Module):
    """Checks the proximity when the controller needs it, and reports to it.

    Args:
        check: detects obstacles and floor.
        searching: searches the right row for ranges ahead; None if the ranging itself does so.
    """

    def __init__(self, check: ProximityCheck, searching: RowRanging | None) -> None:
        super().__init__()
        self.check = check
        self.searching = searching

    def due(self, controller: Controller, last: Command, control: Any, begins: bool) -> bool:
        """Whether to check: one stationary car, at the start or because it is blocked."""
        if last.speed.ndim or abs(float(last.speed)) > STATIONARY:
            return False
        return begins or int(controller.mode(control)) in (SUPPRESSED, STOPPED)

    def report(self, controller: Controller, control: Any, pose: Pose, fields: Pair, rows: Pair) -> Any:
        """The controller's state after a check."""
        obstacles, floor_seen = self.check(fields, rows)
        return controller.told_near(control, pose, obstacles, self.check.across, floor_seen)

    def beginning(self, controller: Controller, left: Strips, right: Strips) -> Beginning:
        """What precedes a step of frames `[1, C, H, W]` of a stationary car."""

        def before(last: Command, control: Any, pose: Pose, begins: bool) -> Any:
            if not self.due(controller, last, control, begins):
                return control
            return self.report(controller, control, pose, (left.field[0], right.field[0]), (left.row[0], right.row[0]))

        return before

    def while_driving(self, controller: Controller, control: Any, pose: Pose, rows: Pair) -> Any:
        """The controller's state after what it asks for while driving."""
        ahead, near = controller.glances(control)
        if not (ahead or near):
            return control
        ranges = None
        if ahead and self.searching is not None:
            ranges = ranges_at(self.searching(rows[0].unsqueeze(0), rows[1].unsqueeze(0))[0], 0)
        return controller.told_more(control, pose, ranges, self.check.obstacles(rows) if near else None)

    def warm_up(self, controller: Controller, frame: Tensor, state: NavigatorState) -> None:
        """Compile or load the kernel of the search, see `Navigator.warm_up`."""
        if self.searching is not None:
            ranges, _ = self.searching(frame, frame)
            controller.told_more(state.control, state.pose, ranges_at(ranges, 0), None)
