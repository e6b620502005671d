"""Memory of the loop of a car over an hour of driving: `python -m tests.benchmarks.memory [--minutes 60]`.

The very loop of `ndtorch run` (navigator with its map, safety layer, timing) drives through the simulated
building as fast as it can, on simulated time. Only the serial link and its board are left out, which keep real time.
The resident memory is printed ten times; the exit code is 1 when it grew by more than 10 MB after the first quarter.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import torch

from ndtorch.memory import tune_allocator
from ndtorch_robot.ports import Step
from ndtorch_robot.run import make_car
from ndtorch_robot.run_config import NavigationTable, RunConfig, SimulationTable
from ndtorch_robot.sim.arenas import load_arena
from ndtorch_robot.sim.simulation import Simulation

GROWTH = 10.0
"""MB that the memory may grow by after the first quarter: the figures of the last quarter of an hour are kept."""


def resident() -> float:
    """Memory of this process that is in use, MB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096 / 1e6


def measure(minutes: float) -> list[tuple[float, float]]:
    """Drive, and give the simulated minutes and the memory ten times on the way."""
    torch.set_num_threads(1)
    tune_allocator()
    config = RunConfig(
        robot="memory",
        simulation=SimulationTable(arena="curve", seed=11),
        navigation=NavigationTable(map_half_size_m=10.0),
    )
    choice, rig = config.navigation.options(), config.rig.rig()
    simulation = Simulation(load_arena("curve", 11), 11, rig=rig, fields=choice.fields(rig))
    steps = round(minutes * 60 * config.rate_hz)
    measured: list[tuple[float, float]] = []
    faults: list[str] = []
    began = time.monotonic()

    def look(step: Step) -> None:
        if (step.number + 1) % (steps // 10) == 0:
            measured.append(((step.number + 1) / config.rate_hz / 60, resident()))
            took = time.monotonic() - began
            print(f"{measured[-1][0]:5.1f} min  {measured[-1][1]:7.1f} MB  ({took:.0f} s)", flush=True)

    car = make_car(config, simulation, rig, simulation, simulation, faults.append, True, [look])
    try:
        made = car.run((steps - 1.5) / config.rate_hz)
    finally:
        simulation.close()
    p50 = car.loop.timer.summary()["step"]["p50"]
    hits = len(simulation.collisions)
    print(f"{made} steps of {p50:.2f} ms, {hits} collisions, {len(faults)} lines of the safety layer")
    return measured


def main() -> int:
    """Measure and judge."""
    parser = argparse.ArgumentParser(description="Memory of the loop of a car")
    parser.add_argument("--minutes", type=float, default=60.0, help="simulated minutes (default 60)")
    asked = parser.parse_args()
    measured = measure(asked.minutes)
    grown = max(megabytes for _, megabytes in measured[2:]) - measured[2][1]
    print(f"grown by {grown:.1f} MB after the first quarter")
    return int(grown > GROWTH)


if __name__ == "__main__":
    sys.exit(main())
