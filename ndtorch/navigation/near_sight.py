"""What is right ahead of one car, for the controller that steers it: asked while it stands, and while it drives."""

from __future__ import annotations

from typing import Any

from torch import Tensor, nn

from ndtorch.navigation.controllers.contract import STOPPED, SUPPRESSED, Command, Controller, ranges_at
from ndtorch.navigation.near_check import NearCheck
from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.row_ranging import RowRanging
from ndtorch.navigation.state import NavigatorState
from ndtorch.navigation.strips import Strips
from ndtorch.navigation.whole_step import Beginning

STANDS = 0.05
"""m/s: a car slower than this stands."""

Eyes = tuple[Tensor, Tensor]


class NearSight(nn.Module):
    """Looks with both cameras where the controller wants it, and tells it.

    Args:
        looks: finds what is right ahead of a car that stands, and what stands near while it drives.
        searching: searches the right row for what stands ahead; None where the ranging itself does so.
    """

    def __init__(self, looks: NearCheck, searching: RowRanging | None) -> None:
        super().__init__()
        self.looks, self.searching = looks, searching

    def due(self, controller: Controller, last: Command, control: Any, begins: bool) -> bool:
        """Whether to look at what is right ahead: one car that stands, at the start or because it is boxed in."""
        if last.speed.ndim or abs(float(last.speed)) > STANDS:
            return False
        return begins or int(controller.mode(control)) in (SUPPRESSED, STOPPED)

    def check(self, controller: Controller, control: Any, pose: Pose, fields: Eyes, rows: Eyes) -> Any:
        """The state of the controller of one car that is told what is right ahead of it."""
        things, floor_seen = self.looks(fields, rows)
        return controller.told_near(control, pose, things, self.looks.across, floor_seen)

    def beginning(self, controller: Controller, left: Strips, right: Strips) -> Beginning:
        """What comes before a step of these frames, `[1, C, H, W]`, that a car begins standing."""

        def look(last: Command, control: Any, pose: Pose, begins: bool) -> Any:
            if not self.due(controller, last, control, begins):
                return control
            return self.check(controller, control, pose, (left.field[0], right.field[0]), (left.row[0], right.row[0]))

        return look

    def glance(self, controller: Controller, control: Any, pose: Pose, rows: Eyes) -> Any:
        """The state of the controller of one car that is told what it wants to know while it drives."""
        ahead, near = controller.glances(control)
        if not (ahead or near):
            return control
        ranges = None
        if ahead and self.searching is not None:
            ranges = ranges_at(self.searching(rows[0].unsqueeze(0), rows[1].unsqueeze(0))[0], 0)
        return controller.told_more(control, pose, ranges, self.looks.things(rows) if near else None)

    def warm_up(self, controller: Controller, frame: Tensor, state: NavigatorState) -> None:
        """Have the kernel of the search ready: see `Navigator.warm_up`."""
        if self.searching is not None:
            ranges, _ = self.searching(frame, frame)
            controller.told_more(state.control, state.pose, ranges_at(ranges, 0), None)
