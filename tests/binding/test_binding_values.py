"""What the models, the networks and the read-outs give is what is in `binding_values.txt`."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

import ndtorch
from ndtorch.binding.models.retinotopic import RetinotopicConfig, RetinotopicModel
from ndtorch.binding.objects import ObjectTable
from ndtorch.binding.readout.common_fate import coherent_patches
from ndtorch.binding.readout.sums import SumStatistics, sums_table
from ndtorch.binding.tracking.detections import detections
from ndtorch.binding.tracking.tracks import Track, TrackParams, follow, standing
from ndtorch.binding.tracking.windows import Windows
from ndtorch.scenes import CommonFate
from ndtorch.vision import CoherentMotion
from tests.binding.models.test_figures import squares
from tests.binding.readout.three_lights import MIXING, lights
from tests.properties import samples
from tests.test_properties import PARTS
from tests.values import compare, main, of_parts, table_of
from tests.vision.camera.passing_scenes import SIZE, passing


def figures() -> Any:
    """Three squares, of which two meet."""
    model = ndtorch.load("figures", size=SIZE, fps=25.0)
    red, blue = (0.8, 0.2, 0.2), (0.1, 0.2, 0.8)
    film = squares(44, (0, 4.0, 40, red), (170, -4.0, 44, blue), (60, 2.0, 84, (0.9, 0.9, 0.2)))
    signals, state = model((film * 255).round().to(torch.uint8))
    return signals, state, model.objects(state)


def video() -> Any:
    model = ndtorch.load("video", size=SIZE, fps=25.0)
    signals, state = model(passing(40, 4.0))
    return signals, state, model.objects(state)


def small(model: Any, size: int, steps: int) -> Any:
    """Two trials of a model, of stripes and of noise."""
    chance = torch.Generator().manual_seed(3)
    frames = [samples((1, steps, 3, size, size), kind, chance) for kind in ("edges", "noise")]
    signals, state = model.double()(torch.cat(frames))
    return signals, state, model.objects(state)


def sums(seconds: float, leaves: float) -> Any:
    """Of three things, of which one leaves."""
    light = lights(seconds)
    light[round(100 * leaves) :, 1] = 0.0
    state = SumStatistics()(100 * light @ MIXING)
    none = ObjectTable(torch.zeros(10, dtype=torch.bool), torch.zeros(10, 10))
    return state, sums_table(none, torch.zeros(10, 10), state, torch.zeros(10, 10))


def patches() -> Any:
    scene = CommonFate(1.4, seed=1)
    motion = CoherentMotion(scene.size, 1 / scene.fps)
    return [
        found._replace(mask=found.mask.sum((0, 1)))
        for found in coherent_patches(motion, motion.advance(scene.frames(0, scene.length)))
    ]


def crowd() -> Any:
    """Fields that move by chance, some together: what is seen at each step, and the tracks and objects at the end."""
    chance, params, aspect = np.random.default_rng(4), TrackParams(shortest=0.2, travel=0.02), 1.5
    open_: list[Track] = []
    gone, seen = [], []
    for n in range(24):
        motion = chance.normal(0, 0.02, (8, 12, 2))
        for k, (row, column) in enumerate([(1, n // 3), (2 + n // 12, 11 - n // 4), (6, 2), (6, 8 - n // 6)]):
            motion[row : row + 2, column : column + 2] += (0.6 - 0.3 * k, 0.1 * k)
        signals = [chance.random((96, 14)) for _ in range(2)]
        found = detections(motion, signals[0], signals[1], chance.random((8, 12)), 0.02, 1.0, params)
        open_, late = follow(open_, 0.04 * n, found, len(open_) + len(gone), aspect, params)
        gone += late
        seen.append((len(found), sum(len(one.fields) * k for k, one in enumerate(found))))
    return seen, open_, gone, standing(open_ + gone, 0.04, aspect, params)


def windows() -> Any:
    """Where windows are that follow things around a torus, in three trials of which each sees more."""
    layer, chance = Windows((6, 8), 5.0, border="wrap"), torch.Generator().manual_seed(2)
    steps = torch.arange(160)
    fields = 0.02 * torch.rand(3, 160, 6, 8, 10, generator=chance)
    for trial in range(3):
        for k in range(trial + 1):
            fields[trial, steps, 2 * k, (3 * k + steps // 6) % 8, 1 + k :: 4] += 1.0
    state = layer(fields)[1]
    return state, layer.places(state), layer.confirmed(state), layer.before_light(state)


APART = {"PublishedModel", "ScaleFreeModel"}
"""Of pictures as small as those, their inputs differ by some percent between processors."""

SCENES = of_parts({name: part for name, part in PARTS.items() if name not in APART}, "ndtorch.binding") | {
    "figures": figures,
    "video": video,
    "retinotopic": lambda: small(RetinotopicModel(RetinotopicConfig(size=(24, 24), fps=100.0)), 24, 60),
    "sums": lambda: sums(20, 12),
    "sums of one that left just now": lambda: sums(9, 8.5),
    "patches": patches,
    "crowd": crowd,
    "windows": windows,
}


@pytest.mark.parametrize("scene", SCENES)
def test_the_numbers_are_those_that_were(scene: str) -> None:
    # The rule of the model `video` divides by the power of weak outputs, and rounding grows in it.
    compare(table_of(__file__), scene, SCENES[scene], 5e-3 if scene == "video" else 1e-4)


if __name__ == "__main__":
    main(__file__, SCENES)
