"""The ranging controller: its decisions on cells made up by a formula."""

import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import (
    CRUISE,
    REVERSE,
    SUPPRESSED,
    TURN,
    AvoidanceParams,
    Command,
    Navigator,
    Pose,
    Ranges,
    RangingParams,
    StereoRig,
)
from ndtorch.navigation.controllers.ranging.control import RangingControl
from ndtorch.navigation.controllers.ranging.floor_view import FloorParams, floor_view
from ndtorch.navigation.odometry import drive_step

DT = 1 / 30
RIG = StereoRig(forward=0.15)
VIEW = floor_view(RIG, FloorParams())
BANDS, BLOCKS = FloorParams().bands, FloorParams().blocks


def cells_of(depth, speed, curvature=0.0):
    """Outputs when the floor ends at `depth` `[2, BLOCKS]` metres ahead of the cameras, a blank wall behind."""
    down = 430 * 0.2 / VIEW.depth.square() * abs(speed) * DT
    flow = torch.hypot(down, torch.full_like(down, 430 * speed * curvature * DT))
    floor = (0.18 * (1 - torch.exp(-flow / 1.2)))[:, None].expand(2, BANDS, BLOCKS)
    return torch.where(VIEW.depth[:, None] < depth.unsqueeze(-2), floor, 0.0)


def ranges_of(places, valid):
    """Ranges of which only the places in the body frame `[..., 2, n]` matter."""
    blank = torch.zeros_like(places[..., 0, :])
    return Ranges(blank, blank, blank, places[..., 0, :], places[..., 1, :], valid)


def run(look, steps, control=None, start=(0.0, 0.0, 0.0), ranges=None):
    """Close the loop with a car that does at once what it is told; returns poses, commands and modes.

    Args:
        look: `look(pose, step)` -> depth at which the floor ends, `[2, BLOCKS]`.
        ranges: `ranges(pose)` -> places in the body frame that are ranged, `[2, n]`.
    """
    control = control or RangingControl(RIG, DT)
    pose = Pose(*map(torch.tensor, start))
    command, state = Command(torch.tensor(0.0), torch.tensor(0.0)), control.start(None, pose)
    poses, commands, modes = [], [], []
    for n in range(steps):
        cells = cells_of(look(pose, n), float(command.speed), float(command.curvature))
        places = torch.zeros(2, 1) if ranges is None else ranges(pose)
        valid = torch.full(places.shape[-1:], ranges is not None)
        command, state = control.step(cells, ranges_of(places, valid), pose, command, state)
        poses.append(torch.stack(pose))
        commands.append(torch.stack(command))
        modes.append(int(control.mode(state)))
        pose = drive_step(pose, *command, DT)
    return torch.stack(poses), torch.stack(commands), modes


def open_floor(pose, n):
    return torch.full((2, BLOCKS), 9.0)


def wall_ahead(x):
    """A wall across the way at x, seen from any pose that faces it."""

    def look(pose, n):
        eye = pose.x + 0.15 * pose.heading.cos()
        slope = (VIEW.y[:, 0] - torch.tensor([[0.15], [-0.15]])) / VIEW.depth[0]
        across = pose.heading.cos() - slope * pose.heading.sin()
        return torch.where(across > 0.05, (x - eye) / across.clamp(min=0.05), 9.0)

    return look


def test_drives_straight_over_open_floor():
    _, commands, modes = run(open_floor, 90)
    assert modes[:14] == [SUPPRESSED] * 14
    assert modes[15:] == [CRUISE] * 75
    assert (commands[:3, 0] == 0).all()  # it stands to measure the noise
    assert (commands[4:, 0] == 0.5).all()
    assert (commands[:, 1] == 0).all()


def half_hidden(side):
    """After a second the floor of one side ends 0.8 m ahead."""

    def look(pose, n):
        depth = torch.full((2, BLOCKS), 9.0)
        depth[side] = 0.8 if n > 30 else 9.0
        return depth

    return look


def test_turns_before_a_wall_and_goes_on():
    poses, _, modes = run(wall_ahead(4.0), 330)
    assert float(poses[:, 0].max()) < 4.0 - 0.3  # half the body's length and a little
    turned = modes.index(TURN)
    assert 0.8 < 4.0 - float(poses[turned, 0]) < 1.6
    assert CRUISE in modes[turned:]
    assert REVERSE not in modes
    assert abs(float(poses[-1, 2])) > 1.0


