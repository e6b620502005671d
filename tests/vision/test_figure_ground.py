"""Figure and ground: the velocities and the outline of what moves apart."""

import numpy as np
import pytest

from ndtorch.errors import InputError
from ndtorch.vision.figure_ground import figure_ground, refined


def film(figure: tuple[int, int], ground: tuple[int, int], seed: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Sparse dots at whole velocities, columns and rows a frame; a square of 40 pixels moves over a torus."""
    rng = np.random.default_rng(seed)
    sheets = np.where(rng.random((2, 128, 128)) < 0.03, 255, 128).astype(np.uint8)
    frames, mask = np.empty((12, 128, 128), np.uint8), np.zeros((128, 128), bool)
    for t in range(12):
        mask = np.zeros((128, 128), bool)
        row, column = 40 + t * figure[1], 44 + t * figure[0]
        mask[row : row + 40, column : column + 40] = True
        own, other = (np.roll(s, (t * v[1], t * v[0]), (0, 1)) for s, v in zip(sheets, (figure, ground), strict=True))
        frames[t] = np.where(mask, own, other)
    return frames, mask


@pytest.mark.parametrize(("figure", "ground"), [((2, 1), (-1, 0)), ((0, 0), (0, 3)), ((1, 0), (0, 0))])
def test_velocities_and_outline(figure: tuple[int, int], ground: tuple[int, int]) -> None:
    frames, mask = film(figure, ground)
    found = figure_ground(frames)
    assert found.velocity == pytest.approx(figure, abs=0.1)
    assert found.ground == pytest.approx(ground, abs=0.05)
    assert (found.mask & mask).sum() / (found.mask | mask).sum() > 0.7
    assert found.confidence > 0.9
    # Contrast of either sign counts, and light does not.
    dark = figure_ground(100.0 - 0.2 * frames)
    assert dark.velocity == pytest.approx(found.velocity, abs=0.02)


def test_confidence_is_lower_without_a_figure() -> None:
    moving, _ = film((2, 1), (-1, 0))
    frames = np.where(np.random.default_rng(4).random((12, 128, 128)) < 0.03, 255, 128)
    assert figure_ground(frames).confidence < 0.8 < figure_ground(moving).confidence
    assert figure_ground(np.full((5, 64, 64), 7)).confidence == 0


@pytest.mark.parametrize("frames", [np.zeros((2, 64, 64)), np.zeros((5, 64)), np.full((5, 64, 64), np.nan)])
def test_refused(frames: np.ndarray) -> None:
    with pytest.raises(InputError, match="frames must be"):
        figure_ground(frames)


def test_a_velocity_at_the_end_of_the_map_stays_there() -> None:
    """Whatever the maps hold beyond the fastest velocity."""
    lags = np.arange(1, 13)
    maps = np.zeros((12, 129, 129), np.float32)
    maps[:, -1, -1] = 1
    assert np.isfinite(refined(maps, lags, np.ones(12), np.array([5.0, 5.3]))).all()
