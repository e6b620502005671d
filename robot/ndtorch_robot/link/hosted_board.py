"""The link of a car to the firmware's own code in simulated time: no hardware, and as fast as this computer can."""

from __future__ import annotations

from ndtorch.errors import InputError
from ndtorch.toml import Strict
from ndtorch_robot.link.line import Line
from ndtorch_robot.link.link_drive import LinkDrive
from ndtorch_robot.link.registry import HOSTED_BOARD, Opening, link
from ndtorch_robot.ports import CameraPair, Clock, Report
from ndtorch_robot.sim.lockstep_world import LockstepWorld
from ndtorch_robot.sim.simulation import Simulation


class HostedSettings(Strict):
    """`[link]` with `kind = "hosted-board"` has no further keys."""


class HostedDrive(LinkDrive):
    """A `LinkDrive` that has its board, and the world, with it."""

    def __init__(self, simulation: Simulation, robot: str, report: Report) -> None:
        self.world = LockstepWorld(simulation, self)
        super().__init__(Line(self.world, self.world.now), self.world.now, robot, report)
        self.world.await_welcome()

    def sight(self) -> tuple[CameraPair, Clock]:
        """Pictures of the world that the pulses move, and its time."""
        return self.world, self.world

    def close(self) -> None:
        """Stop, and end the board."""
        super().close()
        self.world.close()


@link(HOSTED_BOARD, HostedSettings)
def open_hosted(settings: HostedSettings, opening: Opening) -> HostedDrive:
    """Compile the board's code and greet it."""
    if opening.simulation is None:
        raise InputError(f"link.kind = {HOSTED_BOARD!r} needs the table [simulation]")
    return HostedDrive(opening.simulation, opening.robot, opening.report)
