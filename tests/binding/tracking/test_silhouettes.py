"""What silhouettes show of each track: the kernel sees what its reference sees."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from ndtorch.binding.tracking.shades import Light, ShadeParams
from ndtorch.binding.tracking.silhouettes import marked, measured, told
from ndtorch.vision.camera.figures import Standing


def test_the_kernel_is_its_reference() -> None:
    pytest.importorskip("numba")
    chance, kind = np.random.default_rng(7), np.float32
    shape, names = (48, 64), [3, 5, 8, 9, 12]
    picture, ground = (chance.random((3, *shape)).astype(kind) for _ in range(2))
    deviation = chance.uniform(0.001, 0.05, (3, *shape)).astype(kind)
    # Ragged ones, one inside another's box, one of a single pixel, and one that is not seen.
    silhouettes = np.zeros(shape, np.int32)
    silhouettes[5:30, 6:40] = 3 * (chance.random((25, 34)) < 0.7)
    silhouettes[10:20, 12:24] = 5
    silhouettes[35:44, 50:64] = 8 * (chance.random((9, 14)) < 0.5)
    silhouettes[47, 0] = 9
    noise = np.array([0.006, 0.01, 0.02], kind)
    standing = Standing(
        picture, ground, deviation, noise, picture[0], silhouettes > 0, np.zeros_like(silhouettes, np.uint8), False
    )
    light = Light(picture, ground, ShadeParams())
    doubted = [True, False, True, True, True]
    table = chance.integers(0, 2, 14, np.uint8)
    plain = measured(names, doubted, silhouettes, standing, light)
    with torch.inference_mode():
        quick = measured(names, doubted, silhouettes, standing, light)
        named = told(silhouettes, table)
    assert np.array_equal(plain[:, :5], quick[:, :5])
    assert np.array_equal(named, told(silhouettes, table))
    assert np.allclose(plain, quick, rtol=1e-5, atol=1e-5)
    assert plain[0, 4] > 300
    assert plain[0, 14] > 1
    assert not plain[4].any()
    assert plain[1, 14] == 0


def test_where_objects_are_and_where_the_ground_is_kept() -> None:
    pytest.importorskip("numba")
    silhouettes = np.random.default_rng(1).integers(-3, 6, (21, 30)).clip(0).astype(np.int32)
    kept, other_kept = np.full((2, 21, 30), 7, np.float32)
    plain = marked(silhouettes, [0, 4], [2], 5, kept), kept
    with torch.inference_mode():
        quick = marked(silhouettes, [0, 4], [2], 5, other_kept), other_kept
        assert np.array_equal(told(silhouettes, np.arange(6, dtype=np.int32) * 7), silhouettes * 7)
    for one, other in zip(plain, quick, strict=True):
        assert np.array_equal(one, other)
        assert one.dtype == other.dtype
    assert np.array_equal(plain[0], (silhouettes == 1) | (silhouettes == 5))
    assert plain[1][silhouettes == 3].all()
    assert (silhouettes == 3).sum() < plain[1].sum() < plain[1].size
