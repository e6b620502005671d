"""One piece of a soak: a car drives, now and then something goes wrong, and it is noted what the wheels did."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from ndtorch.navigation import Strips
from ndtorch_robot.car import Car
from ndtorch_robot.ports import Step
from ndtorch_robot.sim.board import Pulse
from ndtorch_robot.sim.lockstep_world import LockstepWorld
from ndtorch_robot.soak.cable import FailingCable
from ndtorch_robot.soak.disk import DiskTrial
from ndtorch_robot.soak.eyes import FailingCameras
from ndtorch_robot.soak.faults import FAULTS, Fault
from ndtorch_robot.trouble import Kind
from ndtorch_robot.watching.eye import SightLimits, blindness, look

MOVES = 2.0
"""Microseconds by which a pulse of the motor is off its neutral when the wheels turn."""

NEUTRAL = 1500.0

CALM = (1.0, 2.5)
"""Seconds of driving before something goes wrong: the shortest and the longest."""

BEYOND = 0.6
"""A fault lasts so much longer than the car may take to stop, s."""

AFTER = 1.0
"""Seconds after a fault, or after the car was put elsewhere, in which a stop is still its doing."""

AGAIN = 10.0
"""Seconds in which the car must drive again after a fault."""

TELL_AFTER = 0.5
"""Seconds after which somebody tells a car to go that waits for it."""

Row = dict[str, Any]


class Trials:
    """An observer that makes faults and notes what comes of them.

    Args:
        car: with `FailingCameras`.
        world: in which it drives.
        seed: of the order and of the times.
        scratch: folder for recordings.

    Attributes:
        rows: one for each fault.
        unexplained: stops for which there was no fault.
        blank: stops before a wall that shows nothing.
        carried: stops because the pictures moved, after somebody really had put the car elsewhere.
        lines: what was said.
    """

    def __init__(self, car: Car, world: LockstepWorld, cameras: FailingCameras, seed: int, scratch: Path) -> None:
        self.car, self.world, self.scratch = car, world, scratch
        self.cameras, self.cable = cameras, FailingCable(world, seed)
        self.random = np.random.default_rng((seed, 9))
        self.rows: list[Row] = []
        self.unexplained: list[str] = []
        self.blank: list[str] = []
        self.carried: list[str] = []
        self.stopped: list[str] = []
        self.lines: list[str] = []
        self.waiting: list[Fault] = []
        self.fault: Fault | None = None
        self.disk: DiskTrial | None = None
        self.began = self.ends = self.mended = -math.inf
        self.turned = self.put = -math.inf
        self.rolled = self.heard = 0.0
        self.placed = world.simulation.placed
        self.calm, self.driving = float(self.random.uniform(*CALM)), 0.0
        self.counted = 0
        self.moved_for = 0
        world.pulsed = self.pulsed

    def pulsed(self, pulse: Pulse) -> None:
        """The board has made a pulse."""
        if pulse.name == "motor":
            moves = abs(pulse.width - NEUTRAL) > MOVES
            self.rolled += pulse.time - self.heard if self.world.simulation.car.speed else 0.0
            self.heard = pulse.time
            self.moved_for = self.moved_for + 1 if moves else 0
            self.turned = pulse.time if moves else self.turned

    def __call__(self, step: Step) -> None:
        now = self.world.now()
        if self.world.simulation.placed is not self.placed:
            self.placed, self.put = self.world.simulation.placed, now
        self.look_at_stops()
        if self.disk is not None:
            self.disk(step)
        if self.fault is not None:
            told = self.fault.within is not None and self.fault.within > 1.0 and step.standing is not None
            if now >= self.ends or (told and now > self.turned + AFTER):
                self.end(self.fault, now)
            return
        if step.standing is not None:
            self.driving = 0.0
            if not self.car.safe.passes and now > self.mended + TELL_AFTER:
                self.car.safe.resume()
        elif abs(step.driven.speed) > 0.15:
            self.driving += 1 / self.car.pilot.rate
        if self.rows and "on after" not in self.rows[-1]:
            self.wait_to_drive(self.rows[-1], now)
        elif self.driving >= self.calm and self.moved_for > 25:
            self.begin(now)

    def look_at_stops(self) -> None:
        """Stops that no fault has brought about, though there may be one that the car must drive through."""
        faults = self.car.safe.faults
        for stop in faults[self.counted :]:
            must_drive = self.fault is not None and self.fault.within is None
            calm = self.fault is None and stop.time > self.mended + AFTER and stop.kind is not Kind.NOT_TOLD
            if must_drive or calm:
                kept = self.stopped if must_drive else self.unexplained
                if stop.kind is Kind.BLANK and self.nothing_to_see():
                    kept = self.blank
                elif stop.kind is Kind.CARRIED and stop.time < self.put + AFTER:
                    kept = self.carried
                kept.append(f"{stop.time:.2f} s: {stop.why}")
        self.counted = len(faults)

    def nothing_to_see(self) -> bool:
        """Whether good cameras have nothing before them but a wall without any mark."""
        seen = self.world.read()
        limits = self.car.safe.sight.watch.limits if self.car.safe.sight is not None else SightLimits()
        wrong = [blindness(look(eye), limits) for eye in seen[:2] if isinstance(eye, Strips)]
        return any(each is not None and each.kind is Kind.BLANK for each in wrong)

    def begin(self, now: float) -> None:
        """Something goes wrong."""
        if not self.waiting:
            self.waiting = [FAULTS[n] for n in self.random.permutation(len(FAULTS))]
        self.fault = fault = self.waiting.pop()
        self.began, self.ends = now, now + (1.0 if fault.within is None else fault.within) + BEYOND
        self.stops, self.stopped, self.rolled = len(self.car.safe.faults), [], 0.0
        self.calm, self.driving = float(self.random.uniform(*CALM)), 0.0
        if fault.part == "camera":
            self.cameras.fail(fault.name)
        elif fault.part == "link":
            self.cable.fail(fault.name)
        elif fault.part == "disk":
            self.disk = DiskTrial(self.scratch, self.lines)
            self.disk.recorder.fault = fault.name
        else:
            short = fault.within is None
            self.cameras.stall = float(self.random.uniform(0.02, 0.05) if short else self.random.uniform(0.3, 1.0))

    def end(self, fault: Fault, now: float) -> None:
        """It is well again: what happened meanwhile?"""
        self.cameras.fault = None
        self.cable.mend()
        said = [stop.why for stop in self.car.safe.faults[self.stops :]]
        turned = self.rolled if fault.rolling else max(0.0, self.turned - self.began)
        row: Row = {"part": fault.part, "fault": fault.name, "at": round(self.began, 3), "said": said[:1]}
        row["turned"] = round(turned, 3) if fault.within is not None else None
        if fault.within is None:
            row["bad"] = f"stopped at {self.stopped[0]}" if self.stopped else None
        elif turned > fault.within + 1e-9:
            row["bad"] = f"wheels turned for {turned:.3f} s"
        else:
            row["bad"] = None
        if self.disk is not None:
            row["bad"] = row["bad"] or self.disk.end(fault.name)
            self.disk = None
        if len(self.cameras.sides) == 1 and fault.part == "camera":
            row["side"] = self.cameras.sides[0]
        self.rows.append(row)
        self.fault, self.mended = None, now

    def wait_to_drive(self, row: Row, now: float) -> None:
        """Note how long it takes until the car drives again."""
        if self.driving > 0.3:
            row["on after"] = round(now - self.mended, 2)
        elif now > self.mended + AGAIN:
            row["on after"] = None
            row["bad"] = row["bad"] or f"does not drive again: {self.car.safe.standing}"
