"""The composed sensors and the whole navigator on frames."""

import numpy as np
import pytest
import torch

from ndtorch.navigation import (
    AlphaBetaTracker,
    AvoidanceParams,
    Command,
    FeatureParams,
    Grid,
    GridMap,
    Navigator,
    ObservationList,
    StereoRig,
    Strips,
    cut_strips,
)
from ndtorch.navigation.controllers.published import SubfieldMotion
from ndtorch.navigation.proximity import NOWHERE, ProximityScan
from ndtorch.utils import tensors as tree
from ndtorch.vision.nondirectional import NDMin, spatial_maximum
from tests.compilers import compiles

DT = 1 / 30
RIG = StereoRig(width=320, height=240, focal=215.0)
FIELDS = RIG.subfields()


def frames(seed, *batch, steps=8, channels=3, shift=3):
    """A blurred random texture that slides to the left; the right camera sees it 90 pixels further left."""
    generator = torch.Generator().manual_seed(seed)
    wide = torch.rand(*batch, 1, channels, 240, 500, generator=generator)
    left = torch.cat([wide[..., shift * t : shift * t + 320] for t in range(steps)], -4)
    right = torch.cat([wide[..., 90 + shift * t : 90 + shift * t + 320] for t in range(steps)], -4)
    return left, right


def full_navigator(controller="published", backend="torch", **options):
    grid = GridMap(RIG, Grid(-1.0, 3.0, -2.0, 2.0, cell=0.02))
    return Navigator(
        RIG,
        DT,
        controller=controller,
        backend=backend,
        grid_map=grid,
        observations=ObservationList(DT, 32),
        tracker=AlphaBetaTracker(DT),
        **options,
    )


def leaves(state):
    """All tensors of a nested state, in order."""
    return [torch.as_tensor(leaf).clone() for leaf in tree.leaves(state).values()]


def test_subfield_motion_against_its_definition():
    left, right = frames(1)
    sides, _ = SubfieldMotion(RIG, DT)(left, right)
    for k, (image, rect) in enumerate(zip((left, right), FIELDS, strict=True)):
        motion, _ = NDMin(0.005, DT)(image.mean(-3, keepdim=True))
        motion = motion[..., rect.top : rect.bottom, rect.left : rect.right]
        torch.testing.assert_close(sides[..., k], 20 * spatial_maximum(motion)[..., 0])
    assert sides[0].tolist() == [0.0, 0.0]
    assert (sides[1:] > 0).all()
    assert sides.max() < 20 * 0.1305  # the raw output cannot exceed 0.13


@pytest.mark.parametrize("features", [None, FeatureParams(7, edge_reach_px=4, shared=True)])
def test_chunked_is_whole_is_frame_by_frame(features):
    left, right = frames(4, steps=24)
    quick = AvoidanceParams(turn_threshold=0.01, start_suppression_s=0.1, turn_s=0.2, suppression_s=0.1)
    navigator = full_navigator(params=quick, features=features)
    whole, final = navigator(left, right)
    final = leaves(final)
    assert whole.curvature.unique().numel() > 1  # it does something
    for size in (1, 7):
        state, commands = None, []
        for a, b in zip(left.split(size), right.split(size), strict=True):
            command, state = navigator(a, b, state)
            commands.append(command)
        assert torch.equal(torch.cat([c.curvature for c in commands]), whole.curvature)
        assert torch.equal(torch.cat([c.speed for c in commands]), whole.speed)
        for a, b in zip(leaves(state), final, strict=True):
            torch.testing.assert_close(a, b, atol=1e-4, rtol=1e-4)


def test_uint8_float_grey_and_strips_agree():
    left, right = ((255 * x).to(torch.uint8) for x in frames(5, steps=12))
    bytes_, state = Navigator(RIG, DT, controller="published")(left, right)
    floats, _ = Navigator(RIG, DT, controller="published")(left / 255, right / 255)
    torch.testing.assert_close(floats, bytes_)
    grey, grey_state = Navigator(RIG, DT, controller="published")(
        *(x.double().mean(-3, keepdim=True) / 255 for x in (left, right))
    )
    torch.testing.assert_close(grey.curvature.float(), bytes_.curvature)
    np.testing.assert_allclose(grey_state.sides, state.sides, atol=1e-5, rtol=1e-4)
    pieces = [cut_strips(x, rect, RIG) for x, rect in zip((left, right), FIELDS, strict=True)]
    assert pieces[0].row.shape == (12, 3, 1, 320)
    cut, cut_state = Navigator(RIG, DT, controller="published")(
        *(Strips(*(part.clone() for part in p)) for p in pieces)
    )
    torch.testing.assert_close(cut, bytes_)
    for a, b in zip(leaves(cut_state), leaves(state), strict=True):
        assert torch.equal(a, b)


@compiles
def test_compiles():
    torch._dynamo.reset()
    left, right = ((255 * x).to(torch.uint8) for x in frames(3, steps=2))
    navigator = Navigator(RIG, DT, controller="published", backend="torch", observations=ObservationList(DT, 16))
    compiled = torch.compile(navigator, backend="eager", fullgraph=True)
    for a, b in zip(leaves(compiled(left, right)), leaves(navigator(left, right)), strict=True):
        torch.testing.assert_close(a, b)


def test_a_car_that_begins_stands_until_it_has_checked_what_is_near(monkeypatch):
    frame = torch.zeros(1, 3, RIG.height, RIG.width, dtype=torch.uint8)
    navigator = Navigator(RIG, DT, controller="ranging")
    checked, nothing = [], ProximityScan(NOWHERE, True, NOWHERE, NOWHERE)
    monkeypatch.setattr(navigator, "near", lambda *given: checked.append(given) or nothing)
    step = navigator.controller.step
    monkeypatch.setattr(navigator.controller, "step", lambda *given: (Command(0.3, 0.0), step(*given)[1]))
    command, complete = navigator.command_first(frame, frame)
    assert (command.speed, checked) == (0.0, [])
    state = complete()
    assert len(checked) == 1
    assert float(navigator(frame, frame, state)[0].speed) == pytest.approx(0.3)
    anew = state._replace(fields=None, rows=None)  # after a fault
    assert float(navigator(frame, frame, anew)[0].speed) == 0.0
    assert len(checked) >= 2
