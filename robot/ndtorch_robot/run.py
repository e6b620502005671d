"""Driving a real car: the navigator in the loop, on real ports."""

from __future__ import annotations

import contextlib
import gc
import os
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import (
    Command,
    CompiledNavigator,
    Grid,
    GridMap,
    NavigatorState,
    StereoRig,
)
from ndtorch_robot.link import SerialDrive
from ndtorch_robot.loop import Loop, MonotonicClock
from ndtorch_robot.navigating import configuration, say
from ndtorch_robot.ports import CameraPair, Clock, DriveCommand, StereoFrames
from ndtorch_robot.run_config import RunConfig
from ndtorch_robot.safety import SafeDrive, Sight
from ndtorch_robot.sim.board import SimulatedBoard

STAND = DriveCommand(0.0, 0.0)

KEPT = 30_000
"""Steps whose times are kept for the summary, a quarter of an hour: 1 MB for each part that is timed."""


class Step(NamedTuple):
    """What one step of the loop saw and did, for observers.

    Attributes:
        number, time: of the step; seconds on the monotonic clock.
        frames: what was seen; None when the cameras gave nothing.
        driven: what the board applied since the step before.
        state: of the navigator; None when it did not run.
        wanted, sent: by the navigator, and by the safety layer to the board.
        standing: why the car is kept standing, or None.
        restarted: the navigator began anew, because it had seen nothing, or nothing move, before.
    """

    number: int
    time: float
    frames: StereoFrames | None
    driven: DriveCommand
    state: NavigatorState | None
    wanted: DriveCommand
    sent: DriveCommand
    standing: str | None
    restarted: bool


Observer = Callable[[Step], None]


class CameraClock(MonotonicClock):
    """For cameras that are waited for: they keep the time of the loop."""

    def wait_until(self, time_: float) -> None:
        """Return at once; the loop waits in reading the next frames."""


class CarLoop:
    """The parts of a running car and what passes between them.

    Args:
        config: the car.
        cameras, rig, clock: as `make_cameras` gives them.
        drive: the link.
        report: told of everything that happens.
        go: drive as soon as there are good frames; else stand until told to resume.
        observers: called with every step.
    """

    def __init__(
        self,
        config: RunConfig,
        cameras: CameraPair,
        rig: StereoRig,
        clock: Clock,
        drive: SerialDrive,
        report: Callable[[str], None],
        go: bool = False,
        observers: list[Observer] | None = None,
    ) -> None:
        self.config, self.rig = config, rig
        self.cameras, self.link, self.go, self.observers = cameras, drive, go, observers or []
        limits = config.limits.limits()
        self.safe = SafeDrive(drive, clock, limits, Sight(rig, config.rate_hz, limits.age), report)
        half = config.navigation.map_half_size_m
        grid_map = GridMap(rig, Grid(-half, half, -half, half)) if half else None
        self.navigator = config.navigation.options().navigator(rig, config.rate_hz, grid_map, say)
        self.state: NavigatorState | None = None
        self.interrupted = False  # in the frames: motion across a gap would be believed
        self.ended = threading.Event()
        self.starts: list[float] = []
        self.loop = Loop(config.rate_hz, clock)

    def configuration(self) -> dict[str, Any]:
        """For a recording: what the navigator is made of."""
        made_of = configuration(self.config.navigation.options(), self.rig, self.config.rate_hz)
        return made_of | {"map_half_size_m": self.config.navigation.map_half_size_m}

    def telemetry(self) -> dict[str, Any]:
        """What the board says of itself, for JSON; `link` is why it cannot be commanded, or None."""
        heard = self.link.telemetry
        return (heard.values() if heard is not None else {}) | {"link": self.link.trouble()}

    def run(self, seconds: float | None = None) -> int:
        """Step until `ended` is set or so many seconds are over; returns the number of steps."""
        self.warm_up()
        end = None if seconds is None else self.loop.clock.now() + seconds

        def step(number: int, now: float) -> bool:
            self.step(number, now)
            return not self.ended.is_set() and (end is None or now < end)

        # What is there now is not looked at again by the garbage collector: a pass through all of torch's objects
        # takes longer than a step.
        gc.collect()
        gc.freeze()
        try:
            with torch.inference_mode():
                return self.loop.run(step, self.safe)
        finally:
            gc.unfreeze()

    def warm_up(self) -> None:
        """Compile the navigator's step while the car stands, if it is to be compiled."""
        while isinstance(self.navigator, CompiledNavigator) and not self.ended.is_set():
            try:
                frames = self.cameras.read()
            except InputError:  # the loop will say so
                time.sleep(0.1)
                continue
            with torch.inference_mode():
                self.navigator.warm_up(frames.left, frames.right)
            return

    def step(self, number: int, now: float) -> None:
        """See, navigate, drive."""
        timing = self.loop.timing
        driven = self.link.driven()
        frames: StereoFrames | None = None
        with timing.part("cameras"):
            try:
                frames = self.cameras.read()
            except InputError as error:
                self.safe.blind(str(error))
        # A step that waits for its cameras begins when they have answered.
        self.starts.append(self.loop.clock.now() if isinstance(self.loop.clock, CameraClock) else now)
        del self.starts[:-KEPT]
        if self.safe.standing is not None:
            self.interrupted = True  # a car that stands sees nothing move, which the navigator takes for being lost
        wanted, good = STAND, frames is not None and self.safe.see(frames, driven.speed)
        restarted = good and self.interrupted and self.state is not None
        if good and frames is not None:
            with timing.part("navigate"):
                wanted = self.navigate(frames, driven)
        else:
            self.interrupted = True
        sent = self.safe.send(wanted)
        if good and frames is not None:
            timing.seconds.setdefault("frame to command", []).append(self.loop.clock.now() - frames.time)
            if self.go:
                self.go = False
                self.safe.resume()
        for seconds in timing.seconds.values():
            del seconds[:-KEPT]
        for observer in self.observers:
            state = self.state if good else None
            observer(Step(number, now, frames, driven, state, wanted, sent, self.safe.standing, restarted))

    def navigate(self, frames: StereoFrames, driven: DriveCommand) -> DriveCommand:
        """What the navigator wants."""
        before = self.state
        if self.interrupted and before is not None:
            command, state = self.navigator(frames.left, frames.right)
            self.state = state._replace(pose=before.pose, map=before.map)
        else:
            moved = Command(torch.tensor([driven.speed]), torch.tensor([driven.curvature]))
            command, self.state = self.navigator(frames.left, frames.right, before, moved)
        self.interrupted = False
        return DriveCommand(float(command.speed[-1]), float(command.curvature[-1]))

    def summary(self) -> dict[str, object]:
        """Figures of the run so far: times in ms."""
        trips = np.array(self.link.round_trips) * 1e3
        jitter = np.abs(np.diff(self.starts) - 1 / self.loop.rate) * 1e3
        return {
            "steps": self.loop.steps,
            "late": self.loop.late,
            "faults": [{"time_s": round(when - self.starts[0], 3), "why": why} for when, why in self.safe.faults],
            "standing": self.safe.standing,
            "round_trip_ms": percentiles(trips),
            "jitter_ms": percentiles(jitter),
            "parts_ms": self.loop.timing.summary(),
        }


