"""A car drives rounds of a corridor with a wrong odometer: parts are moved until the walls are where they are."""

import math

import numpy as np
import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import Pose, StereoRig
from ndtorch.navigation.localisation import LocaliserParams
from ndtorch.navigation.localisation.anchors import anchor_of
from ndtorch.navigation.localisation.graph import carried
from ndtorch.navigation.localisation.params import PartParams
from ndtorch.navigation.localisation.parts import add_to_part, begun_at, frames_of, no_parts, redrawn
from ndtorch.navigation.localisation.walls import Scan, add_scan, empty_walls, pack
from ndtorch.navigation.odometry import arc
from tests.navigation.localisation.test_finding import Blindfold

pytest.importorskip("numba")

DT, SPEED, TURN = 0.2, 0.5, 0.9
SIDES = (7.0, 3.5)
"""The straight parts of the way, between bends of a radius of 1 / TURN."""


def corridor():
    """Ends of walls `[n, 2, 2]` to both sides of the way, with oblique screens along them."""
    radius, (length, width) = 1 / TURN, SIDES
    rng, ends = np.random.default_rng(5), []
    for out in (0.9, -0.75):
        left, bottom = -radius - out, -out
        right, top = length + radius + out, width + 2 * radius + out
        corners = [(left, bottom), (right, bottom), (right, top), (left, top)]
        ends += list(zip(corners, corners[1:] + corners[:1], strict=True))
    for k in range(4):
        (ax, ay), (bx, by) = ends[k]
        for share in np.arange(0.08, 1.0, 0.09):
            x, y, turn = ax + share * (bx - ax), ay + share * (by - ay), rng.uniform(0, math.pi)
            ends.append(((x, y), (x + 0.25 * math.cos(turn), y + 0.25 * math.sin(turn))))
    return np.array(ends)


def rounds(count):
    """Speeds and curvatures of so many rounds."""
    bend = [(SPEED, TURN)] * round(math.pi / 2 / TURN / SPEED / DT)
    sides = [[(SPEED, 0.0)] * round(side / SPEED / DT) for side in SIDES]
    return (sides[0] + bend + sides[1] + bend) * (2 * count)


def path(driven, scale=0.0, bend=0.0, drift=0.0):
    found = [(0.0, 0.0, 0.0)]
    for speed, curvature in driven:
        turn = speed * curvature * (1 + bend) + drift
        found.append(arc(*found[-1], speed * (1 + scale), turn / speed / (1 + scale), DT))
    return np.array(found)


class Sighted(Blindfold):
    """It ranges some points ahead, a little wrong, and sees through walls."""

    rng = np.random.default_rng(0)

    def scan(self, rows):
        scan = super().scan(rows)
        pick = self.rng.permutation(len(scan.x))[:14]
        noise = self.rng.normal(0, 0.01, (2, len(pick)))
        return type(scan)(scan.x[pick] + noise[0], scan.y[pick] + noise[1], scan.weight[pick])


@pytest.fixture(scope="module")
def points():
    ends = corridor()
    lines = [np.linspace(a, b, int(20 * math.dist(a, b)) + 2) for a, b in ends]
    return np.concatenate(lines)


def run(points, true, reckoned, params, steps=None, state=None, anchors=None):
    localiser = Sighted(StereoRig(), DT, params)
    localiser.points, localiser.rng = points, np.random.default_rng(0)
    found = []
    for here, there in list(zip(true, reckoned, strict=True))[:steps]:
        localiser.pose = tuple(here)
        state = localiser(torch.zeros(2, 8), Pose(*(torch.tensor(v) for v in there)), state)
        found.append([float(part) for part in state.pose])
        if anchors is not None:
            anchors.append(anchor_of(state))
    return np.array(found), state


def off_walls(state, params):
    """How far the middles of the cells are from the nearest wall, m."""
    packed = pack(state.walls).double().numpy()
    packed = packed[packed[:, 2] >= params.least]
    middle = (packed[:, :2] + 0.5) * params.cell + packed[:, 3:5] / packed[:, 2:3]
    a, b = corridor().transpose(1, 0, 2)
    share = ((middle[:, None] - a) * (b - a)).sum(-1) / ((b - a) ** 2).sum(-1)
    nearest = a + np.clip(share, 0, 1)[..., None] * (b - a)
    return np.hypot(*(middle[:, None] - nearest).transpose(2, 0, 1)).min(1)


