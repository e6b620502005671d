"""Where the time of a simulated drive goes, part by part and in transforms.

`python -m tests.benchmarks.bench_drive ranging [SECONDS]`
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable
from typing import Any

from ndtorch.navigation import GridMap
from ndtorch_robot.car import Car
from ndtorch_robot.drive import DriveConfig, drive
from ndtorch_robot.evaluation.record import Record
from ndtorch_robot.navigator_runner import NavigatorRunner
from ndtorch_robot.safety import SafeDrive
from ndtorch_robot.sim.cameras import Cameras
from ndtorch_robot.sim.simulation import Simulation
from tests.benchmarks.timing import Row, reference, table

PARTS: tuple[tuple[Any, str, str], ...] = (
    (Car, "step", "whole step"),
    (Car, "see", "cameras"),
    (Cameras, "render", "- rendered"),
    (SafeDrive, "see", "watch"),
    (NavigatorRunner, "step", "navigation"),
    (GridMap, "update", "- map"),
    (Record, "add", "record"),
    (Simulation, "wait_until", "physics"),
)


def rows(controller: str = "ranging", seconds: float = 15.0) -> list[Row]:
    """Medians over the steps of a drive through the hallway."""
    config = DriveConfig(arena="hallway", controller=controller, seconds=2.0)
    drive(config)
    times: dict[str, list[float]] = {}

    def timed(name: str, job: Callable[..., Any]) -> Callable[..., Any]:
        def run(*given: Any, **more: Any) -> Any:
            start = time.thread_time()
            out = job(*given, **more)
            times.setdefault(name, []).append(time.thread_time() - start)
            return out

        return run

    kept = [(owner, attribute, getattr(owner, attribute)) for owner, attribute, _ in PARTS]
    for (owner, attribute, job), (_, _, name) in zip(kept, PARTS, strict=True):
        setattr(owner, attribute, timed(name, job))
    one = timed("transform", reference)
    try:
        drive(config.model_copy(update={"seconds": seconds}), observers=[lambda step: one()])
    finally:
        for owner, attribute, job in kept:
            setattr(owner, attribute, job)
    steps, unit = len(times["whole step"]), statistics.median(times.pop("transform"))
    found = []
    for _, _, name in PARTS:
        middle = statistics.median(times[name]) * len(times[name]) / steps
        middle -= unit if name == "whole step" else 0.0  # in which the transform was taken
        found.append(Row(f"{controller}: {name}", f"{1e3 * middle:.2f} ms", "transform", f"{middle / unit:.1f}x"))
    whole = statistics.median(times["whole step"]) - unit + statistics.median(times["physics"])
    found.append(Row(f"{controller}: drive", f"{1 / 30 / whole:.1f}x", "real time", f"transform {1e6 * unit:.0f} us"))
    return found


if __name__ == "__main__":
    print(table("A simulated drive", rows(*sys.argv[1:2], *map(float, sys.argv[2:3]))))
