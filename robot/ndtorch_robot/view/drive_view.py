"""A simulated drive in the rerun viewer, over the true plan."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from torch import Tensor

from ndtorch.navigation import Grid, Rect, StereoRig
from ndtorch.report.recording import end_stream, import_rerun
from ndtorch_robot.evaluation.record import Record
from ndtorch_robot.ports import Observer, Step, StereoFrames
from ndtorch_robot.sim.plan import Plan
from ndtorch_robot.view.drawing import (
    BELIEVED,
    PATH,
    PICTURES,
    TIMELINE,
    WHITE,
    car_arrow,
    feature_points,
    field_box,
    flipped,
    jpeg,
    map_points,
    panels,
    picture,
    speed_lines,
)
from ndtorch_robot.view.opening import Where, open_stream

BATCH = 30
"""Frames whose numbers are written at once."""

WALL = (150, 150, 150)


class DriveView:
    """Shows a drive: both images with subfields and ranged features, speeds, path over the plan, map growing.

    Entities: `cameras/left` and `cameras/right` (JPEG, with `fields` and `features`), `speeds`, `command/curvature`,
    `plan` (y up: drawn at -y) with `walls`, `path`, `believed`, `car` and `map`. Times are simulated seconds.

    Args:
        plan, rig: the building and the cameras.
        fields: subfields of the left and of the right image.
        levels: lines to draw beside the speeds, by name.
        where: to show it: a file, a viewer, or both.
        name: of the recording.

    Raises:
        InputError: rerun is not installed, the file cannot be written, or the viewer does not open.
    """

    def __init__(
        self,
        plan: Plan,
        rig: StereoRig,
        fields: tuple[Rect, Rect],
        levels: Mapping[str, float],
        where: Where,
        name: str = "drive",
    ) -> None:
        self._rr = import_rerun()
        self.rig, self.fields, self.levels = rig, fields, dict(levels)
        self._waiting = 0
        self._next_picture = 0.0
        self._next_map = 0.0
        self._stream: Any = open_stream(name, where, layout(plan))
        self._fixed(plan, fields)

    def observer(self, record: Record, grid: Grid) -> Observer:
        """Shows every step that `record` has kept; it must be told of it before."""

        def look(step: Step) -> None:
            if step.frames is not None and step.state is not None:
                self.frame(step.frames, record, grid, None if step.state.map is None else step.state.map.cells)

        return look

    def frame(self, frames: StereoFrames, record: Record, grid: Grid, cells: Tensor | None) -> None:
        """Show the newest frame of a record.

        Args:
            frames: whole frames of both cameras.
            grid, cells: the map as it is now, with its margin.
        """
        now = record.time[-1]
        self._stream.set_time(TIMELINE, duration=now)
        if now >= self._next_picture - 1e-6:
            self._next_picture = max(self._next_picture + 1 / PICTURES, now)
            self._pictures(frames, record)
            self._car(record)
        if now >= self._next_map - 1e-6:
            self._next_map = now + 1.0
            self._paths(record)
            if cells is not None:
                self._map(grid, cells)
        self._waiting += 1
        if self._waiting >= BATCH:
            self._numbers(record)

    def close(self, record: Record) -> None:
        """Write what is waiting and close the file. Calling it again does nothing."""
        if self._stream is None:
            return
        if record.time:
            self._numbers(record)
            self._paths(record)
        end_stream(self._stream)
        self._stream = None

    def _fixed(self, plan: Plan, fields: tuple[Rect, Rect]) -> None:
        """What never changes."""
        rr, log = self._rr, self._stream.log
        for eye, field in zip(("left", "right"), fields, strict=True):
            log(f"cameras/{eye}/fields", field_box(rr, field, eye), static=True)
        log("speeds", speed_lines(rr, self.levels), static=True)
        log("command/curvature", rr.SeriesLines(colors=[PATH], names=["1/m, left is up"]), static=True)
        walls = [flipped(np.concatenate((r.array, r.array[:1]))) for r in plan.rings]
        log("plan/walls", rr.LineStrips2D(walls, colors=[WALL], radii=0.02), static=True)

    def _pictures(self, frames: StereoFrames, record: Record) -> None:
        features = feature_points(self._rr, record.ranges[-1], self.rig)
        eyes = zip(("left", "right"), frames[:2], self.fields, features, strict=True)
        for name, frame, field, points in eyes:
            self._stream.log(f"cameras/{name}", jpeg(self._rr, picture(frame, field, self.rig)))
            self._stream.log(f"cameras/{name}/features", points)

    def _car(self, record: Record) -> None:
        self._stream.log("plan/car", car_arrow(self._rr, record.pose[-1]))

    def _paths(self, record: Record) -> None:
        for name, list_, color in (("path", "pose", PATH), ("believed", "believed", BELIEVED)):
            strips = [flipped(part) for part in pieces(record.track(list_))]
            line = self._rr.LineStrips2D(strips, colors=[color], radii=0.03 if name == "path" else 0.015)
            self._stream.log(f"plan/{name}", line)

    def _map(self, grid: Grid, cells: Tensor) -> None:
        self._stream.log("plan/map", map_points(self._rr, grid, cells, 0.015))

    def _numbers(self, record: Record) -> None:
        """The speeds and commands of the frames that are waiting."""
        rr, last = self._rr, slice(len(record.time) - self._waiting, None)
        count, self._waiting = self._waiting, 0
        if not count:
            return
        index = rr.TimeColumn(TIMELINE, duration=record.time[last])
        levels = np.tile(list(self.levels.values()), (count, 1)).reshape(count, -1)
        speeds = np.column_stack((np.array(record.sides[last]), np.array(record.difference[last]), levels))
        curvature = np.array([command.curvature for command in record.command[last]])[:, None]
        for entity, values in (("speeds", speeds), ("command/curvature", curvature)):
            columns = rr.Scalars.columns(scalars=values)
            self._stream.send_columns(entity, indexes=[index], columns=columns)


def pieces(line: npt.NDArray[np.float64]) -> list[npt.NDArray[np.float64]]:
    """A line `[T, 2]` cut where it is NaN."""
    gaps = np.flatnonzero(np.isnan(line[:, 0]))
    parts = [part[~np.isnan(part[:, 0])] for part in np.split(line, gaps)]
    return [part for part in parts if len(part) > 1]


def layout(plan: Plan) -> Any:
    """Both cameras on top; the plan with path and map below them, the speeds and the steering beside it."""
    import rerun.blueprint as rrb

    cameras = [rrb.Spatial2DView(origin=f"cameras/{eye}", name=f"{eye} camera") for eye in ("left", "right")]
    left, right, bottom, top = plan.bounds
    bounds = rrb.VisualBounds2D(x_range=(left - 0.6, right + 0.6), y_range=(-top - 0.6, -bottom + 0.6))
    floor = rrb.Spatial2DView(origin="plan", name="plan: path and map (m)", visual_bounds=bounds, background=WHITE)
    legend = rrb.PlotLegend(rrb.Corner2D.LeftTop)
    speeds = rrb.TimeSeriesView(origin="speeds", name="speed of the image beside the path", plot_legend=legend)
    steering = rrb.TimeSeriesView(origin="command", name="curvature driven", plot_legend=legend)
    wide = (right - left) > 2.5 * (top - bottom)
    content: Any
    plots: Any
    if wide:
        plots = rrb.Horizontal(speeds, steering)
        content = rrb.Vertical(rrb.Horizontal(*cameras), floor, plots, row_shares=[5, 3, 3])
    else:
        plots = rrb.Vertical(speeds, steering, row_shares=[3, 2])
        content = rrb.Horizontal(floor, rrb.Vertical(rrb.Horizontal(*cameras), plots), column_shares=[1, 1])
    return rrb.Blueprint(content, *panels(), auto_views=False)
