"""What detectors, features, fields and the camera's front end give is what is in `vision_values.txt`."""

from __future__ import annotations

from typing import Any

import pytest
import torch

from ndtorch import vision
from tests.properties import DT
from tests.test_properties import PARTS
from tests.values import compare, main, of_parts, table_of
from tests.vision.camera.passing_scenes import SIZE, passing


def front_end() -> Any:
    return vision.CameraFrontEnd(SIZE, 25.0)(passing(40, 4.0))


def coherent() -> Any:
    params = vision.CoherentParams(kept=0.3, fastest=9.0)
    return vision.CoherentMotion(SIZE, DT, params).advance(passing(16, 3.0))


def features() -> Any:
    return vision.VisualFeatures(SIZE)(passing(14, 4.0, first=2))


def curve() -> Any:
    answers = torch.tensor([[0.1, 0.3, 0.3, 0.8, 0.7, 0.9], [0.0, 0.2, 0.5, 0.6, 0.9, 0.2]], dtype=torch.float64)
    speeds = torch.tensor([0.5, 1.0, 2.0, 4.0, 8.0, 16.0], dtype=torch.float64)
    points = torch.linspace(0, 30, 25, dtype=torch.float64)
    weights = [vision.field_weights(points, 40, 8, border) for border in ("wrap", "reflect")]
    return vision.judge_speed_curve(speeds, answers), weights


SCENES = of_parts(PARTS, "ndtorch.vision") | {
    "front end": front_end,
    "coherent": coherent,
    "features": features,
    "curve": curve,
}


@pytest.mark.parametrize("scene", SCENES)
def test_the_numbers_are_those_that_were(scene: str) -> None:
    compare(table_of(__file__), scene, SCENES[scene])


if __name__ == "__main__":
    main(__file__, SCENES)
