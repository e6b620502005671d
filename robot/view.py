"""A drive in the rerun viewer, as it goes or from a file. The only file of the robot that knows rerun."""

from __future__ import annotations

import math
import socket
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from torch import Tensor

from ndtorch.errors import InputError
from ndtorch.navigation import Grid, Rect, StereoRig
from ndtorch.report.recording import import_rerun
from robot.ports import StereoFrames
from robot.record import Record, range_columns
from robot.sim.plan import Plan

TIMELINE = "time"

PICTURES = 10
"""Pairs of pictures a second: enough to look at, a third of the size."""

JPEG_QUALITY = 75

BATCH = 30
"""Frames whose numbers are written at once."""

FAINT = 0.04
"""Cells of the map are shown from this share of the largest on."""

LEFT, RIGHT, OTHER, FEATURE, PATH, BELIEVED = (
    (0, 114, 178),
    (213, 94, 0),
    (90, 90, 90),
    (240, 228, 66),
    (0, 114, 178),
    (204, 121, 167),
)
MAP_LOW, MAP_HIGH = np.array([250.0, 190.0, 120.0]), np.array([170.0, 20.0, 20.0])
WALL = (150, 150, 150)
SPEEDS = ("left", "right", "right - left, smoothed")
NOWHERE = 10.0
"""Seconds to wait for the viewer."""


