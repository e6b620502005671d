"""A piece of a soak from its number: the arena, the faults and their times are always the same."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ndtorch_robot.link.hosted_board import HostedDrive
from ndtorch_robot.link.registry import HOSTED_BOARD
from ndtorch_robot.ports import Observer, Step
from ndtorch_robot.run import open_car
from ndtorch_robot.run_config import RunConfig, SimulationTable
from ndtorch_robot.sim.arenas import ARENAS
from ndtorch_robot.sim.put_back import PutBack, TellAgain
from ndtorch_robot.soak.eyes import FailingCameras
from ndtorch_robot.soak.trial import Trials

FIRST_SEED = 50_000
"""Buildings of a soak are no others'."""

Piece = dict[str, Any]


def drive_piece(config: RunConfig, number: int, seconds: float, tell: Callable[[float], None]) -> Piece:
    """Drive for so long, s of simulated time; returns what came of it.

    Args:
        config: of a car; its link and its world are replaced.
        number: of the piece.
        tell: told the seconds driven so far.
    """
    arena = list(ARENAS)[number % len(ARENAS)]
    world = SimulationTable(arena=arena, seed=FIRST_SEED + number)
    config = config.model_copy(update={"simulation": world, "cameras": None, "link": {"kind": HOSTED_BOARD}})
    lines: list[str] = []
    began = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="soak-") as scratch, open_car(config, lines.append, go=True) as car:
        assert isinstance(car.drive, HostedDrive)
        cameras = FailingCameras(car.drive.world, number)
        car.cameras = cameras
        trials = Trials(car, car.drive.world, cameras, number, Path(scratch) / "recording")
        simulation = car.drive.world.simulation
        put_back = PutBack(simulation, car.pilot)

        def told(step: Step) -> None:
            if step.number % 300 == 299:
                tell(simulation.now())

        car.observers += [put_back, trials, go_elsewhere(trials, put_back), told]
        car.run(seconds)
        return {
            "number": number,
            "arena": arena,
            "seconds": round(simulation.now(), 3),
            "wall_seconds": round(time.monotonic() - began, 1),
            "steps": car.loop.steps,
            "collisions": len(simulation.collisions),
            "controller_stops": len(put_back.stops),
            "unexplained": trials.unexplained,
            "blank": trials.blank,
            "carried": trials.carried,
            "faults": [row for row in trials.rows if "on after" in row],
        }


def go_elsewhere(trials: Trials, put_back: PutBack) -> Observer:
    """Before a blank wall a car stands for the rest of the piece, and tries nothing, unless it is put elsewhere."""
    tell_again = TellAgain(trials.car.safe, put_back)

    def observe(step: Step) -> None:
        if trials.fault is None:
            tell_again(step)

    return observe


def resident_megabytes() -> float:
    """Memory of this process, MB; 0 where the system does not say."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except (OSError, ValueError, IndexError):
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6
