"""A car in the rerun viewer, as it drives, from a recording, or into a file. Only this module of the robot knows rerun.

Entities: `cameras/left` and `cameras/right` (JPEG, with `fields` and `features`; strips are drawn where they were
read), `speeds`, `command/speed` and `command/curvature` (wanted, sent, applied), `board/battery`, `car` and `events`
(text), and `floor` (y up: drawn at -y) with `walls` where a plan is known, `path`, `believed`, `car` and `map`. Where
the true pose is known, `path` and `car` are the true ones and `believed` is the path by dead reckoning.
"""

from __future__ import annotations

import math
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from ndtorch.errors import InputError
from ndtorch.navigation import NavigatorState, Rect, StereoRig, Strips
from ndtorch.report.recording import end_stream
from ndtorch.utils.packages import need
from ndtorch_robot.navigator_runner import NavigatorRunner
from ndtorch_robot.ports import Report, Step
from ndtorch_robot.sim.plan import Plan
from ndtorch_robot.step_thread import StepThread

Pose = tuple[float, float, float]

PORT = 9876
"""Port at which `rerun` listens."""

QUEUE, PICTURES_PER_SECOND, MAP_EVERY = 30, 10, 2.0
"""Steps that may wait, pairs of frames a second that are shown, and seconds between two maps and paths."""

STRIDE, FAINT, CELLS = 0.1, 0.04, 20_000
"""Metres between points of a path; part of the largest cell from which cells are shown; the most that are."""

BOARD = ("armed", "faults", "battery_v", "rejected")
"""Telemetry that is shown as text."""

UNREAD, THICK = 40, 4
"""Grey of what is not in the strips, and rows above and below a row that is read alone, to be seen."""

BLUE, RED, GREY, YELLOW, PURPLE, GREEN = (
    (0, 114, 178), (213, 94, 0), (90, 90, 90), (240, 228, 66), (204, 121, 167), (0, 158, 115),
)  # fmt: skip

SERIES = {
    "command/speed": ("speed (m/s)", "wanted", "sent", "applied"),
    "command/curvature": ("curvature (1/m)", "wanted", "sent", "applied"),
    "speeds": ("speed of the image beside the path", "left", "right", "difference"),
    "board/battery": ("battery (V)", "battery, V"),
}
"""Title and lines of each plot."""


def open_stream(name: str, file: Path | None = None, viewer: str = "", plan: Plan | None = None) -> Any:
    """A rerun stream into a `.rrd` file, and to a running viewer at `ADDRESS` or `ADDRESS:PORT`.

    Raises:
        InputError: rerun is not installed, the file cannot be written, or no viewer is there.
    """
    rr = need("rerun", "a recording")
    stream: Any = rr.RecordingStream(f"ndtorch {name}")
    sinks = []
    try:
        if file is not None:
            file.parent.mkdir(parents=True, exist_ok=True)
            file.touch()
            sinks.append(rr.FileSink(str(file)))
        if viewer:
            host, _, given = viewer.partition(":")
            port = int(given or PORT) if (given or "0").isdigit() else 0
            if not host or not 0 < port < 65536:
                raise InputError(f"--view must be ADDRESS or ADDRESS:PORT, as 127.0.0.1:{PORT}, got {viewer!r}")
            socket.create_connection((host, port), timeout=5.0).close()
            sinks.append(rr.GrpcSink(f"rerun+http://{host}:{port}/proxy"))
        stream.set_sinks(*sinks, default_blueprint=layout(plan))
    except (OSError, RuntimeError) as error:
        to = " and ".join(filter(None, (str(file or ""), viewer)))
        hint = "; `rerun` starts a viewer" if viewer else ""
        raise InputError(f"cannot write the recording to {to}: {error}{hint}") from None
    return stream


