"""What silhouettes show of each track: the kernel sees what its reference sees."""

from __future__ import annotations

import numpy as np
import pytest

from ndtorch.foreground.noise import MEAN_SIZE
from ndtorch.foreground.segmentation import Segmentation
from ndtorch.tracking.color_names import ColorParams, WhiteBalance
from ndtorch.tracking.masks import measure_detections
from ndtorch.tracking.track import Track, TrackState


def test_what_masks_show_of_each_track() -> None:
    chance, kind = np.random.default_rng(7), np.float32
    shape, numbers = (48, 64), [2, 4, 7, 8, 11]
    image, background = (chance.random((3, *shape)).astype(kind) for _ in range(2))
    deviation = chance.uniform(0.001, 0.05, (3, *shape)).astype(kind)
    # Ragged ones, one inside another's box, one of a single pixel, and one that is not seen.
    labels = np.zeros(shape, np.int32)
    labels[5:30, 6:40] = 3 * (chance.random((25, 34)) < 0.7)
    labels[10:20, 12:24] = 5
    labels[35:44, 50:64] = 8 * (chance.random((9, 14)) < 0.5)
    labels[47, 0] = 9
    noise = np.array([0.006, 0.01, 0.02], kind)
    none = np.zeros(shape, np.uint8)
    seen = Segmentation(image, image[0], background, deviation, noise, labels > 0, none, none, False)
    tracks = [Track.begin(number, 0.0, np.zeros(2)) for number in numbers]
    tracks[1].state = TrackState.CONFIRMED
    light = WhiteBalance(image, background, ColorParams())
    found = measure_detections(tracks, labels, seen, light, {7})
    assert found[4] is None
    contrast = np.abs(image - background) / np.maximum(deviation / MEAN_SIZE, noise[:, None, None])
    for number, detection in zip(numbers[:4], found, strict=False):
        assert detection is not None
        rows, columns = np.nonzero(labels == number + 1)
        inside = labels == number + 1
        top, left, bottom, right = rows.min(), columns.min(), rows.max() + 1, columns.max() + 1
        assert detection.pixels == pytest.approx(len(rows) / 48**2)
        assert detection.place == pytest.approx(((top + bottom) / 96, (left + right) / 96))
        assert detection.extent == pytest.approx(((bottom - top) / 48, (right - left) / 48))
        assert detection.color == pytest.approx(image[:, inside].mean(1), rel=1e-4)
        assert detection.shared == (number == 7)
        # Objects, and what shares its blob, are not asked how far they stand out.
        wanted = 0 if number in (4, 7) else contrast[:, inside].max(0).mean()
        assert detection.contrast == pytest.approx(wanted, rel=1e-4)
        nearest = ((rows - rows.mean()) ** 2 + (columns - columns.mean()) ** 2).argmin()
        inner = 48 * np.array(detection.inner) - 0.5
        assert np.abs(inner - [rows[nearest], columns[nearest]]).max() < 0.5 + 1e-6
        assert detection.shades.sum() == pytest.approx(1, abs=1e-5)
