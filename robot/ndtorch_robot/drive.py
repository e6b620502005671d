"""A simulated drive: the car's own loop in a building, recorded and scored."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import STOPPED
from ndtorch.navigation.options import place_of
from ndtorch.navigation.stereo.features import MatchParams
from ndtorch_robot.camera_monitor import CameraMonitor
from ndtorch_robot.car import Car
from ndtorch_robot.config import DriveConfig
from ndtorch_robot.evaluation.metrics import MapScore, nearest, score_map
from ndtorch_robot.evaluation.record import Record, pose_error
from ndtorch_robot.navigator_runner import NavigatorRunner, WalkedPath
from ndtorch_robot.ports import DriveCommand, FaultKind, Observer, Step, print_note
from ndtorch_robot.run import observe
from ndtorch_robot.safety import DriveState, SafeDrive
from ndtorch_robot.sim.arenas import load_arena
from ndtorch_robot.sim.disturbances import Disturbances
from ndtorch_robot.sim.plan import Plan
from ndtorch_robot.sim.simulation import Simulation

DRAWN = 2.0
"""Seconds without contrast that are no fault: a car turns away from stretches of wall without marks."""

FACTS = ("arena", "seed", "controller", "odometry", "disturbance")
"""Options that the summary repeats."""

STOP_TIME = 2.0
"""Seconds after which a car that has stopped for good respawns."""


@dataclass
class DriveResult:
    """A drive as it was."""

    config: DriveConfig
    summary: dict[str, Any]  # what `summary.json` holds
    record: Record  # frame by frame
    plan: Plan
    cells: torch.Tensor  # of the map
    simulation: Simulation
    runner: NavigatorRunner
    path: WalkedPath  # where the car was as far as it knew
    stops: list[float]  # times at which the controller stopped for good
    interrupted: bool  # by Ctrl-C


def drive(
    config: DriveConfig,
    observers: Iterable[Observer] = (),
    steer: Callable[[DriveCommand], DriveCommand] | None = None,
) -> DriveResult:
    """Drive through a simulated building; `observers` are told every step, `steer` changes what the controller wants.

    Cameras that fail end it with `InputError`, after the car was stopped.
    """
    plan, robot = load_arena(config.arena, config.seed), config.robot_config
    rig, rate, body, limits = robot.stereo_rig, robot.rate_hz, robot.body, robot.simulated_limits
    check_goal(config, plan)
    runner = NavigatorRunner(config, rig, rate, plan.grid(), body=body)
    disturbances, whole = config.disturbance_values, bool(config.view) or config.rrd is not None
    how = {"odometry": config.odometry, "fields": runner.fields, "disturbances": disturbances, "full_frames": whole}
    simulation = robot.simulate(plan, config.seed, **how)
    monitor = CameraMonitor(rig, rate, limits.frame_age_s, DRAWN, rendered=True)
    safe = SafeDrive(simulation, simulation, limits, monitor)
    car = Car(runner, simulation, safe, steer=steer, max_steps=max(1, round(config.seconds * rate)))
    record, path = Record(runner, lambda: simulation.pose), WalkedPath()
    respawn = Respawn(simulation, runner, safe, end=disturbances == Disturbances())
    known: dict[str, Any] = {"plan": plan, "truth": lambda: simulation.pose}
    name, interrupted = f"{config.arena} seed {config.seed}", False
    with observe(car, name, config, print_note, **known) as (recorder, _):
        car.observers += [record, path, respawn, *observers]
        runner.navigator.warm_up()  # before the time is taken
        began = time.perf_counter()
        try:
            # Where frames are lost, fewer steps fill the time.
            car.run(config.seconds - 0.5 / rate if disturbances.lost_ratio else None, warm_up=False)
        except KeyboardInterrupt:
            interrupted = True
    cells, seconds = runner.map_cells(), time.perf_counter() - began
    summary = summarise(config, car, simulation, record, respawn, cells)
    summary |= {"wall_seconds": round(seconds, 3), "recording": recorder.summary() if recorder is not None else None}
    return DriveResult(config, summary, record, plan, cells, simulation, runner, path, respawn.stops, interrupted)


def check_goal(config: DriveConfig, plan: Plan) -> None:
    """Raise `InputError` where the goal of a drive has no room for the middle of the car."""
    goal = place_of(config.goal)
    if goal is not None and not plan.clearance(np.array([goal]))[0] > 0:
        left, right, bottom, top = plan.bounds
        raise InputError(
            f"goal {config.goal} is no free place of {plan.name}, "
            f"which reaches from {left:g},{bottom:g} to {right:g},{top:g} m"
        )


def summarise(
    config: DriveConfig, car: Car, simulation: Simulation, record: Record, respawn: Respawn, cells: torch.Tensor
) -> dict[str, Any]:
    """The numbers of a drive: collisions, stops, metres, area, map and pose errors."""
    plan, poses, hits = simulation.plan, record.array("pose"), simulation.collisions
    score, errors, passed = MapScore(), {}, 0.0
    if len(poses):
        window = MatchParams.for_body(simulation.rig, simulation.body)
        score = score_map(cells, plan.grid(), plan, simulation.world.profiles, poses[::5], simulation.rig, window)
        # Part of the free places that the car came within a metre of.
        passed = float((nearest(simulation.spawn_points.free, poses[::10, :2]) <= 1.0).mean())
        for name in ("believed", "located"):
            away, turned = pose_error(record.array(name), poses)
            values = (away[-1], turned[-1], np.median(away), np.median(turned))
            keys = ("end_m", "end_degrees", "median_m", "median_degrees")
            errors[name] = {key: round(float(value), 4) for key, value in zip(keys, values, strict=True)}
    seconds, timing = simulation.now(), car.timer.summary()
    return {
        **{name: getattr(config, name) for name in FACTS},
        "simulated_seconds": round(seconds, 3),
        "collisions": len(hits),
        "collisions_per_hour": round(len(hits) / seconds * 3600, 1) if seconds else math.nan,
        "stopped": len(respawn.stops),
        "distance_m": round(record.distance, 3) if len(poses) else 0.0,
        "turns": record.turns,
        "free_area_passed": round(passed, 4),
        "map": {key: None if v is None else round(v, 4) for key, v in score._asdict().items()},
        "pose_error": errors,
        "troubles": car.troubles,
        "faults": [stop.message for stop in car.safe.faults],
        "step_ms": {key: round(value, 3) for key, value in timing.get("navigate", {}).items()},
        "parts_ms": timing,
    }


class Respawn:
    """An observer that respawns a car that its controller or its cameras have stopped for 2 s, as a person would.

    With `end` it raises `InputError` for faults other than blank walls: simulated cameras do not recover.
    """

    def __init__(self, simulation: Simulation, runner: NavigatorRunner, safe: SafeDrive, end: bool = False) -> None:
        self.simulation, self.runner, self.safe, self.end = simulation, runner, safe, end
        self.stops: list[float] = []
        self.stopped = self.standing = 0

    def __call__(self, step: Step) -> None:
        stopped = step.state is not None and self.runner.mode() == STOPPED
        self.stopped = self.stopped + 1 if stopped else 0
        self.standing = 0 if step.standing is None else self.standing + 1
        if step.standing is not None and self.end and self.safe.faults[-1].kind is not FaultKind.BLANK:
            raise InputError(step.standing)
        if self.stopped == 1 and step.frames is not None:
            self.stops.append(step.frames.time)
        most = STOP_TIME * self.runner.rate
        blind = self.standing > most and self.safe.state is not DriveState.DRIVING
        if blind:
            self.stops.append(step.time)
            self.safe.resume()
        if blind or self.stopped >= most:
            self.stopped = self.standing = 0
            self.simulation.respawn()
