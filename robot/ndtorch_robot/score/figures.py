"""Pictures of a drive: the path, the map, the speeds and the rows."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ndtorch.navigation import REVERSE, TURN
from ndtorch_robot.drive import Result
from ndtorch_robot.score.record import Floats, pose_error, range_columns
from ndtorch_robot.sim.plan import Plan

LOOKS = {
    "wall": ("0.2", 2.0),
    "blank": ("0.6", 2.0),
    "door": ("#a05a2c", 3.5),
    "jamb": ("0.2", 1.5),
    "pillar": ("0.2", 2.0),
    "furniture": ("#b08d57", 1.5),
}
LEFT, RIGHT, PATH, HIT = "#0072b2", "#d55e00", "#0072b2", "#cc0000"

LONGEST = 40.0
"""Seconds shown in the picture of the speeds: more cannot be read."""

CARRIED = 0.5
"""Metres from place to place of a path from which on the car was carried, or has found itself elsewhere."""


def write_figures(result: Result, folder: Path) -> None:
    """Write path.png, map.png, speeds.png and rows.png, and pose.png where the car was localised."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    drawn: list[tuple[str, Callable[[Any, Result], Any]]] = [("path", path), ("map", map_), ("speeds", speeds)]
    drawn.append(("rows", rows))
    if result.ndt_cells is not None:
        drawn.append(("pose", pose))
    for name, draw in drawn:
        figure = draw(plt, result)
        figure.savefig(folder / f"{name}.png", dpi=110)
        plt.close(figure)


def plan_figure(plt: Any, plan: Plan, title: str, faint: bool = False) -> tuple[Any, Any]:
    """Axes in metres with the plan drawn to scale."""
    left, right, bottom, top = plan.bounds
    wide, high = right - left + 1.0, top - bottom + 1.0
    scale = min(13.0 / wide, 9.0 / high)
    figure, axes = plt.subplots(figsize=(max(wide * scale, 6.0) + 1.0, max(high * scale, 2.2) + 1.6))
    figure.set_layout_engine("constrained")
    axes.set_facecolor("0.85")
    axes.fill(*plan.outline.array.T, color="white", zorder=0)
    for shape in plan.rings:
        corners = shape.array
        if shape is not plan.outline:
            axes.fill(*corners.T, color="#e8d9bd" if shape.kinds[0] == "furniture" else "0.85", zorder=0.5)
        for k, kind in enumerate(shape.kinds):
            color, thick = LOOKS[kind]
            a, b = corners[k], corners[(k + 1) % len(corners)]
            width = thick * (0.5 if faint else 1.0)
            axes.plot(*zip(a, b, strict=True), color=color, lw=width, zorder=1, solid_capstyle="round")
    axes.set(aspect="equal", xlim=(left - 0.5, right + 0.5), ylim=(bottom - 0.5, top + 0.5))
    axes.set(xlabel="x (m)", ylabel="y (m)")
    axes.set_title(title, fontsize=11)
    kinds = {kind for shape in plan.rings for kind in shape.kinds}
    for kind in ("door", "furniture", "pillar"):
        if kind in kinds:
            axes.plot([], [], color=LOOKS[kind][0], lw=LOOKS[kind][1], label=kind)
    return figure, axes


def headline(result: Result) -> str:
    """What was driven, in one line."""
    s, c = result.summary, result.config
    return f"{c.arena}, seed {c.seed}, {c.controller}: {s['distance_m']:.0f} m in {s['simulated_seconds']:.0f} s"


def legend(axes: Any, columns: int) -> None:
    """A legend below the axes, where it hides nothing."""
    axes.figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=columns, frameon=False)


def plural(number: int, word: str) -> str:
    """`1 turn`, `2 turns`."""
    return f"{number} {word}" + ("" if number == 1 else "s")


