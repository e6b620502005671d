"""`python -m tests.benchmarks.camera_monitor --minutes 480`: no false stop in any arena at any light.

Drives through all arenas with textured and with blank walls. What is seen is made darker or brighter and noisy, and
judged as on a car. Prints every false stop, and how long was driven; the exit code is 1 when there was one. Before a
wall without any mark that fills row and subfield a car does stop; this is counted by itself. So is a stop before a wall
with marks of which the undisturbed picture shows less contrast than a row must have, in the row and in the subfield: a
piece without marks, or a wall in the dark.
"""

from __future__ import annotations

import argparse
import itertools
import sys

import torch

from ndtorch.navigation import Strips
from ndtorch.navigation.controllers.registry import DEFAULT_CONTROLLER, make_controller
from ndtorch_robot.camera_monitor.frame_check import FrameCheck
from ndtorch_robot.camera_monitor.image_quality import measure
from ndtorch_robot.camera_monitor.limits import CameraLimits
from ndtorch_robot.config import RATE, DriveConfig
from ndtorch_robot.drive import drive
from ndtorch_robot.faults import FaultKind
from ndtorch_robot.ports import Step, StereoFrames
from ndtorch_robot.sim.arenas import arenas
from ndtorch_robot.sim.simulation import RIG

LIGHTS = ((1.0, 0.0), (1.0, 2.0), (0.25, 1.0), (1.4, 1.0))
"""Factor on the light, and standard deviation of the noise in levels of 255."""


LIMITS = CameraLimits()


class Judge:
    """An observer: the same drive at all lights."""

    def __init__(self, name: str) -> None:
        self.name, self.noise = name, torch.Generator().manual_seed(1)
        self.floor = make_controller(DEFAULT_CONTROLLER, RIG, 1 / RATE).fields
        self.fields = DriveConfig().options().fields(RIG)
        self.checks = {light: self.new() for light in LIGHTS}
        self.checks = {light: self.fresh() for light in LIGHTS}
        self.stops: list[str] = []
        self.steps = self.blank = 0

    def new(self) -> FrameCheck:
        """One that has seen nothing yet."""
        return FrameCheck(RIG, RATE, 0.1, floor=self.fields)

    def __call__(self, step: Step) -> None:
        assert step.frames is not None
        self.steps += 1
        for light, check in self.checks.items():
            frames = StereoFrames(*(self.lit(eye, *light) for eye in step.frames[:2]), step.frames.time)
            why = check.judge(frames, step.driven.speed, frames.time, step.driven.curvature)
            if why is None:
                continue
            self.checks[light] = self.new()
            if why.kind is FaultKind.BLANK and (
                "blank" in self.name or any(self.dark(eye, light[0]) for eye in step.frames[:2])
            ):
                self.blank += 1
            else:
                self.stops.append(f"{self.name} light {light} at {step.time:.1f} s: {why.message}")

    def fresh(self) -> FrameCheck:
        """As on a car: it looks for one floor in both pictures too."""
        return FrameCheck(RIG, RATE, 0.1, floor=self.floor)

    def lit(self, eye: torch.Tensor | Strips, factor: float, noise: float) -> Strips:
        """Strips as they would be at another light."""
        assert isinstance(eye, Strips)
        return Strips(*(self.part(part, factor, noise) for part in eye))

    def dark(self, eye: torch.Tensor | Strips, factor: float) -> bool:
        """Whether an undisturbed picture shows nothing at this light, however much that is of its brightness."""
        seen = measure(self.lit(eye, factor, 0.0)).statistics
        least = max(LIMITS.row_contrast_levels, LIMITS.field_contrast_levels)
        return seen.row_contrast < least and seen.field_contrast < least

    def part(self, part: torch.Tensor, factor: float, noise: float) -> torch.Tensor:
        """One picture."""
        levels = part * factor + noise * torch.randn(part.shape, generator=self.noise)
        return levels.round().clamp(0, 255).to(torch.uint8)


def main() -> int:
    """Drive, judge, tell."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=12.0, help="of simulated driving, each judged at every light")
    parser.add_argument("--seconds", type=float, default=60.0, help="of one drive")
    parser.add_argument("--seed", type=int, default=100, help="of the first building")
    chosen = parser.parse_args()
    torch.set_num_threads(1)
    driven = blank = 0
    stops: list[str] = []
    for seed in itertools.count(chosen.seed):
        for arena, walls in itertools.product(arenas(test=False), ("textured", "blank")):
            judge = Judge(f"{arena} {walls} seed {seed}")
            drive(
                DriveConfig.model_validate({"arena": arena, "walls": walls, "seed": seed, "seconds": chosen.seconds}),
                [judge],
            )
            driven, blank = driven + judge.steps, blank + judge.blank
            stops += judge.stops
            print("\n".join([f"{judge.name}: {len(judge.stops)} false stops", *judge.stops]), flush=True)
            if driven / RATE / 60 >= chosen.minutes:
                told = f"{len(stops)} false stops, {blank} before blank walls"
                print(f"{driven / RATE / 60:.0f} minutes at each of {len(LIGHTS)} lights: {told}")
                return bool(stops)
    return 0


if __name__ == "__main__":
    sys.exit(main())
