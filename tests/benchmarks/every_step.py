"""How long each step of a drive takes, from frame to command, with a map: `python -m tests.benchmarks.every_step`.

The frames are those of a drive before a sofa. The navigators go through them in turn; times are of the processor.
"""

from __future__ import annotations

import copy
import time

import numpy as np
import torch

from ndtorch.navigation import STOPPED, SUPPRESSED, Navigator
from ndtorch_robot.config import DriveConfig
from ndtorch_robot.drive import drive, drive_runner
from ndtorch_robot.sim.arenas import load_arena
from tests.benchmarks.timing import Row, table

TITLE = "Every step of a drive, with a map"
ROUNDS, LIMIT_MS = 8, 1.0

NAVIGATORS = {
    "published": {"controller": "published"},
    "ranging": {},
    "ranging, features": {"stereo": "features"},
    "ranging, localise": {"localise": True},
}
"""Options, beside those of the drive."""


def part(navigator: Navigator, state: object) -> str:
    """What a step from a state does beside the usual: the near check of both cameras, or their rows."""
    near, control = navigator.near, getattr(state, "control", None)
    if near is None or control is None:
        return "near check" if near is not None else ""
    controller = navigator.controller
    if abs(state.command[0]) < 0.02 and controller.mode(control) in (SUPPRESSED, STOPPED):  # type: ignore[attr-defined]
        return "near check"
    ahead, rows = controller.sensing_requests(control)
    return "near rows" if rows else "search" if ahead and near.searching is not None else ""


def rows(device: str | None = None, arena: str = "sofa", seed: int = 103, seconds: float = 8.0) -> list[Row]:
    """Percentiles of all steps, and of those with a part that not every step has."""
    config, steps = DriveConfig(arena=arena, seed=seed, seconds=seconds, full_frames=True), []
    drive(config, [lambda step: steps.append((copy.deepcopy(step.frames), step.driven))])
    runners = {
        name: drive_runner(DriveConfig(arena=arena, seed=seed, seconds=seconds, **options), load_arena(arena, seed))
        for name, options in NAVIGATORS.items()
    }
    found: dict[str, list[float]] = {}
    with torch.inference_mode():
        for turn in range(ROUNDS + 1):
            for name, runner in runners.items():
                runner.state = None
                for frames, driven in steps:
                    beside = part(runner.navigator, runner.state)
                    start = time.thread_time()
                    runner.step(frames, driven)
                    if turn:
                        taken = 1e3 * (time.thread_time() - start)
                        for kind in {name, f"{name}: {beside}" if beside else name}:
                            found.setdefault(kind, []).append(taken)
    made = []
    for kind, times in sorted(found.items()):
        p50, p99, p999 = np.percentile(times, (50, 99, 99.9))
        share = 100 * float(np.mean(np.array(times) <= LIMIT_MS))
        figure = f"{p50:.2f}, {p99:.2f}, {p999:.2f} ms (median, 99, 99.9 %)"
        made.append(Row(kind, figure, f"{share:.1f} % of {len(times)} in {LIMIT_MS:g} ms", f"{p999 / p50:.1f}x"))
    return made


if __name__ == "__main__":
    torch.set_num_threads(1)
    print(table(TITLE, rows()))
