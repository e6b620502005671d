"""White, grey and black of what has no hue."""

from __future__ import annotations

import numpy as np
import pytest

from ndtorch.foreground.segmentation import Segmentation
from ndtorch.tracking.color_names import ColorParams, WhiteBalance, achromatic_name
from ndtorch.tracking.masks import measure_detections
from ndtorch.tracking.track import Track


def light(tint: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> WhiteBalance:
    """Over grey ground of .4, with a white patch of .9 in view."""
    ground = np.full((3, 32, 40), 0.4, np.float32)
    picture = ground.copy()
    picture[:, 8:16, 8:16] = 0.9
    color = np.array(tint, np.float32)[:, None, None]
    return WhiteBalance(picture * color, ground * color, ColorParams())


def shares_of(light: WhiteBalance, *color: float) -> np.ndarray:
    """Shares of a mask of one color."""
    image, labels = np.empty((3, 32, 40), np.float32), np.zeros((32, 40), np.int32)
    image[:] = np.array(color, np.float32)[:, None, None]
    labels[4:20, 4:30] = 1
    noise, none = np.ones(3, np.float32), np.zeros((32, 40), np.uint8)
    seen = Segmentation(image, image[0], image, image, noise, labels > 0, none, none, False)
    (detection,) = measure_detections([Track.begin(0, 0.0, np.zeros(2))], labels, seen, light, set())
    assert detection is not None
    return detection.shades


@pytest.mark.parametrize(
    ("color", "name"),
    [
        ((0.85, 0.85, 0.85), "white"),
        ((0.3, 0.3, 0.3), "grey"),
        ((0.05, 0.05, 0.05), "black"),
        ((0.8, 0.2, 0.2), None),
        ((0.3, 0.35, 0.6), None),
        # A tinge is none.
        ((0.8, 0.83, 0.85), "white"),
    ],
)
@pytest.mark.parametrize("tint", [(1.0, 1.0, 1.0), (1.0, 0.9, 0.75)])
def test_by_daylight_and_lamplight(
    color: tuple[float, float, float], name: str | None, tint: tuple[float, float, float]
) -> None:
    shares = shares_of(light(tint), *(a * b for a, b in zip(color, tint, strict=True)))
    assert shares.sum() == pytest.approx(1, abs=1e-5)
    assert achromatic_name(shares) == name
