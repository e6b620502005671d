"""The proximity check of a car that is stationary or turns."""

from __future__ import annotations

import numpy as np
from torch import Tensor

from ndtorch.navigation.proximity.floor_consistency import reject_unoccluded
from ndtorch.navigation.proximity.floor_plane import floor_correlation
from ndtorch.navigation.proximity.params import ProximityParams
from ndtorch.navigation.proximity.stereo_match import Obstacles, detect_obstacles, reject_mismatches
from ndtorch.navigation.stereo.rig import Rect, StereoRig
from ndtorch.navigation.stereo.strips import grey_pair, row_rect


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

    def __call__(self, fields: tuple[Tensor, Tensor], rows: tuple[Tensor, Tensor]) -> tuple[Obstacles, bool]:
        """Obstacles that are near, and whether floor is seen straight ahead.

        Args:
            fields, rows: of the left and the right camera, frames `[C, H, W]`, whole or cut.
        """
        size = (self.rig.height, self.rig.width)
        left, right = grey_pair(fields[0][None], fields[1][None], *self.rects, size)[0].float().numpy()
        correlation = floor_correlation(left, right, self.rects, self.rig, self.params)
        obstacles = reject_mismatches(self.obstacles(rows), correlation, self.rig, self.params)
        obstacles = reject_unoccluded(obstacles, left, right, self.rects, self.rig, self.params)
        return obstacles, correlation >= self.params.min_floor_correlation

    def obstacles(self, rows: tuple[Tensor, Tensor]) -> Obstacles:
        """Obstacles that are near, whatever the floor shows.

        Args:
            rows: of the left and the right camera, frames `[C, H, W]`, whole or cut.
        """
        size = (self.rig.height, self.rig.width)
        grey = grey_pair(rows[0][None], rows[1][None], self.row, self.row, size)[0, :, 0].float().numpy()
        return detect_obstacles(grey[0], grey[1], self.rig, self.params)
