"""Small recordings of drawn steps."""

import torch

from ndtorch.navigation import StereoRig, Strips
from ndtorch_robot.ports import DriveCommand, StereoFrames
from ndtorch_robot.recording import Recorder

RIG = StereoRig(width=64, height=48, focal=43.0)
STILL = DriveCommand(0.0, 0.0)


def eye(n, channels=3, height=48, width=64):
    shape = (1, channels, height, width)
    return torch.randint(0, 256, shape, generator=torch.Generator().manual_seed(n), dtype=torch.uint8)


def step(n, strips=False, channels=3):
    if strips:
        left, right = (Strips(eye(4 * n + k, channels, 9, 21), eye(4 * n + k + 1, channels, 1)) for k in (0, 2))
        return StereoFrames(left, right, n / 30)
    return StereoFrames(eye(2 * n, channels), eye(2 * n + 1, channels), n / 30)


def write(folder, count=5, strips=False, channels=3, **options):
    with Recorder(folder, {"program": "test"}, **options) as recorder:
        for n in range(count):
            recorder.record_step(step(n, strips, channels), DriveCommand(0.1 * n, -0.3), DriveCommand(0.5, 1 / 3))
    return recorder


def same(a, b):
    if isinstance(a, Strips):
        return torch.equal(a.field, b.field) and torch.equal(a.row, b.row)
    return torch.equal(a, b)
