"""The goal controller: what it is asked to do, and that its state is all it has."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.kernels.load import kernel
from ndtorch.navigation import ARRIVED, CRUISE, STOPPED, Command, Navigator, NavigatorOptions, Pose, StereoRig
from ndtorch.navigation.controllers.goal import GoalControl, GoalParams
from ndtorch.navigation.controllers.goal.params import reactive_params
from ndtorch.navigation.controllers.ranging.patch import PatchParams
from ndtorch.navigation.localisation import LocaliserState
from ndtorch.navigation.near_things import Near
from ndtorch.navigation.odometry import drive_step
from ndtorch.navigation.ranging import Ranges

RIG, DT = StereoRig(forward=0.15), 1 / 30
SMALL = replace(reactive_params(), patch=PatchParams(cell=0.05, size=128))


def nothing(*batch):
    blank = torch.zeros(*batch, 4)
    return Ranges(blank, blank, blank, blank, blank, blank.bool())


def floor(*batch, moves=True):
    """What open floor gives while the car moves at a steady speed, roughly; nothing while it stands."""
    return torch.full((*batch, 2, 14, 8), 0.5 if moves else 0.0)


def drive(control, steps, pose, state=None):
    """Through open floor: the commands are obeyed at once."""
    command = Command(torch.zeros_like(pose.x), torch.zeros_like(pose.x))
    batch = pose.x.shape
    for _ in range(steps):
        if state is None:
            state = control.start(floor(*batch), pose)
        moves = bool((command.speed != 0).all())
        command, state = control.step(floor(*batch, moves=moves), nothing(*batch), pose, command, state)
        pose = drive_step(pose, command.speed, command.curvature, DT)
    return pose, state, command


def place(x, y, heading):
    return Pose(torch.tensor(x), torch.tensor(y), torch.tensor(heading))


def test_it_goes_to_the_place_and_back_and_stands():
    control = GoalControl(RIG, DT, GoalParams(to=(1.5, 0.5), back=True, reactive=SMALL))
    state, pose, nearest = None, place(0.0, 0.0, 0.0), 9.0
    for _ in range(60):
        pose, state, command = drive(control, 10, pose, state)
        nearest = min(nearest, float(torch.hypot(pose.x - 1.5, pose.y - 0.5)))
        if int(control.mode(state)) == ARRIVED:
            break
    assert nearest < 0.5
    assert float(torch.hypot(pose.x, pose.y)) < 0.35
    assert float(command.speed) == 0


def test_the_same_state_gives_the_same_step_and_stays_as_it_was():
    control = GoalControl(RIG, DT, GoalParams(to=(3.0, 0.0), reactive=SMALL))
    pose, state, command = drive(control, 30, place(0.0, 0.0, 0.0))
    kept = [part.clone() for part in state if isinstance(part, torch.Tensor)]
    patch = state.reactive.patch.evidence.clone()
    one, two = (control.step(floor(), nothing(), pose, command, state) for _ in range(2))
    assert torch.equal(torch.stack(one[0]), torch.stack(two[0]))
    assert torch.equal(one[1].way, two[1].way)
    assert all(torch.equal(a, b) for a, b in zip(kept, (p for p in state if isinstance(p, torch.Tensor)), strict=True))
    assert torch.equal(patch, state.reactive.patch.evidence)


def test_a_batch_is_as_many_cars():
    control = GoalControl(RIG, DT, GoalParams(to=(2.0, 1.0), reactive=SMALL))
    poses = [place(0.0, 0.0, 0.0), place(1.0, -1.0, 1.0)]
    both = Pose(*(torch.stack(parts) for parts in zip(*poses, strict=True)))
    _, together, command = drive(control, 25, both)
    for n, pose in enumerate(poses):
        _, alone, single = drive(control, 25, pose)
        assert float(single.curvature) == pytest.approx(float(command.curvature[n]))
        torch.testing.assert_close(together.way[n], alone.way)


def test_what_is_ranged_in_the_way_is_driven_around():
    control = GoalControl(RIG, DT, GoalParams(to=(3.0, 0.0), reactive=SMALL))
    pose, state, command = drive(control, 20, place(0.0, 0.0, 0.0))
    assert int(control.mode(state)) == CRUISE
    straight = state.way[: int(state.places)]
    assert float(straight[:, 1].abs().max()) < 0.05
    x = 1.6 - pose.x
    across = torch.tensor([-0.1, -0.03, 0.03, 0.1]) - pose.y
    wall = Ranges(x.expand(4), across * 0, across * 0, x.expand(4), across, torch.ones(4, dtype=torch.bool))
    for _ in range(10):
        command, state = control.step(floor(), wall, pose, command, state)
    way = state.way[: int(state.places)]
    beside = way[(way[:, 0] - 1.6).abs() < 0.2]
    assert len(beside)
    assert float(beside[:, 1].abs().min()) > 0.3


def test_it_is_ready_before_a_car_depends_on_it():
    control = GoalControl(RIG, DT, GoalParams(to=(3.0, 0.0), reactive=SMALL))
    control.warm_up()
    assert kernel("find_way").run is kernel("find_way").dispatcher


def test_what_cannot_be_asked_for_is_said():
    with pytest.raises(InputError, match="controller goal"):
        NavigatorOptions(to="1,2").navigator(RIG, 30.0)
    for to in ("1", "a,b", "1,2,3", "nan,1"):
        with pytest.raises(InputError, match="X,Y"):
            NavigatorOptions("goal", to=to)
    with pytest.raises(InputError, match="cruise"):
        NavigatorOptions(cruise=2.0)


@pytest.mark.parametrize("name", ["ranging", "published", "goal"])
def test_no_controller_is_told_to_go_faster_than_its_cruise_speed(name):
    params = NavigatorOptions(name, cruise=0.25).make(RIG, DT).params
    assert params.speed == 0.25
    reactive = getattr(params, "reactive", params)
    for key in ("tight_speed", "reverse_speed", "slow", "creep"):
        assert getattr(params, key, 0) <= 0.25
        assert getattr(reactive, key, 0) <= 0.25


class Shifted(torch.nn.Module):
    """Stands in for a localiser: the car is a metre farther ahead than dead reckoning says, and ever more."""

    def due(self, state):
        return False

    def forward(self, rows, reckoned, state=None):
        still = torch.zeros((), dtype=torch.float64)
        age = still if state is None else state.age + 1
        pose = Pose(reckoned.x.double() + 1 + 0.1 * age, reckoned.y.double(), reckoned.heading.double())
        return LocaliserState(still, pose, reckoned, *[still] * 6, age, still)


def test_the_navigator_tells_it_where_it_is_at_every_frame():
    pytest.importorskip("numba")
    params = GoalParams(to=(3.0, 0.0), reactive=SMALL)
    navigator = Navigator(RIG, DT, controller="goal", params=params, localiser=Shifted())
    eyes = torch.zeros(3, 1, 480, 640, dtype=torch.uint8)
    command, state = navigator(eyes, eyes)
    assert state.control.frame.tolist() == pytest.approx([-1.2, 0.0, 0.0])
    assert float(state.place.x) == pytest.approx(float(state.pose.x) + 1.2)
    one = None
    for t in range(3):
        single, one = navigator(eyes[t : t + 1], eyes[t : t + 1], one)
        assert float(single.speed) == float(command.speed[t])
    assert torch.equal(one.control.frame, state.control.frame)


def test_it_does_not_begin_with_something_near_and_says_so():
    control = GoalControl(RIG, DT, GoalParams(to=(3.0, 0.0), reactive=SMALL))
    here, still = place(0.0, 0.0, 0.0), Command(torch.tensor(0.0), torch.tensor(0.0))
    across = Near(np.full(9, 0.4, np.float32), np.linspace(-0.3, 0.3, 9, dtype=np.float32))
    nobody = Near(np.zeros(0, np.float32), np.zeros(0, np.float32))
    state, command = control.start(floor(), here), still
    for _ in range(8):
        state = control.told_near(state, here, nobody, across, False)
        command, state = control.step(floor(moves=False), nothing(), here, still, state)
    assert float(command.speed) == 0
    assert int(control.mode(state)) == STOPPED
    assert "it cannot begin" in control.trouble(state)
    for _ in range(8):
        state = control.told_near(state, here, nobody, across, True)
        command, state = control.step(floor(moves=False), nothing(), here, still, state)
    assert float(command.speed) > 0


def test_the_speed_towards_the_next_place_falls_as_it_is_neared():
    from ndtorch.navigation.controllers.goal.speeds import speed_towards

    way = np.array([[0.0, 0.0, 0.0, 0.0, 1.0, 0.5], [0.3, 0.4, 0.0, 0.0, 1.0, 0.2], [0.3, 1.0, 0.0, 0.0, 1.0, 0.4]])
    for x, y in ((0.0, 0.4), (0.3, 0.39), (0.2, 0.2)):
        length = np.hypot(0.3 - x, 0.4 - y)
        wanted = min(0.5, np.sqrt(0.2**2 + 2 * 0.1 * length))
        assert speed_towards(way, 0, (x, y, 9.0), 0.1) == pytest.approx(wanted)
    # It stands where it changes its direction, and at the end of all its speed is the last one's.
    turned = way.copy()
    turned[2, 4] = -1.0
    assert speed_towards(turned, 0, (0.3, 0.39, 0.0), 0.1) == pytest.approx(0.08)
    assert speed_towards(way, 2, (0.3, 0.9, 0.0), 0.1) == pytest.approx(0.2)


def on_the_way():
    """A controller that drives straight ahead, to a place 3 m away."""
    control = GoalControl(RIG, DT, GoalParams(to=(3.0, 0.0), reactive=SMALL))
    pose, state, _ = drive(control, 20, place(0.0, 0.0, 0.0))
    reaction = Command(torch.tensor(-0.1), torch.tensor(1.5))
    return control, pose, state, reaction


def test_a_way_that_is_refused_for_a_second_is_left_to_the_reactive_controller_for_a_second():
    control, pose, state, reaction = on_the_way()
    room = torch.zeros(2, len(control.reactive.arcs.curvature))
    second = round(1 / DT)
    for refused in range(1, second):
        command, state = control.drive_one(room, pose, reaction, state, False)
        assert (float(command.speed), int(state.vetoed), int(state.lost)) == (0.0, refused, 0)
        assert int(state.due) == 0  # another way is looked for at once
        assert int(control.mode(state)) == CRUISE
    _, state = control.drive_one(room, pose, reaction, state, False)
    assert (int(state.vetoed), int(state.lost)) == (0, second)
    for left in reversed(range(second)):
        command, state = control.drive_one(room, pose, reaction, state, False)
        assert (command, int(state.lost)) == (reaction, left)
    command, state = control.drive_one(room + 2.0, pose, reaction, state, False)
    assert float(command.speed) > 0.3
    assert (int(state.vetoed), int(state.lost)) == (0, 0)


def test_refusals_that_are_apart_are_not_added_up():
    control, pose, state, reaction = on_the_way()
    room = torch.zeros(2, len(control.reactive.arcs.curvature))
    for free in (0.0, 0.0, 2.0, 0.0):
        _, state = control.drive_one(room + free, pose, reaction, state, False)
    assert int(state.vetoed) == 1


def test_speed_is_what_can_be_braked_from_in_the_room_there_is():
    """v^2 = 2 a (s - lag), where the way itself allows more; nothing where that is less than 0.1 m/s."""
    control, pose, state, reaction = on_the_way()
    p, arcs = control.params, len(control.reactive.arcs.curvature)
    for room in (0.125, 0.12, p.lag + 0.0034, p.lag + 0.0033, p.lag, 0.05):
        command, _ = control.drive_one(torch.full((2, arcs), room), pose, reaction, state, False)
        safe = (2 * p.braking * max(0.0, room - p.lag)) ** 0.5
        assert float(command.speed) == pytest.approx(safe if safe >= 0.1 else 0.0, rel=1e-4)


def test_a_line_of_sight_was_free_from_the_camera_to_just_before_what_is_seen():
    control = GoalControl(RIG, DT, GoalParams(to=(3.0, 0.0), reactive=SMALL))
    x, y = torch.tensor([RIG.forward + 2.0, RIG.forward + 0.3]), torch.tensor([0.5, 0.0])
    seen = Ranges(x, x * 0, x * 0, x, y, torch.tensor([True, True]))
    places, taken = control.rays(seen)
    lines = places.view(2, 2, -1)
    share = torch.linspace(0.15, 0.88, lines.shape[-1])
    torch.testing.assert_close(lines[0, 0], RIG.forward + 2.0 * share)
    torch.testing.assert_close(lines[1, 0], 0.5 * share)
    torch.testing.assert_close(lines[0, 1], RIG.forward + 0.3 * share)
    # Places that are apart by more than a cell take all of `miss`, the others together as much for each cell.
    taken = taken.view(2, -1)
    assert taken[0].tolist() == pytest.approx([-control.params.miss] * lines.shape[-1])
    apart = 0.3 * float(share[1] - share[0]) / SMALL.patch.cell
    assert taken[1].tolist() == pytest.approx([-control.params.miss * apart] * lines.shape[-1])
    assert not control.rays(seen._replace(valid=torch.tensor([False, False])))[1].any()


@pytest.mark.parametrize(
    ("clear", "share"), [(0.6, 1.0), (0.45, 1.0), (0.345, 0.5), (0.24 + 0.021, 0.1), (0.24, 0.0), (0.1, 0.0)]
)
def test_speed_falls_with_the_room_beside_the_way(clear, share):
    """From the cruise speed where there is `soft` around the discs to `slow` where they just fit."""
    from ndtorch.navigation.controllers.goal.memory import Surroundings
    from ndtorch.navigation.controllers.goal.planning import Planned
    from ndtorch.navigation.controllers.goal.speeds import allowed_speeds

    params, blocked = GoalParams(), np.zeros((40, 40), bool)
    around = Surroundings(blocked, ~blocked, -1.0, -1.0, 0.05)
    way = np.array([[0.0, 0.0, 0.0, 0.0, 1.0], [0.2, 0.0, 0.0, 0.0, 1.0]], np.float32)
    room, seen = np.full((40, 40), clear, np.float32), np.zeros((40, 40), np.float32)
    speeds = allowed_speeds(way, around, Planned(way, 1.0, room, seen, seen), params)
    wanted = params.slow + (params.speed - params.slow) * share
    assert speeds.tolist() == pytest.approx([wanted] * 2, abs=1e-5)
    # Into what was not seen it creeps, and backwards it is no faster than its other half.
    unseen = allowed_speeds(way, around, Planned(way, 1.0, room, seen + 1, seen), params)
    assert unseen.tolist() == pytest.approx([min(wanted, params.creep)] * 2, abs=1e-5)
    back = way * np.array([-1.0, 1.0, 1.0, 1.0, -1.0], np.float32)
    reverse = allowed_speeds(back, around, Planned(back, 1.0, room, seen, seen), params)
    assert reverse.tolist() == pytest.approx([min(wanted, params.reactive.reverse_speed)] * 2, abs=1e-5)
