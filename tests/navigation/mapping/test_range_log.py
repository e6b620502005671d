"""Ranges kept with the pose they were seen from, in frames that move."""

import math

import pytest
import torch

from ndtorch.navigation import Ranges
from ndtorch.navigation.mapping.range_log import (
    MAX_FRAME_RANGES,
    FramePose,
    Frames,
    add_ranges,
    empty_log,
    in_world,
    thinned,
)
from ndtorch.utils.tensors import leaves


def ranges(*ahead):
    """So many features straight ahead; None is a slot that is not valid."""
    x = torch.tensor([0.0 if v is None else v for v in ahead])
    valid = torch.tensor([v is not None for v in ahead])
    return Ranges(x, -0.1 * valid, 0.1 * valid, x, 0 * x, valid)


def frames(**poses):
    numbers = torch.tensor([float(name[1:]) for name in poses], dtype=torch.float64)
    return Frames(numbers, torch.tensor(list(poses.values()), dtype=torch.float64).reshape(-1, 3))


def test_sights_move_with_their_frames():
    log = add_ranges(empty_log(), FramePose(0, (1.0, 0.0, 0.0)), ranges(2.0, None))
    log = add_ranges(log, FramePose(0, (1.0, 0.5, 0.1)), ranges(None, None))
    log = add_ranges(log, FramePose(7, (0.0, 0.0, 0.0)), ranges(1.0, 1.5))
    found, poses = in_world(log, frames(f0=(0, 0, 0), f7=(3, 1, 0.2)))
    assert found.x.flatten().tolist() == [2.0, 1.0, 1.5]
    assert bool(found.valid.all())
    assert torch.stack(poses, -1).tolist() == [pytest.approx(v) for v in ((1, 0, 0), (3, 1, 0.2), (3, 1, 0.2))]
    _, poses = in_world(log, frames(f0=(5, 0, math.pi / 2), f7=(0, 0, 0)))
    assert [float(part[0]) for part in poses] == pytest.approx([5.0, 1.0, math.pi / 2])


def test_each_number_of_a_range_stays_what_it_was_and_its_pose_is_turned_with_the_frame():
    numbers = torch.tensor([[2.0, -0.3, 0.2, 1.9, 0.4], [3.0, -0.1, 0.6, 2.8, -0.5]])
    seen = Ranges(*numbers.unbind(-1), torch.tensor([True, True]))
    log = add_ranges(empty_log(), FramePose(4, (1.0, 2.0, 0.3)), seen)
    found, pose = in_world(log, frames(f4=(10, 20, math.pi / 6)))
    assert [part.shape for part in found] == [(2, 1)] * 6
    torch.testing.assert_close(torch.cat(found[:-1], -1), numbers)
    cos, sin = math.cos(math.pi / 6), math.sin(math.pi / 6)
    wanted = (10 + cos - 2 * sin, 20 + sin + 2 * cos, 0.3 + math.pi / 6)
    assert [part.tolist() for part in pose] == [pytest.approx([v] * 2) for v in wanted]


def test_what_a_standing_car_sees_counts_once():
    log = add_ranges(empty_log(), FramePose(3, (0.1, 0.0, 0.0)), ranges(None))
    for _ in range(4):
        log = add_ranges(log, FramePose(3, (0.1, 0.0, 0.0)), ranges(1.0, 2.0))
    assert len(log.present) == 2
    log = add_ranges(log, FramePose(3, (0.1, 0.0, 0.01)), ranges(1.0, 2.0))
    assert len(log.present) == 4


def test_a_frame_that_ends_in_another_moves_with_it():
    home = FramePose(2, (1.0, 0.0, math.pi / 2))
    log = add_ranges(empty_log(), FramePose(5, (0.5, 0.0, 0.1)), ranges(2.0))
    log = add_ranges(log, FramePose(6, (0.0, 0.0, 0.0)), ranges(1.0), {5.0: home}.get)
    log = add_ranges(log, FramePose(7, (0.0, 0.0, 0.0)), ranges(), lambda frame: None)
    found, poses = in_world(log, frames(f2=(0, 0, 0), f5=(9, 9, 9), f6=(9, 9, 9)))
    assert found.x.flatten().tolist() == [2.0]
    assert [float(part) for part in poses] == pytest.approx([1.0, 0.5, 0.1 + math.pi / 2])


def test_the_log_grows_with_the_rooms_and_not_with_the_rounds():
    """Rounds through six rooms, each of a frame that ends in that of the first round."""
    chance, log, sizes = torch.Generator().manual_seed(0), empty_log(), []
    for lap in range(24):
        for room in range(6):
            for step in range(12):
                number = 6.0 * lap + room
                x = 1 + 3 * torch.rand(80, generator=chance)
                seen = Ranges(x, -0.1 + 0 * x, 0.1 + 0 * x, x, 0 * x, x > 0)
                at = FramePose(number, (0.25 * step, 0.0, 0.0))
                log = add_ranges(log, at, seen, lambda frame: FramePose(frame % 6, (0.0, 0.001 * frame, 0.0)))
        sizes.append(sum(part.numel() * part.element_size() for part in leaves(log).values()))
    assert sizes[-1] <= 1.01 * sizes[5]
    assert max(map(len, log.ended)) <= MAX_FRAME_RANGES
    assert set(log.numbers.tolist()) == set(range(6))


def test_what_was_seen_once_outlasts_what_is_seen_again():
    here, there = (torch.tensor([[2.0, -0.1, 0.1, 2.0, 0.0, *pose, 0.0]]) for pose in ((0.0, 0.0), (1.0, 0.0)))
    kept = thinned(torch.cat((here.repeat(2 * MAX_FRAME_RANGES, 1), there)))
    assert len(kept) <= MAX_FRAME_RANGES
    assert torch.equal(kept[-1:], there)
    apart = torch.arange(3.0 * MAX_FRAME_RANGES)[:, None] * torch.eye(8)[5] + here
    assert len(thinned(apart)) == MAX_FRAME_RANGES
