"""Dead reckoning against exact circles and fine integration."""

import math

import pytest
import torch
from torch.autograd import gradcheck

from ndtorch.errors import InputError
from ndtorch.navigation import DeadReckoning, Pose
from ndtorch.navigation.odometry import drive_step, to_body, to_world


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


def test_chunks_batches_and_precision():
    speed, turn = torch.rand(2, 3, 20), torch.randn(2, 3, 20)
    reckon = DeadReckoning(0.1, scale_error=0.01, drift=0.02)
    whole, final = reckon(speed, turn)
    assert whole.x.shape == (2, 3, 20)
    state, parts = None, []
    for v, k in zip(speed.split(7, -1), turn.split(7, -1), strict=True):
        poses, state = reckon(v, k, state)
        parts.append(poses)
    for k in range(3):
        assert torch.equal(torch.cat([p[k] for p in parts], -1), whole[k])
        assert torch.equal(state[k], final[k])
        assert torch.equal(reckon(speed[1, 2], turn[1, 2])[0][k], whole[k][1, 2])
    torch.testing.assert_close(reckon(speed.double(), turn.double())[0].x.float(), whole.x)


def test_errors_of_the_reckoning():
    speed, turn = torch.full((300,), 0.5), torch.zeros(300)
    _, scaled = DeadReckoning(1 / 30, scale_error=0.02)(speed, turn)
    assert float(scaled.x) == pytest.approx(5.1, rel=1e-4)
    _, drifted = DeadReckoning(1 / 30, drift=math.radians(2))(speed, turn)
    assert float(drifted.heading) == pytest.approx(math.radians(20), rel=1e-4)


def test_frames_are_inverse_and_turn_the_right_way():
    pose = Pose(*torch.tensor([1.0, 2.0, 0.7], dtype=torch.float64))
    x, y = torch.randn(2, 9, dtype=torch.float64)
    back = to_body(pose, *to_world(pose, x, y))
    torch.testing.assert_close(back[0], x)
    torch.testing.assert_close(back[1], y)
    left = to_world(Pose(*torch.tensor([0.0, 0.0, math.pi / 2])), torch.tensor(1.0), torch.tensor(0.0))
    assert [float(v) for v in left] == pytest.approx([0.0, 1.0], abs=1e-6)


def test_gradient_through_a_straight_step():
    start = torch.tensor([0.1, 0.2, 0.3], dtype=torch.float64, requires_grad=True)
    drive = torch.tensor([0.5, 0.0], dtype=torch.float64, requires_grad=True)
    assert gradcheck(lambda p, d: tuple(drive_step(Pose(*p.unbind()), d[0], d[1], 0.1)), (start, drive), atol=1e-6)


def test_bad_input():
    with pytest.raises(InputError, match="dt"):
        DeadReckoning(0.0)
    with pytest.raises(InputError, match="drift"):
        DeadReckoning(0.1, drift=math.nan)
    for speed, turn in [(torch.zeros(3), torch.zeros(4)), (torch.zeros(0), torch.zeros(0))]:
        with pytest.raises(InputError, match="one shape"):
            DeadReckoning(0.1)(speed, turn)
