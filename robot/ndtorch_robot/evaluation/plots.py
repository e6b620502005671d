"""Plots of a drive."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ndtorch.navigation import REVERSE, TURN, Grid
from ndtorch.report.plots import DPI, save
from ndtorch_robot.drive import Result
from ndtorch_robot.evaluation.record import Floats, pose_error, range_columns
from ndtorch_robot.sim.plan import Plan

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY = "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"
"""The color-blind safe palette of Okabe and Ito."""

SURFACES = {"wall": "0.2", "blank": "0.6", "door": "#a05a2c", "jamb": "0.2", "pillar": "0.2", "furniture": "#b08d57"}
"""Color of each kind of surface."""

SHOWN_SECONDS = 40.0
"""Longest part of a drive whose speeds can be read in one plot."""


def new_figure(width: float, height: float, title: str = "") -> Figure:
    """A figure of that size in inches, whose axes make room for their labels."""
    from matplotlib.figure import Figure

    figure = Figure((width, height), dpi=DPI, layout="constrained")
    figure.suptitle(textwrap.fill(title, int(10 * width)), fontsize=11)
    return figure


def legend(figure: Figure, columns: int, *axes: Axes) -> None:
    """A legend below the axes, where it covers no line."""
    entries = [pair for one in axes for pair in zip(*one.get_legend_handles_labels(), strict=True)]
    handles, labels = zip(*entries, strict=True)
    figure.legend(handles, labels, loc="outside lower center", ncols=columns, frameon=False, fontsize=9)


def write_plots(result: Result, folder: Path) -> None:
    """Write path.png, map.png, speeds.png and rows.png, and pose.png where the car was localised."""
    s, c = result.summary, result.config
    title = f"{c.arena}, seed {c.seed}, {c.controller}: {s['distance_m']:.0f} m in {s['simulated_seconds']:.0f} s"
    plots = {"path": path_plot, "map": map_plot, "speeds": speed_plot, "rows": row_plot}
    if result.ndt_cells is not None:
        plots["pose"] = pose_plot
    for name, draw in plots.items():
        save(draw(result, title), folder / f"{name}.png")


def draw_plan(axes: Axes, plan: Plan, faint: bool = False) -> None:
    """The walls of a building, to scale."""
    left, right, bottom, top = plan.bounds
    axes.set_facecolor("0.85")
    axes.fill(*plan.outline.array.T, color="white", zorder=0)
    for shape in plan.rings:
        if shape is not plan.outline:
            axes.fill(*shape.array.T, color="#e8d9bd" if shape.kinds[0] == "furniture" else "0.85", zorder=0.5)
        for side, kind in zip(shape.sides, shape.kinds, strict=True):
            axes.plot(*side.T, color=SURFACES[kind], lw=1.0 if faint else 2.0, zorder=1, solid_capstyle="round")
    axes.set(aspect="equal", xlim=(left - 0.5, right + 0.5), ylim=(bottom - 0.5, top + 0.5))
    axes.set(xlabel="x (m)", ylabel="y (m)")


def draw_cells(axes: Axes, cells: Floats, grid: Grid, step: int) -> None:
    """A map in red, the darker the more certain; a pixel shows the largest of `step` x `step` cells."""
    rows, columns = cells.shape[0] // step, cells.shape[1] // step
    largest = cells[: rows * step, : columns * step].reshape(rows, step, columns, step).max((1, 3))
    image = np.zeros((*largest.shape, 4))
    image[..., 0], image[..., 3] = 0.8, np.clip(largest / 0.15, 0, 1) ** 0.5
    extent = (grid.left, grid.left + columns * step * grid.cell, grid.bottom, grid.bottom + rows * step * grid.cell)
    axes.imshow(image, origin="lower", extent=extent, zorder=2, interpolation="nearest", aspect="equal")


def plan_axes(plan: Plan, title: str, faint: bool = False) -> tuple[Figure, Axes]:
    """Axes in metres with the plan drawn to scale."""
    left, right, bottom, top = plan.bounds
    scale = min(13.0 / (right - left + 1), 9.0 / (top - bottom + 1))
    width, height = max((right - left + 1) * scale, 6.0) + 1.0, max((top - bottom + 1) * scale, 2.2) + 1.6
    figure = new_figure(width, height, title)
    axes = figure.subplots()
    draw_plan(axes, plan, faint)
    return figure, axes


def path_plot(result: Result, title: str) -> Figure:
    """The true path over the true plan, with turns, collisions and stops."""
    record, hits = result.record, result.simulation.collisions
    counts = f"turns {record.turns}, collisions {len(hits)}, stops {len(result.stops)}"
    figure, axes = plan_axes(result.plan, f"{title}; {counts}")
    pose, line, mode = record.array("pose"), record.track(), record.array("mode")
    stops = np.searchsorted(record.array("time"), result.stops).clip(max=max(len(pose) - 1, 0))
    walk = np.array(result.simulation.walk or np.zeros((0, 2)))
    moved = np.array(record.placed[1:], np.int64)
    for places, style, color, label in (
        (walk, ":", PURPLE, "path of the pedestrian"),
        (line, "-", BLUE, "path"),
        (np.where((mode == TURN)[:, None], line, np.nan), "-", ORANGE, "turning"),
        (np.where((mode == REVERSE)[:, None], line, np.nan), "-", SKY, "reversing"),
        (pose[:1], "o", GREEN, "start"),
        (pose[-1:], "D", "#222222", "end of the path"),
        (np.array([(h.x, h.y) for h in hits]).reshape(-1, 2), "X", "#cc0000", "collision"),
        (pose[moved], "o", "0.6", "respawned"),
        (pose[stops] if len(pose) else pose, "s", "#7b3294", "stopped"),
    ):
        if np.isfinite(places).any():
            axes.plot(*places[:, :2].T, style, color=color, lw=2, ms=8, zorder=4, label=label)
    legend(figure, 6, axes)
    return figure


def map_plot(result: Result, title: str) -> Figure:
    """The map in red over the true plan: the darker, the more certain."""
    score = {key: value for key, value in result.summary["map"].items() if value is not None}
    figure, axes = plan_axes(result.plan, "map: " + ", ".join(f"{k} {v:.2f}" for k, v in score.items()), faint=True)
    cells = result.cells.numpy()
    draw_cells(axes, cells, result.grid, max(1, round(max(cells.shape) / 1400)))
    axes.plot(*result.record.track("located").T, color=BLUE, lw=1.0, alpha=0.6, zorder=3, label="path as believed")
    axes.plot([], [], color=(0.8, 0, 0), lw=4, label="map: features that were confirmed")
    left, right, bottom, top = result.plan.bounds
    axes.set(xlim=(left - 0.5, right + 0.5), ylim=(bottom - 0.5, top + 0.5))
    legend(figure, 2, axes)
    return figure


def pose_plot(result: Result, title: str) -> Figure:
    """Errors of dead reckoning and of the corrected pose over time; the axes are logarithmic."""
    figure, record = new_figure(9, 5, f"{title}, {result.config.odometry} odometry"), result.record
    axes = figure.subplots(2, 1, sharex=True)
    for name, color, label in (("believed", VERMILION, "dead reckoning"), ("located", BLUE, "corrected")):
        for errors, ax in zip(pose_error(record.array(name), record.array("pose")), axes, strict=True):
            ax.plot(record.array("time") / 60, np.maximum(errors, 1e-3), color=color, lw=1, label=label)
    for ax, label in zip(axes, ("m", "degrees"), strict=True):
        ax.set(yscale="log", ylabel=f"error ({label})")
    axes[1].set_xlabel("time (minutes)")
    legend(figure, 2, axes[0])
    return figure


def speed_plot(result: Result, title: str) -> Figure:
    """Both speed estimates, what the controller weighs, its thresholds and its turns. [A fig. 7]"""
    trace, record = result.trace, result.record
    figure = new_figure(13, 6.5, f"{title}; the first {SHOWN_SECONDS:.0f} s at most")
    upper, lower = figure.subplots(2, 1, sharex=True)
    time = record.array("time")
    kept = time <= SHOWN_SECONDS
    time, difference = time[kept], record.array("difference")[kept]
    for values, color, label in zip(
        record.array("sides").reshape(-1, 2)[kept].T, (BLUE, VERMILION), ("left", "right"), strict=True
    ):
        upper.plot(time, values, color=color, lw=1, label=label)
    if trace.stop is not None:
        upper.axhline(trace.stop, color="0.5", lw=1, ls=":", label="both below: stop")
    upper.set(ylabel="speed estimate (no unit)")
    lower.plot(time, difference, color="0.15", lw=1, label=trace.difference)
    lower.axhline(trace.turn, color="0.5", lw=1, ls="--", label="turn left above, right below")
    lower.axhline(-trace.turn, color="0.5", lw=1, ls="--")
    lower.set(xlabel="time (s)", ylabel=f"difference ({trace.unit or 'no unit'})")
    if len(difference):
        span = max(1.15 * float(np.quantile(np.abs(difference), 0.998)), 0.3)
        lower.set(ylim=(-span, span))
    turning = (record.array("mode") == TURN)[kept]
    for axes in (upper, lower):
        axes.fill_between(
            time, 0, 1, turning, transform=axes.get_xaxis_transform(), color=ORANGE, alpha=0.25, lw=0,
            label="turn" if axes is upper else None,
        )  # fmt: skip
    for hit in result.simulation.collisions:
        if hit.time <= SHOWN_SECONDS:
            lower.axvline(hit.time, color="#cc0000", lw=1.5)
    legend(figure, 6, upper, lower)
    return figure


def row_plot(result: Result, title: str) -> Figure:
    """Space-time images of both horizon rows with the ranged features, time upward. [A fig. 10]"""
    figure, record, rig = new_figure(13, 7.5, title), result.record, result.simulation.rig
    panels = figure.subplots(1, 2, sharey=True)
    if not record.rows:
        return figure
    images = np.stack(record.rows)
    ranges = np.stack(record.ranges)[: len(images)]
    columns, end = range_columns(ranges, rig, result.config.angle == "linear"), len(images) / result.config.rate
    times = np.broadcast_to(np.linspace(0, end, len(images), False)[:, None], ranges[:, 3].shape)
    for k, (axes, name) in enumerate(zip(panels, ("left", "right"), strict=True)):
        axes.imshow(images[:, k], cmap="gray", origin="lower", aspect="auto", extent=(0, rig.width, 0, end))
        dots = axes.scatter(columns[k], times, s=5, c=ranges[:, 0], cmap="autumn", vmin=0.7, vmax=2.5, lw=0)
        axes.set(title=f"{name} camera, row {rig.row}", xlabel="column (px)", xlim=(0, rig.width), ylim=(0, end))
    panels[0].set_ylabel("time (s)")
    figure.colorbar(dots, ax=panels, shrink=0.6, label="range of the feature (m)")
    return figure
