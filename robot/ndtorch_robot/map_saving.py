"""The map of a car that has driven, as files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from ndtorch.navigation.localisation.walls import pack
from ndtorch.navigation.map_files import save_map
from ndtorch_robot.pilot import Pilot
from ndtorch_robot.ports import Step

APART = 0.05
"""Metres between two places of the path that are kept."""


class WalkedPath:
    """An observer that keeps where the car believes that it was, for the free floor of a map.

    Attributes:
        places: x, y, m.
    """

    def __init__(self) -> None:
        self.places: list[tuple[float, float]] = []

    def __call__(self, step: Step) -> None:
        if step.state is None:
            return
        x, y = float(step.state.place.x), float(step.state.place.y)
        if not self.places or np.hypot(x - self.places[-1][0], y - self.places[-1][1]) >= APART:
            self.places.append((x, y))


def pilot_walls(pilot: Pilot) -> torch.Tensor | None:
    """What the localiser has gathered, as map files hold it; None where there is none."""
    if pilot.state is None or pilot.state.located is None:
        return None
    return pack(pilot.state.located.walls)


def save_pilot_map(folder: Path, pilot: Pilot, path: WalkedPath) -> None:
    """Write the map of a pilot that makes one."""
    grid = pilot.grid
    assert grid is not None
    cells = pilot.map_cells()
    save_map(folder, cells, grid, np.array(path.places).reshape(-1, 2), pilot_walls(pilot))
