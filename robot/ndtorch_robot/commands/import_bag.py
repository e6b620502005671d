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

FAR_APART = 0.05
"""Median time between the images of a pair, of the time between frames, beyond which a line says so."""


@dataclass(frozen=True)
class Import:
    """Run the navigator on the stereo bag of another robot; write frames, ranges and odometry as a recording.

    Reads bags of ROS 2 (sqlite3 and mcap), of ROS 1, and MCAP files, without ROS. The images are rectified by their
    camera_info or another calibration, and the motion is that of the bag. Nothing is steered: the commands are those
    that the navigator would give.
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
    """Topic of the motion: Odometry, TFMessage, or a stamped pose, transform or twist (default: the first one)."""
    calibration: tuple[Path, ...] = ()
    """Files of the calibration of both cameras, one or two, of ROS, KITTI, EuRoC, OpenCV or Kalibr (default: the topics
    camera_info)."""
    apart_ms: float | None = None
    """Most time between both images of a pair, in ms (default: a quarter of the time between frames)."""
    shift_ms: float = 0.0
    """Time by which stamps of right images are later than those of left images taken at once, in ms."""
    robot: Path | None = None
    """Robot of the bag, a file or one of robot/configs: its body and where its cameras are; calibration and rate are
    the bag's."""
    controller: str | None = None
    """Controller: published, ranging or goal; the last two need a view of the floor (default: the robot's, or
    published)."""
    seconds: float | None = None
    """Length of the bag that is read, in s."""
    whole_frames: bool = False
    """Record whole frames instead of what navigation reads of them."""
    json: bool = False
    """Print the result as one JSON object."""

    def run(self) -> int:
        import numpy as np
        import torch

        from ndtorch.navigation import Body, SearchParams
        from ndtorch.navigation.options import options_of
        from ndtorch_robot.bags import StereoBag, why_few_ranges
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
        apart_s = None if self.apart_ms is None else self.apart_ms / 1000
        left, right, odometry, where = self.left, self.right, self.odometry, cameras.mounting
        bag = StereoBag(self.bag, left, right, odometry, self.calibration, apart_s, self.shift_ms / 1000, **where)
        if bag.topics.odometry is None:
            print_note("the bag has no odometry: the robot is taken to stand")
        if bag.by_log:
            print_note("stamps of the images do not increase: the times of recording are taken")
        runner = NavigatorRunner(options_of(options), bag.rig, bag.rate, None, False, body)
        ranged, began, last = 0, math.nan, math.nan
        writer = Recorder(self.out, runner, when_full="wait", report=print_note, whole=self.whole_frames)
        with writer as recorder, torch.inference_mode():
            for number, (frames, driven) in enumerate(bag.pairs()):
                began = frames.time if number == 0 else began
                if self.seconds is not None and frames.time - began >= self.seconds:
                    break
                anew = frames.time - last > GAP_S
                wanted, last = runner.step(frames, driven, anew=anew), frames.time
                assert runner.state is not None
                ranged += int(runner.state.ranges.valid.sum())
                recorder(Step(number, last, frames, driven, wanted, STAND, runner.state, restarted=anew))
        if not recorder.steps:
            ms = f"the nearest are {1000 * bag.nearest_s:.4g} ms apart, more than {1000 * bag.apart_s:.4g} ms"
            print_note(f"no image of the left camera has one of the right: {ms}; --apart-ms, --shift-ms change that")
        elif ranged < 4 * recorder.steps:
            params = runner.navigator.ranging.search or SearchParams.for_body(bag.rig, body)
            if reason := why_few_ranges(bag.rig, frames, params):
                print_note(f"{ranged} ranges in {recorder.steps} pairs; the last one: {reason}")
        if recorder.steps and np.median(np.abs(bag.later_s)) > FAR_APART * bag.period_s:
            low, later, high, period = (1000 * v for v in (*np.quantile(bag.later_s, (0, 0.5, 1)), bag.period_s))
            shifts = [f"{self.shift_ms + later - by:.4g}" for by in (0, math.copysign(period, later))]
            print_note(
                f"right images are {later:.1f} ms later than left ones ({low:.1f} to {high:.1f}; {period:.1f} between "
                f"frames): taken at once if the clocks differ by --shift-ms {shifts[0]}, or by {shifts[1]}"
            )
        if bag.topics.odometry is not None and bag.moves.path_m < 0.01:
            print_note(f"by {bag.topics.odometry} the robot does not move")
        elif bag.moves.up_m > bag.moves.path_m:
            print_note(f"by {bag.topics.odometry} the robot moves up more than ahead: is its frame an optical one?")
        result = {
            **bag.topics._asdict(),
            "rate_hz": round(bag.rate, 3),
            "path_m": round(bag.moves.path_m, 3),
            "ranges": ranged,
            "unpaired": bag.alone,
            **recorder.summary(),
        }
        words = f"{recorder.steps} pairs of {self.bag} at {bag.rate:.1f} a second, {ranged} ranges: {self.out}"
        words += f"\n  {' and '.join(map(str, bag.alone))} images of left and right without a partner" * any(bag.alone)
        print(json.dumps(result) if self.json else f"{words}\n  {bag.topics}")
        if recorder.failed:
            print(f"error: {recorder.failed}", file=sys.stderr)
        return 1 if recorder.failed or not recorder.steps else 0