def path(plt: Any, result: Result) -> Any:
    """The true path over the true plan, with turns, collisions and stops."""
    record, hits = result.record, result.simulation.collisions
    turns, stops = record.turns, len(result.stops)
    counts = f"{plural(turns, 'turn')}, {plural(len(hits), 'collision')}, {plural(stops, 'stop')}"
    figure, axes = plan_figure(plt, result.plan, f"{headline(result)}, {counts}")
    if not record.pose:
        return figure
    pose, mode = record.array("pose"), record.array("mode")
    line = record.track()
    carried = np.array(record.placed[1:], dtype=np.int64)
    walk = result.simulation.walk
    if walk is not None:
        axes.plot(*zip(*walk, strict=True), ":", color="#cc79a7", lw=2.5, zorder=2, label="way of the moving obstacle")
    axes.plot(*line.T, color=PATH, lw=1.6, zorder=3, label="path")
    turning = np.where((mode == TURN)[:, None], line, np.nan)
    axes.plot(*turning.T, color="#e69f00", lw=3.2, zorder=4, label="turning")
    if (mode == REVERSE).any():
        backing = np.where((mode == REVERSE)[:, None], line, np.nan)
        axes.plot(*backing.T, color="#56b4e9", lw=3.2, zorder=4, label="reversing")
    axes.plot(*pose[0, :2], "o", color="#009e73", ms=8, zorder=5, label="start")
    axes.plot(*pose[-1, :2], "D", color="#222222", mfc="white", mew=2, ms=8, zorder=5, label="end of the path")
    if hits:
        axes.plot([h.x for h in hits], [h.y for h in hits], "X", color=HIT, ms=10, zorder=6, label="collision")
    if carried.size:
        axes.plot(*pose[carried, :2].T, "o", mfc="white", mec="0.3", ms=6, zorder=5, label="put back")
    if result.stops:
        at = np.searchsorted(record.array("time"), result.stops).clip(max=len(pose) - 1)
        axes.plot(*pose[at, :2].T, "s", color="#7b3294", ms=8, zorder=6, label="stopped")
    legend(axes, 6)
    return figure


def map_(plt: Any, result: Result) -> Any:
    """The map in red over the true plan: the darker, the more certain."""
    score = result.summary["map"]
    assert isinstance(score, dict)
    words = [
        f"{100 * score['precision']:.0f} % of its mass within 10 cm of a true edge" if score["precision"] else "",
        f"{100 * score['surfaces']:.0f} % of any surface" if score["surfaces"] else "",
        f"{100 * score['recall']:.0f} % of the visible edges found" if score["recall"] else "",
        f"median error {score['position_error_cm']:.1f} cm" if score["position_error_cm"] else "",
    ]
    figure, axes = plan_figure(
        plt, result.plan, "Map: " + (", ".join(w for w in words if w) or "nothing seen to compare"), faint=True
    )
    cells = result.cells.numpy()
    # What a pixel shows is the largest of its cells: small peaks must not vanish.
    step = max(1, round(max(cells.shape) / 1400))
    rows_, columns = cells.shape[0] // step, cells.shape[1] // step
    shown = cells[: rows_ * step, : columns * step].reshape(rows_, step, columns, step).max((1, 3))
    strength = np.clip(shown / 0.15, 0, 1) ** 0.5
    image = np.zeros((*shown.shape, 4))
    image[..., 0], image[..., 3] = 0.8, strength
    g = result.grid
    extent = (g.left, g.left + columns * step * g.cell, g.bottom, g.bottom + rows_ * step * g.cell)
    axes.imshow(image, origin="lower", extent=extent, zorder=2, interpolation="nearest")
    believed, located = result.record.array("believed"), result.record.array("located")
    if len(believed):
        # The map is drawn where its parts are known to be at the end, and so is the path.
        line, how = result.record.track("located"), "by dead reckoning"
        if result.walked is not None and not np.array_equal(believed, located):
            line, how = result.walked.copy(), "corrected by landmarks"
            line[1:][np.hypot(*np.diff(result.walked, axis=0).T) > CARRIED] = np.nan
        axes.plot(*line.T, color=PATH, lw=1.0, alpha=0.6, zorder=3, label=f"path {how}")
        axes.plot([], [], color=(0.8, 0, 0), lw=4, label="map: features that were confirmed")
        axes.plot([], [], color=(0.8, 0, 0, 0.35), lw=4, label="faint: seen rarely, or matched wrongly")
        legend(axes, 4)
    left, right, bottom, top = result.plan.bounds
    axes.set(xlim=(left - 0.5, right + 0.5), ylim=(bottom - 0.5, top + 0.5))
    return figure


