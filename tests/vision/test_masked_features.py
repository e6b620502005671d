"""Signals of masks: orientation is that of the filters of whole images, summed over the mask."""

from __future__ import annotations

import numpy as np
import torch

from ndtorch.vision import OrientedDoG
from ndtorch.vision.masked_features import CENTER, SURROUND, MaskedFeatures


def test_orientation_in_a_mask_is_that_of_the_whole_image() -> None:
    chance, size = np.random.default_rng(2), (80, 120)
    image, background = chance.random((2, 3, *size)).astype(np.float32)
    labels = np.zeros(size, np.int32)
    # One touches two edges of the image; tracks 0 and 2 have signals.
    labels[:30, :20], labels[40:70, 50:90] = 1, 3
    features = MaskedFeatures(size, 0.04)
    measured = features.measure(image, background, labels, features.start(image, background, labels))
    found = features.signals([measured], [labels])[0].double()
    filters = OrientedDoG((40, 60), center=CENTER, surround=SURROUND, border="reflect", exact=True)
    responses = filters.images(torch.from_numpy(measured.strongest)).abs().double()
    for field, mask in ((0, labels[::2, ::2] == 1), (2, labels[::2, ::2] == 3)):
        means = responses[:, torch.from_numpy(mask)].mean(1)
        assert torch.allclose(found[field, 4:7] ** 2, means - means.min(), atol=0.02 * float(means.max()))
        assert found[field, 4:7].max() > 0
    assert not found[1].any()
