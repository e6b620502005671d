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


def by_kernel(trail, pose, speed):
    after = torch.zeros_like(trail.places).numpy()
    number = lay_trail(trail.places.numpy(), float(trail.number), tuple(map(float, pose)), speed, after)
    return Trail(torch.from_numpy(after), torch.tensor(number))


def by_torch(trail, pose, speed):
    return lay(trail, pose, torch.tensor(speed))


def behind(count, heading=0.0):
    """So many poses along x, 5 cm apart, the newest at the origin."""
    places = torch.zeros(POSES, 3)
    places[:, 0] = -SPACING * torch.arange(POSES)
    places[:, 2] = heading
    return Trail(places, torch.tensor(float(count)))


def at(x=0.0, y=0.0, heading=0.0):
    return Pose(*torch.tensor([x, y, heading]))


@pytest.mark.parametrize("laid", [by_torch, by_kernel])
@pytest.mark.parametrize(
    ("pose", "speed", "shift"),
    [
        (at(0.051), 0.5, 1),
        (at(0.049), 0.5, 0),
        (at(0.036, -0.036), 0.5, 1),  # however it came there
        (at(-0.03, 0.041), 0.5, 1),
        (at(0.051), 0.0, 0),  # who stands does not drive on
        (at(-0.05), 0.0, -1),
        (at(0.009), -0.3, -1),
        (at(-0.01), -0.3, -1),
        (at(0.011), -0.3, 0),  # not there yet
        (at(-0.2, 0.059), -0.3, -1),
        (at(-0.2, -0.059), -0.3, -1),
        (at(-0.2, 0.0, 0.249), -0.3, -1),
        (at(-0.2, 0.0, -0.249), -0.3, -1),
    ],
)
def test_it_grows_by_what_is_far_enough_and_loses_what_is_passed(laid, pose, speed, shift):
    trail = behind(10)
    after = laid(trail, pose, speed)
    assert float(after.number) == 10 + shift
    if shift == 1:
        torch.testing.assert_close(after.places[0], torch.stack(pose))
        assert torch.equal(after.places[1:], trail.places[:-1])
    else:
        moved = -shift
        assert torch.equal(after.places[: POSES - moved], trail.places[moved:])


@pytest.mark.parametrize("laid", [by_torch, by_kernel])
@pytest.mark.parametrize("pose", [at(0.0, 0.061), at(0.0, -0.061), at(0.0, 0.0, 0.251), at(-0.2, 0.0, -0.251)])
def test_who_backs_beside_it_or_turned_against_it_begins_another_one(laid, pose):
    after = laid(behind(10), pose, -0.0011)
    assert float(after.number) == 1
    torch.testing.assert_close(after.places[0], torch.stack(pose))
    # Rolling back by less than a millimetre a second is no going back, and going on is none.
    assert float(laid(behind(10), pose, -0.0009).number) in (9.0, 10.0)
    assert float(laid(behind(10), pose, 0.3).number) == 10 + (torch.hypot(pose.x, pose.y) >= SPACING)


@pytest.mark.parametrize("laid", [by_torch, by_kernel])
def test_it_begins_where_the_car_is_and_is_never_longer_than_its_memory(laid):
    for speed in (0.0, 0.5, -0.3):
        assert float(laid(behind(0), at(1.0, 2.0, 0.5), speed).number) == 1
        torch.testing.assert_close(laid(behind(0), at(1.0, 2.0, 0.5), speed).places[0], torch.tensor([1.0, 2.0, 0.5]))
    full = laid(behind(POSES), at(0.06), 0.5)
    assert float(full.number) == POSES
    assert torch.equal(full.places[1:], behind(POSES).places[:-1])


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("count", [0, 1, 2, 4, 5, 6, 40])
def test_it_steers_back_by_the_arc_to_the_fifth_pose_or_to_the_last_one(count, side):
    pose, tightest = at(0.01, side * 0.03, side * 0.02), 9.0
    trail = behind(count)
    length, bend = (float(v) for v in back(trail, pose, torch.tensor(tightest)))
    assert (length, bend) == pytest.approx(follow_trail(trail.places.numpy(), count, tuple(map(float, pose)), tightest))
    poses = max(count - 1, 0)
    assert length == pytest.approx(poses * SPACING)
    dx, dy = -SPACING * min(poses, 4) - 0.01, -side * 0.03
    angle = math.atan2(dy, dx) - side * 0.02
    square = max(dx * dx + dy * dy, 0.01)  # nearer than 10 cm as if it were that far
    wanted = 2 * math.hypot(dx, dy) * math.sin(angle) / square
    assert bend == pytest.approx(wanted if poses else 0.0, abs=1e-5)
    assert abs(float(back(trail, pose, torch.tensor(0.25))[1])) <= 0.25


@pytest.mark.parametrize(("x", "steers"), [(0.021, True), (0.019, False)])
def test_nothing_is_steered_to_that_is_no_more_than_2_cm_behind(x, steers):
    trail, pose = behind(1), at(x, 0.05, 0.0)
    bends = float(back(trail, pose, TIGHT)[1]), follow_trail(trail.places.numpy(), 1, tuple(map(float, pose)), 2.0)[1]
    assert [bend != 0 for bend in bends] == [steers] * 2
