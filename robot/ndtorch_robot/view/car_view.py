"""A car in the rerun viewer: what it sees, does and believes; of a simulated one also the plan and the true pose."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ndtorch.navigation import Grid, NavigatorState, Rect, StereoRig
from ndtorch.report.recording import end_stream, import_rerun
from ndtorch_robot.ports import Step, StereoFrames
from ndtorch_robot.sim.plan import Plan
from ndtorch_robot.view.archetypes import (
    BELIEVED,
    CAR,
    LEFT,
    OTHER,
    PATH,
    RIGHT,
    TIMELINE,
    WHITE,
    car_arrow,
    feature_points,
    field_box,
    flipped,
    frame_image,
    jpeg,
    map_points,
    panels,
    speed_lines,
)

BATCH = 15
"""Steps whose numbers are written at once: half a second."""

STRIDE, CHUNK = 0.03, 200
"""Metres between two points of a path, and points in one chunk of it: only the last chunk is written anew."""

MAP_EVERY = 2.0
"""Seconds between two updates of the map."""

Pose = tuple[float, float, float]
Bounds = tuple[float, float, float, float]
"""Left, right, upper and lower side of the floor that is shown, m, y down."""

MARGIN, NEAR, MORE = 2.0, 0.5, 0.5
"""When the car is nearer than 0.5 m to the end of what is shown, half as much more is shown there, at least 2 m."""

PALE, WALL = (200, 200, 200), (150, 150, 150)
THIN, FINE = -1.0, -1.2
"""Radii of lines and of cells of the map in points of the screen, so that they are seen in a large building too."""

COMMAND_LINES = {"wanted": OTHER, "sent": LEFT, "applied": RIGHT}


class Seen(NamedTuple):
    """One step to show.

    Attributes:
        time: s since the start.
        step: of the loop, without frames where they are not to be shown.
        lines: what happened since the last step, in words.
        notes: words to add to the panel with the state of the car.
        truth: the true pose, where it is known.
    """

    time: float
    step: Step
    lines: tuple[str, ...] = ()
    notes: str = ""
    truth: Pose | None = None


class PathLine:
    """A path that grows: entity, color and width of the line, in m or minus points of the screen."""

    def __init__(self, rr: Any, stream: Any, entity: str, color: tuple[int, int, int], width: float) -> None:
        self.rr, self.stream, self.entity, self.color, self.width = rr, stream, entity, color, width
        self.points: list[tuple[float, float]] = []
        self.chunk = 0

    def add(self, x: float, y: float) -> None:
        if self.points and math.dist(self.points[-1], (x, y)) < STRIDE:
            return
        self.points.append((x, y))
        if len(self.points) % 10 == 0:
            self.write()
        if len(self.points) >= CHUNK:
            self.points, self.chunk = [(x, y)], self.chunk + 1

    def cut(self) -> None:
        """Begin anew somewhere else."""
        self.write()
        self.points, self.chunk = [], self.chunk + 1

    def write(self) -> None:
        if len(self.points) > 1:
            line = [(x, -y) for x, y in self.points]
            strips = self.rr.LineStrips2D([line], colors=[self.color], radii=self.width)
            self.stream.log(f"{self.entity}/{self.chunk}", strips)


class CarView:
    """Shows a car: both images with what is read of them, features, speeds, commands, battery, faults, its map.

    Entities: `cameras/left` and `cameras/right` (JPEG, with `fields` and `features`; strips are drawn in their
    places), `speeds`, `command/speed` and `command/curvature` (wanted, sent, applied), `board/battery`, `car`
    (text), `events`, and `floor` (y up: drawn at -y) with `start` (a square metre about it), `path`, `car` and `map`.
    Where the true pose is known, `path` and `car` are the true ones and `believed` is the path by dead reckoning; else
    they are by dead reckoning. `walls` are those of the plan.

    Args:
        stream: of `open_stream`, with `layout`.
        rig: the cameras.
        fields: subfields of the left and of the right image.
        levels: lines to draw beside the speeds, by name.
        grid: of the map, if there is one.
        plan: of the building, if it is known.
    """

    def __init__(
        self,
        stream: Any,
        rig: StereoRig,
        fields: tuple[Rect, Rect],
        levels: Mapping[str, float],
        grid: Grid | None,
        plan: Plan | None = None,
    ) -> None:
        self.rr, self.stream = import_rerun(), stream
        self.rig, self.fields, self.levels, self.grid, self.plan = rig, fields, dict(levels), grid, plan
        self.next_map = 0.0
        self.waiting: list[tuple[float, list[float], list[float], list[float], float]] = []
        self.path = PathLine(self.rr, stream, "floor/path", PATH, THIN)
        self.believed = PathLine(self.rr, stream, "floor/believed", BELIEVED, THIN)
        self.started = False
        self.words = ""
        self.shown: Bounds | None = None
        self.fixed()

    def fixed(self) -> None:
        rr, log = self.rr, self.stream.log
        for side, field in zip(("left", "right"), self.fields, strict=True):
            log(f"cameras/{side}/fields", field_box(rr, field, side), static=True)
        log("speeds", speed_lines(rr, self.levels), static=True)
        names, colors = list(COMMAND_LINES), list(COMMAND_LINES.values())
        for entity in ("command/speed", "command/curvature"):
            log(entity, rr.SeriesLines(colors=colors, names=names, widths=[1.0, 2.0, 1.5]), static=True)
        log("board/battery", rr.SeriesLines(colors=[CAR], names=["battery, V"]), static=True)
        if self.plan is not None:
            walls = [flipped(np.concatenate((r.array, r.array[:1]))) for r in self.plan.rings]
            log("floor/walls", rr.LineStrips2D(walls, colors=[WALL], radii=0.02), static=True)

    def show(self, seen: Seen) -> None:
        self.stream.set_time(TIMELINE, duration=seen.time)
        for line in seen.lines:
            self.stream.log("events", self.rr.TextLog(line, level="WARN" if "stopped" in line else "INFO"))
        self.describe(seen)
        step, state, speeds = seen.step, seen.step.state, [math.nan] * 3
        if step.frames is not None:
            self.images(step.frames, state)
        if state is not None:
            speeds = [*map(float, state.sides), float(state.difference)]
            self.place(state, step.placed is not None, seen.truth)
            if self.grid is not None and state.map is not None and seen.time >= self.next_map:
                self.next_map = seen.time + MAP_EVERY
                self.stream.log("floor/map", map_points(self.rr, self.grid, state.map.cells, FINE))
        commands = (step.wanted, step.sent, step.driven)
        battery = float(step.telemetry.get("battery_v") or math.nan)
        self.waiting.append((seen.time, speeds, [c.speed for c in commands], [c.curvature for c in commands], battery))
        if len(self.waiting) >= BATCH:
            self.numbers()

    def close(self) -> None:
        """Write what is waiting and close the stream."""
        self.numbers()
        self.path.write()
        self.believed.write()
        end_stream(self.stream, patience=3.0)

    def images(self, frames: StereoFrames, state: NavigatorState | None) -> None:
        rr = self.rr
        for side, frame, field in zip(("left", "right"), frames[:2], self.fields, strict=True):
            self.stream.log(f"cameras/{side}", jpeg(rr, frame_image(frame, field, self.rig)))
        found = np.zeros((4, 0), np.float32)
        if state is not None:
            r = state.ranges
            parts = (r.left_range, r.left_angle, r.right_angle, r.valid)
            found = np.stack([np.asarray(part) for part in parts]).astype(np.float32)
        for side, points in zip(("left", "right"), feature_points(rr, found, self.rig), strict=True):
            self.stream.log(f"cameras/{side}/features", points)

    def place(self, state: NavigatorState, carried: bool, truth: Pose | None) -> None:
        x, y, heading = (float(value) for value in state.pose)
        if carried:
            self.path.cut()
            self.believed.cut()
        if truth is not None:
            self.believed.add(x, y)
            x, y, heading = truth
        self.stream.log("floor/car", car_arrow(self.rr, (x, y, heading)))
        if self.plan is None:
            self.widen(x, y)
        if not self.started:
            # A square metre gives the scale, and the viewer something to show until there is more.
            self.started = True
            square = self.rr.Boxes2D(centers=[(x, -y)], sizes=[(1.0, 1.0)], colors=[PALE], radii=THIN)
            self.stream.log("floor/start", square)
        self.path.add(x, y)

    def widen(self, x: float, y: float) -> None:
        """Show more of the floor when the car comes near the end of what is shown."""
        shown = self.shown or (x, x, -y, -y)
        sides = []
        for low, high, at in ((*shown[:2], x), (*shown[2:], -y)):
            more = max(MARGIN, MORE * (high - low))
            sides += [low - more if at < low + NEAR else low, high + more if at > high - NEAR else high]
        if tuple(sides) != self.shown:
            self.shown = (sides[0], sides[1], sides[2], sides[3])
            self.rr.send_blueprint(layout(self.shown), recording=self.stream)

    def describe(self, seen: Seen) -> None:
        """The state of the car in words, when it has changed."""
        board, standing = seen.step.telemetry, seen.step.standing
        lines = [f"# STANDS\n{standing}" if standing else "# DRIVES"]
        if board:
            faults = ", ".join(board.get("faults", ())) or "none"
            volts = board.get("battery_v")
            lines.append(
                f"board {'armed' if board.get('armed') else 'not armed'}, faults: {faults}; "
                f"battery {f'{volts:.1f} V' if volts else 'not measured'}, {board.get('rejected', 0)} frames refused"
            )
            if board.get("link"):
                lines.append(f"link: {board['link']}")
        if seen.notes:
            lines.append(seen.notes)
        words = "\n\n".join(lines)
        if words != self.words:
            self.words = words
            self.stream.log("car", self.rr.TextDocument(words, media_type="text/markdown"))

    def numbers(self) -> None:
        if not self.waiting:
            return
        times, speeds, speed, curvature, battery = zip(*self.waiting, strict=True)
        self.waiting = []
        index = self.rr.TimeColumn(TIMELINE, duration=list(times))
        lines = np.tile(list(self.levels.values()), (len(times), 1)).reshape(len(times), -1)
        for entity, values in (
            ("speeds", np.column_stack((np.array(speeds), lines))),
            ("command/speed", np.array(speed)),
            ("command/curvature", np.array(curvature)),
            ("board/battery", np.array(battery)[:, None]),
        ):
            self.stream.send_columns(entity, indexes=[index], columns=self.rr.Scalars.columns(scalars=values))


def plan_bounds(plan: Plan) -> Bounds:
    """The floor that is shown of a building."""
    left, right, bottom, top = plan.bounds
    return left - 0.6, right + 0.6, -top - 0.6, -bottom + 0.6


def layout(shown: Bounds = (-MARGIN, MARGIN, -MARGIN, MARGIN)) -> Any:
    """Cameras on top, the floor below them, and the state of the car, its speeds and commands beside it."""
    import rerun.blueprint as rrb

    legend = rrb.PlotLegend(rrb.Corner2D.LeftTop)

    def plot(origin: str, name: str) -> Any:
        return rrb.TimeSeriesView(origin=origin, name=name, plot_legend=legend)

    plain = rrb.archetypes.TextDocumentFormat(word_wrap=True)
    cameras = [rrb.Spatial2DView(origin=f"cameras/{side}", name=f"{side} camera") for side in ("left", "right")]
    bounds = rrb.VisualBounds2D(x_range=shown[:2], y_range=shown[2:])
    floor = rrb.Spatial2DView(origin="floor", name="path and map (m)", background=WHITE, visual_bounds=bounds)
    words = rrb.Horizontal(
        rrb.TextDocumentView(origin="car", name="car", format_options=plain),
        rrb.TextLogView(origin="events", name="what happened"),
        column_shares=[2, 3],
    )
    commands = rrb.Horizontal(plot("command/speed", "speed (m/s)"), plot("command/curvature", "curvature (1/m)"))
    seen = rrb.Horizontal(plot("speeds", "speed of the image beside the path"), plot("board", "battery (V)"))
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(rrb.Horizontal(*cameras), floor, row_shares=[2, 3]),
            rrb.Vertical(words, commands, seen, row_shares=[2, 3, 3]),
            column_shares=[1, 1],
        ),
        *panels(),
        auto_views=False,
    )
