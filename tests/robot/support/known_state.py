"""A navigator's state with obstacles at known places."""

import numpy as np
import torch

from ndtorch.navigation import Pose, StereoRig
from ndtorch.navigation.local_grid.grid import mark_stop
from ndtorch.navigation.options import NavigatorOptions
from ndtorch_robot.navigator_runner import NavigatorRunner
from ndtorch_robot.ports import DriveCommand, Step, StereoFrames

NONE = (np.zeros(0, np.float32), np.zeros(0, np.float32))


def known_step(pose=(1.0, 2.0, 0.3), places=((0.8, 0.4), (-0.5, -0.6)), driven=(0.4, 0.5), grid=None):
    """A step of a car at a pose that knows of obstacles at places of its body frame, m; and its runner."""
    runner = NavigatorRunner(NavigatorOptions(), StereoRig(forward=0.15), 30.0, grid)
    frame = torch.zeros(1, 1, 480, 640, dtype=torch.uint8)
    frames = StereoFrames(frame, frame, 12.5)
    runner.step(frames, DriveCommand(0.0, 0.0), pose)
    control, params = runner.state.control, runner.navigator.controller.params
    x, y = np.array(places, np.float32).T
    local = control.grid._replace(
        evidence=np.zeros_like(control.grid.evidence), raised=np.zeros_like(control.grid.raised)
    )
    local = mark_stop(local, pose, (x, y), NONE, False, params.blocked_evidence, params.grid)
    control = control._replace(grid=local)
    runner.state = runner.state._replace(control=control, pose=Pose(*pose))
    command = DriveCommand(*driven)
    return Step(3, 12.5, frames, command, command, command, runner.state), runner
