"""Motion in every direction and at every pace."""

from __future__ import annotations

import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.vision import CoherentMotion


def drift(step: tuple[int, int], frames: int = 16, size: tuple[int, int] = (48, 60)) -> torch.Tensor:
    """Random dots that move by `step` columns and rows a frame, `[T, 1, H, W]`."""
    dots = (torch.rand(size, generator=torch.Generator().manual_seed(0)) < 0.05).float()
    return torch.stack([dots.roll((n * step[1], n * step[0]), (0, 1)) for n in range(frames)]).unsqueeze(1)


@pytest.mark.parametrize("step", [(1, 0), (0, -1), (-1, 1)])
def test_the_peak_is_at_the_velocity(step: tuple[int, int]) -> None:
    motion = CoherentMotion((48, 60), 0.04)
    maps, _ = motion(drift(step))
    best = maps[-1].flatten(1).mean(1).argmax()
    assert motion.velocities[best].tolist() == pytest.approx([25 * step[0], 25 * step[1]])


def test_chunks_and_batches_give_the_same() -> None:
    motion = CoherentMotion((48, 60), 0.04)
    frames = torch.stack([drift((1, 0)), drift((0, 1))])
    whole, last = motion(frames)
    first, state = motion(frames[:, :5])
    second, state = motion(frames[:, 5:], state)
    torch.testing.assert_close(torch.cat([first, second], 1), whole)
    torch.testing.assert_close(motion.maps(motion.advance(frames[1])), whole[1, -1])
    assert int(last.steps) == int(state.steps) == 16


def test_mirrored_frames_give_mirrored_maps() -> None:
    motion = CoherentMotion((48, 60), 0.04)
    frames = drift((1, 0))
    maps, mirrored = motion(frames)[0][-1], motion(frames.flip(-1))[0][-1]
    side = 2 * motion.reach + 1
    shape = (side, side, *maps.shape[1:])
    torch.testing.assert_close(mirrored.reshape(shape), maps.reshape(shape).flip(1).flip(-1), atol=1e-5, rtol=1e-4)


def test_bad_input() -> None:
    with pytest.raises(InputError, match="no field"):
        CoherentMotion((4, 60), 0.04)
    with pytest.raises(InputError, match="48x60"):
        CoherentMotion((48, 60), 0.04)(torch.zeros(2, 3, 50, 60))