def pose(plt: Any, result: Result) -> Any:
    """How far dead reckoning and the corrected pose are from the truth."""
    record, c = result.record, result.config
    paths = {name: record.array(name).reshape(-1, 3) for name in ("pose", "believed", "located")}
    figure = pose_figure(plt, record.array("time"), paths["pose"], paths["believed"], paths["located"])
    figure.suptitle(f"{headline(result)}, {c.odometry} odometry", fontsize=11)
    return figure


def pose_figure(plt: Any, time: Floats, true: Floats, believed: Floats, located: Floats) -> Any:
    """Errors of both poses over time, `[T]` s and poses `[T, 3]`; the axes are logarithmic."""
    figure, axes = plt.subplots(2, 1, figsize=(9, 5), sharex=True)
    figure.set_layout_engine("constrained")
    for poses, color, name in ((believed, RIGHT, "dead reckoning"), (located, LEFT, "corrected by landmarks")):
        for errors, ax in zip(pose_error(poses, true), axes, strict=True):
            ax.plot(time / 60, np.maximum(errors, 1e-3), color=color, lw=1, label=name)
    for ax, label, wanted in zip(axes, ("m", "degrees"), (0.2, 3.0), strict=True):
        ax.axhline(wanted, color="0.5", lw=1, ls="--")
        ax.set(yscale="log", ylabel=f"error ({label})")
    axes[1].set_xlabel("time (minutes)")
    legend(axes[0], 2)
    return figure


def speeds(plt: Any, result: Result) -> Any:
    """Both speed estimates, what the controller weighs, its thresholds and its turns. [A fig. 7]

    What it weighs, and from where on it acts, is said by the controller's `trace`.
    """
    trace = result.trace
    figure, (upper, lower) = plt.subplots(2, 1, figsize=(13, 6.5), sharex=True)
    figure.set_layout_engine("constrained")
    record = result.record
    time = record.array("time")
    shown = time <= LONGEST
    time, sides = time[shown], record.array("sides").reshape(-1, 2)[shown]
    upper.plot(time, sides[:, 0], color=LEFT, lw=1, label="left")
    upper.plot(time, sides[:, 1], color=RIGHT, lw=1, label="right")
    if trace.stop is not None:
        upper.axhline(trace.stop, color="0.5", lw=1, ls=":")
        upper.annotate("both below: stop", (0, trace.stop), (3, 2), textcoords="offset points", fontsize=8)
    top = float(np.quantile(sides, 0.998)) if len(sides) else 1.0
    upper.set(ylabel="speed estimate (no unit)", ylim=(0, max(1.15 * top, 0.3)))
    upper.set_title(f"{headline(result)}" + (f" (first {LONGEST:.0f} s)" if not shown.all() else ""), fontsize=11)
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
            axes.axvspan(time[k], time[end], color="#e69f00", alpha=0.25, lw=0)
        # Turns that follow each other closely are told apart by the panel below.
        if time[k] - labelled > 0.035 * max(float(time[-1]), 1.0):
            way, labelled = "left" if curvature[k] > 0 else "right", time[k]
            upper.annotate(way, (time[k], 0.94), xycoords=("data", "axes fraction"), fontsize=8)
    upper.axvspan(-1, -1, color="#e69f00", alpha=0.25, lw=0, label="turn")
    for hit in result.simulation.collisions:
        if hit.time <= LONGEST:
            lower.axvline(hit.time, color=HIT, lw=1.5)
    upper.set_xlim(0, max(float(time[-1]), 1.0) if len(time) else 1.0)
    # Below, where it covers no line.
    handles = [*upper.get_legend_handles_labels()[0], *lower.get_legend_handles_labels()[0]]
    figure.legend(handles=handles, loc="outside lower center", ncols=4, fontsize=9)
    return figure


def rows(plt: Any, result: Result) -> Any:
    """Space-time images of both horizon rows with the ranged features, time upward. [A fig. 10]"""
    figure, panels = plt.subplots(1, 2, figsize=(13, 7.5), sharey=True)
    figure.set_layout_engine("constrained")
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
