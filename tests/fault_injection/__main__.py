"""`python -m tests.fault_injection`: drive for hours of simulated time with injected faults (`make soak`).

Loop, safety layer, link and the firmware of the board are those of a car. Every stop must be explained by a fault, and
every fault must stop the wheels within its deadline; the pulses of the board say when the wheels turn. It needs a C
compiler. Exit code 1 when something was not as it must be.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from ndtorch_robot.link import HOSTED_BOARD
from ndtorch_robot.run import open_car
from ndtorch_robot.run_config import RunConfig, SimulationTable, read_run_config
from ndtorch_robot.sim.arenas import BUILDINGS
from tests.fault_injection.faults import FAULTS, Fault
from tests.fault_injection.injector import FaultInjector

FIRST_SEED = 50_000
"""Seeds of the buildings, which no other test uses."""


def drive_scenario(config: RunConfig, number: int, seconds: float, faults: Sequence[Fault] = FAULTS) -> FaultInjector:
    """Drive one scenario; its building, faults and their times follow from its number."""
    world = SimulationTable(arena=list(BUILDINGS)[number % len(BUILDINGS)], seed=FIRST_SEED + number)
    config = config.model_copy(update={"simulation": world, "cameras": None, "link": {"kind": HOSTED_BOARD}})
    with tempfile.TemporaryDirectory() as scratch, open_car(config, lambda line: None, go=True) as car:
        injector = FaultInjector(car, number, Path(scratch) / "recording.mcap", faults)
        car.observers.append(injector)
        car.run(seconds)
    return injector


def main() -> int:
    import torch

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("config", nargs="?", type=Path, default=Path("sim"), help="TOML file of the car, or its name")
    parser.add_argument("--minutes", type=float, default=10.0, help="simulated time in all, minutes")
    parser.add_argument("--scenario-seconds", type=float, default=180.0, help="simulated time of one scenario, s")
    parser.add_argument("--first-scenario", type=int, default=0, help="number that seeds building, faults and times")
    parser.add_argument("--only", nargs="+", choices=[fault.name for fault in FAULTS], help="faults to inject")
    options = parser.parse_args()
    config, rows, failures = read_run_config(options.config), [], 0
    faults = [fault for fault in FAULTS if options.only is None or fault.name in options.only]
    torch.set_num_threads(1)
    for n in range(max(1, round(60 * options.minutes / options.scenario_seconds))):
        injector = drive_scenario(config, options.first_scenario + n, options.scenario_seconds, faults)
        own = [row for row in injector.rows if "recovered_s" in row]
        rows += own
        failed = [*injector.unexplained, *(f"{row['fault']}: {row['failure']}" for row in own if row["failure"])]
        failures += len(failed)
        print(f"scenario {n}: {len(own)} faults, {len(injector.blank)} blank walls", *failed, sep="\n", flush=True)
    groups = pd.DataFrame(rows).groupby(["part", "fault"])
    times = groups[["reaction_s", "recovered_s"]].agg(["count", "median", "max"])
    print(times.to_string(), groups["failure"].count().to_string(), f"{failures} failures", sep="\n")
    return bool(failures)


if __name__ == "__main__":
    sys.exit(main())
