"""The slow background, its noise, and what stands out."""

from __future__ import annotations

import pytest
import torch

from ndtorch.vision.camera.background import background_start, background_step, core, measured_noise, quick_step
from ndtorch.vision.camera.exposure import exposure_gain
from ndtorch.vision.camera.params import CameraParams
from ndtorch.vision.camera.sampling import every_other

STEP = {"a": 0.01, "a_deviation": 0.05, "params": CameraParams()}


def test_noise_is_measured_beside_something_that_moves() -> None:
    noise = 0.02 * torch.randn(3, 80, 80, generator=torch.Generator().manual_seed(1))
    noise[:, :, :24] += 0.5
    # The part that moves is 30 % and raises the median by what 0.5 / 0.7 of the order statistics says.
    assert measured_noise(noise).flatten().tolist() == pytest.approx([0.02 * 1.067 / 0.6745] * 3, rel=0.06)


def test_core_takes_the_threshold_off_both_sides() -> None:
    x = torch.tensor([-0.5, -0.1, 0.0, 0.1, 0.5])
    assert core(x, torch.tensor(0.2)).tolist() == pytest.approx([-0.3, 0.0, 0.0, 0.0, 0.3])


def test_static_scene_has_no_difference() -> None:
    frame = torch.rand(3, 20, 20, generator=torch.Generator().manual_seed(0))
    state = background_start(frame, 0.01)
    for _ in range(5):
        difference, threshold, _, state = background_step(frame, state, **STEP)
        assert (difference == 0).all()
        assert (threshold > 0).all()
    assert int(state.frames) == 5


def test_what_stands_out_is_held_and_sensor_noise_is_not() -> None:
    generator = torch.Generator().manual_seed(0)
    frame = torch.full((3, 40, 40), 0.5)
    state = background_start(frame, 0.01)
    for _ in range(200):
        _, _, _, state = background_step(frame + 0.01 * torch.randn(3, 40, 40, generator=generator), state, **STEP)
    thing = frame.clone()
    thing[:, 10:20, 10:20] = 0.9
    difference, threshold, _, after = background_step(thing, state, **STEP)
    outside = torch.ones(40, 40, dtype=torch.bool)
    outside[10:20, 10:20] = False
    assert (difference.abs() > threshold)[:, ~outside].all()
    assert not (difference.abs() > threshold)[:, outside].any()
    # Outside 1 % of the way is gone, inside a fifth of that.
    inside = (after.mean - state.mean)[:, ~outside] / difference[:, ~outside]
    assert inside.mean().item() == pytest.approx(0.002, rel=0.01)


def test_flickering_pixels_need_more() -> None:
    generator = torch.Generator().manual_seed(0)
    state = background_start(torch.full((3, 20, 20), 0.5), 0.01)
    for _ in range(300):
        frame = torch.full((3, 20, 20), 0.5) + 0.003 * torch.randn(3, 20, 20, generator=generator)
        frame[:, :5, :5] += 0.05 * torch.randn(3, 5, 5, generator=generator)
        _, threshold, _, state = background_step(frame, state, **STEP)
    assert threshold[:, :5, :5].mean() > 2 * threshold[:, 5:, 5:].mean()


def test_the_first_pictures_are_averaged() -> None:
    """Until the memory is as long as that."""
    frames = [torch.full((3, 8, 8), level) for level in (0.5, 0.51, 0.49, 0.505)]
    state = background_start(frames[0], 0.01)
    for n in (1, 2, 3):
        _, _, _, state = background_step(frames[n], state, **STEP)
        mean = sum(float(frame[0, 0, 0]) for frame in frames[: n + 1]) / (n + 1)
        assert state.mean.flatten().tolist() == pytest.approx([mean] * 192, abs=1e-5)


def test_the_kernel_does_what_the_steps_do() -> None:
    pytest.importorskip("numba")
    generator = torch.Generator().manual_seed(4)
    ground, params = torch.rand(3, 30, 41, generator=generator), CameraParams()
    # One color is dark nearly everywhere: its gain is not told.
    ground[2] *= 0.03
    state, shares = background_start(ground, params.first_deviation), (0.004, 0.01, 0.004)
    for step in range(12):
        frame = (1 - 0.02 * step) * (ground + 0.01 * torch.randn(ground.shape, generator=generator))
        frame[:, 8:10, 2 * step : 2 * step + 9] = 0.9
        gain, other = exposure_gain(frame, state.mean, params.gain_limit, params.darkest, params.lit)
        even = frame / gain
        difference, threshold, cut, after = background_step(even, state, *shares[:2], params)
        after = after._replace(mean=after.mean * gain ** shares[2])
        with torch.inference_mode():
            quick = quick_step(frame, state, shares, params)
        assert not cut
        assert not other
        assert quick is not None
        shown = ((difference.abs() / threshold).amax(0, keepdim=True) - 1).clamp(0, 1)
        wanted = (even, core(difference, threshold), shown, every_other(threshold).median(), *after)
        for one, found in zip(wanted, (*quick[:4], *quick[4]), strict=True):
            assert one.shape == found.shape
            assert torch.allclose(one, found, atol=1e-4)
        state = after
    assert gain[2] == 1
    assert gain[0] < 0.95
    assert float(shown.max()) == 1
    with torch.inference_mode():
        assert quick_step(1 - ground, state, shares, params) is None
        assert quick_step(torch.full_like(ground, 0.001), state, shares, params) is None
