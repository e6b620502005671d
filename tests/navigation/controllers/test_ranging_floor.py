"""Cells of floor: where they look, what they learn, and what they take for the end of the floor."""

from typing import NamedTuple

import numpy as np
import pytest
import torch

from ndtorch.navigation import CRUISE, REVERSE, TURN, Pose, RangingParams, Rect, StereoRig
from ndtorch.navigation.controllers.ranging._kernels import FloorState, floor_step, illumination_gain
from ndtorch.navigation.controllers.ranging.control import RangingControl
from ndtorch.navigation.controllers.ranging.floor import BANDS, BLOCKS, floor_view
from ndtorch.navigation.proximity import NOWHERE
from ndtorch.navigation.stereo.strips import as_frames
from ndtorch.vision.nondirectional import NDMin
from tests.navigation.test_proximity import pair

DT = 1 / 30
RIG = StereoRig(forward=0.15)
VIEW = floor_view(RIG)
TABLES = RangingControl(RIG, DT).tables
LEVEL = 0.18


class Seen(NamedTuple):
    """Cells `[2, BANDS, BLOCKS]` that were seen free, and at which the floor ends."""

    free: np.ndarray
    ends: np.ndarray


def outputs(speed=0.5, curvature=0.0, level=LEVEL):
    """What floor gives in every cell, by the formula: image speed in pixels a step, then saturation."""
    down = 430 * 0.2 / VIEW.depth**2 * speed * DT
    flow = np.hypot(down, 430 * speed * curvature * DT)
    return np.tile((level * (1 - np.exp(-flow / 1.2)))[:, None], (2, 1, BLOCKS)).astype(np.float32)


def step(cells, state, speed=0.5, curvature=0.0):
    """What is seen in cells `[2, BANDS, BLOCKS]`, or with what both cameras see `[4, BANDS, BLOCKS]`."""
    marks, cells = np.empty((2, BANDS, BLOCKS), np.float32), np.asarray(cells, np.float32)
    cells = cells if len(cells) == 4 else np.concatenate((cells, np.full_like(cells, -1)))
    after = floor_step(cells, (speed, curvature), state, TABLES, marks)
    assert set(np.unique(marks)) <= {-0.5, 0.0, 1.0}
    return Seen(marks < 0, marks > 0), after


def learned(level=LEVEL, noise=0.0):
    return FloorState(np.full(BANDS, level, np.float32), noise, 100)


def test_the_cells_lie_where_their_pixels_see_the_floor():
    assert VIEW.rects == (Rect(302, 372, 80, 640), Rect(302, 372, 0, 560))
    # The middle of the nearest band is row 369, 129.5 pixels below the middle of the image: 86 / 129.5 m.
    assert float(VIEW.depth[0]) == pytest.approx(86 / 129.5, rel=1e-6)
    assert float(VIEW.depth[-1]) == pytest.approx(86 / 64.5, rel=1e-6)
    # The outermost block of the left image is centered at column 99.5, 220 pixels to the left of the middle.
    assert float(VIEW.x[0, 0, 0]) == pytest.approx(0.15 + 86 / 129.5, rel=1e-6)
    assert float(VIEW.y[0, 0, 0]) == pytest.approx(0.15 + 86 / 129.5 * 220 / 430, rel=1e-5)
    assert np.array_equal(VIEW.y[1], -VIEW.y[0])
    # Both subfields see the floor ahead of the car.
    assert float(VIEW.y[0].min()) < -0.03


def test_motion_of_the_cells_against_its_definition():
    generator = torch.Generator().manual_seed(1)
    left, right = torch.rand(2, 3, 3, 480, 640, generator=generator)
    control, state, cells = RangingControl(RIG, DT), None, []
    for eyes in zip(left, right, strict=True):
        seen, _, state = control.see(as_frames(*eyes), state)
        cells.append(seen)
    cells = np.stack(cells)
    assert cells.shape == (3, 4, BANDS, BLOCKS)
    assert (cells[0, :2] == 0).all()
    for image, rect, k in ((left, Rect(302, 372, 80, 400), 0), (right, Rect(302, 372, 240, 560), 1)):
        motion, _ = NDMin(0.005, DT)(image.mean(-3, keepdim=True))
        for band, block in ((0, 0), (3, 5), (13, 7)):
            column = rect.left + 40 * block if k == 0 else rect.right - 40 * (block + 1)
            rows = slice(rect.bottom - 5 * (band + 1), rect.bottom - 5 * band)
            # Every second column of the subfield is read.
            pixels = motion[:, 0, rows, column : column + 40 : 2]
            wanted = 20 * pixels.abs().amax((-2, -1))
            # Light that all cells share is taken out: random frames have next to none.
            assert cells[:, k, band, block] == pytest.approx(wanted.numpy(), rel=0.02)


