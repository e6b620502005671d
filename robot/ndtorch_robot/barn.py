"""Worlds of the BARN challenge as buildings, attempts at them, and a table of attempts."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from ndtorch.errors import InputError
from ndtorch.navigation.controllers import controller_class
from ndtorch.utils.files import TABLE_BYTES, read_text
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


@dataclass(frozen=True)
class BarnWorld:
    """One world.

    Attributes:
        number: of the challenge.
        cylinders: their middles, m.
        radius, height: of all cylinders, m.
        start: x, y, m, and heading, radians.
        goal: m.
        within: the goal is reached this near to it, m.
        limit: time allowed, s.
        path: length of the shortest path, m.
    """

    number: int
    cylinders: tuple[Point, ...]
    radius: float
    height: float
    start: tuple[float, float, float]
    goal: Point
    within: float
    limit: float
    path: float

    @property
    def is_test(self) -> bool:
        """Whether the world is kept for reports."""
        return self.number % TEST_EVERY == 0

    def score(self, seconds: float | None) -> float:
        """`OT / clip(AT, 2 OT, 8 OT)` for a goal reached after so many seconds, 0 for None; at most 0.5."""
        optimal = self.path / OPTIMAL_SPEED
        return 0.0 if seconds is None else optimal / min(max(seconds, 2 * optimal), 8 * optimal)

    def plan(self) -> Plan:
        """The cylinders in a hall."""
        xs, ys = zip(*self.cylinders, self.start[:2], self.goal, strict=True)
        left, right, bottom, top = min(xs) - AROUND, max(xs) + AROUND, min(ys) - AROUND, max(ys) + AROUND
        hall = ring([(left, bottom), (right, bottom), (right, top), (left, top)])
        solids = tuple(cylinder(x, y, self.radius, self.height) for x, y in self.cylinders)
        return Plan(f"barn-{self.number}", hall, solids, self.start).check()


def read_worlds(file: Path) -> list[BarnWorld]:
    """All worlds of a file. Raises `InputError` for one that cannot be read or holds something else."""
    try:
        values = json.loads(read_text(file, TABLE_BYTES))
        x, y, degrees = values["start"]
        start, goal = (float(x), float(y), math.radians(degrees)), (float(values["goal"][0]), float(values["goal"][1]))
        radius, height, within, limit = (
            float(values[key]) for key in ("radius_m", "height_m", "goal_radius_m", "time_limit_s")
        )
        return [
            BarnWorld(
                int(w["world"]),
                tuple((float(a), float(b)) for a, b in w["cylinders"]),
                *(radius, height, start, goal, within, limit),
                float(w["path_m"]),
            )
            for w in values["worlds"]
        ]
    except OSError as error:
        raise InputError(f"{file}: cannot be read ({error.strerror})") from None
    except InputError:
        raise
    except (ValueError, KeyError, TypeError, IndexError, OverflowError, RecursionError) as error:
        raise InputError(f"{file}: not a file of BARN worlds ({type(error).__name__}: {error})") from None


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

    def __init__(self, world: BarnWorld, simulation: Simulation, car: Car) -> None:
        self.world, self.simulation, self.car = world, simulation, car
        self.success = self.collided = False

    def __call__(self, step: Step) -> None:
        if step.standing is not None:
            raise InputError(step.standing)
        x, y, _ = self.simulation.pose
        self.collided = bool(self.simulation.collisions)
        self.success = not self.collided and math.dist((x, y), self.world.goal) <= self.world.within
        if self.success or self.collided or self.simulation.now() >= self.world.limit:
            self.car.ended.set()


def attempt(world: BarnWorld, options: RobotOptions) -> Attempt:
    """Drive through a world once, by the loop and the safety layer of every other drive.

    The car knows the goal and its start; of the cylinders it knows what it sees.
    """
    if controller_class(options.controller).has_goals:
        options = replace(options, goal=f"{world.goal[0]},{world.goal[1]}")
    rig, body, rate = options.stereo_rig, options.body, options.rate
    limits = replace(options.limits, speed_m_per_s=body.max_speed_m_per_s)
    runner = NavigatorRunner(options, rig, rate, body=body)
    simulation = Simulation(world.plan(), options.seed, rig=rig, fields=runner.fields, rate=rate, body=body)
    monitor = CameraMonitor(rig, rate, limits.frame_age_s, rendered=True)
    car = Car(runner, simulation, SafeDrive(simulation, simulation, limits, monitor))
    referee = Referee(world, simulation, car)
    car.observers.append(referee)
    runner.warm_up()
    car.run(warm_up=False)
    seconds = simulation.collisions[0].time if simulation.collisions else simulation.now()
    score = world.score(seconds if referee.success else None)
    step = car.timer.summary().get("navigate", {}).get("p50", 0.0)
    outcome = referee.success, referee.collided, round(seconds, 2), round(score, 4)
    return Attempt(world.number, *outcome, round(step, 2))


def totals(made: Sequence[Attempt]) -> dict[str, float]:
    """Ratios and means over all attempts; times over those that reached the goal."""
    worlds = pd.DataFrame(made, columns=Attempt._fields)
    means = worlds[["success", "collided", "score"]].mean().fillna(0.0).to_dict()
    return {"worlds": len(made), **means, "median_time_s": float(worlds.time_s[worlds.success.eq(True)].median())}


def table(made: Sequence[Attempt], note: str) -> str:
    """The totals in Markdown, with the worlds that were not passed."""
    t = totals(made)
    lines = [
        "| worlds | success | collisions | score | median time to the goal |",
        "|---:|---:|---:|---:|---:|",
        f"| {len(made)} | {t['success']:.2f} | {t['collided']:.2f} | {t['score']:.3f} | {t['median_time_s']:.1f} s |",
        "",
    ]
    for words, some in (
        ("Collided", [a for a in made if a.collided]),
        ("Out of time", [a for a in made if not a.collided and not a.success]),
    ):
        if some:
            lines += [f"{words}: " + ", ".join(f"{a.world} ({a.time_s:.0f} s)" for a in some) + ".", ""]
    return "\n".join([*lines, note, ""])