class DriveView:
    """Shows a drive: both images with subfields and ranged features, speeds, path over the plan, map growing.

    Entities: `cameras/left` and `cameras/right` (JPEG, with `fields` and `features`), `speeds`, `command/curvature`,
    `plan` (y up: drawn at -y) with `walls`, `path`, `believed`, `car` and `map`. Times are simulated seconds.

    Args:
        plan, rig: the building and the cameras.
        fields: subfields of the left and of the right image.
        levels: lines to draw beside the speeds, by name.
        file: where to write; None writes nothing.
        live: open the viewer. It listens at 127.0.0.1 only.
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
        file: Path | None = None,
        live: bool = False,
        name: str = "drive",
    ) -> None:
        self._rr = rr = import_rerun()
        self.rig, self.levels = rig, dict(levels)
        self._stream: Any = rr.RecordingStream(f"ndtorch {name}")
        self._waiting = 0
        self._next_picture = 0.0
        self._next_map = 0.0
        sinks = []
        try:
            if file is not None:
                file.parent.mkdir(parents=True, exist_ok=True)
                file.touch()
                sinks.append(rr.FileSink(str(file)))
            if live:
                sinks.append(rr.GrpcSink(open_viewer()))
            self._stream.set_sinks(*sinks, default_blueprint=layout(plan))
        except (OSError, RuntimeError) as error:
            raise InputError(f"cannot write the recording {file}: {error}") from None
        self._fixed(plan, fields)

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
        self._stream.flush()
        self._stream.disconnect()
        self._stream = None

    def _fixed(self, plan: Plan, fields: tuple[Rect, Rect]) -> None:
        """What never changes."""
        rr, log = self._rr, self._stream.log
        for eye, field in zip(("left", "right"), fields, strict=True):
            box = rr.Boxes2D(
                mins=[(field.left, field.top)],
                sizes=[(field.right - field.left, field.bottom - field.top)],
                colors=[LEFT if eye == "left" else RIGHT],
                labels=["read"],
                show_labels=False,
            )
            log(f"cameras/{eye}/fields", box, static=True)
        names = [*SPEEDS, *self.levels]
        colours = [LEFT, RIGHT, (230, 159, 0)] + [OTHER] * len(self.levels)
        widths = [1.5, 1.5, 2.0] + [0.8] * len(self.levels)
        log("speeds", rr.SeriesLines(colors=colours, names=names, widths=widths), static=True)
        log("command/curvature", rr.SeriesLines(colors=[PATH], names=["1/m, left is up"]), static=True)
        walls = [flipped(np.concatenate((r.array, r.array[:1]))) for r in plan.rings]
        log("plan/walls", rr.LineStrips2D(walls, colors=[WALL], radii=0.02), static=True)

    def _pictures(self, frames: StereoFrames, record: Record) -> None:
        columns = range_columns(record.ranges[-1][None], self.rig, linear=False)
        for eye, frame, column in zip(("left", "right"), frames[:2], columns, strict=True):
            assert isinstance(frame, Tensor)  # whole frames, not strips
            self._stream.log(f"cameras/{eye}", self._jpeg(frame))
            seen = column[0][~np.isnan(column[0])]
            points = np.stack((seen + 0.5, np.full(len(seen), self.rig.row + 0.5)), -1)
            self._stream.log(f"cameras/{eye}/features", self._rr.Points2D(points, colors=[FEATURE], radii=5.0))

    def _jpeg(self, frame: Tensor) -> Any:
        import cv2

        pixels = frame[0].permute(1, 2, 0).numpy()
        _, jpeg = cv2.imencode(
            ".jpg", np.ascontiguousarray(pixels[..., ::-1]), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
        )
        return self._rr.EncodedImage(contents=jpeg.tobytes(), media_type="image/jpeg")

    def _car(self, record: Record) -> None:
        x, y, heading = record.pose[-1]
        arrow = self._rr.Arrows2D(
            origins=[(x, -y)],
            vectors=[(0.45 * math.cos(heading), -0.45 * math.sin(heading))],
            colors=[(0, 158, 115)],
            radii=0.06,
        )
        self._stream.log("plan/car", arrow)

    def _paths(self, record: Record) -> None:
        for name, list_, colour in (("path", "pose", PATH), ("believed", "believed", BELIEVED)):
            strips = [flipped(part) for part in pieces(record.track(list_))]
            line = self._rr.LineStrips2D(strips, colors=[colour], radii=0.03 if name == "path" else 0.015)
            self._stream.log(f"plan/{name}", line)

    def _map(self, grid: Grid, cells: Tensor) -> None:
        inner = grid.inner(cells)
        row, column = (inner > FAINT * inner.max().clamp_min(1e-9)).nonzero(as_tuple=True)
        share = (inner[row, column] / inner.max().clamp_min(1e-9)).sqrt().numpy()[:, None]
        x, y = grid.centre(row, column)
        points = np.stack((x.numpy(), -y.numpy()), -1)
        colours = (MAP_LOW + share * (MAP_HIGH - MAP_LOW)).astype(np.uint8)
        self._stream.log("plan/map", self._rr.Points2D(points, colors=colours, radii=0.015))

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


def flipped(points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Places as the viewer draws them: its y points down."""
    return points * (1.0, -1.0)


def pieces(line: npt.NDArray[np.float64]) -> list[npt.NDArray[np.float64]]:
    """A line `[T, 2]` cut where it is NaN."""
    gaps = np.flatnonzero(np.isnan(line[:, 0]))
    parts = [part[~np.isnan(part[:, 0])] for part in np.split(line, gaps)]
    return [part for part in parts if len(part) > 1]


def open_viewer() -> str:
    """Start the viewer, listening at 127.0.0.1 only; returns the address to send to."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "rerun", "--bind", "127.0.0.1", "--port", str(port), "--hide-welcome-screen"]
    viewer = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)
    until = time.monotonic() + NOWHERE
    while time.monotonic() < until and viewer.poll() is None:
        with socket.socket() as line:
            line.settimeout(0.2)
            if line.connect_ex(("127.0.0.1", port)) == 0:
                return f"rerun+http://127.0.0.1:{port}/proxy"
        time.sleep(0.1)
    if viewer.poll() is None:
        viewer.terminate()
    raise InputError("the rerun viewer does not open (has this machine a screen?): use --rrd FILE instead of --view")


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
    return rrb.Blueprint(
        content,
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following"),
        auto_views=False,
    )


WHITE = (255, 255, 255)
