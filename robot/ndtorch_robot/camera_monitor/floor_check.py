"""How well the floor ahead of a stationary car can be seen, measured before it drives."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import torch

from ndtorch.navigation import StereoRig
from ndtorch.navigation.controllers.ranging._kernels_floor import (
    FULL_SHARE,
    FloorState,
    known_share,
    lower_median,
    speed_share,
)
from ndtorch.navigation.controllers.ranging.control import RangingControl
from ndtorch.navigation.proximity.check import ProximityCheck
from ndtorch.navigation.stereo.strips import Strips, as_frames, grey_pair, strips
from ndtorch_robot.ports import StereoFrames

FRAMES = 15
"""Pairs of frames whose noise is measured: half a second."""


class FloorFound(NamedTuple):
    """How the ranging controller would see a floor.

    Attributes:
        share: share of the view in which the floor differs from noise at full speed, 0..1.
        speed: share of its speed at which the car would drive, 0..1.
        noise: output of the motion detectors while the car is stationary.
        noisy: whether this is more than the 256 levels of an image cause.
        ahead: both cameras see one floor right ahead.
        near: distance of the nearest obstacle from the middle of the car, m; None where there is none.
    """

    share: float
    speed: float
    noise: float
    noisy: bool
    ahead: bool
    near: float | None

    @property
    def good(self) -> bool:
        """Whether the car would start here, and drive at full speed."""
        return self.ahead and self.near is None and self.share >= FULL_SHARE

    def words(self) -> list[str]:
        """The findings, a line each."""
        why = "the images are noisy" if self.noisy else "the floor shows little, or it is dark"
        seen = f"the floor differs from noise in {100 * self.share:.0f} % of the view"
        drives = f"drive at {100 * self.speed:.0f} % of its speed" if self.speed > 0 else "not start"
        good = self.share >= FULL_SHARE
        lines = [f"{seen}: good" if good else f"not right: {seen}: the car would {drives}; {why}"]
        if self.near is not None:
            lines.append(f"not right: an obstacle is {self.near:.2f} m ahead of the middle of the car")
        elif not self.ahead:
            lines.append("not right: both cameras together see no floor 0.8 to 1.15 m ahead of them")
        return lines


def measure_floor(read: Callable[[], StereoFrames], rig: StereoRig, rate: float, speed: float = 0.5) -> FloorFound:
    """Measure the floor ahead of a stationary car.

    The noise is the output of the motion detectors of the ranging controller while nothing moves. The output of the
    moving floor follows from shifted images: the same frame some rows farther up takes the place of the frame before.
    Steady motion gives the same, since the filters of the detectors decay within a frame.

    Args:
        read: gives `rate` pairs of frames a second.
        speed: at which the car is to drive, m/s.
    """
    control = RangingControl(rig, 1 / rate)
    control.at_speed(speed)
    with torch.inference_mode():
        state, noise, frames = None, [], read()
        for _ in range(FRAMES):
            cells, state = control.see(as_frames(strips(frames.left).field[0], strips(frames.right).field[0]), state)
            noise.append(float(lower_median(cells[:2].ravel())))
            frames = read()
        still = sum(noise[1:]) / (FRAMES - 1)
        ours, theirs = strips(frames.left), strips(frames.right)
        level = moved_level(control, ours, theirs, rig)
        share = known_share(FloorState(level, still, 2**31), control.tables.floor)
        fields, rows = (ours.field[0], theirs.field[0]), (ours.row[0], theirs.row[0])
        scan = ProximityCheck(rig, control.fields)(fields, rows)
    near = float(scan.obstacles.x.min()) if len(scan.obstacles.x) else None
    noisy = still > control.params.min_noise_output
    return FloorFound(float(share), float(speed_share(share)), still, noisy, scan.floor_seen, near)


def moved_level(control: RangingControl, left: Strips, right: Strips, rig: StereoRig) -> Any:
    """The level that the controller would learn from this floor, `[bands]`: see `floor_step`."""
    p, bands = control.tables.floor, control.params.floor.bands
    pair = grey_pair(left.field, right.field, *control.fields, (rig.height, rig.width))
    ours, theirs = pair[0].unsqueeze(1)
    steady = []
    for band in range(max(1, bands * 2 // 5)):
        rows = max(1, round(-math.log1p(-float(p.full[band])) / -p.saturation))
        # The car goes ahead: what is seen now was so many rows farther up before.
        _, state = control.see(as_frames(*(eye.roll(-rows, -2) for eye in (ours, theirs))))
        cells, _ = control.see(as_frames(ours, theirs), state)
        steady.append(cells[:2, band] / -math.expm1(rows * p.saturation))
    level: Any = lower_median(np.stack(steady).ravel()) * p.profile
    return level
