"""What is right before a car that stands, and what is near to one that turns."""

from __future__ import annotations

import numpy as np
from torch import Tensor

from ndtorch.kernels.switch import kernels_wanted
from ndtorch.navigation.near_columns import without_unseen
from ndtorch.navigation.near_floor import floor_likeness
from ndtorch.navigation.near_params import NearParams
from ndtorch.navigation.near_things import Near, believed, near_things
from ndtorch.navigation.rig import Rect, StereoRig
from ndtorch.navigation.strips import grey_pair, row_rect


class NearCheck:
    """Looks at what is right before a car that stands.

    Args:
        rig: the camera pair.
        rects: the subfields of both images.
        params: its numbers.
    """

    def __init__(self, rig: StereoRig, rects: tuple[Rect, Rect], params: NearParams | None = None) -> None:
        self.rig, self.rects, self.params = rig, rects, params or NearParams()
        self.row = row_rect(rig)
        y = np.linspace(-self.params.beside, self.params.beside, 9, dtype=np.float32)
        self.across = Near(np.full_like(y, rig.forward + self.params.nearest), y)

    def __call__(self, fields: tuple[Tensor, Tensor], rows: tuple[Tensor, Tensor]) -> tuple[Near, bool]:
        """Things that are near, and whether floor is seen right ahead.

        Args:
            fields, rows: of the left and the right camera, frames `[C, H, W]`, whole or cut.
        """
        size = (self.rig.height, self.rig.width)
        floor = grey_pair(fields[0][None], fields[1][None], *self.rects, size)[0].float().numpy()
        by_kernel = kernels_wanted(*fields, *rows)
        likeness = floor_likeness(floor[0], floor[1], self.rects, self.rig, self.params, by_kernel)
        things = believed(self.things(rows), likeness, self.rig, self.params)
        things = without_unseen(things, floor[0], floor[1], self.rects, self.rig, self.params)
        return things, likeness >= self.params.floor

    def things(self, rows: tuple[Tensor, Tensor]) -> Near:
        """Things that are near, whatever the floor shows.

        Args:
            rows: of the left and the right camera, frames `[C, H, W]`, whole or cut.
        """
        size = (self.rig.height, self.rig.width)
        grey = grey_pair(rows[0][None], rows[1][None], self.row, self.row, size)[0, :, 0].float().numpy()
        return near_things(grey[0], grey[1], self.rig, self.params, kernels_wanted(*rows))
