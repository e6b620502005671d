"""`ndtorch import`."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

GAP_S = 0.5
"""Seconds without frames after which the filters of the navigator restart."""


@dataclass(frozen=True)
class Import:
    """Run the navigator on the stereo bag of another robot; write frames, ranges and odometry as a recording.

    Reads bags of ROS 2 (sqlite3 and mcap), of ROS 1, and MCAP files, without ROS. The images are rectified by their
    camera_info, and odometry is taken from the bag. Nothing is steered: the commands are what the navigator would want.
    """

    bag: Annotated[Path, tyro.conf.Positional]
    """Folder or file of the bag."""
    out: Path = Path("out/import.mcap")
    """New file NAME.mcap for the recording, which `ndtorch replay` and Foxglove open."""
    left: str | None = None
    """Topic of the left images (default: the pair whose names say left and right, rectified ones first)."""
    right: str | None = None
    """Topic of the right images."""
    odometry: str | None = None
    """Topic of the motion (default: the first one of nav_msgs/Odometry)."""
    robot: Path | None = None
    """Robot of the bag, a file or one of robot/configs: its body and where its cameras are; calibration and rate are
    the bag's."""
    controller: str | None = None
    """Controller: published, ranging or goal; the last two need a view of the floor (default: the robot's, or
    published)."""
    seconds: float | None = None
    """Length of the bag that is read, in s."""
    json: bool = False
    """Print the result as one JSON object."""

    def run(self) -> int:
        import torch

        from ndtorch.navigation import Body
        from ndtorch.navigation.options import options_of
        from ndtorch_robot.bags import StereoBag
        from ndtorch_robot.config import navigation_options
        from ndtorch_robot.navigator_runner import NavigatorRunner
        from ndtorch_robot.ports import STAND, Step, print_note
        from ndtorch_robot.recording import Recorder
        from ndtorch_robot.run_config import RigTable, read_run_config

        torch.set_num_threads(1)
        body, cameras = Body(), RigTable(camera_forward_m=0.0)
        options = dict[str, object](controller="published", stereo="search")
        if self.robot is not None:
            robot = read_run_config(self.robot)
            body, cameras, options = robot.body, robot.rig, options | navigation_options(self.robot)
        if self.controller is not None:
            options["controller"] = self.controller
        bag = StereoBag(self.bag, self.left, self.right, self.odometry, **cameras.mounting)
        if bag.topics.odometry is None:
            print_note("the bag has no odometry: the robot is taken to stand")
        runner = NavigatorRunner(options_of(options), bag.rig, bag.rate, None, False, body)
        ranged, began, last = 0, math.nan, math.nan
        with Recorder(self.out, runner, when_full="wait", report=print_note) as recorder, torch.inference_mode():
            for number, (frames, driven) in enumerate(bag.pairs()):
                began = frames.time if number == 0 else began
                if self.seconds is not None and frames.time - began >= self.seconds:
                    break
                anew = frames.time - last > GAP_S
                wanted, last = runner.step(frames, driven, anew=anew), frames.time
                assert runner.state is not None
                ranged += int(runner.state.ranges.valid.sum())
                recorder(Step(number, last, frames, driven, wanted, STAND, runner.state, restarted=anew))
        result = {**bag.topics._asdict(), "rate_hz": round(bag.rate, 3), "ranges": ranged, **recorder.summary()}
        words = f"{recorder.steps} pairs of {self.bag} at {bag.rate:.1f} a second, {ranged} ranges: {self.out}"
        print(json.dumps(result) if self.json else f"{words}\n  {bag.topics}")
        if recorder.failed:
            print(f"error: {recorder.failed}", file=sys.stderr)
        return 1 if recorder.failed or not recorder.steps else 0