def test_reversing_retraces():
    """At the end of a corridor too narrow to turn in the car goes straight back the way it came."""
    poses, commands, modes = run(open_floor, 200, ranges=lambda pose: narrow_end(pose, 2.0))
    first = modes.index(REVERSE)
    last = next(k for k in range(first, len(modes)) if modes[k] != REVERSE)
    assert float(poses[:, 0].max()) < 2.0 - 0.3
    assert (commands[first:last, 0] < 0).all()
    assert 0.1 < float(poses[first, 0] - poses[last, 0]) < 0.6
    assert float((poses[last, 1] - poses[first, 1]).abs()) < 0.1


def narrow_end(pose, wall):
    """Ranged places of a wall across the way and of both sides of the corridor that ends there."""
    y = torch.linspace(-0.36, 0.36, 10)
    x = torch.linspace(wall - 1.2, wall, 16)
    world = torch.cat(
        [
            torch.stack((torch.full_like(y, wall), y)),
            torch.stack((x, torch.full_like(x, 0.42))),
            torch.stack((x, torch.full_like(x, -0.42))),
        ],
        -1,
    )
    dx, dy = world[0] - pose.x, world[1] - pose.y
    cos, sin = pose.heading.cos(), pose.heading.sin()
    return torch.stack((cos * dx + sin * dy, cos * dy - sin * dx))


def test_ranges_alone_turn_the_car():
    """A wall ahead and on the left side that only the rows see."""

    def posts(pose):
        y, x = torch.linspace(0.0, 0.7, 8), torch.linspace(1.0, 2.0, 8)
        world = torch.cat((torch.stack((torch.full_like(y, 2.0), y)), torch.stack((x, torch.full_like(x, 0.7)))), -1)
        dx, dy = world[0] - pose.x, world[1] - pose.y
        cos, sin = pose.heading.cos(), pose.heading.sin()
        return torch.stack((cos * dx + sin * dy, cos * dy - sin * dx))

    poses, commands, modes = run(open_floor, 120, ranges=posts)
    assert TURN in modes
    turned = modes.index(TURN)
    assert float(commands[turned, 1]) < 0
    # Nothing was seen free on that side: it backs once before, where it has been, and no farther.
    assert modes[turned - 1] == REVERSE
    assert modes[modes.index(REVERSE) - 1] == CRUISE
    assert float(poses[:, 0].min()) > -0.05


def test_a_batch_of_cars_is_each_car():
    control = RangingControl(RIG, DT)
    looks = [half_hidden(0), half_hidden(1), wall_ahead(1.6), open_floor]
    alone = [run(look, 60, control) for look in looks]
    pose = Pose(*torch.zeros(3, 2, 2))
    command, state = Command(*torch.zeros(2, 2, 2)), control.start(None, pose)
    for n in range(60):
        cells = [
            cells_of(look(Pose(*(p.flatten()[k] for p in pose)), n), *(float(c.flatten()[k]) for c in command))
            for k, look in enumerate(looks)
        ]
        cells = torch.stack(cells).view(2, 2, 2, BANDS, BLOCKS)
        nothing = ranges_of(torch.zeros(2, 2, 2, 1), torch.zeros(2, 2, 1, dtype=torch.bool))
        command, state = control.step(cells, nothing, pose, command, state)
        for k, (poses, commands, modes) in enumerate(alone):
            assert int(state.mode.flatten()[k]) == modes[n]
            torch.testing.assert_close(torch.stack([c.flatten()[k] for c in command]), commands[n])
            torch.testing.assert_close(torch.stack([p.flatten()[k] for p in pose]), poses[n], atol=1e-5, rtol=1e-5)
        pose = drive_step(pose, *command, DT)


def recorded(steps=90):
    """Cells, ranges, poses and driven commands of a drive towards a wall, `[T, ...]`."""
    poses, commands, _ = run(wall_ahead(2.0), steps)
    driven = torch.cat([torch.zeros(1, 2), commands[:-1]])
    cells = [
        cells_of(wall_ahead(2.0)(Pose(*pose), 0), float(moved[0]), float(moved[1]))
        for pose, moved in zip(poses, driven, strict=True)
    ]
    slots = torch.zeros(steps, 5)
    ranges = Ranges(slots, slots, slots, slots, slots, slots > 0)
    return torch.stack(cells), ranges, Pose(*poses.unbind(-1)), Command(*driven.unbind(-1)), commands


