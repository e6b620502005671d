"""A drive: the navigator at the wheel of a robot in the loop, recorded and scored."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch

from ndtorch.navigation import (
    STOPPED,
    Command,
    CompiledNavigator,
    Grid,
    GridMap,
    NavigatorState,
    Pose,
    Strips,
)
from ndtorch.navigation.controllers import Trace
from ndtorch_robot.config import DriveConfig
from ndtorch_robot.loop import Loop
from ndtorch_robot.navigating import say
from ndtorch_robot.ports import DriveCommand
from ndtorch_robot.record import Record
from ndtorch_robot.recording.recorder import Recorder
from ndtorch_robot.safety import SafeDrive
from ndtorch_robot.score import MapScore, coverage, score_map
from ndtorch_robot.sim.arenas import load_arena
from ndtorch_robot.sim.plan import Plan
from ndtorch_robot.sim.simulation import RIG, Simulation
from ndtorch_robot.watch import CameraWatch

if TYPE_CHECKING:
    from ndtorch_robot.view import DriveView

RATE = 30.0
"""Frames a second."""

STOP_TIME = 2.0
"""Seconds after which a car that has stopped for good is put back, as after a collision."""


@dataclass
class Result:
    """A drive as it was.

    Attributes:
        summary: what `summary.json` holds.
        record: frame by frame.
        plan, cells, grid: the building, the map that was made of it, and where the map's cells are.
        collisions: times and true poses.
        stops: times at which the controller stopped for good.
        interrupted: by Ctrl-C.
        trace: how to draw what the controller weighed.
    """

    config: DriveConfig
    summary: dict[str, object]
    record: Record
    plan: Plan
    cells: torch.Tensor
    grid: Grid
    simulation: Simulation
    stops: list[float]
    interrupted: bool
    trace: Trace


def drive(
    config: DriveConfig,
    progress: Callable[[int, int], None] | None = None,
    steer: Callable[[DriveCommand], DriveCommand] | None = None,
) -> Result:
    """Drive through a simulated building.

    Args:
        progress: called with the steps made and to make after each.
        steer: changes what the controller wants before it is sent: to compare with a blind or a wrong one.

    Raises:
        InputError: an arena or a machine that cannot be used; cameras that fail, after the car was stopped.
    """
    plan = load_arena(config.arena, config.seed)
    simulation = Simulation(
        plan,
        config.seed,
        walls=config.walls,
        moving=config.moving,
        odometry=config.odometry,
        whole=config.whole or shown(config),
        fields=config.options().fields(RIG),
    )
    run: Run | None = None
    try:
        run = Run(config, plan, simulation, steer)
        if shown(config):
            run.show()
        run.recorder = make_recorder(config, simulation)
        if isinstance(run.navigator, CompiledNavigator):  # before the time is taken
            frames = simulation.read()
            with torch.inference_mode():
                run.navigator.warm_up(frames.left, frames.right)
        return run.go(progress)
    finally:
        if run is not None and run.view is not None:
            run.view.close(run.record)
        simulation.close()


def shown(config: DriveConfig) -> bool:
    """Whether somebody looks at the frames, now or later."""
    return config.view or config.view_at is not None or config.rrd is not None


def make_recorder(config: DriveConfig, simulation: Simulation) -> Recorder | None:
    """What writes the drive down, if anything. Simulated time waits for it, so that nothing is left out."""
    if config.record is None:
        return None
    from ndtorch_robot.recording.drive_pilot import drive_configuration

    configuration = drive_configuration(config, simulation.rig)
    return Recorder(config.record, configuration, format=config.record_format, when_full="wait", say=say)


class Run:
    """The parts of one drive and what passes between them."""

    def __init__(
        self,
        config: DriveConfig,
        plan: Plan,
        simulation: Simulation,
        steer: Callable[[DriveCommand], DriveCommand] | None,
    ) -> None:
        self.config, self.plan, self.simulation, self.steer = config, plan, simulation, steer
        left, right, bottom, top = plan.bounds
        self.grid = Grid(left - 0.5, right + 0.5, bottom - 0.5, top + 0.5)
        self.navigator = config.options().navigator(simulation.rig, RATE, GridMap(simulation.rig, self.grid), say)
        self.state: NavigatorState | None = None
        self.record = Record()
        self.watch = CameraWatch(simulation.rig)
        self.view: DriveView | None = None
        self.stops: list[float] = []
        self.standing = 0
        self.recorder: Recorder | None = None
        self.safe = SafeDrive(simulation, simulation)
        self.loop = Loop(RATE, simulation, max_steps=max(1, round(config.seconds * RATE)))

    def show(self) -> None:
        """Record the drive for the viewer, or open it."""
        from ndtorch_robot.view import DriveView, Where
        from ndtorch_robot.view.drawing import levels

        config, simulation = self.config, self.simulation
        name = f"{config.arena} seed {config.seed} {config.controller}"
        fields = simulation.cameras.fields
        lines, where = levels(self.navigator), Where(config.rrd, config.view, config.view_at)
        self.view = DriveView(self.plan, simulation.rig, fields, lines, where, name)

    def go(self, progress: Callable[[int, int], None] | None) -> Result:
        """Drive to the end or to Ctrl-C."""
        steps = self.loop.max_steps or 0
        began, interrupted = time.perf_counter(), False

        def step(n: int, now: float) -> None:
            self.step()
            if progress is not None:
                progress(n + 1, steps)

        try:
            with torch.inference_mode():
                self.loop.run(step, self.safe)
        except KeyboardInterrupt:
            interrupted = True
        finally:
            if self.recorder is not None:
                self.recorder.close()
        wall = time.perf_counter() - began
        cells = torch.zeros(self.grid.rows, self.grid.columns)
        if self.state is not None and self.state.map is not None:
            cells = GridMap.normalise(self.grid.inner(self.state.map.cells).clone())
        summary = self.summary(cells, wall)
        return Result(
            self.config,
            summary,
            self.record,
            self.plan,
            cells,
            self.grid,
            self.simulation,
            self.stops,
            interrupted,
            self.navigator.controller.trace,
        )

    def step(self) -> None:
        """See, navigate, drive."""
        timing, simulation = self.loop.timing, self.simulation
        placed = simulation.take_placed()
        driven = simulation.driven()
        if placed is not None:
            self.record.placed.append(len(self.record.time))
        with timing.part("cameras"):
            frames = simulation.read()
        self.watch.check(frames, driven.speed)
        with timing.part("navigate"):
            if placed is None:
                moved = Command(torch.tensor([driven.speed]), torch.tensor([driven.curvature]))
                command, self.state = self.navigator(frames.left, frames.right, self.state, moved)
            else:
                command, self.state = self.restart(frames.left, frames.right, placed)
        wanted = DriveCommand(float(command.speed[-1]), float(command.curvature[-1]))
        sent = self.safe.send(self.steer(wanted) if self.steer else wanted)
        if self.recorder is not None:
            self.recorder.record_step(frames, driven, wanted, sent=sent, placed=placed)
        mode = int(self.navigator.mode(self.state))
        with timing.part("record"):
            self.record.add(frames, self.state, mode, sent, simulation.pose, simulation.rig)
        if self.view is not None:
            with timing.part("view"):
                self.view.frame(frames, self.record, self.grid, self.state.map.cells if self.state.map else None)
        self.standing = self.standing + 1 if mode == STOPPED else 0
        if self.standing == 1:
            self.stops.append(frames.time)
        if self.standing >= STOP_TIME * RATE:
            self.standing = 0
            simulation.put_back()

    def restart(
        self, left: torch.Tensor | Strips, right: torch.Tensor | Strips, placed: tuple[float, float, float]
    ) -> tuple[Command, NavigatorState]:
        """Begin anew where someone has put the car; the map goes on."""
        before = self.state
        command, state = self.navigator(left, right)
        pose = Pose(*(torch.tensor(float(value)) for value in placed))
        return command, state._replace(pose=pose, map=before.map if before is not None else state.map)

    def summary(self, cells: torch.Tensor, wall: float) -> dict[str, object]:
        """The keys of `summary.json`."""
        record, simulation = self.record, self.simulation
        poses = record.array("pose").reshape(-1, 3)
        seconds = len(poses) / RATE
        score = MapScore(None, None, None, None)
        if len(poses):
            score = score_map(cells, self.grid, self.plan, simulation.world.profiles, poses[::5], simulation.rig)
        hits = len(simulation.collisions)
        timing = self.loop.timing.summary()
        return {
            "collisions": hits,
            "stopped": len(self.stops),
            "simulated_seconds": round(seconds, 3),
            "wall_seconds": round(wall, 3),
            "distance_m": round(record.distance, 3) if len(poses) else 0.0,
            "turns": record.turns,
            "step_ms": {key: round(value, 3) for key, value in timing.get("navigate", {}).items()},
            "map": {key: None if v is None else round(v, 4) for key, v in score._asdict().items()},
            "collisions_per_hour": round(hits / seconds * 3600, 1) if seconds else math.nan,
            "free_area_passed": round(coverage(simulation.places.free, poses[:, :2]), 4) if len(poses) else 0.0,
            "arena": self.config.arena,
            "seed": self.config.seed,
            "controller": self.config.controller,
            "walls": self.config.walls,
            "odometry": self.config.odometry,
            "parts_ms": timing,
            "recording": self.recorder.summary() if self.recorder is not None else None,
        }
