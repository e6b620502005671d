"""Worlds of the BARN challenge as buildings, attempts at them, and a table of attempts."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, NamedTuple

import pandas as pd
from pydantic import Field

from ndtorch.errors import InputError
from ndtorch.navigation.controllers.registry import controller_class
from ndtorch.utils.files import TABLE_BYTES, read_text
from ndtorch.utils.toml import Strict, check
from ndtorch_robot.camera_monitor import CameraMonitor
from ndtorch_robot.car import Car
from ndtorch_robot.config import RobotOptions
from ndtorch_robot.navigator_runner import NavigatorRunner
from ndtorch_robot.ports import Step
from ndtorch_robot.safety import SafeDrive
from ndtorch_robot.sim.plan import Plan, Point, cylinder, ring
from ndtorch_robot.sim.simulation import Simulation

AROUND = 1.2
"""Metres between the cylinders or the goal and the walls of the hall around them."""

TEST_EVERY = 5
"""Worlds whose number this divides are for reports; nothing is tuned on them."""

OPTIMAL_SPEED = 2.0
"""m/s with which the shortest path becomes the optimal time of the score."""


class BarnWorld(Strict, extra="ignore"):
    """One world of a file.

    Attributes:
        world: number of the challenge.
        path_m: length of the shortest path.
        cylinders: their middles, m.
    """

    world: int
    path_m: Annotated[float, Field(gt=0)]
    cylinders: tuple[Point, ...]

    @property
    def is_test(self) -> bool:
        """Whether the world is kept for reports."""
        return self.world % TEST_EVERY == 0

    def score(self, seconds: float | None) -> float:
        """`OT / clip(AT, 2 OT, 8 OT)` for a goal reached after so many seconds, 0 for None; at most 0.5."""
        optimal = self.path_m / OPTIMAL_SPEED
        return 0.0 if seconds is None else optimal / min(max(seconds, 2 * optimal), 8 * optimal)


class BarnFile(Strict, extra="ignore"):
    """A file of worlds.

    Attributes:
        radius_m, height_m: of all cylinders.
        goal_radius_m: the goal is reached this near to it.
        time_limit_s: time allowed.
        start: x, y, m, and heading, degrees.
        goal: m.
    """

    radius_m: Annotated[float, Field(gt=0)]
    height_m: Annotated[float, Field(gt=0)]
    goal_radius_m: float
    time_limit_s: Annotated[float, Field(gt=0)]
    start: tuple[float, float, float]
    goal: Point
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
    try:
        values = json.loads(read_text(file, TABLE_BYTES))
        return check(values if isinstance(values, dict) else {}, BarnFile, str(file))
    except OSError as error:
        raise InputError(f"{file}: cannot be read ({error.strerror})") from None
    except InputError:
        raise
    except (ValueError, RecursionError) as error:
        raise InputError(f"{file}: no JSON ({error})") from None


class Attempt(NamedTuple):
    """What came of driving through a world once.

    Attributes:
        world: its number.
        success, collided: the goal was reached in time and untouched; the car touched something.
        time_s: until the goal, the collision or the end of the time.
        score: of the challenge.
        step_ms: median of a navigation step.
    """

    world: int
    success: bool
    collided: bool
    time_s: float
    score: float
    step_ms: float


class Referee:
    """An observer that ends the drive at the goal, at a collision and when the time is over."""

    def __init__(self, file: BarnFile, simulation: Simulation, car: Car) -> None:
        self.file, self.simulation, self.car = file, simulation, car
        self.success = self.collided = False

    def __call__(self, step: Step) -> None:
        if step.standing is not None:
            raise InputError(step.standing)
        x, y, _ = self.simulation.pose
        self.collided = bool(self.simulation.collisions)
        self.success = not self.collided and math.dist((x, y), self.file.goal) <= self.file.goal_radius_m
        if self.success or self.collided or self.simulation.now() >= self.file.time_limit_s:
            self.car.ended.set()


def attempt(file: BarnFile, world: BarnWorld, options: RobotOptions) -> Attempt:
    """Drive through a world once, by the loop and the safety layer of every other drive.

    The car knows the goal and its start; of the cylinders it knows what it sees.
    """
    if controller_class(options.controller).has_goals:
        options = replace(options, goal=f"{file.goal[0]},{file.goal[1]}")
    rig, body, rate = options.stereo_rig, options.body, options.rate
    limits = replace(options.limits, speed_m_per_s=body.max_speed_m_per_s)
    runner = NavigatorRunner(options, rig, rate, body=body)
    simulation = Simulation(file.plan(world), options.seed, rig=rig, fields=runner.fields, rate=rate, body=body)
    monitor = CameraMonitor(rig, rate, limits.frame_age_s, rendered=True)
    car = Car(runner, simulation, SafeDrive(simulation, simulation, limits, monitor))
    referee = Referee(file, simulation, car)
    car.observers.append(referee)
    runner.warm_up()
    car.run(warm_up=False)
    seconds = simulation.collisions[0].time if simulation.collisions else simulation.now()
    score = world.score(seconds if referee.success else None)
    step = car.timer.summary().get("navigate", {}).get("p50", 0.0)
    outcome = referee.success, referee.collided, round(seconds, 2), round(score, 4)
    return Attempt(world.world, *outcome, round(step, 2))


def totals(made: Sequence[Attempt]) -> dict[str, float]:
    """Ratios and means over all attempts; times over those that reached the goal."""
    worlds = pd.DataFrame(made, columns=Attempt._fields)
    means = worlds[["success", "collided", "score"]].mean().fillna(0.0).to_dict()
    return {"worlds": len(made), **means, "median_time_s": float(worlds.time_s[worlds.success.eq(True)].median())}


def table(made: Sequence[Attempt], note: str) -> str:
    """The totals in Markdown."""
    t = totals(made)
    lines = [
        "| worlds | success | collisions | score | median time to the goal |",
        "|---:|---:|---:|---:|---:|",
        f"| {len(made)} | {t['success']:.2f} | {t['collided']:.2f} | {t['score']:.3f} | {t['median_time_s']:.1f} s |",
    ]
    return "\n".join([*lines, "", note, ""])
