"""Layers: labels of moving objects over a still ground."""

import numpy as np
import pytest

from ndtorch.errors import InputError
from ndtorch.tracking.layers import Layers
from ndtorch.tracking.regions import color_parts, commonest_color, shifted


def plain_crossing() -> tuple[np.ndarray, np.ndarray]:
    """Two squares of one color each; the second hides the first on its path."""
    frames, truth = np.full((10, 48, 48, 3), 30, np.uint8), np.zeros((10, 48, 48), int)
    for t in range(10):
        for label, (row, column), color in ((1, (10, 4 + 3 * t), (220, 30, 30)), (2, (14, 31 - 3 * t), (30, 30, 220))):
            frames[t, row : row + 12, column : column + 12] = color
            truth[t, row : row + 12, column : column + 12] = label
    return frames, truth


def textured() -> tuple[np.ndarray, np.ndarray]:
    """Two patches of a texture with the statistics of the ground."""
    rng = np.random.default_rng(5)
    ground, patches = rng.integers(0, 256, (64, 64, 3), np.uint8), rng.integers(0, 256, (2, 14, 14, 3), np.uint8)
    frames, truth = np.repeat(ground[None], 10, 0), np.zeros((10, 64, 64), int)
    for t in range(10):
        for label, (row, column) in ((1, (6 + 2 * t, 8)), (2, (40, 44 - 3 * t))):
            frames[t, row : row + 14, column : column + 14] = patches[label - 1]
            truth[t, row : row + 14, column : column + 14] = label
    return frames, truth


@pytest.mark.parametrize("video", [plain_crossing, textured])
def test_objects_keep_their_labels_and_their_silhouettes(video):
    frames, truth = video()
    labels, _ = Layers()(frames)
    for label in (1, 2):
        seen = labels[2:][truth[2:] == label]
        own = np.bincount(seen[seen > 0]).argmax()
        for t in range(2, 10):
            one, other = labels[t] == own, truth[t] == label
            assert (one & other).sum() >= 0.8 * (one | other).sum(), (label, t)


def test_chunks_are_the_whole():
    frames, _ = textured()
    whole, _ = Layers()(frames)
    first, state = Layers()(frames[:4])
    second, _ = Layers()(frames[4:], state)
    assert np.array_equal(np.concatenate([first, second]), whole)


def test_a_still_image_holds_no_object():
    frames = np.repeat(np.random.default_rng(0).integers(0, 256, (1, 32, 40, 3), np.uint8), 6, 0)
    assert not Layers()(frames)[0].any()


@pytest.mark.parametrize(
    "frames",
    [np.zeros((2, 8, 8)), np.zeros((2, 8, 8, 3)), np.zeros((2, 2, 8, 3), np.uint8), np.zeros((2, 8, 8, 4), np.uint8)],
)
def test_other_frames_are_refused(frames):
    with pytest.raises(InputError, match=r"frames must be \[T, H, W, 3\] uint8"):
        Layers()(frames)


def test_a_state_of_another_size_is_refused():
    _, state = Layers()(np.zeros((1, 8, 8, 3), np.uint8))
    with pytest.raises(InputError, match="do not go on"):
        Layers()(np.zeros((1, 8, 9, 3), np.uint8), state)


def test_parts_of_one_color():
    image = np.zeros((3, 5, 3), np.int32)
    image[:, 2] = 100
    image[:, 3:] = 3
    parts = color_parts(image, 2)
    assert len(np.unique(parts)) == 3
    assert (parts[:, 0] == parts[0, 1]).all()
    assert (parts[:, 3] == parts[0, 4]).all()
    assert commonest_color(image, 0.4).tolist() == [0, 0, 0]
    assert commonest_color(image, 0.5) is None


def test_shifted_moves_and_fills():
    image = np.arange(12).reshape(3, 4)
    assert np.array_equal(shifted(image, (1, -1), -1), [[-1, -1, -1, -1], [1, 2, 3, -1], [5, 6, 7, -1]])
    assert (shifted(image, (3, 0), 9) == 9).all()
