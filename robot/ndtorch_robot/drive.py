"""A simulated drive: the car's own loop in a building, recorded and scored."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import STOPPED, Grid
from ndtorch.navigation.body import match_params
from ndtorch.navigation.controllers import Trace
from ndtorch.navigation.options import place_of
from ndtorch_robot.camera_monitor import CameraLimits, CameraMonitor
from ndtorch_robot.car import Car
from ndtorch_robot.config import DriveConfig
from ndtorch_robot.evaluation.metrics import MapScore, collision_summary, coverage, score_map
from ndtorch_robot.evaluation.record import Record, pose_error
from ndtorch_robot.faults import FaultKind
from ndtorch_robot.map_saving import WalkedPath, runner_ndt_cells
from ndtorch_robot.navigator_runner import NavigatorRunner
from ndtorch_robot.ports import DriveCommand, Observer, Step, print_note
from ndtorch_robot.recording import Recorder
from ndtorch_robot.safety import DriveState, SafeDrive
from ndtorch_robot.sim.arenas import load_arena
from ndtorch_robot.sim.disturbances import read_disturbances
from ndtorch_robot.sim.plan import Plan
from ndtorch_robot.sim.simulation import Simulation

DRAWN = CameraLimits(patience_s=2.0)
"""Walls that are drawn blank have no marks at all: a car that turns away from one may see nothing for a second."""

BLANK = CameraLimits(patience_s=60.0)
"""Where all walls are blank, a car that stands before one sees nothing until it has found a way out."""

STOP_TIME = 2.0
"""Seconds after which a car that has stopped for good respawns."""


@dataclass
class Result:
    """A drive as it was.

    Attributes:
        summary: what `summary.json` holds.
        record: frame by frame.
        plan, cells, grid: the building, the map that was made of it, and where the map's cells are.
        collisions: times and true poses.
        stops: times at which the controller stopped for good.
        interrupted: by Ctrl-C.
        trace: how to draw what the controller weighed.
        ndt_cells: NDT cells of the localiser for a map file; None without a localiser.
        walked: the path `[T, 2]` as it was known at the end, every few centimetres.
    """

    config: DriveConfig
    summary: dict[str, Any]
    record: Record
    plan: Plan
    cells: torch.Tensor
    grid: Grid
    simulation: Simulation
    stops: list[float]
    interrupted: bool
    trace: Trace
    ndt_cells: npt.NDArray[np.float32] | None = None
    walked: npt.NDArray[np.float64] | None = None


def drive(
    config: DriveConfig,
    observers: Iterable[Observer] = (),
    steer: Callable[[DriveCommand], DriveCommand] | None = None,
    runner: NavigatorRunner | None = None,
) -> Result:
    """Drive through a simulated building; `observers` are told every step, `steer` changes what the controller wants.

    Cameras that fail end it with `InputError`, after the car was stopped.
    """
    plan = load_arena(config.arena, config.seed)
    check_goal(config, plan)
    runner = runner or drive_runner(config, plan)
    disturbances, rate = read_disturbances(config.disturbance), config.rate
    with contextlib.ExitStack() as stack:
        simulation = Simulation(
            plan,
            config.seed,
            walls=config.walls,
            pedestrian=config.pedestrian,
            odometry=config.odometry,
            full_frames=config.full_frames or shown(config),
            fields=runner.fields,
            disturbances=disturbances,
            rate=rate,
            rig=config.rig,
            body=config.body,
        )
        stack.callback(simulation.close)
        camera_limits = BLANK if config.walls == "blank" else DRAWN
        frame_check = CameraMonitor(simulation.rig, rate, config.limits.age, camera_limits, rendered=True)
        steps = max(1, round(config.seconds * rate))
        safe = SafeDrive(simulation, simulation, config.limits, frame_check)
        car = Car(runner, simulation, safe, steer=steer, max_steps=steps)
        record, respawn, path = Record(), Respawn(simulation, runner), WalkedPath()
        view = show(config, plan, runner, simulation, stack) if shown(config) else None
        recorder = None
        if config.record is not None:
            # Simulated time waits for it, so that nothing is left out.
            recorder = stack.enter_context(Recorder(config.record, runner, when_full="wait", report=print_note))
            car.observers.append(recorder)
        car.observers += [record.observer(runner, lambda: simulation.pose), path]
        car.observers += [] if view is None else [view]
        car.observers += [respawn, AutoResume(car.safe, respawn), *observers]
        if disturbances.none:
            car.observers.append(EndUnlessBlank(car.safe))
        began, interrupted = time.perf_counter(), False
        try:
            runner.warm_up()  # before the time is taken
            began = time.perf_counter()
            # Where frames are lost, fewer steps fill the time.
            car.run(config.seconds - 0.5 / rate if disturbances.lost_ratio else None, warm_up=False)
        except KeyboardInterrupt:
            interrupted = True
        if recorder is not None:
            recorder.close()
        wall = time.perf_counter() - began
        cells = runner.map_cells()
        summary = summarise(config, car, simulation, record, respawn, cells, wall)
        summary["recording"] = recorder.summary() if recorder is not None else None
        trace = runner.navigator.controller.trace
        about = plan, cells, plan.grid(), simulation, respawn.stops, interrupted
        return Result(config, summary, record, *about, trace, runner_ndt_cells(runner), path.places())


def check_goal(config: DriveConfig, plan: Plan) -> None:
    """Raise `InputError` where a drive shall lead to a place at which there is no room for the car's middle."""
    goal = place_of(config.goal)
    if goal is not None and not plan.clearance(np.array([goal]))[0] > 0:
        left, right, bottom, top = plan.bounds
        raise InputError(
            f"goal {config.goal} is no free place of {plan.name}, "
            f"which reaches from {left:g},{bottom:g} to {right:g},{top:g} m"
        )