class View(StepThread):
    """An observer of the loop that shows a car, in a thread of its own.

    The loop never waits: frames are left out when the view is slow, and when it is slower still, steps are dropped and
    counted. When showing fails it is over, which is reported once, and the car drives on. `wait` waits for
    room instead, for a replay or a simulated drive.
    """

    patience = 5.0

    def __init__(
        self,
        stream: Any,
        runner: NavigatorRunner,
        report: Report | None = None,
        wait: bool = False,
        plan: Plan | None = None,
        truth: Callable[[], Pose] | None = None,
    ) -> None:
        self.rr, self.stream, self.runner, self.truth = need("rerun", "a recording"), stream, runner, truth
        self.shown, self.words, self.lines = 0, "", list[str]()
        self.start: float | None = None
        self.next_picture = self.next_map = 0.0
        self.paths: dict[str, list[list[tuple[float, float]]]] = {"path": [[]], "believed": [[]]}
        rr = self.rr
        for side, field, color in zip(("left", "right"), runner.fields, (BLUE, RED), strict=True):
            size = (field.right - field.left, field.bottom - field.top)
            box = rr.Boxes2D(mins=[(field.left, field.top)], sizes=[size], colors=[color])
            stream.log(f"cameras/{side}/fields", box, static=True)
        for name, (_, *lines) in SERIES.items():
            stream.log(name, rr.SeriesLines(colors=[BLUE, RED, YELLOW][: len(lines)], names=lines), static=True)
        if plan is not None:
            walls = [np.concatenate((r.array, r.array[:1])) * (1, -1) for r in plan.rings]
            stream.log("floor/walls", rr.LineStrips2D(walls, colors=[GREY], radii=0.02), static=True)
        super().__init__("view", QUEUE, "wait" if wait else "drop", report)

    def report(self, line: str) -> None:
        """Show a line with the next step. From any thread."""
        self.lines.append(line)

    def __call__(self, step: Step) -> None:
        self.start = step.time if self.start is None else self.start
        now, busy = step.time - self.start, self.queue.qsize() > QUEUE // 3 and self.when_full == "drop"
        if now < self.next_picture - 1e-6 or busy:
            step = step._replace(frames=None)
        else:
            self.next_picture = max(self.next_picture, now - 0.5 / PICTURES_PER_SECOND) + 1 / PICTURES_PER_SECOND
        lines, self.lines = tuple(self.lines), []
        self.put((now, step, lines, None if self.truth is None else self.truth()))

    def finish(self) -> None:
        self.log_paths()
        end_stream(self.stream, patience=3.0)

    def handle(self, item: tuple[float, Step, tuple[str, ...], Pose | None]) -> None:
        now, step, lines, truth = item
        rr, log, state, speeds = self.rr, self.stream.log, step.state, [math.nan] * 3
        self.stream.set_time("time", duration=now)
        for line in lines:
            log("events", rr.TextLog(line, level="WARN" if "stopped" in line else "INFO"))
        parts = [f"# STANDS\n{step.standing}" if step.standing else "# DRIVES"]
        parts += [f"{name} {step.telemetry[name]}" for name in BOARD if name in step.telemetry]
        words = "\n\n".join([*parts, f"{self.dropped} steps not shown"])
        if words != self.words:
            self.words = words
            log("car", rr.TextDocument(words, media_type="text/markdown"))
        if step.frames is not None:
            for side, frame, field in zip(("left", "right"), step.frames[:2], self.runner.fields, strict=True):
                picture = whole_frame(frame, field, self.runner.rig)[..., ::-1]
                _, data = cv2.imencode(".jpg", np.ascontiguousarray(picture), [cv2.IMWRITE_JPEG_QUALITY, 75])
                log(f"cameras/{side}", rr.EncodedImage(contents=data.tobytes(), media_type="image/jpeg"))
                points = np.zeros((0, 2)) if state is None else feature_pixels(state, side, self.runner.rig)
                log(f"cameras/{side}/features", rr.Points2D(points, colors=[YELLOW], radii=5.0))
        if state is not None:
            speeds = [*map(float, state.sides), float(state.difference)]
            self.log_pose(state, step.placed is not None, truth)
            if now >= self.next_map:
                self.next_map = now + MAP_EVERY
                self.log_paths()
                self.log_map(state)
        commands = (step.wanted, step.sent, step.driven)
        battery = float(step.telemetry.get("battery_v") or math.nan)
        values = ([c.speed for c in commands], [c.curvature for c in commands], speeds, [battery])
        for name, numbers in zip(SERIES, values, strict=True):
            log(name, rr.Scalars(numbers))
        self.shown += 1

    def log_pose(self, state: NavigatorState, carried: bool, truth: Pose | None) -> None:
        x, y, heading = (float(value) for value in state.pose)
        poses = {"path": (x, y)} if truth is None else {"path": truth[:2], "believed": (x, y)}
        for name, point in poses.items():
            strips = self.paths[name]
            if carried:
                strips.append([])
            if not strips[-1] or math.dist(strips[-1][-1], point) >= STRIDE:
                strips[-1].append(point)
        x, y, heading = truth or (x, y, heading)
        vector = (0.45 * math.cos(heading), -0.45 * math.sin(heading))
        self.stream.log("floor/car", self.rr.Arrows2D(origins=[(x, -y)], vectors=[vector], colors=[GREEN], radii=0.06))

    def log_paths(self) -> None:
        for (name, path), color in zip(self.paths.items(), (BLUE, PURPLE), strict=True):
            strips = [np.array(strip) * (1, -1) for strip in path if len(strip) > 1]
            if strips:
                self.stream.log(f"floor/{name}", self.rr.LineStrips2D(strips, colors=[color], radii=-1.0))

    def log_map(self, state: NavigatorState) -> None:
        grid = self.runner.grid
        if grid is None or state.map is None:
            return
        cells = grid.inner(state.map.cells)
        largest = cells.max().clamp_min(1e-9)
        row, column = (cells > FAINT * largest).nonzero(as_tuple=True)
        value, strongest = cells[row, column].topk(min(CELLS, len(row)))
        x, y = grid.center(row[strongest], column[strongest])
        certain = (value / largest).clamp(0, 1).sqrt().numpy()[:, None]
        colors = (np.array([250, 190, 120]) + certain * np.array([-80, -170, -100])).astype(np.uint8)
        points = np.stack((x.numpy(), -y.numpy()), -1)
        self.stream.log("floor/map", self.rr.Points2D(points, colors=colors, radii=-1.2))


