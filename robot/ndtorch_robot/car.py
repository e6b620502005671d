"""The only loop: cameras, navigator, safety layer, drive, observers, at a fixed rate.

A car, a simulated drive, a simulated board and a replay are the same `Car` with other parts behind the same ports.
"""

from __future__ import annotations

import gc
import math
import threading
import time
from collections import defaultdict, deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import STOPPED
from ndtorch_robot.navigator_runner import NavigatorRunner
from ndtorch_robot.ports import STAND, CameraPair, DriveCommand, FaultKind, Observer, Step
from ndtorch_robot.safety import SafeDrive

KEPT = 30_000
"""Steps whose times are kept for the summary, a quarter of an hour: 1 MB for each part that is timed."""

LASTS = 0.2
"""Seconds for which the navigator's reason to stop must hold before it is reported: just after a stop the filters still
contain motion, which looks like noise for some frames."""


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


class StepTimer(defaultdict[str, deque[float]]):
    """How long the parts of a step take, s in real time."""

    def __init__(self) -> None:
        super().__init__(lambda: deque(maxlen=KEPT))

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        """Add the time spent inside to a part."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self[name].append(time.perf_counter() - start)

    def summary(self) -> dict[str, dict[str, float]]:
        """Median, 99th percentile and maximum of each part, in ms: `{"navigate": {"p50": 0.6, "p99": 0.9, ...}}`."""
        return {name: percentiles_ms(seconds) for name, seconds in self.items()}


class Car:
    """The parts of a car and what passes between them.

    Steps are due at `start + n / rate`, not at the end of one step plus a pause, so that they do not drift. A step that
    takes too long delays the next one and is counted in `late`; missed steps are not made up for.

    Args:
        safe: the safety layer, with the drive behind it and the clock of the loop.
        go: True drives off at the first good frames; False waits for `resume`; None is for a simulation without a
            person.
        steer: changes the command of the navigator before it is sent, for comparisons.
        max_steps: the drive ends after this number of steps.

    Attributes:
        troubles: reasons for which the navigator stopped, each once.
        ended: set it, from any thread, to end the drive after the step.
        steps, late: number of steps so far, and of those that came late.
    """

    def __init__(
        self,
        runner: NavigatorRunner,
        cameras: CameraPair,
        safe: SafeDrive,
        *,
        observers: Iterable[Observer] = (),
        go: bool | None = None,
        steer: Callable[[DriveCommand], DriveCommand] | None = None,
        max_steps: int | None = None,
    ) -> None:
        if not isinstance(safe, SafeDrive):
            raise TypeError(f"the loop drives only through a SafeDrive, got {type(safe).__name__}")
        self.runner, self.cameras, self.safe, self.drive = runner, cameras, safe, safe.drive
        self.observers, self.go, self.steer, self.max_steps = list(observers), go, steer, max_steps
        self.ended = threading.Event()
        self.troubles: list[str] = []
        self.trouble: str | None = None
        self.timer, self.steps, self.late, self.trouble_steps = StepTimer(), 0, 0, 0
        self.began = self.distance = 0.0
        self.starts: deque[float] = deque(maxlen=KEPT)

    def run(self, seconds: float | None = None, warm_up: bool = True) -> int:
        """Step until `ended` is set, the time is over, or the steps are used up; the number of steps.

        The car is stopped at the end, and also when a step raises or the user presses Ctrl-C: both go on to the caller
        after that.
        """
        clock, period = self.safe.clock, 1 / self.runner.rate
        if warm_up:
            self.runner.navigator.warm_up()
        if self.go is not None:
            self.safe.wait_for_start(self.go)
        # A pass of the garbage collector through all of torch's objects takes longer than a step.
        gc.collect()
        gc.freeze()
        try:
            due = clock.now()
            end = math.inf if seconds is None else due + seconds
            with torch.inference_mode():
                while self.max_steps is None or self.steps < self.max_steps:
                    now = clock.now()
                    with self.timer.part("step"):
                        self.step(self.steps, now)
                    self.steps += 1
                    if self.ended.is_set() or now >= end:
                        break
                    due += period
                    if clock.now() > due:
                        self.late += 1
                        due = clock.now()
                    clock.wait_until(due)
        finally:
            self.safe.stop()
            gc.unfreeze()
        return self.steps

    def step(self, number: int, now: float) -> None:
        timer, clock, safe, runner = self.timer, self.safe.clock, self.safe, self.runner
        driven, frames = safe.driven(), None
        with timer.part("cameras"):
            try:
                frames = self.cameras.read()
            except InputError as error:
                safe.blind(str(error))
        self.distance += abs(driven.speed) / runner.rate
        # A step that waits for its cameras begins when they have answered.
        started = clock.now() if isinstance(clock, CameraClock) else now
        self.began = self.began if self.starts else started
        self.starts.append(started)
        wanted, restarted, placed = STAND, False, None
        good = frames is not None and safe.see(frames, driven.speed)
        if good and frames is not None:
            placed, anew = self.drive.take_placed(), safe.take_interruption()
            restarted = anew and runner.state is not None
            with timer.part("navigate"):
                wanted = runner.command(frames, driven, placed, anew)
        else:
            runner.roll(driven)
        sent = safe.send(wanted if self.steer is None else self.steer(wanted))
        if good and frames is not None:
            if isinstance(clock, MonotonicClock):  # simulated time stands still in a step
                timer["frame to command"].append(clock.now() - frames.time)
            with timer.part("map"):
                runner.complete()
            self.report_trouble()
        state, about = runner.state if good else None, (good, restarted, placed, self.drive.telemetry())
        record = Step(number, now, frames, driven, wanted, sent, state, safe.standing, *about)
        with timer.part("observers"):
            for observer in self.observers:
                observer(record)

    def report_trouble(self) -> None:
        trouble = self.runner.trouble() if self.runner.mode() == STOPPED else None
        self.trouble_steps = self.trouble_steps + 1 if trouble == self.trouble else 1
        self.trouble, lasts = trouble, self.trouble_steps >= LASTS * self.runner.rate
        if trouble is not None and lasts and trouble not in self.troubles:
            self.troubles.append(trouble)
            self.safe.report(f"stands: {trouble}")

    def summary(self) -> dict[str, Any]:
        """Figures of the drive so far, as JSON has them: times in ms, those of faults in s since the first step."""
        began, real = self.began, isinstance(self.safe.clock, MonotonicClock)
        jitter = np.abs(np.diff(self.starts) - 1 / self.runner.rate) if real else ()
        stops = [stop for stop in self.safe.faults if stop.kind is not FaultKind.EMERGENCY]
        faults = [{"time_s": round(max(0.0, stop.time - began), 3), "why": stop.message} for stop in stops]
        return {
            "steps": self.steps,
            "late": self.late,
            "distance_m": round(self.distance, 3),
            "clamped": self.safe.clamped,
            "faults": faults,
            "standing": self.safe.standing,
            "troubles": self.troubles,
            "round_trip_ms": percentiles_ms(self.drive.round_trips() if real else ()),
            "jitter_ms": percentiles_ms(jitter),
            "parts_ms": self.timer.summary(),
        }


def percentiles_ms(seconds: Iterable[float]) -> dict[str, float]:
    """Median, 99th percentile and maximum in ms; nothing for no values."""
    values = np.array(list(seconds)) * 1e3
    if not len(values):
        return {}
    return {name: round(float(np.percentile(values, q)), 3) for name, q in (("p50", 50), ("p99", 99), ("max", 100))}
