"""Links to a simulated car: through the firmware's own code, or to the simulated car itself."""

from __future__ import annotations

from ndtorch.errors import InputError
from ndtorch.utils.toml import Strict
from ndtorch_robot.link import HOSTED_BOARD, SIMULATED_WORLD, Opening, link
from ndtorch_robot.link.link_drive import LinkDrive
from ndtorch_robot.ports import CameraPair, Clock, Report
from ndtorch_robot.sim.simulation import Simulation
from ndtorch_robot.sim.stepped_world import SteppedWorld


class HostedSettings(Strict):
    """`[link]` with `kind = "hosted-board"`.

    Args:
        real_time: Simulated time does not run ahead of real time.
    """

    real_time: bool = False


class HostedDrive(LinkDrive):
    """A `LinkDrive` that has its board, and the world, with it. It needs no hardware."""

    def __init__(self, simulation: Simulation, board_name: str, report: Report, real_time: bool = False) -> None:
        self.world = SteppedWorld(simulation, self, real_time)
        super().__init__(self.world, self.world.now, board_name, report)
        self.world.await_welcome()

    def cameras_and_clock(self) -> tuple[CameraPair, Clock]:
        return self.world, self.world

    def close(self) -> None:
        super().close()
        self.world.close()


class WorldSettings(Strict):
    """`[link]` with `kind = "simulated-world"`, which has no further keys."""


@link(HOSTED_BOARD)
def open_hosted(settings: HostedSettings, opening: Opening) -> HostedDrive:
    return HostedDrive(world_of(opening, HOSTED_BOARD), opening.board_name, opening.report, settings.real_time)


@link(SIMULATED_WORLD)
def open_world(settings: WorldSettings, opening: Opening) -> Simulation:
    return world_of(opening, SIMULATED_WORLD)


def world_of(opening: Opening, kind: str) -> Simulation:
    if opening.simulation is None:
        raise InputError(f"link.kind = {kind!r} needs the table [simulation]")
    return opening.simulation
