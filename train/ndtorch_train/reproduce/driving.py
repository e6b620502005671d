"""A4, A5 and A9: driving by the published saccades, and how fast it computes; simulated drives that others share."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import torch

from ndtorch.navigation import TURN, AvoidanceParams, Navigator, StereoRig
from ndtorch.navigation.controllers.published import SaccadeAvoidance, SubfieldMotion
from ndtorch_robot.evaluation.plots import draw_plan
from ndtorch_robot.sim.arenas import load_arena
from ndtorch_train.plots import BLACK, BLUE, GREEN, ORANGE, YELLOW, panels
from ndtorch_train.recorded import RATE, Recorded, from_arrays, record_drive
from ndtorch_train.reproduce.experiment import Context, Outcome, judged

PUBLISHED = {"controller": "published", "features": 5, "feature_position": "motion"}
"""What is printed in place of the defaults of `ndtorch drive`."""


def recorded(context: Context, arena: str, seed: int, seconds: float, **options: Any) -> Recorded:
    """Drive with the published controller, or look up the drive; `options`: other fields of `DriveConfig`."""
    key = {"arena": arena, "seed": seed, "seconds": seconds, **PUBLISHED, **options}
    return from_arrays(context.stored("drive", key, lambda: record_drive(key)), arena, seed)


def path_panel(axes: Any, seen: Recorded) -> None:
    """The true path over the plan, with turns, collisions and stops."""
    draw_plan(axes, load_arena(seen.arena, seen.seed))
    line = seen.line()
    axes.plot(*line.T, color=BLUE, lw=1.2, zorder=3, label="path")
    turning = np.where((seen.mode == TURN)[:, None], line, np.nan)
    axes.plot(*turning.T, color=YELLOW, lw=2.5, zorder=4, label="saccade")
    if len(seen.collisions):
        axes.plot(*seen.collisions[:, 1:].T, "X", color=ORANGE, ms=9, zorder=6, label="collision")
    if len(seen.stops):
        at = np.searchsorted(seen.time, seen.stops).clip(max=len(seen.pose) - 1)
        axes.plot(*seen.pose[at, :2].T, "s", color=BLACK, ms=6, zorder=6, label="stopped for good")
    s = seen.summary
    hits, stops = len(seen.collisions), len(seen.stops)
    axes.set_title(
        f"{seen.arena}, seed {seen.seed}: {s['simulated_seconds']:.0f} s, {hits} hits, {stops} stops", fontsize=10
    )
    axes.legend(frameon=False, fontsize=8, loc="center")


def free_driving(
    context: Context,
    curve_seeds: list[int],
    curve_seconds: float,
    other: list[str],
    seed: int,
    other_seconds: float,
) -> Outcome:
    """The curved hallway for minutes, and arenas with walls met head-on."""
    tasks = [("curve", s, curve_seconds) for s in curve_seeds] + [(a, seed, other_seconds) for a in other]
    drives = [recorded(context, arena, s, seconds) for arena, s, seconds in tasks]
    shown = [drives[0], *drives[len(curve_seeds) :]]
    figure, axes = panels(1, len(shown), 6.2 * len(shown), 6)
    for one, seen in zip(axes, shown, strict=True):
        path_panel(one, seen)
    caption = "Paths of the published controller: a hallway whose walls are met obliquely, and walls met head-on."
    context.draw("A8-paths", figure, "A fig. 8", caption, drives=tasks)

    def troubles(seen: Recorded) -> int:
        return len(seen.collisions) + len(seen.stops)

    curved, rest = drives[: len(curve_seeds)], drives[len(curve_seeds) :]
    numbers = {
        f"{d.arena} {d.seed}": {
            "seconds": d.summary["simulated_seconds"],
            "collisions": len(d.collisions),
            "stops": len(d.stops),
            "turns": d.summary["turns"],
            "first trouble at": min([*d.collisions[:, 0], *d.stops], default=None),
        }
        for d in drives
    }
    parts = {"curved hallway: no collision, no stop": all(troubles(d) == 0 for d in curved)}
    parts |= {f"{d.arena}: no collision, no stop": troubles(d) == 0 for d in rest}
    fine = sum(float(d.summary["simulated_seconds"]) for d in curved if troubles(d) == 0) / 60
    words = [f"{d.arena} {len(d.collisions)} hits, {len(d.stops)} stops in {other_seconds:.0f} s" for d in rest]
    ours = f"curve {fine:.1f} min without trouble; " + "; ".join(words)
    first = [n["first trouble at"] for n in numbers.values() if n["first trouble at"] is not None]
    why = f"The first trouble comes after {min(first):.0f}-{max(first):.0f} s." if first else ""
    head_on = "At walls met head-on it stops for good (both sides low) or hits them."
    why = f"Walls met obliquely are avoided. {head_on} {why}".strip()
    return judged(context, ours, why, parts, numbers)


def saccades(context: Context, arena: str, seed: int, seconds: float, shown: float) -> Outcome:
    """The difference of both sides over time, with two saccades."""
    seen = recorded(context, arena, seed, seconds)
    limit = AvoidanceParams().turn_threshold
    turning = seen.mode == TURN
    starts = np.flatnonzero(turning & ~np.concatenate(([False], turning[:-1])))
    sides = np.sign(seen.command[starts, 1])
    # The first two turns in a row that lead to different sides, or the first two.
    pair = next((k for k in range(len(starts) - 1) if sides[k] != sides[k + 1]), 0)
    middle = seen.time[starts[pair]] if len(starts) else 0.0
    begin = max(0.0, middle - 1.0)
    end = max(begin + shown, seen.time[starts[pair + 1]] + 1.5 if len(starts) > pair + 1 else 0.0)
    within = (seen.time >= begin) & (seen.time <= end)
    figure, (one,) = panels(1, 1, 11, 4)
    one.plot(seen.time[within], seen.difference[within], color=BLUE, lw=1.3, label="right - left, low-passed")
    for sign in (1, -1):
        one.axhline(sign * limit, color=BLACK, ls="--", lw=1)
    top = float(np.abs(seen.difference[within]).max()) if within.any() else 1.0
    for k, side in zip(starts, sides, strict=True):
        if begin <= seen.time[k] <= end:
            words = "left turn" if side > 0 else "right turn"
            one.annotate(words, (seen.time[k], seen.difference[k]), (seen.time[k], 1.15 * top), ha="center",
                         arrowprops={"arrowstyle": "->", "color": ORANGE}, color=ORANGE)  # fmt: skip
    one.set(xlabel="time (s)", ylabel="difference of speed estimates", ylim=(-1.1 * top, 1.4 * top), xlim=(begin, end))
    one.set_title(f"{arena}, seed {seed}", fontsize=10)
    one.legend(frameon=False, loc="lower right", fontsize=9)
    caption = "Difference of the right and left speed estimates, the threshold (dashed) and the saccades it starts."
    context.draw("A7-saccades", figure, "A fig. 7", caption, arena=arena, seed=seed, window=[begin, end])
    cause = seen.difference[starts]
    parts = {
        "at least two saccades": len(starts) >= 2,
        "each starts where |difference| > 0.15": bool((np.abs(cause) > limit).all()) and len(starts) > 0,
        "each leads away from the faster side": bool((np.sign(cause) == sides).all()) and len(starts) > 0,
        "a right and a left turn": len(set(sides.tolist())) == 2,
    }
    numbers = {"times": seen.time[starts], "difference": cause, "sides": sides}
    left, right = int((sides > 0).sum()), int((sides < 0).sum())
    ours = f"{right} right, {left} left turns in {seconds:.0f} s"
    why = "No turn to the other side: the ring bends one way only." if min(left, right) == 0 else ""
    return judged(context, ours, why, parts, numbers)


def speed(context: Context, seconds: float) -> Outcome:
    """How many frames a second the avoidance and the whole navigation step take on one core."""
    rig = StereoRig()
    generator = torch.Generator().manual_seed(0)
    frames = torch.randint(0, 256, (2, 8, 3, 480, 640), dtype=torch.uint8, generator=generator)
    left, right = frames[:, :, None]
    motion, rule = SubfieldMotion(rig, 1 / RATE), SaccadeAvoidance(1 / RATE)
    navigator = Navigator(rig, 1 / RATE, controller="published")

    kept: dict[str, Any] = {"fields": None, "mode": None, "all": None}

    def avoid() -> None:
        for k in range(8):
            sides, kept["fields"] = motion(left[k], right[k], kept["fields"])
            _, kept["mode"] = rule(sides, kept["mode"])

    def navigate() -> None:
        for k in range(8):
            _, kept["all"] = navigator(left[k], right[k], kept["all"])

    rates: dict[str, float] = {}
    with torch.inference_mode():
        for name, step in (("avoidance", avoid), ("avoidance and ranges", navigate)):
            step()
            times = []
            began = time.perf_counter()
            while time.perf_counter() - began < seconds:
                # Processor time: other processes on the core are not ours to count.
                start = time.process_time()
                step()
                times.append((time.process_time() - start) / 8)
            rates[name] = 1 / float(np.median(times))
    figure, (one,) = panels(1, 1, 7, 2.6)
    one.barh(list(rates), list(rates.values()), color=[BLUE, GREEN])
    one.axvline(1000, color=BLACK, ls="--", lw=1)
    one.set(xlabel="frames a second, one core (dashed: 1000)")
    for k, rate in enumerate(rates.values()):
        one.text(rate, k, f" {rate:.0f}", va="center", fontsize=9)
    one.set_xlim(0, 1.15 * max(rates.values()))
    caption = "Frames a second of two 640 x 480 cameras, by one core with torch."
    context.draw("A-speed", figure, "A §2.3", caption, seconds=seconds)
    parts = {f"{name}: over 1000 a second": rate > 1000 for name, rate in rates.items()}
    ours = "; ".join(f"{name} {rate:.0f}/s" for name, rate in rates.items())
    why = "The paper speaks of a microcontroller without measuring; this is processor time of one core here."
    return judged(context, ours, why, parts, {"rates": rates})
