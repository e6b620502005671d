"""Patches of dots, told by their common motion."""

from __future__ import annotations

import math

import pytest
import torch

from ndtorch.binding.readout.common_fate import coherent_patches
from ndtorch.scenes import CommonFate
from ndtorch.vision import CoherentMotion


@pytest.mark.parametrize(("ground", "coherence"), [(0.0, 1.0), (1.0, 1.0), (0.0, 0.5)])
def test_a_patch_is_found_with_its_place_motion_and_outline(ground: float, coherence: float) -> None:
    scene = CommonFate(1.6, seed=1, ground=ground, coherence=coherence)
    motion = CoherentMotion(scene.size, 1 / scene.fps)
    (found,) = coherent_patches(motion, motion.advance(scene.frames(0, scene.length)))
    mask = scene.masks(scene.length - 1, scene.length)[0, 0]
    assert math.dist(found.place, scene.centers(scene.length - 1, scene.length)[0, 0].tolist()) < 6
    assert math.dist(found.velocity, scene.patches[0].velocity) < 3
    overlap = float((found.mask & mask).sum() / (found.mask | mask).sum())
    assert overlap > (0.75 if coherence == 1 else 0.6)


def test_dots_that_move_each_its_own_way_are_no_patch_nor_is_light_alone() -> None:
    scene = CommonFate(1.2, seed=2, patches=0)
    motion = CoherentMotion(scene.size, 1 / scene.fps)
    assert coherent_patches(motion, motion.advance(scene.frames(0, scene.length))) == []
    light = torch.rand(20, 1, 1, 1, generator=torch.Generator().manual_seed(0)).expand(20, 3, *scene.size)
    assert coherent_patches(motion, motion.advance(light)) == []
