"""The observer that injects faults into a drive and measures how the car reacts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ndtorch_robot.camera_monitor import CameraMonitor
from ndtorch_robot.car import Car
from ndtorch_robot.drive import Respawn
from ndtorch_robot.link.board import Pulse
from ndtorch_robot.link.simulated import SimulatedDrive
from ndtorch_robot.ports import FaultKind, Step
from ndtorch_robot.safety import DriveState
from tests.fault_injection.camera_faults import FaultyCameras
from tests.fault_injection.faults import FAULTS, Fault, FaultyLink, RecordingCheck

NEUTRAL_US, MOVING_US = 1500.0, 2.0
"""Width of a motor pulse at rest, and the difference from it at which the wheels turn, microseconds."""

CALM_S = (1.0, 2.5)
"""Shortest and longest time of undisturbed driving before a fault, s."""

EXTRA_S, AFTERMATH_S = 0.6, 1.0
"""Time that a fault lasts beyond its deadline, and time after it in which a stop is still caused by it, s."""

RECOVERY_S, RESUME_AFTER_S = 10.0, 0.5
"""Time within which the car must drive again, and after which one that waits for a person is resumed, s."""


class FaultInjector:
    """Injects one fault after the other while the car drives, and moves a car away that would stand before a wall.

    Args:
        car: on a hosted board; it gets `FaultyCameras`.
        seed: of the noise, and of order and times of the faults.
        scratch: file of recordings.

    Attributes:
        rows: one for each fault, with its `reaction_s`, its `recovered_s` and its `failure`, in words, or None.
        unexplained: stops without a fault.
        blank: stops before a wall without any texture.
        lines: messages of the recorders.
    """

    def __init__(self, car: Car, seed: int, scratch: Path, faults: Sequence[Fault] = FAULTS) -> None:
        assert isinstance(car.drive, SimulatedDrive)
        self.car, self.world, self.scratch, self.faults = car, car.drive, scratch, faults
        self.cameras, self.link = FaultyCameras(self.world, seed), FaultyLink(self.world, seed)
        self.respawn = Respawn(self.world.simulation, car.runner, car.safe)
        car.cameras = self.cameras
        self.random = np.random.default_rng((seed, 9))
        self.rows: list[dict[str, Any]] = []
        self.unexplained, self.blank, self.stopped, self.lines = list[str](), list[str](), list[str](), list[str]()
        self.queue: list[Fault] = []
        self.fault: Fault | None = None
        self.recording: RecordingCheck | None = None
        self.began = self.ends = self.cleared = self.last_moving = -math.inf
        self.calm, self.driving = float(self.random.uniform(*CALM_S)), 0.0
        self.stops_seen = self.moving_pulses = 0
        self.world.pulsed = self.on_pulse

    def on_pulse(self, pulse: Pulse) -> None:
        """Measure by the pulses of the board how long the wheels turn."""
        if pulse.name == "motor":
            moving = abs(pulse.width - NEUTRAL_US) > MOVING_US
            self.moving_pulses = self.moving_pulses + 1 if moving else 0
            self.last_moving = pulse.time if moving else self.last_moving

    def __call__(self, step: Step) -> None:
        self.go_on(step)
        if self.fault is None:
            self.respawn(step)

    def go_on(self, step: Step) -> None:
        now = self.world.now()
        self.sort_stops()
        if self.recording is not None:
            self.recording(step)
        if self.fault is not None:
            if now >= self.ends:
                self.end(self.fault, now)
            return
        if step.standing is not None:
            self.driving = 0.0
            if self.car.safe.state is DriveState.STOPPED and now > self.cleared + RESUME_AFTER_S:
                self.car.safe.resume()
        elif abs(step.driven.speed) > 0.15:
            self.driving += 1 / self.car.runner.rate
        row = self.rows[-1] if self.rows else {"recovered_s": 0}
        if "recovered_s" not in row:
            if self.driving > 0.3:
                row["recovered_s"] = round(now - self.cleared, 2)
            elif now > self.cleared + RECOVERY_S:
                row["recovered_s"] = None
                row["failure"] = row["failure"] or f"does not drive again: {self.car.safe.standing}"
        elif self.driving >= self.calm and self.moving_pulses > 25:
            self.begin(now)

    def sort_stops(self) -> None:
        """Sort new stops that no fault explains by their cause."""
        stops = self.car.safe.faults
        for stop in stops[self.stops_seen :]:
            must_drive = self.fault is not None and self.fault.max_reaction_s is None
            if must_drive or (self.fault is None and stop.time > self.cleared + AFTERMATH_S):
                blank = stop.kind is FaultKind.BLANK and self.is_blank()
                kept = self.blank if blank else self.stopped if must_drive else self.unexplained
                kept.append(f"{stop.time:.2f} s: {stop.message}")
        self.stops_seen = len(stops)

    def is_blank(self) -> bool:
        """Whether good cameras would see nothing but a wall without texture."""
        frames = self.world.read()
        monitor = CameraMonitor(self.car.runner.rig, self.car.runner.rate, math.inf)
        return any(monitor.judge_contrast(list(frames[:2])) is not None for _ in range(monitor.patience))

    def begin(self, now: float) -> None:
        """Inject the next fault."""
        if not self.queue:
            self.queue = [self.faults[n] for n in self.random.permutation(len(self.faults))]
        self.fault = fault = self.queue.pop()
        self.began, self.stopped = now, []
        self.ends = now + (1.0 if fault.max_reaction_s is None else fault.max_reaction_s) + EXTRA_S
        self.calm, self.driving = float(self.random.uniform(*CALM_S)), 0.0
        if fault.part == "camera":
            self.cameras.inject(fault.name)
        elif fault.part == "link":
            self.link.inject(fault.name)
        elif fault.part == "disk":
            self.recording = RecordingCheck(self.scratch, fault.name, self.lines)
        else:
            short = fault.max_reaction_s is None
            self.cameras.stall = float(self.random.uniform(0.02, 0.05) if short else self.random.uniform(0.3, 1.0))

    def end(self, fault: Fault, now: float) -> None:
        """End the fault and judge the reaction."""
        self.cameras.fault = None
        self.link.clear()
        reaction, failure = max(0.0, self.last_moving - self.began), None
        if fault.max_reaction_s is None:
            failure = f"stopped at {self.stopped[0]}" if self.stopped else None
        elif reaction > fault.max_reaction_s + 1e-9:
            failure = f"wheels turned for {reaction:.3f} s"
        if self.recording is not None:
            failure, self.recording = self.recording.end() or failure, None
        measured = None if fault.max_reaction_s is None else round(reaction, 3)
        about = {"part": fault.part, "fault": fault.name, "time_s": round(self.began, 3)}
        self.rows.append(about | {"reaction_s": measured, "failure": failure})
        self.fault, self.cleared = None, now
