"""How long each step of a drive takes that searches for what stands: `python -m tests.benchmarks.every_step`.

The frames are those of a drive before a sofa. Navigators with and without the search go through them in turn.
"""

from __future__ import annotations

import copy
import statistics
import sys
import time
from dataclasses import replace

import torch

from ndtorch.navigation.controllers.ranging.control import RangingControl
from ndtorch_robot.config import DriveConfig
from ndtorch_robot.drive import drive, drive_runner
from ndtorch_robot.sim.arenas import load_arena
from tests.benchmarks.timing import Row, table

ROUNDS, BEGIN = 8, 25
"""How often the frames are gone through, and how many steps at the beginning do not count: it learns its floor."""

LIMITS = (200.0, 400.0)
"""us"""


def main(arena: str = "sofa", seed: int = 103, seconds: float = 8.0) -> list[Row]:
    """Of steps without a search, with one, and with a look at what is near."""
    torch.set_num_threads(1)
    config, frames = DriveConfig(arena=arena, seed=seed, seconds=seconds), []
    drive(config, [lambda step: frames.append(copy.deepcopy((step.frames.left, step.frames.right)))])
    usual = drive_runner(config, load_arena(arena, seed)).navigator
    plain = drive_runner(config, load_arena(arena, seed)).navigator
    control = plain.controller
    plain.controller = RangingControl(plain.ranging.rig, plain.reckoning.dt, replace(control.params, overhangs=False))
    kinds = {
        (False, False): "no search",
        (True, False): "a search",
        (False, True): "a look at what is near",
        (True, True): "both",
    }
    found: dict[str, list[float]] = {kind: [] for kind in kinds.values()}
    every: dict[str, list[float]] = {"with": [], "without": []}
    asked = usual.controller.sensing_requests
    looks: list[tuple[bool, bool]] = []

    def noted(state: object) -> tuple[bool, bool]:
        looks.append(asked(state))
        return looks[-1]

    usual.controller.sensing_requests = noted
    with torch.inference_mode():
        for turn in range(ROUNDS):
            for name, navigator in (("with", usual), ("without", plain)):
                state = None
                for n, eyes in enumerate(frames):
                    looks.clear()
                    start = time.thread_time()
                    _, state = navigator(*eyes, state)
                    taken = 1e6 * (time.thread_time() - start)
                    if not turn or n < BEGIN:
                        continue
                    every[name].append(taken)
                    if name == "with":
                        found[kinds[tuple(looks[-1]) if looks else (False, False)]].append(taken)
    middle = statistics.median(every["without"])
    rows = []
    for kind, times in {**found, "all": every["with"]}.items():
        if times:
            under = " and ".join(f"{100 * sum(t < limit for t in times) / len(times):.1f}" for limit in LIMITS)
            figure = f"{statistics.median(times):.0f} us, mean {statistics.fmean(times):.0f}"
            under = f"{under} % of {len(times)} under 200 and 400 us"
            rows.append(Row(f"steps with {kind}", figure, under, f"{statistics.median(times) / middle:.2f}x"))
    rows.append(Row("steps of a navigator that never searches", f"{middle:.0f} us", "", "1.00x"))
    mean = statistics.fmean(every["with"]) / statistics.fmean(every["without"])
    return [*rows, Row("mean of all steps", "", "never searches", f"{mean:.2f}x")]


if __name__ == "__main__":
    print(table("Steps of `ranging`", main(*sys.argv[1:2])))
