"""`python -m tests.fault_injection`: drive for hours of simulated time with injected faults (`make soak`)."""

from __future__ import annotations

import ctypes
import gc
import json
import secrets
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from ndtorch.cli.command_run import run_command
from ndtorch.errors import InputError
from ndtorch.run.folder import place_for
from ndtorch.utils.files import write_text
from ndtorch.utils.packages import code_digest, toml_file
from ndtorch.utils.signals import parts_kept
from ndtorch.utils.toml import read_toml
from ndtorch_robot.run_config import RunConfig
from ndtorch_robot.sim.firmware_host import FirmwareHost
from tests.fault_injection.faults import FAULTS
from tests.fault_injection.scenario import drive_scenario, resident_megabytes
from tests.fault_injection.table import failures, report, summary

FAILED = 1
"""Exit code when a stop, a reaction time or the memory was not as it must be."""


@dataclass(frozen=True)
class FaultInjection:
    """Drive for hours in simulated time while faults of cameras, link, disk and computer are injected at random.

    Loop, safety layer, link and the firmware of the board are those of a car. Every stop must be explained by a fault,
    every fault must stop the wheels within its deadline, and the memory must not grow. The pulses of the board say
    when the wheels turn. It needs a C compiler.

    Each finished scenario is kept in DIR: a run that was stopped continues there, and a longer run adds to a shorter
    one. Exit code 1 when something was not as it must be.
    """

    config: Annotated[Path, tyro.conf.Positional] = Path("sim")
    """TOML file of the car, or the name of one that comes along; its cameras and its link are replaced."""
    minutes: float = 10.0
    """Simulated time in all, minutes."""
    scenario_seconds: float = 180.0
    """Simulated time of one scenario, s; each drives in another building."""
    first_scenario: int = 0
    """Index of the first scenario. It seeds building, faults and times: use unused indices for held-out runs."""
    only: tuple[str, ...] = ()
    """Names of the faults that are injected, such as `swapped`; all by default."""
    out: Path = Path("out/fault-injection")
    """Folder for the scenarios and the table; another car or other code writes into DIR-2, and so on."""
    force: bool = False
    """Write into this folder whatever is in it."""
    json: bool = False
    """Print the figures as one JSON object and nothing else on stdout."""

    def run(self) -> int:
        """Drive the scenarios that are missing and write the table."""
        import torch

        if not 10 <= self.scenario_seconds <= 3600 or not 0 < self.minutes < 1e6:
            raise InputError(
                f"--minutes must be positive and --scenario-seconds 10 to 3600, "
                f"got {self.minutes:g} and {self.scenario_seconds:g}"
            )
        if not 0 <= self.first_scenario < 1_000_000:
            raise InputError(f"--first-scenario must be 0 to 999999, got {self.first_scenario}")
        faults = tuple(fault for fault in FAULTS if not self.only or fault.name in self.only)
        if unknown := set(self.only) - {fault.name for fault in faults}:
            raise InputError(f"--only: no fault is called {sorted(unknown)[0]!r}")
        config = read_toml(toml_file(self.config, "ndtorch_robot", "configs"), RunConfig)
        torch.set_num_threads(1)
        code = code_digest(("ndtorch", "ndtorch_robot"), ("torch", "numpy"))
        key = {"code": code, "config": config.model_dump_json(), "board": FirmwareHost.code()}
        key |= {"seconds": f"{self.scenario_seconds:g}", "faults": ", ".join(fault.name for fault in faults)}
        place = place_for(self.out, {"command": "fault injection"} | key, force=self.force)
        count = max(1, round(60 * self.minutes / self.scenario_seconds))
        numbers = range(self.first_scenario, self.first_scenario + count)
        files = [place.folder / f"scenario-{number:04d}.json" for number in numbers]
        every = sorted({*files, *place.folder.glob("scenario-*.json")})
        known = {file: found for file in every if (found := kept(file, key)) is not None}
        process = secrets.token_hex(4)
        with parts_kept(place.folder, "scenarios", len(files), lambda: sum(file in known for file in files)):
            for number, file in zip(numbers, files, strict=True):
                if file not in known:
                    found = drive_scenario(config, number, self.scenario_seconds, faults)
                    gc.collect()
                    if trim := getattr(ctypes.CDLL(None), "malloc_trim", None):  # of glibc: free memory is no leak
                        trim(0)
                    found |= {"process": process, "megabytes": round(resident_megabytes(), 1), "key": key}
                    write_text(file, json.dumps(found) + "\n")
                    known[file] = found
                for line in failures([known[file]]):
                    print(line, file=sys.stderr, flush=True)
                print(f"scenario {number}: {summary([known[file]])}", file=sys.stderr, flush=True)
                write_text(place.folder / "table.md", report(in_order(known)))
        scenarios = in_order(known)
        print(json.dumps(summary(scenarios)) if self.json else report(scenarios))
        return FAILED if failures(scenarios) else 0


def in_order(known: dict[Path, dict[str, Any]]) -> list[dict[str, Any]]:
    return [known[file] for file in sorted(known)]


def kept(file: Path, key: dict[str, str]) -> dict[str, Any] | None:
    """A scenario that was driven before by the same code with the same options; None where there is none."""
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return found if isinstance(found, dict) and found.get("key") == key else None


if __name__ == "__main__":
    sys.exit(run_command("python -m tests.fault_injection", FaultInjection, sys.argv[1:]))
