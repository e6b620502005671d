"""A car from its configuration: the parts of `ndtorch run`, opened and closed."""

from __future__ import annotations

import contextlib
import os
import sys
import time
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any, Literal

from ndtorch.errors import InputError
from ndtorch.navigation import Grid, StereoRig
from ndtorch_robot.camera_monitor import CameraMonitor
from ndtorch_robot.cameras.pair import StereoCameras, open_cameras
from ndtorch_robot.car import CameraClock, Car, MonotonicClock
from ndtorch_robot.config import Recorded
from ndtorch_robot.link import SIMULATED_WORLD, Opening, open_link
from ndtorch_robot.navigator_runner import NavigatorRunner
from ndtorch_robot.ports import CameraPair, Clock, Drive, Observer, Report
from ndtorch_robot.recording import Recorder
from ndtorch_robot.run_config import RunConfig
from ndtorch_robot.safety import SafeDrive

if TYPE_CHECKING:
    from ndtorch_robot.view import View


@contextlib.contextmanager
def open_car(config: RunConfig, report: Report, go: bool = False, observers: Iterable[Observer] = ()) -> Iterator[Car]:
    """All parts of a car, opened and afterwards closed again, the drive first."""
    with contextlib.ExitStack() as stack:
        drive, clock, cameras = stack.enter_context(open_drive(config, report))
        rig = config.stereo_rig
        if cameras is None:
            cameras, rig = open_real_cameras(config)
            clock = CameraClock()
        stack.callback(cameras.close)
        stack.callback(drive.close)
        limits, half = config.safety_limits, config.navigation.map_half_size_m
        grid = Grid(-half, half, -half, half) if half else None
        runner = NavigatorRunner(config.navigation, rig, config.rate_hz, grid, body=config.body)
        safe = SafeDrive(drive, clock, limits, CameraMonitor(rig, config.rate_hz, limits.frame_age_s), report)
        yield Car(runner, cameras, safe, observers=observers, go=go)


@contextlib.contextmanager
def open_drive(config: RunConfig, report: Report) -> Iterator[tuple[Drive, Clock, CameraPair | None]]:
    """The drive of a car and its clock, and the cameras of a simulated world."""
    simulation = None
    if config.simulation is not None:
        from ndtorch_robot.sim.arenas import load_arena
        from ndtorch_robot.sim.disturbances import read_disturbances

        world, fields = config.simulation, config.navigation.fields(config.stereo_rig, config.body)
        disturbances = read_disturbances(world.disturbance)
        if disturbances.odometer and config.link_table()["kind"] != SIMULATED_WORLD:
            raise InputError(f"disturbance: a board has no odometer to be off; link.kind = {SIMULATED_WORLD!r} has one")
        plan = load_arena(world.arena, world.seed)
        simulation = config.simulate(plan, world.seed, fields=fields, disturbances=disturbances)
    drive = open_link(config.link_table(), Opening(config.board_name, report, simulation))
    cameras, clock = drive.cameras_and_clock() or (None, MonotonicClock())
    try:
        yield drive, clock, cameras
    finally:
        drive.close()


def open_real_cameras(config: RunConfig) -> tuple[StereoCameras, StereoRig]:
    assert config.cameras is not None
    return open_cameras(config.cameras, config.stereo_rig, lambda rig: config.navigation.fields(rig, config.body))


@contextlib.contextmanager
def observe(
    car: Car, name: str, to: Recorded, report: Report, whole: bool = False, **known: Any
) -> Iterator[tuple[Recorder | None, View | None]]:
    """Record a car, and show it in a file or a viewer, where that is asked for.

    Args:
        whole: record whole frames.
        known: `plan` and `truth` of a `View` of a simulated drive, which then waits for the disk and the viewer, so
            that nothing is left out.
    """
    recorder, shown = None, None
    with contextlib.ExitStack() as stack:
        if to.record is not None:
            when_full: Literal["wait", "drop"] = "wait" if known else "drop"
            options: dict[str, Any] = {"when_full": when_full, "report": report, "whole": whole}
            recorder = stack.enter_context(Recorder(to.record, car.runner, **options))
            car.observers.append(recorder)
        if to.rrd is not None or to.view:
            from ndtorch_robot.view import View, open_stream

            stream = open_stream(name, to.rrd, to.view, known.get("plan"))
            shown = stack.enter_context(View(stream, car.runner, report, bool(known), **known))
            car.observers.append(shown)
        yield recorder, shown


def real_time_priority(report: Report) -> None:
    """Go before other programs, where that is allowed; threads started later do too."""
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(3))
    except (OSError, AttributeError):
        report("no real-time priority: other programs can delay the loop (see the systemd unit in robot/README.md)")


def timed_report() -> Report:
    """Prints lines with the seconds since now, to stderr."""
    start = time.monotonic()

    def report(line: str) -> None:
        print(f"{time.monotonic() - start:9.3f} s  {line}", file=sys.stderr, flush=True)

    return report
