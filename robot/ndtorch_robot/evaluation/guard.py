"""How well a guard stops: simulated drives by somebody who does not look, judged by where the walls are."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ndtorch_robot.config import DriveConfig
from ndtorch_robot.drive import drive, drive_runner
from ndtorch_robot.evaluation.drives import Summary
from ndtorch_robot.guard import Guard
from ndtorch_robot.ports import STAND, DriveCommand
from ndtorch_robot.sim.arenas import load_arena
from ndtorch_robot.sim.simulation import Simulation

MUST_STOP, MAY_GO = 0.2, 0.5
"""m that are free on the path of the wish: with less the guard must stand, with more it must not."""

STANDS = 0.02
"""m/s: a slower command is a stand."""

ANEW = 2.0
"""Seconds of standing after which the blind driver wishes something else."""

STEP = 0.04
"""m from one place to the next at which the truth is looked up."""


class BlindDriver:
    """Wishes drawn by a seed: straight or curved, ahead or now and then back, each for half a second to three.

    Attributes:
        now: the newest wish.
    """

    def __init__(self, seed: int, rate: float) -> None:
        self.rng, self.rate = np.random.default_rng((seed, 400)), rate
        self.left, self.stood, self.now = 0, 0, STAND

    def __call__(self) -> DriveCommand:
        if self.left <= 0 or self.stood > ANEW * self.rate:
            back = self.rng.random() < (0.5 if self.stood else 0.15)
            speed = -0.2 if back else self.rng.uniform(0.2, 0.6)
            self.now = DriveCommand(float(speed), float(self.rng.uniform(-2, 2) * (self.rng.random() < 0.6)))
            self.left, self.stood = round(self.rng.uniform(0.5, 3.0) * self.rate), 0
        self.left -= 1
        return self.now


def true_free(simulation: Simulation, pose: Sequence[float], wish: DriveCommand, longest: float = 1.0) -> float:
    """How far the car could go along a wish from a pose without touching anything, m, up to `longest`."""
    (x, y, heading), way = pose, math.copysign(STEP, wish.speed)
    for n in range(round(longest / STEP)):
        half = wish.curvature * way / 2
        x, y = x + way * math.cos(heading + half), y + way * math.sin(heading + half)
        heading += 2 * half
        if simulation.touches((x, y, heading)):
            return n * STEP
    return longest


def guarded_drive(
    config: DriveConfig, report: Callable[[float], None] = lambda seconds: None, guarded: bool = True
) -> Summary:
    """A drive of the blind driver with a guard, or without for comparison, and how it was judged: see `judge`."""
    runner = drive_runner(config.model_copy(update={"controller": "ranging"}), load_arena(config.arena, config.seed))
    driver, wishes = BlindDriver(config.seed, config.rate), list[DriveCommand]()
    guard = Guard(runner, driver)

    def steer(wanted: DriveCommand) -> DriveCommand:
        sent = guard(wanted)
        driver.stood = driver.stood + 1 if guard.stopped else 0
        wishes.append(driver.now)
        return sent if guarded else driver.now

    result = drive(config, [lambda step: report(step.time)], steer, runner)
    free = [
        true_free(result.simulation, pose, wish)
        for pose, wish in zip(result.record.array("pose"), wishes, strict=False)
    ]
    about = {"arena": config.arena, "seed": config.seed, "seconds": result.summary["simulated_seconds"]}
    hits = {"hits": result.summary["collisions"], "distance_m": result.summary["distance_m"]}
    return about | hits | judge(free, wishes, result.record.command, config.rate)


def judge(free: Sequence[float], wishes: Sequence[DriveCommand], sent: Sequence[DriveCommand], rate: float) -> Summary:
    """What a guard did, step by step.

    Args:
        free: how far the path of the wish was truly free, m.
        wishes, sent: what came in, and what was sent to the wheels.
        rate: steps a second.

    Returns:
        Of wishes ahead: `must_stop` and `held`, steps with less than `MUST_STOP` free, and those of them in which it
        stood; `may_go` and `false_stops`, steps with more than `MAY_GO` free, and those in which it stood; `stop_s` and
        `stop_m`, of each stop the time from the first step that was slower than the wish, and what was free at its end.
    """
    found: Summary = dict.fromkeys(("must_stop", "held", "may_go", "false_stops"), 0) | {"stop_s": [], "stop_m": []}
    slowed = 0
    for here, wish, did in zip(free, wishes, sent, strict=False):
        if wish.speed <= 0:
            slowed = 0
            continue
        stands = abs(did.speed) < STANDS
        found["must_stop"] += here < MUST_STOP
        found["held"] += here < MUST_STOP and stands
        found["may_go"] += here > MAY_GO
        found["false_stops"] += here > MAY_GO and stands
        if stands and slowed:
            found["stop_s"].append(round(slowed / rate, 3))
            found["stop_m"].append(round(here, 2))
        slowed = 0 if stands or did.speed > 0.95 * wish.speed else slowed + 1
    return found


def guard_table(summaries: Sequence[Summary], unguarded: Sequence[Summary] = ()) -> str:
    """A table in Markdown, a row an arena, one for all, and one for the same commands without the guard, if driven."""

    def row(name: str, some: Sequence[Summary]) -> str:
        total: Any = {
            key: sum(s[key] for s in some) for key in ("hits", "seconds", "must_stop", "held", "may_go", "false_stops")
        }
        times, left = (sorted(value for s in some for value in s[key]) for key in ("stop_s", "stop_m"))
        cells = [
            f"{total['hits'] / max(total['seconds'], 1) * 3600:.0f}",
            share(total["held"], total["must_stop"]),
            share(total["false_stops"], total["may_go"]),
            f"{times[len(times) // 2]:.2f}" if times else "",
            f"{left[len(left) // 2]:.2f}" if left else "",
        ]
        return f"| {name} | {' | '.join(cells)} |"

    arenas = dict.fromkeys(s["arena"] for s in summaries)
    head = ["arena", "hits an hour", "hold-stop share", "false-stop share", "time to stop, s", "free at the stop, m"]
    lines = [f"| {' | '.join(head)} |", "|---" + "|---:" * (len(head) - 1) + "|"]
    lines += [row(arena, [s for s in summaries if s["arena"] == arena]) for arena in arenas]
    lines += [row("all", summaries)] + [row("all, unguarded", unguarded)] * bool(unguarded)
    return "\n".join(lines) + "\n"


def share(part: int, whole: int) -> str:
    return f"{part / whole:.3f}" if whole else ""
