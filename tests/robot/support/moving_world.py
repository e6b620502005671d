"""Pictures for cameras that nobody has."""

import numpy as np
import torch

from ndtorch.navigation import StereoRig
from ndtorch_robot.ports import StereoFrames

RIG = StereoRig(width=64, height=48, focal=43.0)


def moving_world(count, rig, seed=0, grain=3):
    """Pictures that slide past, at two speeds, so that the navigator has something to do.

    Args:
        grain: so many neighbouring pixels are alike; with fewer than 3 a camera may count as one that shows noise.
    """
    rng = np.random.default_rng(seed)
    wall = rng.integers(0, 256, (rig.height, 4 * rig.width, 3), dtype=np.uint8).repeat(grain, 1)
    for n in range(count):
        parts = [wall[:, (k + n * speed) % (3 * rig.width) :][:, : rig.width].copy() for k, speed in ((0, 1), (9, 3))]
        left, right = (torch.from_numpy(part).permute(2, 0, 1)[None] for part in parts)
        yield StereoFrames(left, right, n / 30)
