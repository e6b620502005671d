"""How well the floor ahead of a stationary car can be seen, measured before it drives."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor

from ndtorch.navigation import StereoRig
from ndtorch.navigation.controllers.ranging.caution import FULL, known_share, speed_share
from ndtorch.navigation.controllers.ranging.control import RangingControl
from ndtorch.navigation.controllers.ranging.floor import FloorState
from ndtorch.navigation.proximity.check import ProximityCheck
from ndtorch.navigation.strips import Strips, grey_pair, strips
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
        return self.ahead and self.near is None and self.share >= FULL

    def words(self) -> list[str]:
        """The findings, a line each."""
        why = "the images are noisy" if self.noisy else "the floor shows little, or it is dark"
        seen = f"the floor differs from noise in {100 * self.share:.0f} % of the view"
        if self.share >= FULL:
            lines = [f"{seen}: good"]
        elif self.speed > 0:
            lines = [f"not right: {seen}: the car would drive at {100 * self.speed:.0f} % of its speed; {why}"]
        else:
            lines = [f"not right: {seen}: the car would not start; {why}"]
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
        read: gives pairs of frames.
        rig: the cameras.
        rate: pairs a second.
        speed: at which the car is to drive, m/s.
    """
    control = RangingControl(rig, 1 / rate)
    control.full_flow = control.full_flow * (speed / control.params.speed)
    with torch.inference_mode():
        state, noise, frames = None, [], read()
        for _ in range(FRAMES):
            left, right = strips(frames.left), strips(frames.right)
            cells, state = control.look(left.field, right.field, state)
            noise.append(float(cells[0, :2].median()))
            frames = read()
        still = sum(noise[1:]) / max(1, len(noise) - 1)
        ours, theirs = strips(frames.left), strips(frames.right)
        level = moved_level(control, ours, theirs, rig)
        known = torch.tensor(math.inf)
        floor = FloorState(level, torch.tensor(still), known)
        share = known_share(floor, control.full_flow, control.params.least_noise, control.floor)
        fields, rows = (ours.field[0], theirs.field[0]), (ours.row[0], theirs.row[0])
        things, ahead = ProximityCheck(rig, control.fields)(fields, rows)
    near = float(things.x.min()) if len(things.x) else None
    noisy = still > control.params.least_noise
    return FloorFound(float(share), float(speed_share(share)), still, noisy, ahead, near)


def moved_level(control: RangingControl, left: Strips, right: Strips, rig: StereoRig) -> Tensor:
    """The level that the controller would learn from this floor, `[bands]`: see `floor_step`."""
    c, bands = control.floor, control.params.floor.bands
    size = (rig.height, rig.width)
    pair = grey_pair(left.field, right.field, *control.fields, size)
    near = max(1, bands * 2 // 5)
    steady = []
    for band in range(near):
        rows = max(1, round(float(control.full_flow[band])))
        # The car goes ahead: what is seen now was so many rows farther up before.
        before = pair.roll(-rows, -2)
        eyes = [eye.unsqueeze(-3) for eye in before.unbind(-3)]
        _, state = control.look(eyes[0], eyes[1])
        now = [eye.unsqueeze(-3) for eye in pair.unbind(-3)]
        cells, _ = control.look(now[0], now[1], state)
        shape = -math.expm1(rows * float(c.saturation))
        steady.append(cells[0, :2, band] / shape)
    return torch.stack(steady).median() * c.profile
