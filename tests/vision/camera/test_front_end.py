"""The front end for video of a camera as a whole."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from ndtorch.errors import InputError
from ndtorch.vision.camera.figures import GroundParams
from ndtorch.vision.camera.front_end import CameraFrontEnd, FieldSignals, shrink, small_size
from ndtorch.vision.camera.params import CameraParams
from tests.strategies import chunkings
from tests.vision.camera.passing_scenes import SIZE, ground, passing


def run(video: Tensor, fps: float = 25.0, parts: CameraParams | None = None) -> FieldSignals:
    return CameraFrontEnd(SIZE, fps, parts)(video)[0]


@settings(max_examples=5, deadline=None)
@given(lengths=chunkings(14), fps=st.sampled_from([25.0, 90.0]))
def test_chunks_give_the_same_as_the_whole(lengths: list[int], fps: float) -> None:
    video = (passing(14, 5.0, first=3) * 255).round().to(torch.uint8)
    module = CameraFrontEnd(SIZE, fps)
    whole, end = module(video)
    parts, state, at = [], None, 0
    for n in lengths:
        out, state = module(video[at : at + n], state)
        parts.append(out)
        at += n
    joined = FieldSignals(*(torch.cat(part) for part in zip(*parts, strict=True)))
    for one, other in zip(whole, joined, strict=True):
        assert torch.equal(one, other)
    assert state is not None
    assert torch.equal(state.waiting, end.waiting)
    assert len(whole.time) == 14 // module.group


def test_red_square_moving_right_is_seen_where_it_is() -> None:
    out = run(passing(30, 4.0))
    late = out.signals[20:30].mean(0)
    # In its fields: right and red, and nothing of the opposite.
    row, column = divmod(int(late[..., 1].argmax()), 10)
    assert row in (2, 3)
    assert 2 <= column <= 5
    here = late[row, column]
    assert here[1] > 3 * here[0]
    assert here[7] > 0.05
    assert here[8:].max() < 0.05 * here[7]
    # Far from it nothing stands out.
    assert out.presence[20:30, :, 8:].max() < 0.01


def test_exposure_alone_is_nothing_and_hides_nothing() -> None:
    gains = (1 + 0.3 * torch.sin(torch.arange(40) / 4))[:, None, None, None]
    assert run(ground() * gains).motion.abs().max() < 1e-8
    faint = passing(40, 3.0, (0.6, 0.45, 0.45)) * gains
    seen = run(faint).signals[..., 1].max()
    # Uncorrected, the swing of the whole picture passes for noise, and the square drowns in it.
    assert seen > 0.02
    assert run(faint, parts=CameraParams(exposure=False)).signals[..., 1].max() < seen / 3


def test_green_on_red_of_the_same_brightness_moves() -> None:
    video = torch.zeros(25, 3, *SIZE)
    video[:, 0] = 0.5
    for n in range(5, 25):
        video[n, 0, 40:70, 4 * n : 4 * n + 30] = 0.1
        video[n, 1, 40:70, 4 * n : 4 * n + 30] = 0.4
    assert run(video).signals[12:, ..., 1].max() > 0.02


@pytest.mark.parametrize("field", ["exposure", "background", "noise_floor", "color_inhibition", "compression"])
def test_every_part_can_be_switched_off(field: str) -> None:
    assert field in CameraParams.model_fields
    video = passing(16, 4.0)
    video = video * torch.linspace(1, 0.9, 16)[:, None, None, None]
    assert not torch.equal(run(video).signals, run(video, parts=CameraParams(**{field: False})).signals)


def test_whole_field_is_one_field() -> None:
    out = run(passing(16, 4.0), parts=CameraParams(grid=(1, 1)))
    assert out.signals.shape == (16, 1, 1, 10)


@pytest.mark.parametrize(("size", "small"), [((224, 400), (56, 100)), ((112, 200), (56, 100)), ((40, 60), (40, 60))])
def test_small_size(size: tuple[int, int], small: tuple[int, int]) -> None:
    assert small_size(size) == small


def test_unusable_arguments_are_refused() -> None:
    with pytest.raises(InputError, match="fps"):
        CameraFrontEnd(SIZE, 0)
    with pytest.raises(InputError, match="scale"):
        CameraFrontEnd(SIZE, 25, CameraParams(scale=3))
    with pytest.raises(InputError, match="frames"):
        CameraFrontEnd(SIZE, 25)(torch.zeros(2, 1, 3, *SIZE))
    with pytest.raises(InputError, match="size"):
        CameraFrontEnd((8, 8), 25)
    bad = ground().repeat(3, 1, 1, 1)
    bad[1] = torch.nan
    with pytest.raises(InputError, match="finite"):
        CameraFrontEnd(SIZE, 25)(bad)


@pytest.mark.parametrize("kind", [CameraParams, GroundParams])
def test_defaults_are_within_the_limits_that_they_have(kind: type[CameraParams] | type[GroundParams]) -> None:
    values = kind().model_dump()
    assert kind(**values) == kind()


@pytest.mark.parametrize(
    ("kind", "wrong"),
    [(CameraParams, {"lit": 1.5}), (CameraParams, {"shade": 1.25}), (GroundParams, {"speckle": 0})],
)
def test_numbers_beyond_their_limits_are_refused(kind: type[Any], wrong: dict[str, float]) -> None:
    with pytest.raises(InputError, match=next(iter(wrong))):
        kind(**wrong)


@pytest.mark.parametrize("beside", [False, True])
@pytest.mark.parametrize("kind", [torch.uint8, pytest.param(torch.float32, marks=pytest.mark.long)])
def test_the_kernel_averages_as_torch_does(kind: torch.dtype, beside: bool) -> None:
    """Blocks that divide the frame, and blocks that share rows and columns."""
    pytest.importorskip("numba")
    for height, width in ((48, 64), (50, 75)):
        frames = torch.randint(0, 256, (2, 3, height, width), dtype=torch.uint8)
        frames = frames if kind == torch.uint8 else frames.to(kind) / 255
        frames = frames.to(memory_format=torch.channels_last) if beside else frames
        wanted = shrink(frames, (12, 16))
        with torch.inference_mode():
            found = shrink(frames, (12, 16))
        torch.testing.assert_close(found, wanted, rtol=1e-5, atol=1e-6)
        assert wanted.std() > 0.01
