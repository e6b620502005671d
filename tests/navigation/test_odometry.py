"""Dead reckoning against exact circles and fine integration."""

import math

import pytest
import torch

from ndtorch.navigation import DeadReckoning, Pose
from ndtorch.navigation.odometry import to_world
from tests.navigation.planar_world import to_body


def test_circle_and_line():
    turn = torch.full((60,), 2.0, dtype=torch.float64)
    speed = torch.full((60,), math.pi / 2, dtype=torch.float64)  # radius 0.5 m: a full circle in 2 s
    poses, last = DeadReckoning(1 / 30)(speed, turn)
    assert [float(v) for v in last] == pytest.approx([0, 0, 2 * math.pi], abs=1e-9)
    assert [float(part[29]) for part in poses] == pytest.approx([0, 1.0, math.pi])  # half way: 1 m to the left
    straight = DeadReckoning(1 / 30)(speed, 0 * turn, Pose(*torch.tensor([1.0, 2.0, math.pi / 2]).double()))[1]
    assert [float(v) for v in straight] == pytest.approx([1.0, 2.0 + math.pi, math.pi / 2])


def test_coarse_steps_are_exact():
    generator = torch.Generator().manual_seed(0)
    speed = torch.rand(10, generator=generator, dtype=torch.float64)
    turn = torch.randn(10, generator=generator, dtype=torch.float64)
    _, coarse = DeadReckoning(0.5)(speed, turn)
    _, fine = DeadReckoning(0.5 / 100)(speed.repeat_interleave(100), turn.repeat_interleave(100))
    for a, b in zip(coarse, fine, strict=True):
        assert float(a) == pytest.approx(float(b), abs=1e-9)


def test_frames_are_inverse_and_turn_the_right_way():
    pose = Pose(*torch.tensor([1.0, 2.0, 0.7], dtype=torch.float64))
    x, y = torch.randn(2, 9, dtype=torch.float64)
    back = to_body(pose, *to_world(pose, x, y))
    torch.testing.assert_close(back[0], x)
    torch.testing.assert_close(back[1], y)
    left = to_world(Pose(*torch.tensor([0.0, 0.0, math.pi / 2])), torch.tensor(1.0), torch.tensor(0.0))
    assert [float(v) for v in left] == pytest.approx([0.0, 1.0], abs=1e-6)