def test_after_three_rounds_with_a_wrong_odometer_the_walls_are_right(points):
    driven = rounds(3)
    true, reckoned = path(driven), path(driven, 0.03, 0.03, math.radians(0.1) * DT)
    assert math.dist(true[-1, :2], reckoned[-1, :2]) > 0.7
    params, anchors = LocaliserParams(), []
    found, state = run(points, true, reckoned, params, anchors=anchors)
    off = found - true
    last = off[-len(off) // 3 :]
    # Black rows show no motion, by which most of this would be known. While a round is fitted, the pose may jump.
    assert np.hypot(*last[:, :2].T).max() < 0.2
    assert np.abs(last[:, 2]).max() < math.radians(3)
    aside = off_walls(state, params)
    assert np.median(aside) < 0.02
    assert np.percentile(aside, 90) < 0.08
    assert float(state.scale) == pytest.approx(0.03 / 1.03, abs=0.01)
    # What was seen on the way moves with the parts, those that were left out too.
    frames = frames_of(state.parts)
    now = dict(zip(frames.numbers.tolist(), frames.poses.numpy(), strict=True))
    moved = np.array([carried(now[a.frame], np.array(a.pose)) for a in anchors])
    assert len(state.parts.aside) > 0
    as_driven, afterwards = (np.percentile(np.hypot(*(way - true)[:, :2].T), 90) for way in (found, moved))
    assert afterwards < 0.7 * as_driven


def test_parts_overlap_and_stop_when_all_is_known(points):
    driven = rounds(3)
    params = LocaliserParams(parts=PartParams(learning=1.0))
    round_ = len(driven) // 3
    _, first = run(points, path(driven), path(driven), params, round_)
    _, state = run(points, path(driven), path(driven), params)
    assert len(first.parts.done) > 4
    assert len(first.parts.edges) > 2
    assert len(state.parts.done) < 3 * len(first.parts.done)  # later rounds show little that is new
    assert len(state.parts.poses) == len(state.parts.begun) == len(state.parts.done) + 1


def test_a_state_goes_on_the_same_wherever_it_was_kept(points):
    driven = rounds(1)
    true, reckoned = path(driven), path(driven, 0.02)
    _, kept = run(points, true, reckoned, LocaliserParams(), 60)
    before, count = kept.walls.clone(), len(kept.parts.done)
    ends = [run(points, true[60:], reckoned[60:], LocaliserParams(), state=kept)[1] for _ in range(2)]
    assert torch.equal(kept.walls, before)
    assert all(torch.equal(a, b) for a, b in zip(ends[0].pose, ends[1].pose, strict=True))
    assert torch.equal(ends[0].walls, ends[1].walls)
    assert torch.equal(ends[0].parts.poses, ends[1].parts.poses)
    assert len(ends[0].parts.done) > count > 0


def test_where_the_car_was_before_it_was_carried_is_kept_beside_the_last_part(points):
    driven = rounds(1)
    _, state = run(points, path(driven), path(driven), LocaliserParams(), 60)
    before, last = state.parts, state.parts.poses[-1].tolist()
    assert len(before.done) > 0
    after = frames_of(begun_at(before, (5.0, 5.0, 0.0), torch.tensor(60.0, dtype=torch.float64)))
    at = after.numbers.tolist().index(float(before.begun[-1]))
    assert after.poses[at].tolist() == pytest.approx(last)


def test_there_are_no_more_parts_than_allowed(points):
    driven = rounds(1)
    params = LocaliserParams(parts=PartParams(count=3))
    _, state = run(points, path(driven), path(driven), params)
    assert len(state.parts.done) == 3


def test_a_packed_part_is_drawn_where_its_frame_is():
    params = LocaliserParams()
    rng, pose = np.random.default_rng(3), (1.3, -0.7, 0.6)
    scan = Scan(*rng.uniform(-2, 2, (2, 500)), np.ones(500))
    parts = add_to_part(no_parts(pose, params), scan, pose, params)
    walls = redrawn(parts, DT, params)
    there = add_scan(empty_walls(params), scan, pose, params)
    half = params.size // 2
    at = (np.indices((params.size, params.size)).transpose(1, 2, 0) - half + 0.5) * params.cell
    for power in (1, 2):  # of all points together, first and second moments are kept
        sums = []
        for cells in (walls.double().numpy(), there.double().numpy()):
            weight, mean = cells[..., :1], cells[..., 1:3]
            square = cells[..., [3, 5]] + 2 * at * mean + at**2 * weight
            sums.append((at * weight + mean if power == 1 else square).sum((0, 1)))
        assert sums[0] == pytest.approx(sums[1], rel=1e-3)


def test_numbers_out_of_range_are_refused():
    with pytest.raises(InputError, match="way"):
        PartParams(way=0.0)