@pytest.mark.parametrize("size", [1, 7, 90])
def test_chunked_is_whole_is_frame_by_frame(size):
    cells, ranges, poses, driven, wanted = recorded()
    control, state, found = RangingControl(RIG, DT), None, []
    for k in range(0, 90, size):
        part = slice(k, k + size)
        command, state = control(
            cells[part], Ranges(*(r[part] for r in ranges)), Pose(*(p[part] for p in poses)),
            Command(*(d[part] for d in driven)), state,
        )  # fmt: skip
        found.append(torch.stack(command, -1))
    assert torch.equal(torch.cat(found), wanted)
    assert (wanted[:, 1] != 0).any()


def test_navigator_with_the_ranging_controller():
    """On frames: chunks agree, a batch agrees, uint8 is enough, and only the strips are read."""
    generator = torch.Generator().manual_seed(4)
    wide = (255 * torch.rand(2, 24, 3, 480, 700, generator=generator)).to(torch.uint8)
    left, right = wide[..., :640], wide[..., 60:]
    navigator = Navigator(RIG, DT, controller="ranging")
    whole, final = navigator(left, right)
    assert whole.speed.shape == (2, 24)
    assert (whole.speed[:, :3] == 0).all()
    state, commands = None, []
    for a, b in zip(left[1].split(5), right[1].split(5), strict=True):
        command, state = navigator(a, b, state)
        commands.append(torch.stack(command))
    torch.testing.assert_close(torch.cat(commands, -1), torch.stack(whole)[:, 1])
    torch.testing.assert_close(state.pose.x, final.pose.x[1])
    torch.testing.assert_close(state.control.patch.evidence, final.control.patch.evidence[1])
    assert int(navigator.mode(state)) == int(navigator.mode(final)[1])
    left, right = left[0].clone(), right[0].clone()
    for image, rect in zip((left, right), VIEW.rects, strict=True):
        outside = torch.ones(480, 640, dtype=torch.bool)
        outside[rect.top : rect.bottom, rect.left : rect.right] = False
        outside[RIG.row] = False
        image[..., outside] = 77
    spoiled, _ = navigator(left, right)
    torch.testing.assert_close(torch.stack(spoiled), torch.stack(whole)[:, 0])


def test_bad_parameters():
    with pytest.raises(InputError, match="turn_at"):
        RangingParams(turn_at=0.0)
    with pytest.raises(InputError, match="speed"):
        RangingParams(speed=float("nan"))
    with pytest.raises(InputError, match="dt"):
        RangingControl(RIG, 0.0)
    with pytest.raises(InputError, match="controller must be one of 'ranging', 'goal', 'published', got 'blind'"):
        Navigator(RIG, DT, controller="blind")
    with pytest.raises(InputError, match="params must be AvoidanceParams"):
        Navigator(RIG, DT, controller="published", params=RangingParams())
    with pytest.raises(InputError, match="params must be RangingParams"):
        Navigator(RIG, DT, params=AvoidanceParams())
    cells, ranges, poses, driven, _ = recorded(3)
    control = RangingControl(RIG, DT)
    with pytest.raises(InputError, match="seen"):
        control(cells[:2], ranges, poses, driven)
    with pytest.raises(InputError, match="ranges"):
        control(cells, Ranges(*(r[:2] for r in ranges)), poses, driven)
    with pytest.raises(InputError, match="driven"):
        control(cells, ranges, poses, Command(*(d[:2] for d in driven)))


def test_trouble_is_told_where_the_floor_shows_little():
    control = RangingControl(RIG, DT)
    pose = Pose(*map(torch.tensor, (0.0, 0.0, 0.0)))
    command, state = Command(torch.tensor(0.0), torch.tensor(0.0)), control.start(None, pose)
    for n in range(60):
        cells = cells_of(open_floor(pose, n), float(command.speed), float(command.curvature))
        command, state = control.step(
            cells, ranges_of(torch.zeros(2, 1), torch.zeros(1, dtype=bool)), pose, command, state
        )
    assert control.trouble(state) is None
    dark = state._replace(floor=state.floor._replace(level=state.floor.level * 1e-6))
    assert "floor is told from noise in 0 % of the view" in control.trouble(dark)
