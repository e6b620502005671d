"""The control loop: one step at a fixed rate, timed part by part, and a drive that is stopped whatever happens."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from ndtorch.errors import InputError
from ndtorch_robot.ports import Clock
from ndtorch_robot.safety import SafeDrive


class MonotonicClock:
    """Real time."""

    def now(self) -> float:
        return time.monotonic()

    def wait_until(self, time_: float) -> None:
        time.sleep(max(0.0, time_ - time.monotonic()))


class CameraClock(MonotonicClock):
    """For cameras that are waited for: they keep the time of the loop."""

    def wait_until(self, time_: float) -> None:
        """Return at once; the loop waits in reading the next frames."""


class StepTimer:
    """How long the parts of a step take, in real time."""

    def __init__(self) -> None:
        self.seconds: dict[str, list[float]] = {}

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        """Add the time spent inside to a part."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.add(name, time.perf_counter() - start)

    def add(self, name: str, seconds: float) -> None:
        self.seconds.setdefault(name, []).append(seconds)

    def forget(self, kept: int) -> None:
        for seconds in self.seconds.values():
            del seconds[:-kept]

    def summary(self) -> dict[str, dict[str, float]]:
        """Median and 99th percentile of each part, in ms: `{"navigate": {"p50": 0.6, "p99": 0.9}}`."""
        result = {}
        for name, seconds in self.seconds.items():
            p50, p99 = np.percentile(np.array(seconds) * 1e3, (50, 99))
            result[name] = {"p50": float(p50), "p99": float(p99)}
        return result


class Loop:
    """Calls a step at a fixed rate.

    Times are `start + n / rate`, not the end of one step plus a pause, so that they do not drift. A step that
    takes too long delays the next one and is counted in `late`; missed steps are not made up for.

    Args:
        rate: steps a second.
        clock: real or simulated time.
        max_steps: stop after so many; None goes on until the step says stop.

    Raises:
        InputError: a rate or number of steps that is not positive.
    """

    def __init__(self, rate: float, clock: Clock, max_steps: int | None = None) -> None:
        if not 0 < rate < math.inf or (max_steps is not None and max_steps < 1):
            raise InputError(f"expected rate > 0 and max_steps >= 1, got rate={rate}, max_steps={max_steps}")
        self.rate, self.clock, self.max_steps = rate, clock, max_steps
        self.timer = StepTimer()
        self.steps = 0
        self.late = 0

    def run(self, step: Callable[[int, float], bool | None], drive: SafeDrive) -> int:
        """Call `step(n, time)` until it returns False or the steps are used up; returns how many were made.

        The drive is stopped at the end, and also when the step raises or the user presses Ctrl-C: both go on to the
        caller after that.
        """
        if not isinstance(drive, SafeDrive):
            raise TypeError(f"the loop drives only through a SafeDrive, got {type(drive).__name__}")
        try:
            due = self.clock.now()
            while self.max_steps is None or self.steps < self.max_steps:
                with self.timer.part("step"):
                    go_on = step(self.steps, self.clock.now())
                self.steps += 1
                if go_on is False:
                    break
                due += 1 / self.rate
                now = self.clock.now()
                if now > due:
                    self.late += 1
                    due = now
                self.clock.wait_until(due)
        finally:
            drive.stop()
        return self.steps
