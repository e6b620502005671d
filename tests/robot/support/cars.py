"""Stand-ins for a car: pictures that slide past, a loop without a board, a drive that notes, a state with obstacles."""

import numpy as np
import torch

from ndtorch.navigation import Grid, Pose, StereoRig
from ndtorch.navigation.controllers.ranging._kernels import mark_scan
from ndtorch.navigation.options import NavigatorOptions
from ndtorch.navigation.proximity import NOWHERE, Obstacles, ProximityScan
from ndtorch_robot.camera_monitor import CameraMonitor
from ndtorch_robot.car import Car
from ndtorch_robot.navigator_runner import NavigatorRunner
from ndtorch_robot.ports import Drive, DriveCommand, Step, StereoFrames, unseal
from ndtorch_robot.run_config import RunConfig
from ndtorch_robot.safety import SafeDrive

RIG = StereoRig(width=64, height=48, focal=43.0)


def moving_world(count, rig, seed=0, grain=3):
    """Pictures that slide past, at two speeds; so many neighbouring pixels are alike, 3 or more for good cameras."""
    rng = np.random.default_rng(seed)
    wall = rng.integers(0, 256, (rig.height, 4 * rig.width, 3), dtype=np.uint8).repeat(grain, 1)
    for n in range(count):
        parts = [wall[:, (k + n * speed) % (3 * rig.width) :][:, : rig.width].copy() for k, speed in ((0, 1), (9, 3))]
        left, right = (torch.from_numpy(part).permute(2, 0, 1)[None] for part in parts)
        yield StereoFrames(left, right, n / 30)


FAULTS = ["no command for 0.2 s"]


class FilmCar(Drive):
    """Cameras, clock and drive: every reading gives the next of some frames, and wheels that do what they are told."""

    def __init__(self, frames):
        self.frames, self.time, self.sent = iter(frames), 0.0, DriveCommand(0.0, 0.0)

    def now(self):
        return self.time

    def wait_until(self, time):
        self.time = time

    def read(self):
        return next(self.frames)._replace(time=self.time)

    def send(self, command):
        self.sent = unseal(command)
        return self.sent

    def driven(self):
        return self.sent

    def telemetry(self):
        return {"armed": True, "faults": FAULTS, "battery_v": 7.4, "rejected": 3, "link": None}

    def stop(self):
        self.sent = DriveCommand(0.0, 0.0)

    def resume(self):
        return True


def bare_loop(car, rig, observers=None, half=0.0, **navigation):
    """A loop that drives off at once, with a map that reaches so far to all sides."""
    limits, grid = RunConfig().safety_limits, Grid(-half, half, -half, half) if half else None
    runner = NavigatorRunner(NavigatorOptions(**navigation), rig, 30.0, grid, near_check=False)
    safe = SafeDrive(car, car, limits, CameraMonitor(rig, 30.0, limits.frame_age_s))
    return Car(runner, car, safe, observers=observers or [], go=True)


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
    local = mark_scan(local, pose, ProximityScan(Obstacles(x, y), False, NOWHERE, NOWHERE), params.grid.cell_m)
    control = control._replace(grid=local)
    runner.state = runner.state._replace(control=control, pose=Pose(*pose))
    command = DriveCommand(*driven)
    return Step(3, 12.5, frames, command, command, command, runner.state), runner


class PlainDrive:
    def __init__(self):
        self.sent, self.stops, self.resumes, self.why, self.ready = [], 0, 0, None, True

    def send(self, command):
        self.sent.append(unseal(command))
        return self.sent[-1]

    def stop(self):
        self.stops += 1

    def resume(self):
        self.resumes += self.ready
        return self.ready

    def trouble(self):
        return self.why


class SimulatedClock:
    """Time that passes only by waiting: a loop on it runs as fast as it can and always sees the same times."""

    def __init__(self) -> None:
        self.time = 0.0

    def now(self) -> float:
        return self.time

    def wait_until(self, time_: float) -> None:
        self.time = max(self.time, time_)
