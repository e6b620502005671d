"""Attempts at worlds of the BARN challenge: driven once, kept, and as a table."""

from __future__ import annotations

import csv
import dataclasses
import hashlib
import io
import json
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ndtorch.errors import InputError
from ndtorch.navigation.controllers import controller_class
from ndtorch.navigation.options import NavigatorOptions
from ndtorch_robot.barn.moving import Sightings, is_visible
from ndtorch_robot.barn.worlds import World
from ndtorch_robot.camera_monitor import CameraMonitor
from ndtorch_robot.car import Car
from ndtorch_robot.config import RATE
from ndtorch_robot.evaluation.drives import ResultCache
from ndtorch_robot.navigator_runner import NavigatorRunner
from ndtorch_robot.ports import Step
from ndtorch_robot.run_config import RobotTable
from ndtorch_robot.safety import SafeDrive, SafetyLimits
from ndtorch_robot.sim.plan import Point
from ndtorch_robot.sim.simulation import BODY, RIG, Mover, Simulation

LIMITS = SafetyLimits(speed=1.0, curvature=2.2, silence=0.1, age=0.1)
"""Those of a car; the simulated one has limits of its own for how fast speed and steering may change."""


COLUMNS = ("world", "success", "collided", "time_s", "score")
"""Of `barn.csv`."""


class Attempt(NamedTuple):
    """What came of driving through a world once.

    Attributes:
        world: its number.
        success, collided: the goal was reached in time and untouched; the car touched something.
        time_s: until the goal, the collision or the end of the time.
        score: of the challenge.
        path: true x and y ten times a second, m.
        wall_s: real time it took.
        step_ms: median of a navigation step.
        touched: what it touched: `"standing"`, `"moving"`, `"stood"` for a moving cylinder that hit the stationary car,
            or `"seen"` for one ahead of its bumper that had been visible for a second; empty for nothing.
        margin_m: the least distance that was seen free beyond the braking distance; inf where the controller has none.
    """

    world: int
    success: bool
    collided: bool
    time_s: float
    score: float
    path: list[tuple[float, float]]
    wall_s: float
    step_ms: float
    touched: str = ""
    margin_m: float = math.inf


@dataclass(frozen=True)
class Entry:
    """A world and who drives it."""

    world: World
    options: NavigatorOptions
    seed: int = 0
    robot: RobotTable | None = None
    movers: tuple[Mover, ...] = ()
    plain_cylinders: bool = False


class Referee:
    """An observer that ends the drive at the goal, at a collision and when the time is over."""

    def __init__(self, world: World, simulation: Simulation, car: Car) -> None:
        self.world, self.simulation, self.car = world, simulation, car
        self.path: list[tuple[float, float]] = []
        self.success = self.collided = False
        self.margin, self.sightings = math.inf, Sightings(simulation.rate)

    def __call__(self, step: Step) -> None:
        if step.standing is not None:
            raise InputError(step.standing)
        x, y, _ = self.simulation.pose
        if step.number % 3 == 0 and not self.simulation.collisions:
            self.path.append((round(x, 3), round(y, 3)))
        if step.state is not None:
            self.margin = min(self.margin, getattr(step.state.control, "margin", math.inf))
        now = self.simulation.now()
        self.sightings.add(tuple(self.sees(mover.at(now)) for mover in self.simulation.movers))
        self.collided = bool(self.simulation.collisions)
        self.success = not self.collided and math.dist((x, y), self.world.goal) <= self.world.within
        if self.success or self.collided or self.simulation.now() >= self.world.limit:
            self.car.ended.set()

    def sees(self, place: Point) -> bool:
        """Whether a cylinder at a place is visible to the cameras."""
        (x, y, heading), rig = self.simulation.pose, self.simulation.rig
        camera = (x + rig.forward * math.cos(heading), y + rig.forward * math.sin(heading))
        return is_visible(self.world, place, camera, heading, math.atan(rig.width / 2 / rig.focal))

    def touched(self) -> str:
        """What the car touched, as in `Attempt`."""
        if not self.simulation.collisions:
            return ""
        hit = self.simulation.collisions[0]
        if not hit.person:
            return "standing"
        if hit.stationary:
            return "stood"
        away = [np.subtract(mover.at(hit.time), (hit.x, hit.y)) for mover in self.simulation.movers]
        nearest = int(np.argmin([np.hypot(*to) for to in away]))
        ahead = away[nearest] @ np.array((math.cos(hit.heading), math.sin(hit.heading)))
        return "seen" if ahead > self.simulation.body.length_m / 2 and self.sightings.lasted(nearest) else "moving"