def drive_runner(config: DriveConfig, plan: Plan) -> NavigatorRunner:
    """Who steers a simulated drive, with a map as large as the building."""
    return NavigatorRunner(config.options(), config.rig, config.rate, plan.grid(), body=config.body)


@dataclass
class EndUnlessBlank:
    """An observer: simulated cameras do not recover. A car that sees only blank wall is put elsewhere instead."""

    safe: SafeDrive

    def __call__(self, step: Step) -> None:
        # Whoever came before may have told it to go on already: the last fault is what it stood for.
        if step.standing is not None and self.safe.faults[-1].kind is not FaultKind.BLANK:
            raise InputError(step.standing)


def shown(config: DriveConfig) -> bool:
    return config.view or config.view_at is not None or config.rrd is not None


def show(
    config: DriveConfig, plan: Plan, runner: NavigatorRunner, simulation: Simulation, stack: contextlib.ExitStack
) -> Observer:
    """Record the drive for the viewer, or open it; closed with the stack."""
    from ndtorch_robot.view import ViewSteps, Where, layout, open_stream, plan_bounds, start_view

    name = f"{config.arena} seed {config.seed} {config.controller}"
    where = Where(config.rrd, config.view, config.view_at)
    stream = open_stream(name, where, layout(plan_bounds(plan)))
    view = start_view(stream, runner, print_note, wait=True, plan=plan)
    stack.callback(view.close)
    return ViewSteps(view, truth=lambda: simulation.pose)


def pose_errors(record: Record) -> dict[str, dict[str, float]]:
    """How far from the truth dead reckoning and the localiser are: m and degrees, at the end and in the middle."""
    true, found = record.array("pose").reshape(-1, 3), {}
    for name in ("believed", "located"):
        away, turned = pose_error(record.array(name).reshape(-1, 3), true)
        if len(true):
            found[name] = {
                "end_m": round(float(away[-1]), 4),
                "end_degrees": round(float(turned[-1]), 3),
                "median_m": round(float(np.median(away)), 4),
                "median_degrees": round(float(np.median(turned)), 3),
            }
    return found


def summarise(
    config: DriveConfig,
    car: Car,
    simulation: Simulation,
    record: Record,
    respawn: Respawn,
    cells: torch.Tensor,
    wall: float,
) -> dict[str, Any]:
    plan = simulation.plan
    poses = record.array("pose").reshape(-1, 3)
    seconds = simulation.now()
    score = MapScore(None, None, None, None, None)
    if len(poses):
        score = score_map(
            cells,
            plan.grid(),
            plan,
            simulation.world.profiles,
            poses[::5],
            config.rig,
            match_params(config.rig, config.body),
        )
    hits = len(simulation.collisions)
    free, path = simulation.spawn_points.free, poses[:, :2]
    timing = car.timer.summary()
    return {
        **collision_summary(simulation.collisions),
        "stopped": len(respawn.stops),
        "simulated_seconds": round(seconds, 3),
        "wall_seconds": round(wall, 3),
        "distance_m": round(record.distance, 3) if len(poses) else 0.0,
        "turns": record.turns,
        "step_ms": {key: round(value, 3) for key, value in timing.get("navigate", {}).items()},
        "map": {key: None if v is None else round(v, 4) for key, v in score._asdict().items()},
        "collisions_per_hour": round(hits / seconds * 3600, 1) if seconds else math.nan,
        "body_lengths": round(record.distance / config.body.length_m, 1) if len(poses) else 0.0,
        "free_area_passed": round(coverage(free, path), 4) if len(poses) else 0.0,
        "free_area_passed_40cm": round(coverage(free, path, 0.4), 4) if len(poses) else 0.0,
        **config.model_dump(include={"arena", "seed", "controller", "walls", "odometry", "disturbance"}),
        "pose_error": pose_errors(record),
        "troubles": car.troubles,
        "faults": [stop.why for stop in car.safe.faults],
        "parts_ms": timing,
    }


class AutoResume:
    """An observer that respawns and resumes a car that its cameras have stopped; this counts as a stop for good.

    Args:
        safe: the safety layer of the car.
        respawn: where stops are counted.
    """

    def __init__(self, safe: SafeDrive, respawn: Respawn) -> None:
        self.safe, self.respawn = safe, respawn
        self.since: float | None = None

    def __call__(self, step: Step) -> None:
        if step.standing is None:
            self.since = None
        elif self.since is None:
            self.since = step.time
        elif step.time - self.since >= STOP_TIME and self.safe.state is not DriveState.DRIVING:
            self.since = None
            self.respawn.stops.append(step.time)
            self.respawn.simulation.respawn()
            self.safe.resume()


class Respawn:
    """An observer that respawns a car whose controller has stopped for 2 s. On hardware a person does this.

    Attributes:
        stops: times at which the controller stopped for good.
    """

    def __init__(self, simulation: Simulation, runner: NavigatorRunner) -> None:
        self.simulation, self.runner = simulation, runner
        self.stops: list[float] = []
        self.stopped_steps = 0

    def __call__(self, step: Step) -> None:
        stopped = step.state is not None and self.runner.mode() == STOPPED
        self.stopped_steps = self.stopped_steps + 1 if stopped else 0
        if self.stopped_steps == 1 and step.frames is not None:
            self.stops.append(step.frames.time)
        if self.stopped_steps >= STOP_TIME * self.runner.rate:
            self.stopped_steps = 0
            self.simulation.respawn()
