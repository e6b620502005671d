"""A simulated car that has stopped for good respawns, as after a collision."""

from __future__ import annotations

from ndtorch.navigation import STOPPED
from ndtorch_robot.navigator_runner import NavigatorRunner
from ndtorch_robot.ports import Step
from ndtorch_robot.safety import SafeDrive
from ndtorch_robot.sim.simulation import Simulation

STOP_TIME = 2.0
"""Seconds after which a car that has stopped for good respawns."""


class AutoResume:
    """An observer that respawns and resumes a car that its cameras have stopped; this counts as a stop for good.

    Args:
        safe: the safety layer of the car.
        respawn: where stops are counted.
    """

    def __init__(self, safe: SafeDrive, respawn: Respawn) -> None:
        self.safe, self.respawn = safe, respawn
        self.since: float | None = None

    def __call__(self, step: Step) -> None:
        if step.standing is None:
            self.since = None
        elif self.since is None:
            self.since = step.time
        elif step.time - self.since >= STOP_TIME and (self.safe.blindness is not None or not self.safe.auto_recover):
            self.since = None
            self.respawn.stops.append(step.time)
            self.respawn.simulation.respawn()
            self.safe.resume()


class Respawn:
    """An observer that respawns a car whose controller has stopped for 2 s. On hardware a person does this.

    Attributes:
        stops: times at which the controller stopped for good.
    """

    def __init__(self, simulation: Simulation, runner: NavigatorRunner) -> None:
        self.simulation, self.runner = simulation, runner
        self.stops: list[float] = []
        self.stopped_steps = 0

    def __call__(self, step: Step) -> None:
        stopped = step.state is not None and self.runner.mode() == STOPPED
        self.stopped_steps = self.stopped_steps + 1 if stopped else 0
        if self.stopped_steps == 1 and step.frames is not None:
            self.stops.append(step.frames.time)
        if self.stopped_steps >= STOP_TIME * self.runner.rate:
            self.stopped_steps = 0
            self.simulation.respawn()
