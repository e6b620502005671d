"""`ndtorch import`."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from ndtorch.errors import InputError
from ndtorch_robot.navigator_options import navigator_options

if TYPE_CHECKING:
    from ndtorch_robot.navigator_runner import NavigatorRunner
    from ndtorch_robot.recording.bags import StereoBag

GAP_S = 0.5
"""After so many seconds without frames the filters of the navigator begin anew."""


@dataclass(frozen=True)
@navigator_options("controller", "stereo")
class Import:
    """Drive the navigator on the stereo bag of another robot; write ranges, odometry and map as a recording.

    Reads bags of ROS 2 (sqlite3 and mcap), of ROS 1, and MCAP files, without ROS. The images are rectified by their
    camera_info, and odometry is taken from the bag. Nothing is steered: the commands are what the navigator would want.
    """

    bag: Annotated[Path, tyro.conf.Positional]
    """The bag is this folder or file."""
    out: Path = Path("out/import.mcap")
    """The recording is written into this new file, NAME.mcap, which `ndtorch replay` and Foxglove open."""
    left: str | None = None
    """The left images have this topic (default: the pair whose names say left and right, rectified ones first)."""
    right: str | None = None
    """The right images have this topic."""
    odometry: str | None = None
    """The motion is read from this topic (default: the first one of nav_msgs/Odometry)."""
    robot: Path | None = None
    """The bag is of this robot, a file or one of robot/configs: its body and where its cameras are; calibration and
    rate are the bag's."""
    camera_height: float | None = None
    """The cameras are this high above the floor, m (default: the robot's, or 0.2)."""
    pitch: float | None = None
    """The cameras look down by this angle, degrees (default: the robot's, or 0)."""
    forward: float | None = None
    """The cameras are this far ahead of the point about which the robot turns, m (default: the robot's, or 0)."""
    controller: str | None = None
    """The controller of this name is asked; `ranging` and `goal` need a view of the floor (default: the robot's, or
    published)."""
    stereo: str | None = None
    """Ranges are found by a search of the right row (search), or by matching features (features) (default: the
    robot's, or search)."""
    map_half_size: float = 10.0
    """The map reaches so far from the start, m."""
    seconds: float | None = None
    """Only this much of the bag is read, s."""
    json: bool = False
    """What was made is printed as one JSON object."""

    def run(self) -> int:
        import math

        import torch

        from ndtorch.navigation import Grid
        from ndtorch.navigation.options import options_of
        from ndtorch_robot.config import read_robot
        from ndtorch_robot.navigator_runner import NavigatorRunner
        from ndtorch_robot.ports import print_note
        from ndtorch_robot.recording import Recorder
        from ndtorch_robot.recording.bags import StereoBag
        from ndtorch_robot.run_config import BodyTable

        torch.set_num_threads(1)
        if not 0 < self.map_half_size < 1e4:
            raise InputError(f"--map-half-size must be from 0 to 10000 m, got {self.map_half_size}")
        given = {k: v for k, v in asdict(self).items() if v is not None and v is not False}
        body, usual = BodyTable(camera_forward_m=0.0), {"controller": "published", "stereo": "search"}
        own: dict[str, object] = {}
        if self.robot is not None:
            robot, own = read_robot(self.robot)
            body = robot.body
        pitch = math.radians(given.get("pitch", body.camera_pitch_deg))
        where = {"camera_height": body.camera_height_m, "forward": body.camera_forward_m}
        where = {name: given.get(name, length) for name, length in where.items()} | {"pitch": pitch}
        bag, half = StereoBag(self.bag, self.left, self.right, self.odometry, **where), self.map_half_size
        grid = Grid(-half, half, -half, half, 0.05)
        options = options_of(usual | own | given)
        runner = NavigatorRunner(options, bag.rig, bag.rate, grid, near_check=False, body=body.body())
        if bag.topics.odometry is None:
            print_note("the bag has no odometry: the robot is taken to stand")
        with Recorder(self.out, runner, when_full="wait", report=print_note) as recorder, torch.inference_mode():
            ranged = self.drive(bag, runner, recorder)
        found = {**bag.topics._asdict(), "rate_hz": round(bag.rate, 3), "ranges": ranged, **recorder.summary()}
        if self.json:
            print(json.dumps(found))
        else:
            print(f"{recorder.steps} pairs of {self.bag} at {bag.rate:.1f} a second, {ranged} ranges: {self.out}")
            print(f"  left {bag.topics.left}, right {bag.topics.right}, odometry {bag.topics.odometry or 'none'}")
        if recorder.failed:
            print(f"error: {recorder.failed}", file=sys.stderr)
        return 1 if recorder.failed or not recorder.steps else 0

    def drive(self, bag: StereoBag, runner: NavigatorRunner, recorder: Any) -> int:
        """Every pair as a step; returns the number of ranges."""
        from ndtorch_robot.ports import STAND, Step

        began: float | None = None
        last, ranged = 0.0, 0
        for number, (frames, driven) in enumerate(bag.pairs()):
            time = frames.time
            began = time if began is None else began
            if self.seconds is not None and time - began >= self.seconds:
                break
            anew = number > 0 and time - last > GAP_S
            wanted = runner.step(frames, driven, anew=anew)
            assert runner.state is not None
            ranged += int(runner.state.ranges.valid.sum())
            recorder(Step(number, time, frames, driven, wanted, STAND, runner.state, restarted=anew))
            last = time
        return ranged
