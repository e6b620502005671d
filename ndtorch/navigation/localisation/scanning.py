"""What a look at both rows ranges."""

from __future__ import annotations

import numpy as np
from torch import Tensor

from ndtorch.navigation.localisation.params import LocaliserParams
from ndtorch.navigation.localisation.walls import Scan
from ndtorch.navigation.ranging import triangulate
from ndtorch.navigation.rig import StereoRig
from ndtorch.navigation.row_search import search_rows


def scan_rows(rows: Tensor, rig: StereoRig, params: LocaliserParams) -> Scan:
    """What is ranged in both gray rows `[2, W]`; what is too near or too far to count weighs nothing."""
    p = params
    ranges = triangulate(search_rows(rows.detach().cpu(), p.search), rig)
    x, y = (part[ranges.valid].double().numpy() for part in (ranges.x, ranges.y))
    distance = np.hypot(x, y)
    weight = np.minimum(1.0, (p.full / np.maximum(distance, p.near)) ** 2)
    return Scan(x, y, np.where((distance > p.near) & (distance < p.far), weight, 0.0))
