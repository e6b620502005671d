"""Mirrored, turned and upside-down clips give mirrored answers."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch.nn.functional import interpolate

import ndtorch
from ndtorch.vision import LocalFeatures, VisualFeatures
from ndtorch.vision._kernels_masked import sum_features
from ndtorch.vision.features import GROUPS
from ndtorch.vision.motion import Border

# Dimensions that are turned over, and which feature takes the place of which.
TURNS = {
    "mirrored": ((-1,), [1, 0, 2, 3, 4, 6, 5, 7, 8, 9]),
    "upside down": ((-2,), [0, 1, 3, 2, 4, 6, 5, 7, 8, 9]),
    "turned": ((-1, -2), [1, 0, 3, 2, 4, 5, 6, 7, 8, 9]),
}


# The last two are large enough for rows or columns to be thinned.
@pytest.mark.parametrize("size", [(48, 60), (33, 50), (40, 388), (388, 41)])
@pytest.mark.parametrize("kernels", [True, False])
@pytest.mark.parametrize("border", ["wrap", "reflect"])
def test_signals_of_fields(size: tuple[int, int], border: Border, kernels: bool) -> None:
    video = torch.rand(3, 3, *size, generator=torch.Generator().manual_seed(0))
    whole = VisualFeatures(size, border=border)
    local = LocalFeatures(whole, 5)
    with torch.inference_mode() if kernels else torch.no_grad():
        (sums, _), (fields, _) = whole(video), local(video)
        for dims, order in TURNS.values():
            turned = video.flip(dims)
            back = local(turned)[0].flip([dim - 1 for dim in dims])
            for there, here in ((whole(turned)[0], sums), (back, fields)):
                for part in GROUPS.values():
                    difference = (there[..., order] - here)[..., part].abs().amax()
                    assert difference < 1e-5 * here[..., part].amax()


def test_figures() -> None:
    size = (96, 128)
    generator = torch.Generator().manual_seed(0)
    coarse = 0.2 + 0.5 * torch.rand(1, 3, 12, 16, generator=generator)
    video = interpolate(coarse, size, mode="bilinear").repeat(34, 1, 1, 1)
    for n in range(6, 34):  # a red box goes right and a little down, then a green one left
        video[n, 0, 20 + n // 3 : 44 + n // 3, 3 * n : 3 * n + 20] = 0.9
        if n > 14:
            video[n, 1, 66 : 66 + 15, 101 - 3 * n + 40 : 118 - 3 * n + 40] = 0.95
    video = (video + 0.01 * torch.randn(video.shape, generator=generator)).clamp(0, 1)
    model = ndtorch.load("foreground", size=size, fps=25.0)
    with torch.inference_mode():
        upright, state = model(video)
        wanted = model.objects(state)
        assert len(wanted) == 2
        for dims, order in TURNS.values():
            signals, state = model(video.flip(dims))
            assert torch.equal(signals.mask.flip(dims), upright.mask)
            assert torch.equal(signals.labels.flip(dims), upright.labels)
            # Before the root, which makes .0003 of what rounding leaves of no motion.
            torch.testing.assert_close(signals.inputs[..., order] ** 2, upright.inputs**2, atol=1e-5, rtol=0)
            for thing, other in zip(wanted, model.objects(state), strict=True):
                path, mirrored = torch.tensor(thing.path), torch.tensor(other.path)
                for dim in dims:
                    mirrored[:, 2 + (dim == -1) * -1] = size[dim] - mirrored[:, 2 + (dim == -1) * -1]
                torch.testing.assert_close(mirrored, path, atol=1e-3, rtol=0)


def test_what_is_measured_of_a_mirrored_image_is_mirrored_to_the_bit() -> None:
    image, ground = np.random.default_rng(5).random((2, 3, 20, 24), dtype=np.float32)
    slow, delayed = np.random.default_rng(5).random((2, 3, 10, 12), dtype=np.float32)
    names = np.zeros((20, 24), np.int32)
    names[3:15, 5:14] = 2  # an edge within a block of two by two pixels

    def strongest(*images: np.ndarray) -> np.ndarray:
        found, given = np.empty((10, 12), np.float32), [image.copy() for image in images]
        sum_features(*given, (0.1, 0.4), found, np.empty((4, 6)))
        return found

    one = strongest(image, ground, names, slow, delayed)
    other = strongest(*(image[..., ::-1] for image in (image, ground, names, slow, delayed)))
    assert np.array_equal(one, other[:, ::-1])
    assert one.max() > 0
