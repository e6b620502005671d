"""The proximity check of a car that is stationary or turns, and when it is due."""

from __future__ import annotations

from typing import Any

import numpy as np
from torch import Tensor, nn

from ndtorch.navigation.controllers.contract import STOPPED, SUPPRESSED, Command, Controller
from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.proximity.floor_consistency import floor_correlation, reject_unoccluded
from ndtorch.navigation.proximity.params import ProximityParams
from ndtorch.navigation.proximity.stereo_match import (
    NOWHERE,
    Obstacles,
    ProximityScan,
    detect_obstacles,
    reject_mismatches,
)
from ndtorch.navigation.stereo.ranging import Ranges, StereoRanging
from ndtorch.navigation.stereo.rig import Rect, StereoRig
from ndtorch.navigation.stereo.strips import Strips, as_frames, grey_pair, row_rect

STATIONARY = 0.05
"""A slower car is stationary, m/s."""

Pair = tuple[Tensor, Tensor]


class ProximityCheck:
    """Detects obstacles right before the car, and whether floor is seen there.

    Args:
        rig: the camera pair.
        rects: the subfields of both images.
        params: its parameters.
    """

    def __init__(self, rig: StereoRig, rects: tuple[Rect, Rect], params: ProximityParams | None = None) -> None:
        self.rig, self.rects, self.params = rig, rects, params or ProximityParams()
        self.row = row_rect(rig)
        y = np.linspace(-self.params.half_width_m, self.params.half_width_m, 9, dtype=np.float32)
        self.across = Obstacles(np.full_like(y, rig.forward + self.params.min_depth_m), y)

    def __call__(
        self, fields: tuple[Tensor, Tensor], rows: tuple[Tensor, Tensor], ranges: Obstacles = NOWHERE
    ) -> ProximityScan:
        """Obstacles that are near, and whether floor is seen straight ahead.

        A mismatch of the ranging is the same in every frame of a stationary car. So one near range where no obstacle is
        detected is a mismatch if floor is seen behind it.

        Args:
            fields, rows: of the left and the right camera, frames `[C, H, W]`, whole or cut.
            ranges: what was ranged, body frame.
        """
        size = (self.rig.height, self.rig.width)
        left, right = grey_pair(fields[0][None], fields[1][None], *self.rects, size)[0].float().numpy()
        correlation = floor_correlation(left, right, self.rects, self.rig, self.params)
        obstacles = reject_mismatches(self.obstacles(rows), correlation, self.rig, self.params)
        images = (left, right, self.rects, self.rig, self.params)
        obstacles, seen = reject_unoccluded(obstacles, *images), correlation >= self.params.min_floor_correlation
        near = (ranges.x - self.rig.forward < self.params.max_depth_m) & (np.abs(ranges.y) <= self.params.half_width_m)
        one, mismatches = Obstacles(ranges.x[near], ranges.y[near]), NOWHERE
        if seen and len(one.x) == 1 and not len(obstacles.x) and not len(reject_unoccluded(one, *images).x):
            mismatches = one
        return ProximityScan(obstacles, seen, self.across, mismatches)

    def obstacles(self, rows: tuple[Tensor, Tensor]) -> Obstacles:
        """Obstacles that are near, whatever the floor shows.

        Args:
            rows: of the left and the right camera, frames `[C, H, W]`, whole or cut.
        """
        size = (self.rig.height, self.rig.width)
        grey = grey_pair(rows[0][None], rows[1][None], self.row, self.row, size)[0, :, 0].float().numpy()
        return detect_obstacles(grey[0], grey[1], self.rig, self.params)


class ProximitySchedule(nn.Module):
    """Checks the proximity when the controller needs it, and reports to it.

    Args:
        check: detects obstacles and floor.
        searching: searches the right row for ranges ahead; None if the ranging itself does so.
        unit_m: a range of so many metres is 1 for the check.
    """

    def __init__(self, check: ProximityCheck, searching: StereoRanging | None, unit_m: float = 1.0) -> None:
        super().__init__()
        self.check = check
        self.searching = searching
        self.unit_m = unit_m

    def due(self, controller: Controller, last: Command, control: Any, begins: bool) -> bool:
        """Whether to check: a stationary car, at the start or because it is blocked."""
        if abs(last.speed) > STATIONARY:
            return False
        return begins or controller.mode(control) in (SUPPRESSED, STOPPED)

    def while_standing(
        self,
        controller: Controller,
        control: Any,
        last: Command,
        pose: Pose,
        left: Strips,
        right: Strips,
        ranges: Ranges,
        begins: bool,
    ) -> Any:
        """The controller's state after the check that follows a step, if one is due.

        Args:
            last: driven on the path to the pose.
            left, right: frames `[C, H, W]`.
            ranges: of these frames.
            begins: this is the first frame, or the first one after a fault.
        """
        if not self.due(controller, last, control, begins):
            return control
        ranged = Obstacles(*(part[ranges.valid] / self.unit_m for part in (ranges.x, ranges.y)))
        scan = self.check((left.field, right.field), (left.row, right.row), ranged)
        return controller.on_near_obstacles(control, pose, scan)

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