def whole_frame(frame: Tensor | Strips, field: Rect, rig: StereoRig) -> npt.NDArray[np.uint8]:
    """A frame `[1, C, H, W]` as `[H, W, 3]` uint8, or strips in their places, the row drawn thicker."""

    def pixels(part: Tensor) -> npt.NDArray[np.uint8]:
        bytes_ = part if part.dtype == torch.uint8 else (part.clamp(0, 1) * 255).round().byte()
        return bytes_[0].permute(1, 2, 0).numpy()

    if isinstance(frame, Tensor):
        return pixels(frame)
    whole = np.full((rig.height, rig.width, 3), UNREAD, np.uint8)
    whole[max(0, rig.row - THICK) : rig.row + THICK + 1] = pixels(frame.row)
    whole[field.top : field.bottom, field.left : field.right] = pixels(frame.field)
    return whole


def feature_pixels(state: NavigatorState, side: str, rig: StereoRig) -> npt.NDArray[np.float64]:
    """Where ranged features are in the image of one side, `[n, 2]`."""
    ranges = state.ranges
    angles = np.asarray(ranges.left_angle if side == "left" else ranges.right_angle, np.float64)
    columns = rig.center[0] - np.tan(angles[np.asarray(ranges.valid, bool)]) * rig.focal
    return np.stack((columns + 0.5, np.full(len(columns), rig.row + 0.5)), -1)


def layout(plan: Plan | None = None) -> Any:
    """Cameras on top, the floor below them, and the state of the car, its speeds and commands beside it."""
    import rerun.blueprint as rrb

    bounds = None
    if plan is not None:
        left, right, bottom, top = plan.bounds
        bounds = rrb.VisualBounds2D(x_range=(left - 0.6, right + 0.6), y_range=(-top - 0.6, -bottom + 0.6))
    cameras = [rrb.Spatial2DView(origin=f"cameras/{side}", name=f"{side} camera") for side in ("left", "right")]
    floor = rrb.Spatial2DView(origin="floor", name="path and map (m)", background=(255, 255, 255), visual_bounds=bounds)
    words = [rrb.TextDocumentView(origin="car", name="car"), rrb.TextLogView(origin="events", name="events")]
    plots = [rrb.TimeSeriesView(origin=origin, name=title) for origin, (title, *_) in SERIES.items()]
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(rrb.Horizontal(*cameras), floor, row_shares=[2, 3]),
            rrb.Vertical(rrb.Horizontal(*words), rrb.Grid(*plots, grid_columns=2), row_shares=[1, 3]),
        ),
        rrb.TimePanel(state="collapsed", timeline="time", play_state="following"),
        collapse_panels=True,
        auto_views=False,
    )
