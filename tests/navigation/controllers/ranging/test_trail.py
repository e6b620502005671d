"""The trail: what is kept of the way, and going back on it, by torch and by the kernel."""

import math

import pytest
import torch

from ndtorch.kernels.decision import NUMBERS, decision
from ndtorch.kernels.trail import POSES, SPACING, follow_trail, lay_trail
from ndtorch.navigation import Pose
from ndtorch.navigation.controllers.ranging.decision import ranging_constants
from ndtorch.navigation.controllers.ranging.modes import REVERSE, TURN
from ndtorch.navigation.controllers.ranging.params import RangingParams
from ndtorch.navigation.controllers.ranging.trail import Trail, back, empty_trail, lay
from ndtorch.navigation.odometry import drive_step

DT, TIGHT = 1 / 30, torch.tensor(2.0)


def drive(trail, pose, moves):
    """Drive (speed, curvature, steps) after each other; returns trail and pose."""
    for speed, curvature, steps in moves:
        for _ in range(steps):
            pose = drive_step(pose, torch.tensor(speed), torch.tensor(curvature), DT)
            trail = lay(trail, pose, torch.tensor(speed))
    return trail, pose


def started(x=0.0, y=0.0, heading=0.0):
    pose = Pose(*torch.tensor([x, y, heading]))
    return lay(empty_trail(pose), pose, torch.tensor(0.0)), pose


def test_it_is_as_long_as_the_way_up_to_its_end():
    trail, pose = drive(*started(), [(0.5, 0.0, 60)])
    length, bend = back(trail, pose, TIGHT)
    # 1 m, in whole spacings, which a step of 1.7 cm makes up to that much longer.
    assert 1.0 - 17 * 0.017 < float(length) <= 1.0
    assert float(bend) == pytest.approx(0.0, abs=1e-6)
    trail, pose = drive(trail, pose, [(0.5, 0.0, 600)])
    assert float(back(trail, pose, TIGHT)[0]) == pytest.approx((POSES - 1) * SPACING)


@pytest.mark.parametrize("bend", [2.0, -1.0])
def test_a_car_goes_back_the_way_it_came(bend):
    """An arc after a straight, back to where it began: soon beside the way by little, at the end as it stood."""
    trail, pose = drive(*started(1.0, -2.0, 0.7), [(0.5, 0.0, 60), (0.4, bend, 45)])
    away = []
    for _ in range(300):
        length, follow = back(trail, pose, TIGHT)
        if length < 0.1:
            break
        pose = drive_step(pose, torch.tensor(-0.3), follow, DT)
        trail = lay(trail, pose, torch.tensor(-0.3))
        ahead = (pose.x - 1.0) * math.cos(0.7) + (pose.y + 2.0) * math.sin(0.7)
        if ahead < 0.9:
            away.append(abs(float((pose.y + 2.0) * math.cos(0.7) - (pose.x - 1.0) * math.sin(0.7))))
    assert len(away) > 60
    assert max(away) < 0.06
    assert away[-1] < 0.015
    assert float(pose.heading) == pytest.approx(0.7, abs=0.05)


def test_who_backs_beside_it_has_left_it():
    trail, pose = drive(*started(), [(0.5, 0.0, 60), (-0.3, 2.0, 40)])
    assert float(back(trail, pose, TIGHT)[0]) < 0.2
    assert float(pose.heading) < -0.7


def test_the_kernel_lays_and_follows_the_same_trail():
    generator = torch.Generator().manual_seed(6)
    trail, pose = started()
    array, number, lengths = trail.places.numpy().copy(), float(trail.number), set()
    for _ in range(40):
        speed = 0.5 if torch.rand((), generator=generator) < 0.6 else -0.3
        curvature = float(torch.randint(-2, 3, (), generator=generator))
        if speed < 0:
            curvature = float(back(trail, pose, TIGHT)[1]) + 0.5 * curvature * (len(lengths) % 7 == 0)
        for _ in range(12):
            pose = drive_step(pose, torch.tensor(speed), torch.tensor(curvature), DT)
            trail = lay(trail, pose, torch.tensor(speed))
            here, after = tuple(map(float, pose)), array.copy()
            number = lay_trail(array, number, here, float(torch.tensor(speed)), after)
            array = after
            assert number == float(trail.number)
            length, bend = follow_trail(array, number, here, 2.0)
            wanted = back(trail, pose, TIGHT)
            assert (length, bend) == pytest.approx(tuple(map(float, wanted)), abs=1e-3)
            lengths.add(round(length, 2))
    assert len(lengths) > 10


def test_a_batch_is_each_car():
    trails = [drive(*started(), moves) for moves in ([(0.5, 0.0, 60)], [(0.5, 1.0, 50), (-0.3, -1.0, 20)])]
    many = Trail(*(torch.stack(parts) for parts in zip(*(t for t, _ in trails), strict=True)))
    poses = Pose(*(torch.stack(parts) for parts in zip(*(p for _, p in trails), strict=True)))
    both = lay(many, poses, torch.tensor([0.5, -0.3]))
    for k, (trail, pose) in enumerate(trails):
        one = lay(trail, pose, torch.tensor([0.5, -0.3][k]))
        assert torch.equal(both.places[k], one.places)
        assert [float(v[k]) for v in back(both, poses, TIGHT)] == pytest.approx(
            [float(v) for v in back(one, pose, TIGHT)]
        )


@pytest.mark.parametrize(("behind", "bend"), [(0.7, -2.0), (0.5, 0.3), (0.0, 0.3)])
def test_with_much_room_behind_it_turns_on_while_it_backs(behind, bend):
    """Going back the way it came and turning the same way once more would bring a car out of no corner."""
    c = ranging_constants(RangingParams(), DT)
    numbers = tuple(float(getattr(c, name)) for name in NUMBERS)
    moves = torch.stack((c.speeds, c.bends)).double().numpy()
    lengths = torch.full((2, 8), 0.1, dtype=torch.double)
    lengths[:, 5] = behind
    state = (float(TURN), 9.0, 1.0, 0.0, 0.0, 0.0, 0.0)
    speed, curvature, after = decision(
        lengths.numpy(),
        0.4,
        (1.0, 0.3),
        (99.0, 3.0, 15.0),
        state,
        c.comparison.double().numpy(),
        c.table.numpy(),
        moves,
        numbers,
    )
    assert (int(after[0]), after[3]) == (REVERSE, float(behind == 0.7))
    assert (speed, curvature) == pytest.approx((-0.3, bend))
