"""What both eyes see of the floor: it goes on behind a line, and ends at a wall."""

import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import StereoRig
from ndtorch.navigation.controllers.contract import Command
from ndtorch.navigation.controllers.ranging.control import RangingControl
from ndtorch.navigation.controllers.ranging.floor import FloorState, floor_constants, floor_step
from ndtorch.navigation.controllers.ranging.floor_motion import FloorMotion
from ndtorch.navigation.controllers.ranging.floor_view import FloorParams, floor_view
from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.ranging import Ranges
from tests.navigation.proximity.test_check import pair

RIG, DT, PARAMS = StereoRig(forward=0.15), 1 / 30, FloorParams()
VIEW = floor_view(RIG, PARAMS)
CONSTANTS = floor_constants(RIG, PARAMS, VIEW, DT)
BANDS, BLOCKS = PARAMS.bands, PARAMS.blocks


def both_eyes(frames):
    """What both see in every cell, `[2, bands, blocks]`, by torch."""
    with torch.no_grad():
        cells, _ = FloorMotion(RIG, DT)(*frames)
    return cells[0, 2:]


def test_floor_is_one_and_only_the_outermost_blocks_are_seen_by_one_eye():
    seen = both_eyes(pair(3.0))
    assert (seen[..., 0] == -1).all()
    assert (seen[..., 3:] >= 0).all()
    # The left camera is 0.3 m to the left: of block 1 the right one sees what is far.
    assert (seen[:, 0, 1] == -1).all()
    assert (seen[:, -1, 1] == 1).all()
    assert float((seen[seen >= 0] == 1).float().mean()) > 0.97


@pytest.mark.parametrize("wall", [0.8, 1.0, 1.2])
def test_a_wall_is_not(wall):
    seen = both_eyes(pair(wall))
    before, behind = VIEW.depth < wall - 0.1, VIEW.depth > wall + 0.06
    judged = seen >= 0
    assert float((seen[:, before] == 1).float().sum() / judged[:, before].sum()) > 0.95
    assert float((seen[:, behind] == 1).float().sum() / judged[:, behind].sum()) < 0.06
    # A painted wall is none either, and a blank one cannot be told from anything.
    assert float((both_eyes(pair(wall, paint=0.0))[:, behind] == 1).float().sum()) == 0


def test_without_texture_nothing_is_one():
    assert (both_eyes(pair(3.0, floor=0.0)) != 1).all()


def test_a_line_across_the_floor_hides_nothing():
    frames = [frame.clone() for frame in pair(3.0)]
    row = 239 + round(430 * 0.2 / 1.0)
    for frame in frames:
        frame[..., row - 2 : row + 3, :] //= 3
    seen = both_eyes(frames)
    assert float((seen[seen >= 0] == 1).float().mean()) > 0.97


def test_the_kernel_finds_the_same():
    pytest.importorskip("numba")
    for frames in (pair(3.0), pair(1.0), pair(0.9, paint=0.0)):
        with torch.inference_mode():
            cells, _ = FloorMotion(RIG, DT)(*frames)
        assert torch.equal(cells[0, 2:], both_eyes(frames))


def step(motion, both):
    state = FloorState(torch.full((BANDS,), 0.2), torch.tensor(0.0), torch.tensor(100.0))
    return floor_step(torch.cat((motion, both)), torch.tensor(0.5), torch.tensor(0.0), state, CONSTANTS)


def moving_floor():
    flow = VIEW.sweep * DT * 0.5
    return (0.2 * (1 - torch.exp(-flow / 1.2)))[:, None].expand(2, BANDS, BLOCKS).clone()


def test_a_line_is_no_end_where_floor_goes_on_behind_it():
    motion, both = moving_floor(), torch.ones(2, BANDS, BLOCKS)
    motion[:, 6] *= 5
    both[:, :, 0] = -1
    seen, after = step(motion, both)
    assert seen.ends.sum() == 0
    assert (seen.free[:, :, 1:] == 1).all()
    # What only one eye sees is passed over where that eye takes a line for an end, but not called free.
    assert (seen.free[:, 6, 0] == 0).all()
    assert (seen.free[:, 7:, 0] == 1).all()
    assert float(after.level[6]) == pytest.approx(0.2)  # the line does not teach what floor looks like


