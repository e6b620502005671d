"""Worlds of the BARN challenge as buildings, and attempts at them."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import pandas as pd
from pydantic import Field

from ndtorch.errors import InputError
from ndtorch.navigation.controllers.contract import controller_class
from ndtorch.utils.files import TABLE_BYTES
from ndtorch.utils.toml import Strict, check, file_values
from ndtorch_robot.camera_monitor import CameraMonitor
from ndtorch_robot.car import Car
from ndtorch_robot.config import RobotOptions
from ndtorch_robot.navigator_runner import NavigatorRunner
from ndtorch_robot.ports import Step
from ndtorch_robot.safety import SafeDrive
from ndtorch_robot.sim.plan import Plan, Point, cylinder, ring

AROUND, OPTIMAL_SPEED = 1.2, 2.0
"""Metres around cylinders and goal to the walls of the hall; m/s by which the shortest path is the optimal time."""

TEST_EVERY = 5
"""Worlds whose number this divides are for reports; nothing is tuned on them."""

Positive = Annotated[float, Field(gt=0)]


class BarnWorld(Strict, extra="ignore"):
    """One world: number, length of the shortest path, m, and middles of the cylinders, m."""

    world: int
    path_m: Positive
    cylinders: tuple[Point, ...]

    @property
    def is_test(self) -> bool:
        return self.world % TEST_EVERY == 0

    def score(self, seconds: float | None) -> float:
        """`OT / clip(AT, 2 OT, 8 OT)` for a goal reached after so many seconds, 0 for None; at most 0.5."""
        optimal = self.path_m / OPTIMAL_SPEED
        return 0.0 if seconds is None else optimal / min(max(seconds, 2 * optimal), 8 * optimal)


class BarnFile(Strict, extra="ignore"):
    """A file of worlds."""

    radius_m: Positive  # radius, height: of all cylinders
    height_m: Positive
    goal_radius_m: float  # the goal is reached this near to it
    time_limit_s: Positive
    start: tuple[float, float, float]  # x, y, m, and heading, degrees
    goal: Point  # m
    worlds: tuple[BarnWorld, ...]

    def plan(self, world: BarnWorld) -> Plan:
        """The cylinders of a world in a hall."""
        (x, y, degrees), cylinders = self.start, world.cylinders
        xs, ys = zip(*cylinders, (x, y), self.goal, strict=True)
        left, right, bottom, top = min(xs) - AROUND, max(xs) + AROUND, min(ys) - AROUND, max(ys) + AROUND
        hall = ring([(left, bottom), (right, bottom), (right, top), (left, top)])
        solids = tuple(cylinder(*middle, self.radius_m, self.height_m) for middle in cylinders)
        return Plan(f"barn-{world.world}", hall, solids, (x, y, math.radians(degrees))).check()


def read_worlds(file: Path) -> BarnFile:
    """All worlds of a file. Raises `InputError` for one that cannot be read or holds something else."""
    values = file_values(file, json.loads, "JSON", TABLE_BYTES)
    return check(values if isinstance(values, dict) else {}, BarnFile, str(file))


def attempt(job: tuple[BarnFile, RobotOptions]) -> dict[str, Any]:
    """Drive through the first world of a file, by the loop and the safety layer of every other drive.

    The car knows the goal and its start; of the cylinders it knows what it sees.
    """
    (file, options), world = job, job[0].worlds[0]
    if controller_class(options.controller).has_goals:
        options = replace(options, goal=f"{file.goal[0]},{file.goal[1]}")
    robot = options.robot_config
    rig, body, rate = robot.stereo_rig, robot.body, robot.rate_hz
    limits = replace(robot.simulated_limits, speed_m_per_s=body.max_speed_m_per_s)
    runner = NavigatorRunner(options, rig, rate, body=body)
    simulation = robot.simulate(file.plan(world), options.seed, fields=runner.fields)
    monitor = CameraMonitor(rig, rate, limits.frame_age_s, rendered=True)
    car = Car(runner, simulation, SafeDrive(simulation, simulation, limits, monitor))

    def reached() -> bool:
        return not simulation.collisions and math.dist(simulation.pose[:2], file.goal) <= file.goal_radius_m

    def end(step: Step) -> None:
        if step.standing is not None:
            raise InputError(step.standing)
        if reached() or simulation.collisions or simulation.now() >= file.time_limit_s:
            car.ended.set()

    car.observers.append(end)
    runner.navigator.warm_up()
    car.run(warm_up=False)
    collided, success = bool(simulation.collisions), reached()
    seconds = simulation.collisions[0].time if collided else simulation.now()
    return {
        "world": world.world,
        "success": success,
        "collided": collided,
        "time_s": round(seconds, 2),
        "score": round(world.score(seconds if success else None), 4),
        "step_ms": round(car.timer.summary().get("navigate", {}).get("p50", 0.0), 2),
    }


def totals(attempts: pd.DataFrame) -> pd.DataFrame:
    """Means over all attempts as a table of one row; times over those that reached the goal."""
    values = {
        "worlds": len(attempts),
        **attempts[["success", "collided", "score"]].mean(),
        "median_time_s": attempts["time_s"][attempts["success"].eq(True)].median(),
    }
    return pd.DataFrame([values])
