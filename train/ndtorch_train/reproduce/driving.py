"""A4, A5 and A9: driving by the published saccades, and how fast it computes; simulated drives that others share."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import torch
from matplotlib.patches import Rectangle

from ndtorch.navigation import TURN, AvoidanceParams, Navigator, StereoRig
from ndtorch.navigation.controllers.published import SaccadeAvoidance, SubfieldMotion
from ndtorch_robot.evaluation.plots import draw_plan
from ndtorch_robot.sim.arenas import load_arena
from ndtorch_robot.sim.simulation import Simulation
from ndtorch_train.plots import BLACK, BLUE, ORANGE, YELLOW, panels
from ndtorch_train.recorded import RATE, Recorded, from_arrays, record_drive
from ndtorch_train.reproduce.experiment import Context, Outcome

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
    at = np.searchsorted(seen.time, seen.stops).clip(max=len(seen.pose) - 1)
    axes.plot(*seen.collisions[:, 1:].T, "X", color=ORANGE, ms=9, zorder=6, label="collision")
    axes.plot(*seen.pose[at, :2].T, "s", color=BLACK, ms=6, zorder=6, label="stopped for good")
    words = f"{seen.time[-1]:.0f} s, {len(seen.collisions)} hits, {len(seen.stops)} stops"
    axes.set_title(f"{seen.arena}, seed {seen.seed}: {words}", fontsize=10)
    axes.legend(frameon=False, fontsize=8, loc="center")


def free_driving(
    context: Context,
    curves: int = 3,
    curve_seconds: float = 300.0,
    other: tuple[str, ...] = ("loop", "room", "office"),
    other_seconds: float = 120.0,
) -> Outcome:
    """The curved hallway for minutes, and arenas with walls met head-on."""
    curved = [recorded(context, "curve", seed, curve_seconds) for seed in range(curves)]
    rest = [recorded(context, arena, 1, other_seconds) for arena in other]
    shown = [curved[0], *rest]
    figure, axes = panels([list(map(str, range(len(shown))))], 6.2 * len(shown), 6)
    for one, seen in zip(axes, shown, strict=True):
        path_panel(one, seen)
    caption = "Paths of the published controller: a hallway whose walls are met obliquely, and walls met head-on."
    context.draw("A8-paths", figure, "A fig. 8", caption)

    def troubles(seen: Recorded) -> list[float]:
        return [*seen.collisions[:, 0], *seen.stops]

    criteria = {"curved hallway: no collision, no stop": not any(map(troubles, curved))}
    criteria |= {f"{d.arena}: no collision, no stop": not troubles(d) for d in rest}
    fine = sum(float(d.summary["simulated_seconds"]) for d in curved if not troubles(d)) / 60
    words = [f"{d.arena} {len(d.collisions)} hits, {len(d.stops)} stops in {other_seconds:.0f} s" for d in rest]
    first = [min(troubles(d)) for d in (*curved, *rest) if troubles(d)]
    why = "Walls met obliquely are avoided. At walls met head-on it stops for good (both sides low) or hits them."
    why += f" The first trouble comes after {min(first):.0f}-{max(first):.0f} s." if first else ""
    ours = f"curve {fine:.1f} min without trouble; " + "; ".join(words)
    numbers = {f"{d.arena} {d.seed}": {**d.summary, "collisions and stops at": troubles(d)} for d in (*curved, *rest)}
    return Outcome(ours, why, criteria, numbers)


def stereo_pair(context: Context, seen: Recorded) -> None:
    """What both cameras see as the drive begins, with the subfields and the row that are read."""
    simulation = Simulation(load_arena(seen.arena, seen.seed), seen.seed, full_frames=True)
    figure, axes = panels("ab", 11, 4.4)
    pair = zip(axes, simulation.cameras.look(*seen.pose[0]), seen.rig.subfields(), ("left", "right"), strict=True)
    for one, frame, field, side in pair:
        one.imshow(frame[0].permute(1, 2, 0).numpy())
        corner, sides = (field.left, field.top), (field.right - field.left, field.bottom - field.top)
        one.add_patch(Rectangle(corner, *sides, fill=False, ec=YELLOW, lw=2))
        one.axhline(seen.rig.height / 2, color=ORANGE, lw=1)
        one.set(title=f"{side} camera", xticks=[], yticks=[])
    caption = "A stereo pair: subfields of the obstacle avoidance (yellow) and the row of ranging (orange)."
    context.draw("A6-stereo-pair", figure, "A fig. 6", caption)


def saccades(context: Context, arena: str = "room", seconds: float = 120.0) -> Outcome:
    """The difference of both sides over time, with two saccades."""
    seen = recorded(context, arena, 1, seconds)
    stereo_pair(context, seen)
    limit = AvoidanceParams().turn_threshold
    turning = seen.mode == TURN
    starts = np.flatnonzero(turning & ~np.concatenate(([False], turning[:-1])))
    sides, cause, times = np.sign(seen.command[starts, 1]), seen.difference[starts], seen.time[starts]
    # The first two turns in a row that lead to different sides, or the first two.
    pair = next((k for k in range(len(starts) - 1) if sides[k] != sides[k + 1]), 0)
    begin = max(0.0, times[pair] - 1.0) if len(starts) else 0.0
    end = max(begin + 3.0, times[pair + 1] + 1.5) if len(starts) > pair + 1 else begin + 3.0
    within = (seen.time >= begin) & (seen.time <= end)
    figure, (one,) = panels("a", 11, 4)
    one.plot(seen.time[within], seen.difference[within], color=BLUE, lw=1.3, label="right - left, low-passed")
    for sign in (1, -1):
        one.axhline(sign * limit, color=BLACK, ls="--", lw=1)
    top = float(np.abs(seen.difference[within]).max())
    for at, value, side in zip(times, cause, sides, strict=True):
        if begin <= at <= end:
            words, arrow = "left turn" if side > 0 else "right turn", {"arrowstyle": "->", "color": ORANGE}
            one.annotate(words, (at, value), (at, 1.15 * top), ha="center", arrowprops=arrow, color=ORANGE)
    one.set(xlabel="time (s)", ylabel="difference of speed estimates", ylim=(-1.1 * top, 1.4 * top), xlim=(begin, end))
    one.legend(frameon=False, loc="lower right", fontsize=9)
    caption = "Difference of the right and left speed estimates, the threshold (dashed) and the saccades it starts."
    context.draw("A7-saccades", figure, "A fig. 7", caption)
    criteria = {
        "at least two saccades": len(starts) >= 2,
        "each starts where |difference| > 0.15": bool((np.abs(cause) > limit).all()) and len(starts) > 0,
        "each leads away from the faster side": bool((np.sign(cause) == sides).all()) and len(starts) > 0,
        "a right and a left turn": len(set(sides.tolist())) == 2,
    }
    left, right = int((sides > 0).sum()), int((sides < 0).sum())
    why = "No turn to the other side: the ring bends one way only." if min(left, right) == 0 else ""
    numbers = {"times": times, "difference": cause, "sides": sides}
    return Outcome(f"{right} right, {left} left turns in {seconds:.0f} s", why, criteria, numbers)


def speed(context: Context, seconds: float = 3.0) -> Outcome:
    """How many frames a second the avoidance and the whole navigation step take on one core."""
    rig = StereoRig()
    generator = torch.Generator().manual_seed(0)
    left, right = torch.randint(0, 256, (2, 8, 1, 3, 480, 640), dtype=torch.uint8, generator=generator)
    motion, rule = SubfieldMotion(rig, 1 / RATE), SaccadeAvoidance(1 / RATE)
    navigator = Navigator(rig, 1 / RATE, controller="published")

    def avoid(k: int, state: Any) -> Any:
        sides, fields = motion(left[k], right[k], state and state[0])
        return fields, rule(sides, state and state[1])[1]

    def navigate(k: int, state: Any) -> Any:
        return navigator(left[k], right[k], state)[1]

    rates: dict[str, float] = {}
    with torch.inference_mode():
        for name, step in (("avoidance", avoid), ("avoidance and ranges", navigate)):
            state, times, began = None, list[float](), time.perf_counter()
            while time.perf_counter() - began < seconds or len(times) < 3:
                # Processor time: other processes on the core do not count.
                start = time.process_time()
                for k in range(8):
                    state = step(k, state)
                times.append((time.process_time() - start) / 8)
            rates[name] = 1 / float(np.median(times[1:]))
    criteria = {f"{name}: over 1000 a second": rate > 1000 for name, rate in rates.items()}
    ours = "; ".join(f"{name} {rate:.0f}/s" for name, rate in rates.items())
    why = "The paper speaks of a microcontroller without measuring; this is processor time of one core here, with two "
    return Outcome(ours, f"{why}640 x 480 cameras.", criteria, {"rates": rates})
