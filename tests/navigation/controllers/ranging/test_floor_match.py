"""What both eyes see of the floor: it goes on behind a line, and ends at a wall."""

import numpy as np
import pytest

from ndtorch.navigation.controllers.ranging.control import RangingControl
from ndtorch.navigation.stereo.strips import as_frames
from tests.navigation.controllers.ranging.test_floor import BANDS, BLOCKS, DT, RIG, VIEW, learned, outputs
from tests.navigation.controllers.ranging.test_floor import step as floor_step
from tests.navigation.proximity.test_check import pair

DEPTH = VIEW.depth.numpy()


def both_eyes(frames):
    """What both see in every cell, `[2, bands, blocks]`."""
    cells, _ = RangingControl(RIG, DT).see(as_frames(*(eye[0] for eye in frames)))
    return cells[2:]


def test_floor_is_one_and_only_the_outermost_blocks_are_seen_by_one_eye():
    seen = both_eyes(pair(3.0))
    assert (seen[..., 0] == -1).all()
    assert (seen[..., 3:] >= 0).all()
    # The left camera is 0.3 m to the left: of block 1 the right one sees what is far.
    assert (seen[:, 0, 1] == -1).all()
    assert (seen[:, -1, 1] == 1).all()
    assert float((seen[seen >= 0] == 1).mean()) > 0.97


@pytest.mark.parametrize("wall", [0.8, 1.0, 1.2])
def test_a_wall_is_not(wall):
    seen = both_eyes(pair(wall))
    before, behind = wall - 0.1 > DEPTH, wall + 0.06 < DEPTH
    judged = seen >= 0
    assert float((seen[:, before] == 1).sum() / judged[:, before].sum()) > 0.95
    assert float((seen[:, behind] == 1).sum() / judged[:, behind].sum()) < 0.06
    # A painted wall is none either, and a blank one cannot be told from anything.
    assert float((both_eyes(pair(wall, paint=0.0))[:, behind] == 1).sum()) == 0


def step(motion, both):
    return floor_step(np.concatenate((motion, both)), learned(0.2))


def moving_floor():
    return outputs(level=0.2)


def test_a_line_is_no_end_where_floor_goes_on_behind_it():
    motion, both = moving_floor(), np.ones((2, BANDS, BLOCKS))
    motion[:, 6] *= 5
    both[:, :, 0] = -1
    seen, after = step(motion, both)
    assert seen.ends.sum() == 0
    assert (seen.free[:, :, 1:] == 1).all()
    # What only one eye sees is passed over where that eye takes a line for an end, but not called free.
    assert (seen.free[:, 6, 0] == 0).all()
    assert (seen.free[:, 7:, 0] == 1).all()
    assert float(after.level[6]) == pytest.approx(0.2)  # the line does not teach what floor looks like


def test_what_stands_and_moves_like_floor_ends_it():
    """A pole straight ahead hides all floor behind it; a patch that looks odd does not."""
    motion, both = moving_floor(), np.ones((2, BANDS, BLOCKS))
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
