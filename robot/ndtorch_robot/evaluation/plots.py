"""Plots of a drive, of an evaluation and of the BARN worlds."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ndtorch.navigation import REVERSE, TURN, Grid
from ndtorch.report.plots import DPI, save
from ndtorch_robot.drive import Result
from ndtorch_robot.evaluation.record import Floats, pose_error, range_columns
from ndtorch_robot.evaluation.table import Row
from ndtorch_robot.sim.plan import Plan

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ndtorch_robot.barn import Attempt, BarnWorld

BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY = "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"
"""The color-blind safe palette of Okabe and Ito."""

LEFT, RIGHT, PATH, HIT = BLUE, VERMILION, BLUE, "#cc0000"

STYLES = tuple(zip((BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY), "os^DvP", strict=True))
"""Color and marker of each controller."""

SURFACES = {
    "wall": ("0.2", 2.0),
    "blank": ("0.6", 2.0),
    "door": ("#a05a2c", 3.5),
    "jamb": ("0.2", 1.5),
    "pillar": ("0.2", 2.0),
    "furniture": ("#b08d57", 1.5),
}
"""Color and line width of each kind of surface."""

SHOWN_SECONDS = 40.0
"""Longest part of a drive whose speeds can be read in one plot."""

MOVED = 0.5
"""Metres between two places of a path from which on the car was moved."""

OUTCOMES = ((GREEN, "reached the goal"), (VERMILION, "collided"), (BLUE, "out of time"))
"""How an attempt at a BARN world ended."""


def new_figure(width: float, height: float) -> Figure:
    """A figure of that size in inches, whose axes make room for their labels."""
    from matplotlib.figure import Figure

    return Figure((width, height), dpi=DPI, layout="constrained")


def legend(figure: Figure, columns: int, *axes: Axes) -> None:
    """A legend below the axes, where it covers no line."""
    handles, labels = [], []
    for one in axes:
        more = one.get_legend_handles_labels()
        handles += more[0]
        labels += more[1]
    figure.legend(handles, labels, loc="outside lower center", ncols=columns, frameon=False, fontsize=9)


def plural(count: int, word: str) -> str:
    return f"{count} {word}" + ("" if count == 1 else "s")


# A drive.


def write_plots(result: Result, folder: Path) -> None:
    """Write path.png, map.png, speeds.png and rows.png, and pose.png where the car was localised."""
    drawn: dict[str, Callable[[Result], Figure]] = {"path": path, "map": map_, "speeds": speeds, "rows": rows}
    if result.ndt_cells is not None:
        drawn["pose"] = pose
    for name, draw in drawn.items():
        save(draw(result), folder / f"{name}.png")


def headline(result: Result) -> str:
    s, c = result.summary, result.config
    return f"{c.arena}, seed {c.seed}, {c.controller}: {s['distance_m']:.0f} m in {s['simulated_seconds']:.0f} s"


def draw_plan(axes: Axes, plan: Plan, faint: bool = False) -> None:
    left, right, bottom, top = plan.bounds
    axes.set_facecolor("0.85")
    axes.fill(*plan.outline.array.T, color="white", zorder=0)
    for shape in plan.rings:
        corners = shape.array
        if shape is not plan.outline:
            axes.fill(*corners.T, color="#e8d9bd" if shape.kinds[0] == "furniture" else "0.85", zorder=0.5)
        for k, kind in enumerate(shape.kinds):
            color, thick = SURFACES[kind]
            a, b = corners[k], corners[(k + 1) % len(corners)]
            width = thick * (0.5 if faint else 1.0)
            axes.plot(*zip(a, b, strict=True), color=color, lw=width, zorder=1, solid_capstyle="round")
    axes.set(aspect="equal", xlim=(left - 0.5, right + 0.5), ylim=(bottom - 0.5, top + 0.5))
    axes.set(xlabel="x (m)", ylabel="y (m)")


def draw_cells(axes: Axes, cells: Floats, grid: Grid, step: int) -> None:
    """A map in red, the darker the more certain; a pixel shows the largest of `step` x `step` cells."""
    # Small peaks must not vanish.
    rows_, columns = cells.shape[0] // step, cells.shape[1] // step
    shown = cells[: rows_ * step, : columns * step].reshape(rows_, step, columns, step).max((1, 3))
    image = np.zeros((*shown.shape, 4))
    image[..., 0], image[..., 3] = 0.8, np.clip(shown / 0.15, 0, 1) ** 0.5
    extent = (grid.left, grid.left + columns * step * grid.cell, grid.bottom, grid.bottom + rows_ * step * grid.cell)
    axes.imshow(image, origin="lower", extent=extent, zorder=2, interpolation="nearest", aspect="equal")


def plan_axes(plan: Plan, title: str, faint: bool = False) -> tuple[Figure, Axes]:
    """Axes in metres with the plan drawn to scale."""
    left, right, bottom, top = plan.bounds
    wide, high = right - left + 1.0, top - bottom + 1.0
    scale = min(13.0 / wide, 9.0 / high)
    figure = new_figure(max(wide * scale, 6.0) + 1.0, max(high * scale, 2.2) + 1.6)
    axes = figure.subplots()
    draw_plan(axes, plan, faint)
    axes.set_title(textwrap.fill(title, int(10 * figure.get_figwidth())), fontsize=11)
    kinds = {kind for shape in plan.rings for kind in shape.kinds}
    for kind in ("door", "furniture", "pillar"):
        if kind in kinds:
            axes.plot([], [], color=SURFACES[kind][0], lw=SURFACES[kind][1], label=kind)
    return figure, axes


def path(result: Result) -> Figure:
    """The true path over the true plan, with turns, collisions and stops."""
    record, hits = result.record, result.simulation.collisions
    turns, stops = record.turns, len(result.stops)
    counts = f"{plural(turns, 'turn')}, {plural(len(hits), 'collision')}, {plural(stops, 'stop')}"
    figure, axes = plan_axes(result.plan, f"{headline(result)}, {counts}")
    if not record.pose:
        return figure
    pose, mode = record.array("pose"), record.array("mode")
    line = record.track()
    carried = np.array(record.placed[1:], dtype=np.int64)
    walk = result.simulation.walk
    if walk is not None:
        axes.plot(*zip(*walk, strict=True), ":", color=PURPLE, lw=2.5, zorder=2, label="path of the pedestrian")
    axes.plot(*line.T, color=PATH, lw=1.6, zorder=3, label="path")
    turning = np.where((mode == TURN)[:, None], line, np.nan)
    axes.plot(*turning.T, color=ORANGE, lw=3.2, zorder=4, label="turning")
    if (mode == REVERSE).any():
        backing = np.where((mode == REVERSE)[:, None], line, np.nan)
        axes.plot(*backing.T, color=SKY, lw=3.2, zorder=4, label="reversing")
    axes.plot(*pose[0, :2], "o", color=GREEN, ms=8, zorder=5, label="start")
    axes.plot(*pose[-1, :2], "D", color="#222222", mfc="white", mew=2, ms=8, zorder=5, label="end of the path")
    if hits:
        axes.plot([h.x for h in hits], [h.y for h in hits], "X", color=HIT, ms=10, zorder=6, label="collision")
    if carried.size:
        axes.plot(*pose[carried, :2].T, "o", mfc="white", mec="0.3", ms=6, zorder=5, label="respawned")
    if result.stops:
        at = np.searchsorted(record.array("time"), result.stops).clip(max=len(pose) - 1)
        axes.plot(*pose[at, :2].T, "s", color="#7b3294", ms=8, zorder=6, label="stopped")
    legend(figure, 6, axes)
    return figure


def map_(result: Result) -> Figure:
    """The map in red over the true plan: the darker, the more certain."""
    score = result.summary["map"]
    words = [
        f"{100 * score['precision']:.0f} % of its mass within 10 cm of a true edge" if score["precision"] else "",
        f"{100 * score['surfaces']:.0f} % of any surface" if score["surfaces"] else "",
        f"{100 * score['recall']:.0f} % of the visible edges found" if score["recall"] else "",
        f"median error {score['position_error_cm']:.1f} cm" if score["position_error_cm"] else "",
    ]
    figure, axes = plan_axes(
        result.plan, "Map: " + (", ".join(w for w in words if w) or "nothing seen to compare"), faint=True
    )
    cells = result.cells.numpy()
    draw_cells(axes, cells, result.grid, max(1, round(max(cells.shape) / 1400)))
    believed, located = result.record.array("believed"), result.record.array("located")
    if len(believed):
        # The map has the corrections known at the end, and so has the path.
        line, how = result.record.track("located"), "by dead reckoning"
        if result.walked is not None and not np.array_equal(believed, located):
            line, how = result.walked.copy(), "corrected by landmarks"
            line[1:][np.hypot(*np.diff(result.walked, axis=0).T) > MOVED] = np.nan
        axes.plot(*line.T, color=PATH, lw=1.0, alpha=0.6, zorder=3, label=f"path {how}")
        axes.plot([], [], color=(0.8, 0, 0), lw=4, label="map: features that were confirmed")
        axes.plot([], [], color=(0.8, 0, 0, 0.35), lw=4, label="faint: seen rarely, or matched wrongly")
        legend(figure, 4, axes)
    left, right, bottom, top = result.plan.bounds
    axes.set(xlim=(left - 0.5, right + 0.5), ylim=(bottom - 0.5, top + 0.5))
    return figure


def pose(result: Result) -> Figure:
    """How far dead reckoning and the corrected pose are from the truth."""
    record, c = result.record, result.config
    paths = {name: record.array(name).reshape(-1, 3) for name in ("pose", "believed", "located")}
    figure = pose_plot(record.array("time"), paths["pose"], paths["believed"], paths["located"])
    figure.suptitle(f"{headline(result)}, {c.odometry} odometry", fontsize=11)
    return figure


def pose_plot(time: Floats, true: Floats, believed: Floats, located: Floats) -> Figure:
    """Errors of both poses over time, `[T]` s and poses `[T, 3]`; the axes are logarithmic."""
    figure = new_figure(9, 5)
    axes = figure.subplots(2, 1, sharex=True)
    for poses, color, name in ((believed, RIGHT, "dead reckoning"), (located, LEFT, "corrected by landmarks")):
        for errors, ax in zip(pose_error(poses, true), axes, strict=True):
            ax.plot(time / 60, np.maximum(errors, 1e-3), color=color, lw=1, label=name)
    for ax, label, wanted in zip(axes, ("m", "degrees"), (0.2, 3.0), strict=True):
        ax.axhline(wanted, color="0.5", lw=1, ls="--")
        ax.set(yscale="log", ylabel=f"error ({label})")
    axes[1].set_xlabel("time (minutes)")
    legend(figure, 2, axes[0])
    return figure


def speeds(result: Result) -> Figure:
    """Both speed estimates, what the controller weighs, its thresholds and its turns. [A fig. 7]

    The controller's `trace` has the quantity and its thresholds.
    """
    trace = result.trace
    figure = new_figure(13, 6.5)
    upper, lower = figure.subplots(2, 1, sharex=True)
    record = result.record
    time = record.array("time")
    shown = time <= SHOWN_SECONDS
    time, sides = time[shown], record.array("sides").reshape(-1, 2)[shown]
    upper.plot(time, sides[:, 0], color=LEFT, lw=1, label="left")
    upper.plot(time, sides[:, 1], color=RIGHT, lw=1, label="right")
    if trace.stop is not None:
        upper.axhline(trace.stop, color="0.5", lw=1, ls=":")
        upper.annotate("both below: stop", (0, trace.stop), (3, 2), textcoords="offset points", fontsize=8)
    top = float(np.quantile(sides, 0.998)) if len(sides) else 1.0
    upper.set(ylabel="speed estimate (no unit)", ylim=(0, max(1.15 * top, 0.3)))
    upper.set_title(f"{headline(result)}" + (f" (first {SHOWN_SECONDS:.0f} s)" if not shown.all() else ""), fontsize=11)
    difference = record.array("difference")[shown]
    lower.plot(time, difference, color="0.15", lw=1, label=trace.difference)
    level = trace.turn
    for sign in (1, -1):
        lower.axhline(sign * level, color="0.5", lw=1, ls="--")
    lower.annotate("turn left above", (0, level), (3, 3), textcoords="offset points", fontsize=8)
    lower.annotate("turn right below", (0, -level), (3, -10), textcoords="offset points", fontsize=8)
    span = float(np.quantile(np.abs(difference), 0.998)) if len(difference) else 0.5
    lower.set(
        xlabel="time (s)",
        ylabel=f"difference ({trace.unit})" if trace.unit else "difference (no unit)",
        ylim=(-max(1.15 * span, 0.3), max(1.15 * span, 0.3)),
    )
    turning = (record.array("mode") == TURN)[shown]
    starts = np.flatnonzero(turning & ~np.concatenate(([False], turning[:-1])))
    curvature = record.array("command").reshape(-1, 2)[shown, 1]
    labelled = -np.inf
    for k in starts:
        end = k + int(np.argmin(turning[k:])) if not turning[k:].all() else len(turning) - 1
        for axes in (upper, lower):
            axes.axvspan(time[k], time[end], color=ORANGE, alpha=0.25, lw=0)
        # The panel below distinguishes turns that follow each other closely.
        if time[k] - labelled > 0.035 * max(float(time[-1]), 1.0):
            side, labelled = "left" if curvature[k] > 0 else "right", time[k]
            upper.annotate(side, (time[k], 0.94), xycoords=("data", "axes fraction"), fontsize=8)
    upper.axvspan(-1, -1, color=ORANGE, alpha=0.25, lw=0, label="turn")
    for hit in result.simulation.collisions:
        if hit.time <= SHOWN_SECONDS:
            lower.axvline(hit.time, color=HIT, lw=1.5)
    upper.set_xlim(0, max(float(time[-1]), 1.0) if len(time) else 1.0)
    legend(figure, 4, upper, lower)
    return figure


def rows(result: Result) -> Figure:
    """Space-time images of both horizon rows with the ranged features, time upward. [A fig. 10]"""
    figure = new_figure(13, 7.5)
    panels = figure.subplots(1, 2, sharey=True)
    record, rig = result.record, result.simulation.rig
    if not record.rows:
        return figure
    images = np.stack(record.rows)
    found = np.stack(record.ranges)[: len(images)]
    columns = range_columns(found, rig, result.config.angle == "linear")
    times = np.broadcast_to((np.arange(len(images)) / result.config.rate)[:, None], found[:, 3].shape)
    for k, (axes, name) in enumerate(zip(panels, ("left", "right"), strict=True)):
        end = len(images) / result.config.rate
        axes.imshow(images[:, k], cmap="gray", origin="lower", aspect="auto", extent=(0, rig.width, 0, end))
        axes.scatter(columns[k], times, s=5, c=found[:, 0], cmap="autumn", vmin=0.7, vmax=2.5, lw=0)
        axes.set(title=f"{name} camera, row {rig.row}", xlabel="column (px)", xlim=(0, rig.width), ylim=(0, end))
    panels[0].set_ylabel("time (s)")
    bar = figure.colorbar(panels[0].collections[0], ax=panels, shrink=0.6)
    bar.set_label("range of the feature (m)")
    return figure


# Many drives.


def table_plot(rows: Sequence[Row]) -> Figure:
    """Collisions and coverage of every arena and controller.

    Small markers are single drives, the line spans them, large markers are all drives together.
    """
    places = list(dict.fromkeys(place_of(row) for row in rows))
    controllers = list(dict.fromkeys(row["controller"] for row in rows))
    figure = new_figure(11, max(2.4, 0.5 + 0.22 * len(places) * (len(controllers) + 0.6)) + 1.0)
    left, right = figure.subplots(1, 2, sharey=True)
    for row in rows:
        place = places.index(place_of(row))
        which = controllers.index(row["controller"])
        y = place + (which - (len(controllers) - 1) / 2) * min(0.3, 0.8 / len(controllers))
        color, marker = STYLES[which % len(STYLES)]
        hits = [d["collisions"] / d["simulated_seconds"] * 3600 for d in row["drives"]]
        passed = [100 * d["free_area_passed"] for d in row["drives"]]
        for axes, each, mean in ((left, hits, row["collisions_h"]), (right, passed, 100 * row["passed"])):
            axes.plot([min(each), max(each)], [y, y], color=color, lw=1.5, alpha=0.6, zorder=2)
            axes.plot(each, np.full(len(each), y), marker, color=color, ms=5, alpha=0.7, ls="none", zorder=3, mew=0)
            axes.plot([mean], [y], marker, color=color, ms=9, mec="white", ls="none", zorder=4)
    for which, controller in enumerate(controllers):
        color, marker = STYLES[which % len(STYLES)]
        left.plot([], [], marker, color=color, ms=9, mec="white", ls="none", label=controller)
    left.plot([], [], "o", color="0.4", ms=5, alpha=0.7, mew=0, ls="none", label="a single drive")
    table_axes(left, right, places)
    legend(figure, len(controllers) + 1, left)
    return figure


def place_of(row: Row) -> tuple[str, str]:
    return row["arena"], ", ".join(filter(None, (row["walls"], row["disturbance"])))


def table_axes(left: Axes, right: Axes, places: list[tuple[str, str]]) -> None:
    several = len({walls for _, walls in places}) > 1
    names = [f"{Path(arena).stem}, {walls}" if several else Path(arena).stem for arena, walls in places]
    left.set_yticks(range(len(places)), names)
    left.set_ylim(len(places) - 0.45, -0.55)
    left.set_xscale("symlog", linthresh=2, linscale=0.6)
    top = max(left.get_xlim()[1], 10)
    ticks = [t for t in (0, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000) if t <= top]
    left.set_xlim(-0.15, top * 1.1)
    left.set_xticks(ticks, [str(t) for t in ticks])
    left.minorticks_off()
    left.set_xlabel("collisions per simulated hour (fewer is better)")
    right.set_xlim(-2, 102)
    right.set_xlabel("free area passed within 1 m, % (more is better)")
    for axes in (left, right):
        axes.grid(axis="x", color="0.9", zorder=0)
        for k in range(1, len(places)):
            axes.axhline(k - 0.5, color="0.85", lw=0.8, zorder=1)
        axes.spines[["top", "right"]].set_visible(False)


def barn_plot(worlds: Sequence[BarnWorld], attempts: Sequence[Attempt], most: int = 60) -> Figure:
    """All BARN worlds side by side with the path through each; of more than `most` the first ones."""
    from matplotlib.collections import PatchCollection
    from matplotlib.patches import Circle

    by_number = {a.world: a for a in attempts}
    shown = [w for w in worlds if w.number in by_number][:most]
    across = min(10, max(1, len(shown)))
    down = -(-len(shown) // across)
    figure = new_figure(1.25 * across, 2.9 * down + 0.4)
    panels = list(figure.subplots(down, across, squeeze=False).flat)
    for axes in panels:
        axes.set_axis_off()
    for axes, world in zip(panels, shown, strict=False):
        made = by_number[world.number]
        color = OUTCOMES[0 if made.success else 1 if made.collided else 2][0]
        axes.add_collection(PatchCollection([Circle(c, world.radius) for c in world.cylinders], color="0.55", lw=0))
        axes.add_patch(Circle(world.goal, world.within, fill=False, color="0.4", lw=0.8))
        if made.path:
            driven = np.array(made.path)
            axes.plot(*driven.T, color=color, lw=1.4)
            axes.plot(*driven[-1], "X" if made.collided else "o", color=color, ms=5 if made.collided else 3)
        xs = [x for x, _ in world.cylinders]
        axes.set(xlim=(min(xs) - 0.3, max(xs) + 0.3), ylim=(world.start[1] - 0.8, world.goal[1] + 1.2), aspect="equal")
        axes.set_title(f"{world.number}: {made.time_s:.0f} s", fontsize=7, pad=1)
    for color, words in OUTCOMES:
        panels[0].plot([], [], color=color, label=words)
    legend(figure, 3, panels[0])
    return figure
