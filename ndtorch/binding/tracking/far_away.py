"""Small things far away: a region of a few pixels is a thing where nothing larger is near, and a piece elsewhere."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ndtorch.binding.tracking.figure_params import FigureParams
from ndtorch.binding.tracking.figures import PIXELS, Figure
from ndtorch.binding.tracking.regions import Regions
from ndtorch.binding.tracking.silhouettes import told


def without_pieces(regions: Regions, figures: Sequence[Figure], time: float, p: FigureParams) -> Regions:
    """Regions without those smaller than `smallest` that are near a larger one, or where a larger track is expected.

    Args:
        regions: of a step.
        figures: open tracks.
        time: seconds.
        p: constants.
    """
    labels, boxes, areas = regions
    small, (height, width) = areas < p.smallest * labels.size, labels.shape
    if not small.any():
        return regions
    around = [one.box(time, p.ahead) for one in figures if not tiny(one, width / height, p)]
    large = np.concatenate([boxes[~small] / height, np.array(around).reshape(-1, 4)])
    keep, mine = ~small, boxes[small, None] / height
    # The larger gap of rows and columns, to the nearest of them.
    gaps = np.maximum(mine[..., :2] - large[:, 2:], large[:, :2] - mine[..., 2:]).max(2).min(1, initial=np.inf)
    keep[small] = gaps >= p.alone
    if keep.all():
        return regions
    number = np.zeros(len(areas) + 1, np.int32)
    number[1:][keep] = np.arange(1, keep.sum() + 1)
    return Regions(told(labels, number), boxes[keep], areas[keep])


def tiny(one: Figure, width: float, p: FigureParams) -> bool:
    """Whether a track never had a region of `smallest`, in a picture so many heights wide."""
    least = p.smallest * width
    return one.last[PIXELS] < least and bool(one.path[:, PIXELS].max() < least)
