"""`python -m tests.fault_injection`: drive for hours of simulated time with injected faults (`make soak`).

Loop, safety layer, link and the firmware of the board are those of a car. Every stop must be explained by a fault, and
every fault must stop the wheels within its deadline; the pulses of the board say when the wheels turn. It needs a C
compiler. Exit code 1 when something was not as it must be.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from statistics import median
from typing import Any

from ndtorch_robot.run_config import read_run_config
from tests.fault_injection.faults import FAULTS
from tests.fault_injection.scenario import drive_scenario, resident_megabytes


def table(scenarios: list[dict[str, Any]]) -> str:
    """One line for each fault, in Markdown."""
    lines = ["| part | fault | max reaction s | injected | failed | median s | longest s | recovery s |"]
    lines.append("|---|---|---:|---:|---:|---:|---:|---:|")
    rows = [row for scenario in scenarios for row in scenario["faults"]]
    for fault in FAULTS:
        own = [row for row in rows if (row["part"], row["fault"]) == fault[:2]]
        reaction = [row["reaction_s"] for row in own if row["reaction_s"] is not None]
        recovery = [row["recovered_s"] for row in own if row["recovered_s"] is not None]
        deadline = "drives on" if fault.max_reaction_s is None else f"{fault.max_reaction_s:g}"
        failed = sum(row["failure"] is not None for row in own)
        times = f"{median(reaction):.2f} | {max(reaction):.2f}" if reaction else "- | -"
        back = f"{median(recovery):.1f}" if recovery else "-"
        lines.append(f"| {fault.part} | {fault.name} | {deadline} | {len(own)} | {failed} | {times} | {back} |")
    return "\n".join(lines)


def failures(scenario: dict[str, Any]) -> list[str]:
    """Every unexplained stop and late reaction, one line each."""
    where = f"scenario {scenario['number']}, {scenario['arena']}"
    failed = [row for row in scenario["faults"] if row["failure"] is not None]
    return [
        *(f"{where}: unexplained stop at {line}" for line in scenario["unexplained"]),
        *(f"{where}, {row['time_s']:.2f} s: {row['part']}, {row['fault']}: {row['failure']}" for row in failed),
    ]


def main() -> int:
    import torch

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("config", nargs="?", type=Path, default=Path("sim"), help="TOML file of the car, or its name")
    parser.add_argument("--minutes", type=float, default=10.0, help="simulated time in all, minutes")
    parser.add_argument("--scenario-seconds", type=float, default=180.0, help="simulated time of one scenario, s")
    parser.add_argument("--first-scenario", type=int, default=0, help="number that seeds building, faults and times")
    parser.add_argument("--only", nargs="+", choices=[fault.name for fault in FAULTS], help="faults to inject")
    options = parser.parse_args()
    config, scenarios, failed = read_run_config(options.config), [], []
    faults = [fault for fault in FAULTS if options.only is None or fault.name in options.only]
    torch.set_num_threads(1)
    for n in range(max(1, round(60 * options.minutes / options.scenario_seconds))):
        scenarios.append(drive_scenario(config, options.first_scenario + n, options.scenario_seconds, faults))
        failed += failures(scenarios[-1])
        done = ", ".join(f"{len(scenarios[-1][key])} {key}" for key in ("faults", "unexplained", "blank"))
        print(f"scenario {n}: {done}, {resident_megabytes():.0f} MB", *failures(scenarios[-1]), sep="\n", flush=True)
    hours = sum(scenario["seconds"] for scenario in scenarios) / 3600
    print(table(scenarios), f"\n{hours:.2f} hours, {len(failed)} failures", *failed, sep="\n")
    return bool(failed)


if __name__ == "__main__":
    sys.exit(main())
