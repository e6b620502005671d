"""Avoidance on plain arrays is that of the published controller."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import Avoider, StereoRig
from ndtorch.navigation import avoider as module
from ndtorch.navigation.controllers.published import PublishedControl

RIG = StereoRig(width=320, height=240, focal=215.0, pitch=0.1, forward=0.15)
DT = 1 / 30


def frames(count: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Noise of which first the left and then the right eye sees more change."""
    chance = np.random.default_rng(0)
    pairs = []
    for n in range(count):
        strength = (0.9, 0.3) if n < count // 2 else (0.1, 0.5)
        pairs.append(tuple((chance.random((240, 320, 3)) * 255 * s).astype(np.uint8) for s in strength))
    return pairs


@pytest.mark.parametrize("kernels", [True, False])
def test_it_drives_as_the_controller_does(monkeypatch: pytest.MonkeyPatch, kernels: bool) -> None:
    if kernels:
        pytest.importorskip("numba")
    monkeypatch.setattr(module, "switched_on", lambda: kernels)
    avoider, control = Avoider(RIG, DT), PublishedControl(RIG, DT)
    state = fields = machine = None
    driven = set()
    for n, pair in enumerate(frames(80)):
        planar = n % 2
        given = [np.ascontiguousarray(eye.transpose(2, 0, 1)) if planar else eye for eye in pair]
        found, state = avoider(*given, state)
        eyes = [torch.from_numpy(eye).permute(2, 0, 1).unsqueeze(0) for eye in pair]
        with torch.no_grad():
            sides, fields = control.look(*eyes, fields)
            wanted, machine = control.rule(sides, machine)
        assert found == pytest.approx((float(wanted.speed), float(wanted.curvature)), abs=1e-5)
        driven.add(round(found[1], 3))
    assert len(driven) > 1
    np.testing.assert_allclose(state.low, fields.low.numpy().reshape(state.low.shape), atol=1e-6)


def test_a_state_is_never_written() -> None:
    avoider, pairs = Avoider(RIG, DT), frames(4)
    _, state = avoider(*pairs[0])
    kept = [part.copy() for part in state]
    first, _ = avoider(*pairs[1], state)
    again, _ = avoider(*pairs[1], state)
    assert first == again
    assert all(np.array_equal(a, b) for a, b in zip(kept, state, strict=True))


@pytest.mark.parametrize(
    "shapes", [((240, 320, 3), (240, 320, 1)), ((200, 320, 3),) * 2, ((240, 320, 2),) * 2, ((240, 320),) * 2]
)
def test_other_frames_are_refused(shapes: tuple[tuple[int, ...], tuple[int, ...]]) -> None:
    with pytest.raises(InputError, match="frames"):
        Avoider(RIG, DT)(*(np.zeros(shape, np.uint8) for shape in shapes))


def test_floats_are_refused() -> None:
    with pytest.raises(InputError, match="uint8"):
        Avoider(RIG, DT)(*np.zeros((2, 240, 320, 3)))