def attempt(entry: Entry) -> Attempt:
    """Drive through a world once, by the loop and the safety layer of every other drive.

    The car knows the goal and its start; of the cylinders it knows what it sees.
    """
    world = entry.world
    x, y = world.goal
    has_goals = controller_class(entry.options.controller).has_goals
    options = replace(entry.options, goal=f"{x},{y}") if has_goals else entry.options
    robot = entry.robot
    rig, body = (RIG, BODY) if robot is None else (robot.stereo_rig(), robot.body.body())
    rate, limits = (RATE, LIMITS) if robot is None else (robot.rate_hz, robot.simulated_limits(body.max_speed_m_per_s))
    runner = NavigatorRunner(options, rig, rate, body=body)
    simulation = Simulation(
        world.plan(),
        entry.seed,
        rig=rig,
        fields=runner.fields,
        rate=rate,
        body=body,
        movers=entry.movers,
        plain_cylinders=entry.plain_cylinders,
    )
    try:
        frame_check = CameraMonitor(rig, rate, limits.age, rendered=True)
        car = Car(runner, simulation, SafeDrive(simulation, simulation, limits, frame_check))
        referee = Referee(world, simulation, car)
        car.observers.append(referee)
        runner.warm_up()
        began = time.perf_counter()
        car.run(warm_up=False)
        wall = time.perf_counter() - began
        seconds = simulation.collisions[0].time if simulation.collisions else simulation.now()
        score = world.score(seconds if referee.success else None)
        step = car.timer.summary().get("navigate", {}).get("p50", 0.0)
        return Attempt(
            world.number,
            referee.success,
            referee.collided,
            round(seconds, 2),
            round(score, 4),
            referee.path,
            round(wall, 1),
            round(step, 2),
            referee.touched(),
            round(referee.margin * body.unit_m, 3),
        )
    finally:
        simulation.close()


class AttemptCache(ResultCache[Entry]):
    """Finished attempts, so that a run can go on where it was stopped."""

    def name(self, job: Entry) -> str:
        robot = None if job.robot is None else job.robot.model_dump()
        text = json.dumps([dataclasses.asdict(replace(job, robot=None)), robot, self.code], sort_keys=True)
        return f"{job.world.number:04d}-{hashlib.sha256(text.encode()).hexdigest()[:12]}"

    def attempt(self, entry: Entry) -> Attempt | None:
        found = self.get(entry)
        return None if found is None else Attempt(**{**found, "path": [tuple(place) for place in found["path"]]})


def comma_separated(made: Sequence[Attempt]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    writer.writerows([a.world, int(a.success), int(a.collided), f"{a.time_s:.2f}", f"{a.score:.4f}"] for a in made)
    return text.getvalue()


def totals(made: Sequence[Attempt]) -> dict[str, float]:
    """Shares and means over all attempts; times over those that reached the goal."""
    times = [a.time_s for a in made if a.success]
    return {
        "worlds": len(made),
        "success": float(np.mean([a.success for a in made])) if made else 0.0,
        "collisions": float(np.mean([a.collided for a in made])) if made else 0.0,
        "score": float(np.mean([a.score for a in made])) if made else 0.0,
        "median_time_s": float(np.median(times)) if times else float("nan"),
    }


def table(made: Sequence[Attempt], note: str) -> str:
    """The totals in Markdown, with the worlds that were not passed."""
    t = totals(made)
    lines = [
        "| worlds | success | collisions | score | median time to the goal |",
        "|---:|---:|---:|---:|---:|",
        f"| {len(made)} | {t['success']:.2f} | {t['collisions']:.2f} | {t['score']:.3f} | {t['median_time_s']:.1f} s |",
        "",
    ]
    for words, some in (
        ("Hit what stands", [a for a in made if a.touched == "standing"]),
        ("Hit a moving cylinder", [a for a in made if a.touched == "moving"]),
        ("Stood and was hit by a moving cylinder", [a for a in made if a.touched == "stood"]),
        ("Drove into a moving cylinder that was visible for a second", [a for a in made if a.touched == "seen"]),
        ("Out of time", [a for a in made if not a.collided and not a.success]),
    ):
        if some:
            lines += [f"{words}: " + ", ".join(f"{a.world} ({a.time_s:.0f} s)" for a in some) + ".", ""]
    return "\n".join([*lines, note, ""])
