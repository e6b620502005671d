"""`ndtorch drive` on recorded frames: the very same steps, with the recording in place of the world."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any, cast

from ndtorch.errors import InputError
from ndtorch.navigation import NavigatorState, StereoRig
from ndtorch_robot.config import DriveConfig, load_config
from ndtorch_robot.drive import RATE, Run
from ndtorch_robot.ports import DriveCommand, SafeCommand, StereoFrames, unseal
from ndtorch_robot.recording.replay import Placed
from ndtorch_robot.sim.arenas import load_arena
from ndtorch_robot.sim.simulation import Simulation

NOT_RECORDED = {"out", "record", "record_format", "rrd", "view", "view_at"}
"""Where results go is no part of what was driven."""


class RecordedWorld:
    """Answers like the simulation, from one recorded step at a time."""

    def __init__(self, rig: StereoRig) -> None:
        self.rig = rig
        self.time = 0.0
        self.frames: StereoFrames | None = None
        self.moved = DriveCommand(0.0, 0.0)
        self.placed: Placed = None
        self.wanted = DriveCommand(0.0, 0.0)
        self.pose = (0.0, 0.0, 0.0)

    def now(self) -> float:
        """The time of the step."""
        return self.time

    def wait_until(self, time: float) -> None:
        """Time is that of the recording."""

    def take_placed(self) -> Placed:
        """Where the car had been put."""
        return self.placed

    def driven(self) -> DriveCommand:
        """What the wheels had said."""
        return self.moved

    def read(self) -> StereoFrames:
        """What the cameras had seen."""
        assert self.frames is not None
        return self.frames

    def send(self, command: SafeCommand) -> DriveCommand:
        """Keep the command."""
        self.wanted = unseal(command)
        return self.wanted

    def resume(self) -> None:
        """Nothing stops here."""

    def trouble(self) -> None:
        """Never."""

    def stop(self) -> None:
        """Nothing moves."""

    def put_back(self) -> None:
        """The recording says where the car was put."""


class DrivePilot:
    """The step of a simulated drive."""

    def __init__(self, configuration: dict[str, Any]) -> None:
        config = load_config(None, configuration["drive"])
        if configuration["rate_hz"] != RATE:
            raise InputError(
                f"the drive was recorded at {configuration['rate_hz']} Hz and can be replayed at {RATE} Hz"
            )
        self.world = RecordedWorld(StereoRig(**configuration["rig"]))
        plan = load_arena(config.arena, config.seed)
        self.run = Run(config, plan, cast("Simulation", self.world), None)
        self.navigator = self.run.navigator
        self.rig, self.fields = self.world.rig, config.options().fields(self.world.rig)

    @property
    def state(self) -> NavigatorState | None:
        """Of the navigator after the last step."""
        return self.run.state

    def step(
        self, frames: StereoFrames, driven: DriveCommand, placed: Placed = None, restarted: bool = False
    ) -> DriveCommand:
        """The command for a step."""
        world = self.world
        world.frames, world.moved, world.placed, world.time = frames, driven, placed, frames.time
        self.run.step()
        return world.wanted


def drive_configuration(config: DriveConfig, rig: StereoRig) -> dict[str, Any]:
    """The configuration of a simulated drive for `Recorder`."""
    return {
        "program": "drive",
        "drive": config.model_dump(mode="json", exclude=NOT_RECORDED),
        "rig": asdict(rig),
        "rate_hz": RATE,
    }