def percentiles(values: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> dict[str, float]:
    """Median, 99th percentile and largest."""
    if not len(values):
        return {}
    p50, p99, most = np.percentile(values, (50, 99, 100))
    return {"p50": round(float(p50), 3), "p99": round(float(p99), 3), "max": round(float(most), 3)}


def make_cameras(config: RunConfig, board: SimulatedBoard | None) -> tuple[CameraPair, StereoRig, Clock]:
    """The camera pair of a configuration, its geometry, and the clock that the loop keeps with it.

    Raises:
        InputError: cameras or an arena that cannot be used.
    """
    if config.simulation is not None:
        from ndtorch_robot.sim.arenas import load_arena
        from ndtorch_robot.sim.pulse_world import PulseWorld
        from ndtorch_robot.sim.simulation import Simulation

        assert board is not None
        plan = load_arena(config.simulation.arena, config.simulation.seed)
        rig = config.rig.rig()
        simulation = Simulation(plan, config.simulation.seed, rig=rig, fields=config.navigation.options().fields(rig))
        return PulseWorld(simulation, board), simulation.rig, MonotonicClock()
    return make_real_cameras(config)


def make_real_cameras(config: RunConfig) -> tuple[CameraPair, StereoRig, Clock]:
    """Two OpenCV cameras."""
    from ndtorch_robot.cameras import CameraSettings, open_cameras
    from ndtorch_robot.toml import check

    settings = check(dict(config.cameras or {}), CameraSettings, "cameras")
    cameras, rig = open_cameras(settings, config.rig.rig(), config.navigation.options().fields)
    return cameras, rig, CameraClock()


def real_time_priority(report: Callable[[str], None]) -> None:
    """Go before other programs, where that is allowed; threads started later do too."""
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(3))
    except (OSError, AttributeError):
        report("no real-time priority: other programs can delay the loop (see the systemd unit in robot/README.md)")


@contextlib.contextmanager
def open_car(
    config: RunConfig,
    report: Callable[[str], None],
    go: bool = False,
    observers: list[Observer] | None = None,
) -> Iterator[CarLoop]:
    """All parts of a car, opened and afterwards closed again, the drive first.

    Raises:
        InputError: a port, a board or cameras that cannot be used.
    """
    with contextlib.ExitStack() as stack:
        board, device = None, config.link.device
        if config.simulation is not None and device is None:
            board = SimulatedBoard(config.simulation.pulse_log)
            stack.callback(board.close)
            device = board.device
        elif config.simulation is not None:
            raise InputError("a simulated world drives the simulated board only: leave out link.device")
        assert device is not None
        cameras, rig, clock = make_cameras(config, board)
        stack.callback(cameras.close)
        drive = SerialDrive(device, config.link.baud, config.robot, report)
        stack.callback(drive.close)
        yield CarLoop(config, cameras, rig, clock, drive, report, go, observers)


def timed_report() -> Callable[[str], None]:
    """Prints lines with the seconds since now, to stderr."""
    import sys

    start = time.monotonic()

    def report(line: str) -> None:
        print(f"{time.monotonic() - start:9.3f} s  {line}", file=sys.stderr, flush=True)

    return report
