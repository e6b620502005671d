"""The steps of windows: pieces, batches, and the kernel beside torch."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from ndtorch.binding import Windows
from ndtorch.binding.tracking.params import WindowParams
from ndtorch.binding.tracking.window_step import WindowState
from ndtorch.binding.tracking.windows import DIRECTIONS
from ndtorch.vision.motion import Border
from tests.binding.tracking.test_windows import (
    DT,
    GRID,
    LEFT_GREEN,
    RIGHT_RED,
    UP_BLUE,
    blob,
    features_of,
    wave,
    windows,
)


def two() -> Tensor:
    return blob(RIGHT_RED, wave(80, 1.1), (4.0, 3.0), (0.0, 1.5)) + blob(
        LEFT_GREEN, wave(80, 0.7), (9.0, 9.0), (0.5, -1.5)
    )


def test_pieces_and_batches_give_the_same() -> None:
    module, scene = windows(), two()
    counts, end = module(scene)
    state, parts = None, []
    for part in scene.split([1, 2, 30, 7, 40]):
        some, state = module(part, state)
        parts.append(some)
    assert torch.equal(torch.cat(parts), counts)
    assert state is not None
    assert all(torch.equal(a, b) for a, b in zip(state, end, strict=True))
    batch, states = module(torch.stack([scene, 0 * scene, scene.flip(1)]))
    assert batch.shape == (3, 80)
    assert torch.equal(batch[0], counts)
    assert batch[1].max() == 0
    assert torch.allclose(states.place[0], end.place, atol=1e-4)


def test_frames_faster_than_the_updates() -> None:
    """At 100 samples a second windows are still updated 20 times a second."""
    slow, fast = windows(), Windows(GRID, 30.0, 0.01)
    assert (slow.every, fast.every) == (1, 5)
    counts, _ = fast(two().repeat_interleave(5, 0))
    assert counts[-1] == 2


@settings(max_examples=8, deadline=None)
@given(st.floats(1e-3, 1e3), st.integers(0, 15), st.integers(0, 15))
def test_brightness_and_place_do_not_matter(gain: float, down: int, right: int) -> None:
    module = windows()
    # Motion is a product of two brightnesses.
    gains = torch.tensor([gain**2] * 4 + [gain] * 6)
    counts, state = module((two() * gains).roll((down, right), (1, 2)))
    assert counts[-1] == 2
    assert set(map(frozenset, features_of(module, state))) == {
        frozenset({"right", "0°", "red"}),
        frozenset({"left", "60°", "green"}),
    }


def test_motion_points_one_field_left_right_down_and_up() -> None:
    assert DIRECTIONS == ((0.0, -1.0), (0.0, 1.0), (1.0, 0.0), (-1.0, 0.0))


@pytest.mark.parametrize("border", ["wrap", "reflect"])
def test_the_kernel_gives_what_torch_gives(border: Border) -> None:
    """Three objects, one of them seen for a while only, one that goes where another is."""
    pytest.importorskip("numba")
    steps, wrap = 160, border == "wrap"
    parts = [
        blob(RIGHT_RED, wave(steps, 1.1), (4.0, 3.0), (0.0, 1.5), wrap=wrap),
        blob(LEFT_GREEN, wave(steps, 0.7, 0.3), (10.0, 12.0), (0.0, -1.2), wrap=wrap),
        blob(UP_BLUE, wave(steps, 0.9, 0.6), (14.0, 7.0), (-2.0, 0.0), wrap=wrap),
    ]
    parts[1][60:120] = 0
    signals = sum(parts) + 0.01 * torch.rand(steps, *GRID, 10)
    module = Windows(GRID, 30.0, DT, border)
    with torch.no_grad():
        wanted, end = module(signals)
    with torch.inference_mode():
        counts, half = module(signals[:70])
        kept = [part.clone() for part in half]
        rest, state = module(signals[70:], half)
    assert wanted.max() > 1
    assert torch.equal(torch.cat([counts, rest]), wanted)
    for part, before in zip(half, kept, strict=True):
        assert torch.equal(part, before)  # a state that is given is never written
    for name, found, other in zip(WindowState._fields, state, end, strict=True):
        torch.testing.assert_close(found, other, rtol=1e-3, atol=1e-4, msg=name)


def test_no_window_of_a_batch_is_faster_than_it_may_be() -> None:
    """Two scenes at once, both with things that go aslant and are faster: as fast as may be, and just as alone."""
    module = Windows(GRID, 30.0, DT, params=WindowParams(fastest=0.5))
    right = blob(RIGHT_RED, wave(60, 1.1), (4.0, 3.0), (1.1, 1.2))
    up = blob(UP_BLUE, wave(60, 0.9), (9.0, 8.0), (-1.2, 0.9))
    _, both = module(torch.stack([right, up]))
    fastest = both.velocity.norm(dim=-1).amax(-1)
    assert fastest.tolist() == pytest.approx([0.5, 0.5])
    for one, scene in enumerate((right, up)):
        _, alone = module(scene)
        torch.testing.assert_close(both.velocity[one], alone.velocity)


@pytest.mark.parametrize("batch", [(), (2,), (2, 3)])
def test_a_start_has_the_shapes_of_what_comes_after_it(batch: tuple[int, ...]) -> None:
    layer = Windows((4, 5), 4.0)
    begun = layer.start(torch.zeros(*batch, 4, 5, 10))
    _, after = layer(torch.zeros(*batch, 1, 4, 5, 10))
    assert [part.shape for part in begun] == [part.shape for part in after]
