"""Gain of each color against a background."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from ndtorch.vision.camera.exposure import exposure_gain
from tests.vision.camera.passing_scenes import ground

LIMITS = (4.0, 0.04, 0.1)


@settings(max_examples=20, deadline=None)
@given(gains=st.tuples(*[st.floats(0.5, 1.5)] * 3))
def test_gain_is_found_while_a_third_is_covered(gains: tuple[float, float, float]) -> None:
    background = ground()
    frame = background * torch.tensor(gains)[:, None, None]
    frame[:, :, :60] = torch.tensor([0.9, 0.1, 0.3])[:, None, None]
    found = exposure_gain(frame, background, *LIMITS)[0].flatten()
    # Covered pixels shift a median of equal values not at all, but for rounding.
    assert found.tolist() == pytest.approx(gains, rel=1e-3)


def test_darkness_tells_nothing() -> None:
    dark = torch.full((3, 20, 20), 0.01)
    assert exposure_gain(dark * 2, dark, *LIMITS)[0].flatten().tolist() == [1.0, 1.0, 1.0]


def test_gain_is_limited() -> None:
    background = ground()
    gain, other = exposure_gain(background * 10, background, 3.0, *LIMITS[1:])
    assert gain.max() == 3.0
    assert bool(other)


def test_what_comes_out_of_darkness_is_another_picture() -> None:
    dark = torch.full_like(ground(), 0.01)
    assert bool(exposure_gain(ground(), dark, *LIMITS)[1])
    assert not bool(exposure_gain(dark * 2, dark, *LIMITS)[1])
    assert not bool(exposure_gain(ground() * 0.6, ground(), *LIMITS)[1])


def test_each_picture_of_a_batch_is_judged_by_its_own_background() -> None:
    """One comes out of darkness, the others do not."""
    light = ground()
    dark = torch.full_like(light, 0.01)
    frames = torch.stack([light] * 3)
    assert exposure_gain(frames, torch.stack([light, dark, light]), *LIMITS)[1].flatten().tolist() == [
        False,
        True,
        False,
    ]
