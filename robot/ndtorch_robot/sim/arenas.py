"""The arenas by name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ndtorch.errors import InputError
from ndtorch.nearest import meant
from ndtorch_robot.sim.corridors import curve, hallway, loop, room
from ndtorch_robot.sim.generated import office, random_building
from ndtorch_robot.sim.plan import Plan
from ndtorch_robot.sim.trials import TRIALS

ARENAS: dict[str, Callable[[int], Plan]] = {
    "hallway": hallway,
    "curve": curve,
    "loop": loop,
    "room": room,
    "office": office,
    "random": random_building,
}
"""Buildings that the controllers were made in."""

ALL = ARENAS | TRIALS
"""Those, and places that the controllers were not made for."""


def load_arena(name: str, seed: int = 0) -> Plan:
    """The plan of an arena by name, or of a file that ends in `.toml`.

    Raises:
        InputError: no such arena, or a file that cannot be used.
    """
    if name.endswith(".toml"):
        from ndtorch_robot.sim.arena_file import read_arena

        return read_arena(Path(name))
    if name not in ALL:
        raise InputError(f"no arena {name!r}, choose one of {', '.join(ALL)} or a .toml file{meant(name, ALL)}")
    return ALL[name](seed)
