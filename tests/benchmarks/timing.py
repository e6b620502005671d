"""Times things in turn, so that whatever else the machine does hits all of them alike.

Times are those of the processor in this thread: waiting for it does not count.
"""

from __future__ import annotations

import platform
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch


class Row(NamedTuple):
    """One line of a table: what was measured, the figure, what it is compared with, and the ratio.

    `cost` is the time over that of something that does not change, taken in turn in the same process: to compare runs.
    """

    what: str
    figure: str
    against: str
    ratio: str
    cost: float | None = None


FIXED = np.random.default_rng(0).random((128, 128))


def reference() -> object:
    """What times are compared with between runs: some hundred microseconds of NumPy."""
    return np.fft.rfft2(FIXED)


def in_turn(jobs: dict[str, Callable[[], object]], rounds: int = 30, repeat: int = 5) -> dict[str, float]:
    """Median seconds of one call of each job; the jobs take turns, `repeat` calls at a time.

    Once CUDA is in use it is the time that passes until the device has finished.
    """
    samples: dict[str, list[float]] = {name: [] for name in jobs}
    clock = time.perf_counter if torch.cuda.is_initialized() else time.thread_time
    for job in jobs.values():
        job()
        job()
    for _ in range(rounds):
        for name, job in jobs.items():
            start = clock()
            for _ in range(repeat):
                job()
            if torch.cuda.is_initialized():
                torch.cuda.synchronize()
            samples[name].append((clock() - start) / repeat)
    return {name: statistics.median(times) for name, times in samples.items()}


def machine(device: str | None = None) -> str:
    """What this is measured on."""
    name = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.is_file():
        models = [line.split(":", 1)[1].strip() for line in info.read_text().splitlines() if "model name" in line]
        name = models[0] if models else name
    text = f"{name}, one thread, torch {torch.__version__}"
    if device is not None and device.startswith("cuda"):
        text += f"; {torch.cuda.get_device_name(device)}"
    return text


def table(title: str, rows: list[Row]) -> str:
    """Markdown."""
    lines = [f"### {title}", "", "| what | figure | against | ratio |", "|---|---|---|---|"]
    lines += [f"| {row.what} | {row.figure} | {row.against} | {row.ratio} |" for row in rows]
    return "\n".join(lines) + "\n"
