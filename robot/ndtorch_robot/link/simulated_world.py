"""The simulated car itself as a drive: no board, no line, and time that passes only by waiting."""

from __future__ import annotations

from ndtorch.errors import InputError
from ndtorch.toml import Strict
from ndtorch_robot.link.registry import SIMULATED_WORLD, Opening, link
from ndtorch_robot.sim.simulation import Simulation


class WorldSettings(Strict):
    """`[link]` with `kind = "simulated-world"` has no further keys."""


@link(SIMULATED_WORLD, WorldSettings)
def open_world(settings: WorldSettings, opening: Opening) -> Simulation:
    """The world is its own drive."""
    if opening.simulation is None:
        raise InputError(f"link.kind = {SIMULATED_WORLD!r} needs the table [simulation]")
    return opening.simulation
