"""How long each step of a drive takes, with a map: `python -m tests.benchmarks.every_step [PICTURE.png]`.

First the time from the frames to the command, then that of what follows it: map, localiser, checks for the next
command. The frames are those of a drive before a sofa. The navigators go through them in turn; times are of the
processor. What a step itself takes is its least time in all turns: interruptions and cold caches come at other steps
in each of them.
"""

from __future__ import annotations

import copy
import sys
import time
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import torch

from ndtorch_robot.config import DriveConfig
from ndtorch_robot.drive import drive, drive_runner
from ndtorch_robot.sim.arenas import load_arena
from tests.benchmarks.timing import Row, table

TITLE = "Every step of a drive, with a map"
ROUNDS, LIMIT_MS = 16, 1.0

NAVIGATORS: dict[str, dict[str, Any]] = {
    "published": {"controller": "published"},
    "ranging": {},
    "ranging, features": {"stereo": "features"},
    "ranging, localise": {"localise": True},
}
"""Options, beside those of the drive."""

PARTS = "to the command", "after it"


def measure(arena: str = "sofa", seed: int = 103, seconds: float = 8.0) -> dict[tuple[str, str], list[float]]:
    """Times of all steps, ms, by navigator and part."""
    config, steps = DriveConfig(arena=arena, seed=seed, seconds=seconds, full_frames=True), []
    drive(config, [lambda step: steps.append((copy.deepcopy(step.frames), step.driven))])
    runners = {
        name: drive_runner(DriveConfig(arena=arena, seed=seed, seconds=seconds, **options), load_arena(arena, seed))
        for name, options in NAVIGATORS.items()
    }
    found: dict[tuple[str, str], list[float]] = {(name, part): [] for name in runners for part in PARTS}
    with torch.inference_mode():
        for turn in range(ROUNDS + 1):
            for name, runner in runners.items():
                runner.state = None
                for frames, driven in steps:
                    start = time.thread_time()
                    runner.command(frames, driven)
                    middle = time.thread_time()
                    runner.complete()
                    if turn:
                        found[name, PARTS[0]].append(1e3 * (middle - start))
                        found[name, PARTS[1]].append(1e3 * (time.thread_time() - middle))
    return found


def rows(device: str | None = None, found: dict[tuple[str, str], list[float]] | None = None) -> list[Row]:
    """Percentiles of all steps."""
    made = []
    for (name, part), times in (found or measure()).items():
        p50, p99, p999 = np.percentile(times, (50, 99, 99.9))
        least = np.reshape(times, (ROUNDS, -1)).min(0)
        own, own999 = np.percentile(least, (50, 99.9))
        share = 100 * float(np.mean(np.array(times) <= LIMIT_MS))
        figure = f"{p50:.2f}, {p99:.2f}, {p999:.2f} ms (median, 99, 99.9 %), {p999 / p50:.1f}x"
        beside = f"{share:.1f} % of {len(times)} in {LIMIT_MS:g} ms; each step's least: {own:.2f}, {own999:.2f} ms"
        made.append(Row(f"{name}: {part}", figure, beside, f"{own999 / own:.2f}x"))
    return made


def draw(found: dict[tuple[str, str], list[float]], file: str) -> None:
    """Histograms of all steps."""
    figure, axes = plt.subplots(len(NAVIGATORS), sharex=True, figsize=(7, 7), layout="constrained")
    bins = np.geomspace(0.05, 20.0, 91)
    for ax, name in zip(axes, NAVIGATORS, strict=True):
        for part in PARTS:
            ax.hist(found[name, part], bins, alpha=0.6, label=part)
        ax.axvline(LIMIT_MS, color="black", linestyle=":")
        ax.set(title=name, ylabel="steps", xscale="log")
    axes[0].legend()
    axes[-1].set(xlabel="time, ms")
    figure.savefig(file, dpi=110)


if __name__ == "__main__":
    torch.set_num_threads(1)
    times = measure()
    print(table(TITLE, rows(found=times)))
    if len(sys.argv) > 1:
        draw(times, sys.argv[1])
