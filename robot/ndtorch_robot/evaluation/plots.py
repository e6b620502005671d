"""Pictures of a drive: its path and its map over the plan."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

import numpy as np

from ndtorch.navigation import REVERSE, TURN, Grid
from ndtorch.report.plots import DPI
from ndtorch_robot.drive import DriveResult
from ndtorch_robot.sim.plan import Floats, Plan

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BLUE, GREEN, ORANGE, SKY = "#0072b2", "#009e73", "#e69f00", "#56b4e9"
"""The color-blind safe palette of Okabe and Ito."""

SURFACES = {"wall": "0.2", "blank": "0.6", "door": "#a05a2c", "jamb": "0.2", "pillar": "0.2", "furniture": "#b08d57"}
"""Color of each kind of surface."""


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
    from matplotlib.figure import Figure

    left, right, bottom, top = plan.bounds
    scale = min(13.0 / (right - left + 1), 9.0 / (top - bottom + 1))
    width, height = max((right - left + 1) * scale, 6.0) + 1.0, max((top - bottom + 1) * scale, 2.2) + 1.6
    figure = Figure((width, height), dpi=DPI, layout="constrained")
    figure.suptitle(textwrap.fill(title, int(10 * width)), fontsize=11)
    axes = figure.subplots()
    draw_plan(axes, plan, faint)
    return figure, axes


def path_plot(result: DriveResult) -> Figure:
    """The true path over the true plan, with turns, collisions and stops."""
    record, hits, s = result.record, result.simulation.collisions, result.summary
    title = f"{s['arena']}, seed {s['seed']}, {s['controller']}: {s['distance_m']:.0f} m "
    title += f"in {s['simulated_seconds']:.0f} s; turns {s['turns']}, collisions {len(hits)}, stops {s['stopped']}"
    figure, axes = plan_axes(result.plan, title)
    pose, line, mode = record.array("pose"), record.track(), record.array("mode")
    stops = np.searchsorted(record.array("time"), result.stops).clip(max=max(len(pose) - 1, 0))
    for places, style, color, label in (
        (line, "-", BLUE, "path"),
        (np.where((mode == TURN)[:, None], line, np.nan), "-", ORANGE, "turning"),
        (np.where((mode == REVERSE)[:, None], line, np.nan), "-", SKY, "reversing"),
        (pose[:1], "o", GREEN, "start"),
        (pose[-1:], "D", "#222222", "end of the path"),
        (np.array([(h.x, h.y) for h in hits]).reshape(-1, 2), "X", "#cc0000", "collision"),
        (pose[np.array(record.placed[1:], np.int64)], "o", "0.6", "respawned"),
        (pose[stops] if len(pose) else pose, "s", "#7b3294", "stopped"),
    ):
        if np.isfinite(places).any():
            axes.plot(*places[:, :2].T, style, color=color, lw=2, ms=8, zorder=4, label=label)
    figure.legend(loc="outside lower center", ncols=6, frameon=False, fontsize=9)
    return figure


def map_plot(result: DriveResult) -> Figure:
    """The map in red over the true plan: the darker, the more certain."""
    score = {key: value for key, value in result.summary["map"].items() if value is not None}
    figure, axes = plan_axes(result.plan, "map: " + ", ".join(f"{k} {v:.2f}" for k, v in score.items()), faint=True)
    limits, cells = (axes.get_xlim(), axes.get_ylim()), result.cells.numpy()
    draw_cells(axes, cells, result.plan.grid(), max(1, round(max(cells.shape) / 1400)))
    axes.plot(*result.record.track("located").T, color=BLUE, lw=1.0, alpha=0.6, zorder=3, label="path as believed")
    axes.plot([], [], color=(0.8, 0, 0), lw=4, label="map: features that were confirmed")
    axes.set(xlim=limits[0], ylim=limits[1])
    figure.legend(loc="outside lower center", ncols=2, frameon=False, fontsize=9)
    return figure