def test_what_both_eyes_do_not_see_as_floor_ends_it():
    motion, both = moving_floor(), torch.ones(2, BANDS, BLOCKS)
    motion[:, 6:] *= 5
    both[:, 6:] = 0
    seen, _ = step(motion, both)
    assert (seen.ends[:, 6] == 1).all()
    assert seen.ends.sum() == 2 * BLOCKS
    # One eye alone is believed as long as it is not mistaken elsewhere.
    both[:, :, :] = -1
    assert (step(motion, both)[0].ends[:, 6] == 1).all()


def test_what_stands_and_moves_like_floor_ends_it():
    """A pole straight ahead hides all floor behind it; a patch that looks odd does not."""
    motion, both = moving_floor(), torch.ones(2, BANDS, BLOCKS)
    both[0, 6:, 5] = 0
    both[0, 6:8, 4] = 0
    both[1, -2:, 5] = 0
    seen, _ = step(motion, both)
    assert seen.ends[0, 6, 5] == 1
    assert (seen.free[0, :6, 5] == 1).all()
    assert (seen.free[0, 6:, 5] == 0).all()
    # Floor is seen behind it; too little of it is seen yet.
    assert seen.ends.sum() == 1
    # What one eye sees stays as it is.
    both[0, :, 5] = -1
    assert step(motion, both)[0].ends.sum() == 0


def test_eyes_that_agree_on_hardly_any_floor_are_not_believed_about_that():
    """As those of a pair whose pitch or baseline is not what it should be: all of their floor would stand."""
    motion, both = moving_floor(), torch.zeros(2, BANDS, BLOCKS)
    assert step(motion, both)[0].ends.sum() == 0
    both[:, :2] = 1
    assert step(motion, both)[0].ends.sum() == 0
    both[:, : BANDS // 4 + 1] = 1
    assert step(motion, both)[0].ends.sum() > 0


def test_what_one_eye_sees_beside_an_end_is_not_called_free():
    motion, both = moving_floor(), torch.ones(2, BANDS, BLOCKS)
    both[:, :, :3] = -1
    both[0, 6:, 3] = 0
    seen, _ = step(motion, both)
    assert seen.ends[0, 6, 3] == seen.ends.sum() == 1
    assert (seen.free[0, :6, 2] == 1).all()
    assert (seen.free[0, 6:, 2] == 0).all()
    assert (seen.free[0, :, :2] == 1).all()
    assert (seen.free[0, :, 4:] == 1).all()


def test_the_kernel_judges_cells_alike():
    pytest.importorskip("numba")
    control = RangingControl(RIG, DT)
    pose, no_ranges = Pose(*torch.zeros(3)), Ranges(*torch.zeros(5, 1), torch.zeros(1, dtype=torch.bool))
    chance = torch.Generator().manual_seed(5)
    for n in range(20):
        motion = moving_floor() * torch.where(torch.rand(2, BANDS, BLOCKS, generator=chance) < 0.95, 1.0, 5.0)
        both = torch.ones(2, BANDS, BLOCKS)
        foot = torch.randint(0, BANDS + 3, (2, 1, BLOCKS), generator=chance)
        both[torch.arange(BANDS).view(1, -1, 1) >= foot] = 0
        both[torch.rand(2, BANDS, BLOCKS, generator=chance) < 0.1] = 0
        both[torch.rand(2, BANDS, BLOCKS, generator=chance) < 0.1] = -1
        both[torch.rand(2, BANDS, BLOCKS, generator=chance) < (0.7 if n % 4 == 0 else 0.0)] = 0
        both[:, :, 0] = -1
        cells = torch.cat((motion, both))
        state = control.start(cells, pose)
        state = state._replace(floor=FloorState(torch.full((BANDS,), 0.2), torch.tensor(0.0), torch.tensor(100.0)))
        driven = Command(torch.tensor(0.5), torch.tensor(0.0))
        _, slow = control.steer(cells, no_ranges, pose, driven, state)
        with torch.inference_mode():
            _, quick = control.steer(cells, no_ranges, pose, driven, state)
        torch.testing.assert_close(quick.floor.level, slow.floor.level)
        torch.testing.assert_close(quick.patch.evidence, slow.patch.evidence)


def test_bad_numbers():
    with pytest.raises(InputError, match="alike"):
        FloorParams(alike=1.0)
    with pytest.raises(InputError, match="standing"):
        FloorParams(standing=0)
