"""A scenario from its number: building, faults and their times follow from it."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ndtorch_robot.drive import Respawn
from ndtorch_robot.link import HOSTED_BOARD
from ndtorch_robot.link.simulated import HostedDrive
from ndtorch_robot.ports import Observer, Step
from ndtorch_robot.run import open_car
from ndtorch_robot.run_config import RunConfig, SimulationTable
from ndtorch_robot.sim.arenas import BUILDINGS
from tests.fault_injection.camera_faults import FaultyCameras
from tests.fault_injection.faults import FAULTS, Fault
from tests.fault_injection.injector import FaultInjector

FIRST_SEED = 50_000
"""Seeds of the buildings, which no other test uses."""

Scenario = dict[str, Any]


def drive_scenario(config: RunConfig, number: int, seconds: float, faults: Sequence[Fault] = FAULTS) -> Scenario:
    """Drive one scenario; returns its figures and one row a fault.

    Args:
        config: of a car; its link and its world are replaced.
        number: of the scenario.
        seconds: of simulated time.
        faults: that are injected.
    """
    names = list(BUILDINGS)
    arena = names[number % len(names)]
    world = SimulationTable(arena=arena, seed=FIRST_SEED + number)
    config = config.model_copy(update={"simulation": world, "cameras": None, "link": {"kind": HOSTED_BOARD}})
    lines: list[str] = []
    with tempfile.TemporaryDirectory() as scratch, open_car(config, lines.append, go=True) as car:
        assert isinstance(car.drive, HostedDrive)
        cameras = FaultyCameras(car.drive, number)
        car.cameras = cameras
        injector = FaultInjector(car, car.drive, cameras, number, Path(scratch) / "recording.mcap", faults)
        simulation = car.drive.simulation
        car.observers += [injector, resume_elsewhere(injector)]
        car.run(seconds)
        return {
            "number": number,
            "arena": arena,
            "seconds": round(simulation.now(), 3),
            "collisions": len(simulation.collisions),
            "unexplained": injector.unexplained,
            "blank": injector.blank,
            "faults": [row for row in injector.rows if "recovered_s" in row],
        }


def resume_elsewhere(injector: FaultInjector) -> Observer:
    """An observer that moves a car away which would stand before a wall for the rest of the scenario."""
    car = injector.car
    assert isinstance(car.drive, HostedDrive)
    respawn = Respawn(car.drive.simulation, car.runner, car.safe)

    def observe(step: Step) -> None:
        if injector.fault is None:
            respawn(step)

    return observe


def resident_megabytes() -> float:
    """Memory of this process, MB."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
