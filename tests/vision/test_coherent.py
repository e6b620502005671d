"""Motion in every direction and at every pace."""

from __future__ import annotations

import pytest
import torch

from ndtorch.vision import CoherentMotion, CoherentParams

FEW = CoherentParams(kept=0.5, fastest=27.0, step=13.5)


def drift(step: tuple[int, int], frames: int = 16, size: tuple[int, int] = (48, 60)) -> torch.Tensor:
    """Random dots that move by `step` columns and rows a frame, `[T, 1, H, W]`."""
    dots = (torch.rand(size, generator=torch.Generator().manual_seed(0)) < 0.05).float()
    return torch.stack([dots.roll((n * step[1], n * step[0]), (0, 1)) for n in range(frames)]).unsqueeze(1)


@pytest.mark.parametrize("step", [(1, 0), (0, -1), (-1, 1)])
def test_the_peak_is_at_the_velocity(step: tuple[int, int]) -> None:
    motion = CoherentMotion((48, 60), 0.04)
    maps = motion.maps(motion.advance(drift(step)))
    best = motion.velocities[maps.flatten(1).mean(1).argmax()]
    nearest = (motion.velocities - 25 * torch.tensor(step)).norm(dim=-1).argmin()
    assert best.tolist() == motion.velocities[nearest].tolist()


def test_what_moves_together_is_much_and_what_does_not_is_little() -> None:
    # Dots are 27 pixels a second on, which the grid holds; others are drawn anew in every frame.
    motion = CoherentMotion((48, 60), 1 / 27, FEW)
    anew = (torch.rand(30, 1, 48, 60, generator=torch.Generator().manual_seed(1)) < 0.05).float()
    (which,) = (motion.velocities == torch.tensor([27.0, 0.0])).all(1).nonzero()[0].tolist()
    together, apart = (motion.maps(motion.advance(frames))[which] for frames in (drift((1, 0), 30), anew))
    assert float(together[:, 3:].amin()) > 0.5
    assert float(apart.abs().amax()) < 0.25


def test_chunks_and_batches_give_the_same() -> None:
    motion = CoherentMotion((48, 60), 0.04, FEW)
    frames = torch.stack([drift((1, 0), 8), drift((0, 1), 8)])
    whole, last = motion(frames)
    first, state = motion(frames[:, :3])
    second, state = motion(frames[:, 3:], state)
    torch.testing.assert_close(torch.cat([first, second], 1), whole)
    torch.testing.assert_close(motion.maps(motion.advance(frames[1])), whole[1, -1])
    assert int(last.steps) == int(state.steps) == 8
