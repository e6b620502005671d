"""The goal controller: what it is asked to do, and that its state is all it has."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.kernels.load import kernel
from ndtorch.navigation import (
    ARRIVED,
    CRUISE,
    STOPPED,
    SUPPRESSED,
    TURN,
    Command,
    Navigator,
    NavigatorOptions,
    Pose,
    StereoRig,
)
from ndtorch.navigation.controllers.contract import Task
from ndtorch.navigation.controllers.goal import GoalControl, GoalParams
from ndtorch.navigation.controllers.goal.errands import EXPLORE, TO
from ndtorch.navigation.controllers.goal.params import reactive_params
from ndtorch.navigation.controllers.goal.state import LONGEST
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


def test_it_goes_to_a_place_farther_away_than_it_remembers():
    """The memory is a square around the car that comes along: 1.6 m to each side here."""
    near = replace(SMALL, patch=PatchParams(cell=0.05, size=64))
    control = GoalControl(RIG, DT, GoalParams(to=(4.5, 0.0), reactive=near))
    state, pose = None, place(0.0, 0.0, 0.0)
    for _ in range(90):
        pose, state, _ = drive(control, 10, pose, state)
        if int(control.mode(state)) == ARRIVED:
            break
    assert int(control.mode(state)) == ARRIVED
    assert float(torch.hypot(pose.x - 4.5, pose.y)) < 0.35


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
        others = dict.fromkeys(LocaliserState._fields[3:13], still) | {"age": age}
        return LocaliserState(still, pose, reckoned, **others)


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


def test_it_begins_knowing_nothing_and_about_its_first_errand():
    pose = place(1.0, 2.0, 0.5)
    for params, errand, cells in ((GoalParams(to=(3.0, 0.0)), TO, 0), (GoalParams(), EXPLORE, 512 * 512)):
        state = GoalControl(RIG, DT, params).start(floor(), pose)
        values = {name: part.tolist() for name, part in state._asdict().items() if isinstance(part, torch.Tensor)}
        assert values.pop("home") == [1.0, 2.0]
        assert values.pop("frame") == [0.0, 0.0, 0.0]
        assert values.pop("way") == [[0.0] * 6] * LONGEST
        given = {"errand": errand, "direction": 1, "best": math.inf, "mode": SUPPRESSED}
        assert values == dict.fromkeys(values, 0) | given
        assert state.visited.evidence.shape == (cells,)
        assert not state.visited.evidence.any()


def test_where_the_way_has_ended_it_stands_and_lets_the_other_drive_after_a_while():
    control, pose, state, reaction = on_the_way()
    room = torch.full((2, len(control.reactive.arcs.curvature)), 2.0)
    ended = state._replace(at=state.places, due=torch.tensor(5.0))
    for count in range(2 * control.every):
        command, after = control.drive_one(room, pose, reaction, ended._replace(vetoed=torch.tensor(count)), False)
        assert (float(command.speed), float(command.curvature)) == (0.0, 0.0)
        assert (int(after.due), int(after.vetoed), int(after.lost), int(control.mode(after))) == (0, count + 1, 0, TURN)
    _, after = control.drive_one(room, pose, reaction, ended._replace(vetoed=torch.tensor(2 * control.every)), False)
    assert (int(after.vetoed), float(after.lost)) == (0, pytest.approx(1 / DT))


def test_exploring_counts_how_long_it_tries_and_how_long_it_finds_nothing():
    control = GoalControl(RIG, DT, GoalParams(explore=True, reactive=SMALL))
    pose, state, _ = drive(control, 20, place(0.0, 0.0, 0.0))
    room = torch.full((2, len(control.reactive.arcs.curvature)), 2.0)
    reaction = Command(torch.tensor(-0.1), torch.tensor(1.5))
    found = state._replace(cost=torch.tensor(1.0), due=torch.tensor(5.0), tried=torch.tensor(3.0), lost=state.lost * 0)
    nothing = found._replace(cost=torch.tensor(math.inf), fruitless=torch.tensor(2.0))
    _, after = control.drive_one(room, pose, reaction, found._replace(fruitless=torch.tensor(2.0)), False)
    assert (float(after.tried), float(after.fruitless), float(after.lost)) == (pytest.approx(3 + DT), 0.0, 0.0)
    command, after = control.drive_one(room, pose, reaction, nothing, False)
    assert command == reaction
    assert (float(after.fruitless), float(after.lost)) == pytest.approx((2 + DT, 1 / DT - 1))
    # The time for which the other drives is not begun anew at every step.
    _, after = control.drive_one(room, pose, reaction, nothing._replace(lost=torch.tensor(4.0)), False)
    assert (float(after.fruitless), float(after.lost)) == pytest.approx((2 + DT, 3.0))


def test_while_it_looks_for_itself_the_other_drives_and_nothing_is_planned():
    control, pose, state, reaction = on_the_way()
    room = torch.full((2, len(control.reactive.arcs.curvature)), 2.0)
    state = state._replace(told=torch.tensor(-1.0), due=torch.tensor(5.0), tried=torch.tensor(1.0))
    state = state._replace(reactive=state.reactive._replace(mode=torch.tensor(float(TURN))))
    command, after = control.drive_one(room, pose, reaction, state, False)
    assert command == reaction
    assert (float(after.due), int(control.mode(after)), float(after.tried)) == (0.0, TURN, 1.0)
    # While it learns the floor nothing else is counted either.
    assert control.drive_one(room, pose, reaction, state, True) == (reaction, state)


@pytest.mark.parametrize("asked", [STOPPED, CRUISE])
@pytest.mark.parametrize("drives", [STOPPED, CRUISE])
@pytest.mark.parametrize("mode", [ARRIVED, CRUISE])
def test_it_stands_where_caution_stops_the_other_unless_it_has_arrived(monkeypatch, asked, drives, mode):
    control, pose, state, reaction = on_the_way()
    still = Command(torch.tensor(0.0), torch.tensor(0.0))
    state = state._replace(mode=torch.tensor(float(mode)))
    state = state._replace(reactive=state.reactive._replace(mode=torch.tensor(float(drives))))
    careful = state.reactive._replace(mode=torch.tensor(float(asked)))
    monkeypatch.setattr(control.reactive, "caution", lambda *_: (still, careful))
    command, after = control.caution(reaction, state, pose)
    assert (command, after.reactive) == (still, careful)
    stops = asked == STOPPED and drives != STOPPED and mode != ARRIVED
    assert int(control.mode(after)) == (STOPPED if stops else mode)


def test_room_is_that_of_the_longer_of_the_two_arcs_beside_what_is_wanted():
    control = on_the_way()[0]
    arcs = control.reactive.arcs
    lengths = torch.stack((torch.tensor([0.7, 0.3, 0.9, 0.2, 0.6, 0.4, 0.8, 0.5]), torch.zeros(8)))
    for direction in (1.0, -1.0):
        own = (arcs.forward == direction).nonzero().flatten()
        for curvature in (-3.0, -1.3, -0.4, 0.1, 0.9, 1.7):
            near = own[(arcs.curvature[own] - curvature).abs().argsort()[:2]]
            assert control.free_ahead(lengths, direction, curvature) == float(lengths[0, near].max())


def test_the_places_around_the_car_count_as_visited_and_those_before_stay():
    control = GoalControl(RIG, DT, GoalParams(explore=True, reactive=SMALL))
    p, pose = control.params, place(0.0, 0.0, 0.0)
    once = control.visit(control.start(floor(), pose).visited, pose)
    assert float(once.evidence.sum()) == control.disc.shape[1]
    assert float(once.evidence.sum()) * p.places.cell**2 == pytest.approx(math.pi * p.passed**2, rel=0.05)
    assert torch.equal(control.visit(once, pose).evidence, once.evidence)
    both = control.visit(once, place(3.0, 0.0, 0.0))
    assert float(both.evidence.sum()) == 2 * control.disc.shape[1]


def test_a_task_sets_the_speeds_and_leaves_the_rest():
    usual = GoalParams()
    asked = GoalControl.params_for(Task(to=(1.0, 2.0), explore=True, back=True, cruise=0.5))
    assert asked == replace(usual, to=(1.0, 2.0), explore=True, back=True, reactive=asked.reactive)
    assert asked.reactive == usual.reactive
    slow = GoalControl.params_for(Task(cruise=0.2))
    assert (slow.to, slow.explore, slow.back) == (None, False, False)
    assert (slow.speed, slow.slow, slow.creep) == (0.2, 0.2, 0.2)
    r = slow.reactive
    assert (r.speed, r.tight_speed, r.reverse_speed) == pytest.approx((0.2, 0.16, 0.2))
    assert replace(r, speed=0.5, tight_speed=usual.reactive.tight_speed, reverse_speed=0.3) == usual.reactive
    assert not r.overhangs


def test_the_speed_before_what_is_slow_is_what_can_be_braked_from():
    """v^2 = v'^2 + 2 a s from place to place, and standing where the direction changes."""
    from ndtorch.navigation.controllers.goal.memory import Surroundings
    from ndtorch.navigation.controllers.goal.planning import Planned
    from ndtorch.navigation.controllers.goal.speeds import allowed_speeds

    params, blocked = GoalParams(braking=0.1), np.zeros((60, 60), bool)
    around = Surroundings(blocked, ~blocked, -1.0, -1.0, 0.05)
    x = [0.0, 0.2, 0.5, 0.6, 0.7]
    way = np.array([[v, 0.0, 0.0, 0.0, 1.0] for v in x], np.float32)
    seen = np.zeros((60, 60), np.float32)
    unseen = seen.copy()
    unseen[:, round((0.65 + 0.3 + 1) / 0.05) :] = 1  # what the bumper comes over at the last place
    speeds = allowed_speeds(way, around, Planned(way, 1.0, seen + 9, unseen, seen), params)
    wanted = [math.sqrt(params.creep**2 + 2 * 0.1 * (0.7 - v)) for v in x]
    assert speeds.tolist() == pytest.approx(wanted, abs=1e-5)
    assert wanted[0] < params.speed
    way[3:, 4] = -1.0
    speeds = allowed_speeds(way, around, Planned(way, 1.0, seen + 9, seen, seen), params)
    back = params.reactive.reverse_speed
    begun = [math.sqrt(0.2 * 0.5), math.sqrt(0.2 * 0.3), math.sqrt(back**2 + 0.2 * 0.1), back, back]
    assert speeds.tolist() == pytest.approx(begun, abs=1e-5)