@pytest.mark.parametrize("speed", [0.5, -0.3])
@pytest.mark.parametrize("curvature", [0.0, 2.0])
def test_floor_is_free_at_any_speed(speed, curvature):
    seen, _ = step(outputs(abs(speed), curvature), learned(), speed, curvature)
    assert (seen.free == 1).all()
    assert (seen.ends == 0).all()


@pytest.mark.parametrize("factor", [0.0, 0.3, 4.0])
def test_a_cell_that_is_not_floor_ends_its_block(factor):
    cells = outputs()
    cells[0, 5, 2] *= factor
    seen, _ = step(cells, learned())
    assert np.argwhere(seen.ends).tolist() == [[0, 5, 2]]
    assert seen.free[0, :, 2].tolist() == [True] * 5 + [False] * 9
    assert seen.free.sum() == 2 * BANDS * BLOCKS - 9


@pytest.mark.parametrize("level", [0.05, 0.4])
def test_learns_its_floor_at_the_start(level):
    """A blank wall fills the right quarter of the view meanwhile."""
    state = FloorState(np.zeros(BANDS, np.float32), 0.0, 0)
    for n in range(15):
        speed = 0.0 if n < 3 else 0.5
        cells = outputs(speed, level=level)
        cells[1, :, :4] = 0.0
        seen, state = step(cells, state, speed)
        assert not (seen.free | seen.ends).any()
    assert float(state.level[0]) == pytest.approx(level, rel=0.2)
    seen, _ = step(outputs(level=level), state)
    assert (seen.free == 1).all()


DEPTH = VIEW.depth


def both_eyes(frames):
    """What both see in every cell, `[2, bands, blocks]`."""
    cells, _, _ = RangingControl(RIG, DT).see(as_frames(*(eye[0] for eye in frames)))
    return cells[2:]


@pytest.mark.parametrize("wall", [0.8, 1.0, 1.2])
def test_a_wall_is_not(wall):
    seen = both_eyes(pair(wall))
    before, behind = wall - 0.1 > DEPTH, wall + 0.06 < DEPTH
    judged = seen >= 0
    assert float((seen[:, before] == 1).sum() / judged[:, before].sum()) > 0.95
    assert float((seen[:, behind] == 1).sum() / judged[:, behind].sum()) < 0.06
    # A painted wall is none either, and a blank one cannot be told from anything.
    assert float((both_eyes(pair(wall, paint=0.0))[:, behind] == 1).sum()) == 0


def match_step(motion, both):
    return step(np.concatenate((motion, both)), learned(0.2))


def moving_floor():
    return outputs(level=0.2)


def test_a_line_is_no_end_where_floor_goes_on_behind_it():
    motion, both = moving_floor(), np.ones((2, BANDS, BLOCKS))
    motion[:, 6] *= 5
    both[:, :, 0] = -1
    seen, after = match_step(motion, both)
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
    seen, _ = match_step(motion, both)
    assert seen.ends[0, 6, 5] == 1
    assert (seen.free[0, :6, 5] == 1).all()
    assert (seen.free[0, 6:, 5] == 0).all()
    # Floor is seen behind it; too little of it is seen yet.
    assert seen.ends.sum() == 1
    # What one eye sees stays as it is.
    both[0, :, 5] = -1
    assert match_step(motion, both)[0].ends.sum() == 0


CONTROL, POSE = RangingControl(RIG, DT), Pose(0.0, 0.0, 0.0)


@pytest.mark.parametrize("gain", [0.83, 0.97, 1.1, 1.9])
def test_the_gain_is_what_all_cells_share(gain):
    before = (0.3 + 0.4 * np.random.default_rng(0).random(VIEW.shape)).astype(np.float32)
    now = before * np.float32(gain)
    assert illumination_gain(now, before, BANDS, BLOCKS) == pytest.approx(gain, rel=1e-5)
    # What fills less than half of the cells does not matter.
    now[0, :, :120] = 0.9
    assert illumination_gain(now, before, BANDS, BLOCKS) == pytest.approx(gain, rel=1e-5)


def test_it_looks_for_what_is_near_in_turns_alone_every_so_often():
    def looks(control, **changes):
        state, seen = control.start(None, POSE)._replace(**changes), []
        control.look_again(state, POSE, lambda: seen.append(1) or NOWHERE)
        return len(seen)

    assert [looks(CONTROL, mode=TURN, age=age) for age in range(10)] == 2 * [0, 0, 1, 0, 0]
    assert [looks(CONTROL, mode=mode, age=2) for mode in (CRUISE, REVERSE)] == [0, 0]
    assert looks(RangingControl(RIG, DT, RangingParams(overhangs=False)), mode=TURN, age=2) == 0
