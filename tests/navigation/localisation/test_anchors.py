"""Frames in which the car is: those of parts, that of a known map, and none while it looks for itself."""

import pytest
import torch

from ndtorch.navigation import Pose, StereoRig
from ndtorch.navigation.localisation import Localiser, LocaliserParams
from ndtorch.navigation.localisation.anchors import KNOWN_MAP, anchor_of, located_frames
from ndtorch.navigation.localisation.walls import empty_walls

pytest.importorskip("numba")


def pose(*values):
    return Pose(*(torch.tensor(v, dtype=torch.float64) for v in values))


def test_an_anchor_leads_back_to_the_pose_and_moves_with_its_part():
    localiser = Localiser(StereoRig(), 1 / 30)
    state = localiser.start(pose(1.0, 2.0, 0.5))._replace(pose=pose(1.5, 2.5, 0.7))
    anchor, frames = anchor_of(state), located_frames(state)
    assert anchor.frame in frames.numbers.tolist()
    assert frames.poses.tolist() == [[1.0, 2.0, 0.5]]
    moved = state._replace(
        parts=state.parts._replace(poses=state.parts.poses + torch.tensor([3.0, 0.0, 0.0])), pose=pose(4.5, 2.5, 0.7)
    )
    assert anchor_of(moved).pose == pytest.approx(anchor.pose)


def test_in_a_known_map_there_is_one_frame_once_the_car_has_found_itself():
    params = LocaliserParams()
    localiser = Localiser(StereoRig(), 1 / 30, params, known=empty_walls(params))
    state = localiser.start(pose(1.0, 2.0, 0.5))
    assert anchor_of(state) is None
    found = state._replace(hunt=None)
    assert anchor_of(found) == (KNOWN_MAP, pytest.approx((1.0, 2.0, 0.5)))
    assert located_frames(found).poses.tolist() == [[0.0, 0.0, 0.0]]
