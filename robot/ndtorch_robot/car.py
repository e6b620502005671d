"""The only loop: cameras, navigator, safety layer, drive, observers.

A car, a simulated drive, a simulated board and a replay are the same `Car` with other parts behind the same ports.
"""

from __future__ import annotations

import gc
import threading
from collections.abc import Callable, Iterable

import numpy as np
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import STOPPED
from ndtorch_robot.faults import FaultKind
from ndtorch_robot.loop import CameraClock, Loop
from ndtorch_robot.navigator_runner import NavigatorRunner
from ndtorch_robot.ports import STAND, CameraPair, DriveCommand, Observer, Step, StereoFrames
from ndtorch_robot.safety import SafeDrive

NOT_YET = "not yet told to drive"

KEPT = 30_000
"""Steps whose times are kept for the summary, a quarter of an hour: 1 MB for each part that is timed."""

LASTS = 0.2
"""Seconds for which the navigator's reason to stop must hold before it is reported: just after a stop the filters still
contain motion, which looks like noise for some frames."""


class Car:
    """The parts of a car and what passes between them.

    Args:
        runner: the navigator and its state.
        cameras: give the frames.
        safe: the safety layer, with the drive behind it and the clock of the loop.
        observers: called after every step.
        go: True drives off at the first good frames, unless a person has stopped the car before; False waits for
            `resume`; None is for a simulation without a person.
        steer: changes the command of the navigator before it is sent, for comparisons.
        max_steps: the drive ends after this number of steps.

    Attributes:
        troubles: reasons for which the navigator stopped, each once.
        ended: set it, from any thread, to end the drive after the step.
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
        self.runner, self.cameras, self.safe, self.drive = runner, cameras, safe, safe.drive
        self.observers, self.go, self.steer = list(observers), go, steer
        self.ended = threading.Event()
        self.troubles: list[str] = []
        self.reason: tuple[str | None, int] = (None, 0)
        self.began = 0.0
        self.starts: list[float] = []
        self.loop = Loop(runner.rate, safe.clock, max_steps)

    def run(self, seconds: float | None = None, warm_up: bool = True) -> int:
        """Step until `ended` is set, the time is over, or the steps are used up; the number of steps."""
        if warm_up:
            self.runner.warm_up()
        if self.go is not None:
            self.safe.fault(NOT_YET, FaultKind.NOT_STARTED)
        end = None if seconds is None else self.loop.clock.now() + seconds

        def step(number: int, now: float) -> bool:
            self.step(number, now)
            return not self.ended.is_set() and (end is None or now < end)

        # A pass of the garbage collector through all of torch's objects takes longer than a step.
        gc.collect()
        gc.freeze()
        try:
            with torch.inference_mode():
                return self.loop.run(step, self.safe)
        finally:
            gc.unfreeze()

    def step(self, number: int, now: float) -> None:
        timer, clock = self.loop.timer, self.loop.clock
        driven, frames = self.safe.driven(), self.see()
        # A step that waits for its cameras begins when they have answered.
        self.note_start(clock.now() if isinstance(clock, CameraClock) else now)
        wanted, restarted, placed = STAND, False, None
        good = frames is not None and self.safe.see(frames, driven.speed, driven.curvature)
        if good and frames is not None:
            placed, anew = self.drive.take_placed(), self.safe.take_interruption()
            restarted = anew and self.runner.state is not None
            with timer.part("navigate"):
                wanted = self.runner.command(frames, driven, placed, anew)
        else:
            self.runner.roll(driven)
        steered = wanted
        if self.steer is not None:
            self.runner.complete()  # who steers reads the state, and may change it
            steered = self.steer(wanted)
        sent = self.safe.send(steered)
        if good and frames is not None:
            timer.add("frame to command", clock.now() - frames.time)
            with timer.part("remember"):
                self.runner.complete()
            self.tell_trouble()
            if self.go:
                self.go = False
                if not self.safe.by_hand:
                    self.safe.resume(patience=None)
        state = self.runner.state if good else None
        telemetry = self.drive.telemetry()
        made = Step(
            number, now, frames, driven, wanted, sent, state, self.safe.standing, good, restarted, placed, telemetry
        )
        with timer.part("observers"):
            for observer in self.observers:
                observer(made)
        timer.forget(KEPT)

    def tell_trouble(self) -> None:
        """Report why the navigator stops or drives slowly, once for each reason that lasts."""
        trouble = self.runner.trouble() if self.runner.mode() == STOPPED else None
        reason, since = self.reason
        self.reason = (trouble, since + 1 if trouble == reason else 1)
        lasts = self.reason[1] >= LASTS * self.runner.rate
        if trouble is not None and lasts and trouble not in self.troubles:
            self.troubles.append(trouble)
            self.safe.report(f"stands: {trouble}")

    def see(self) -> StereoFrames | None:
        """The newest frames; None when the cameras give none, which is a fault."""
        with self.loop.timer.part("cameras"):
            try:
                return self.cameras.read()
            except InputError as error:
                self.safe.blind(str(error))
                return None

    def note_start(self, when: float) -> None:
        if not self.starts:
            self.began = when
        self.starts.append(when)
        del self.starts[:-KEPT]

    def summary(self) -> dict[str, object]:
        """Figures of the drive so far: times in ms, those of faults in s since the first step."""
        trips = np.array(self.drive.round_trips()) * 1e3
        jitter = np.abs(np.diff(self.starts) - 1 / self.loop.rate) * 1e3
        return {
            "steps": self.loop.steps,
            "late": self.loop.late,
            "faults": [
                {"time_s": round(max(0.0, stop.time - self.began), 3), "why": stop.why} for stop in self.safe.faults
            ],
            "standing": self.safe.standing,
            "troubles": self.troubles,
            "round_trip_ms": percentiles(trips),
            "jitter_ms": percentiles(jitter),
            "parts_ms": self.loop.timer.summary(),
        }


def percentiles(values: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> dict[str, float]:
    if not len(values):
        return {}
    p50, p99, most = np.percentile(values, (50, 99, 100))
    return {"p50": round(float(p50), 3), "p99": round(float(p99), 3), "max": round(float(most), 3)}
