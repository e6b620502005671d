"""What the watch of the cameras remembers and says is what is in `robot_values.txt`."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pytest

from ndtorch_robot.watching.sight import Sight
from tests.robot.watching.test_sight import CURVATURE, MOUNTS, RATE, RIG, SPEED, drive, frames
from tests.values import compare, main, table_of


def watched(mount: str = "", moving: bool = True, seconds: float = 6.0, light: float = 1.0, blind: int = 9999) -> Any:
    """When something was said, the words, and what is remembered then or at the end."""
    sight, n, why = Sight(RIG, RATE, 0.1), 0, None
    for n, part in enumerate(drive(seconds, moving=moving, light=light)):
        shown = [*MOUNTS[mount][0](part[0], part[1]), *part[2:]] if mount else list(part)
        if n >= blind:
            shown[0], shown[2] = (np.full_like(shown[k], 120.0) + (n + k) % 2 for k in (0, 2))
        why = sight.judge(frames(shown, n), SPEED if moving else 0.0, n / RATE, CURVATURE if moving else 0.0)
        if why is not None:
            break
    kept = {"before": sight.watch.before[-1], "ways": len(sight.watch.ways)}
    return n, why and why.words, vars(sight.watch) | kept


SCENES = {
    "good": watched,
    "standing": partial(watched, moving=False),
    "dim": partial(watched, light=0.3),
    "blind": partial(watched, blind=70),
    **{name: partial(watched, mount=name, seconds=12.0) for name in MOUNTS},
}


@pytest.mark.parametrize("scene", SCENES)
def test_the_numbers_are_those_that_were(scene: str) -> None:
    compare(table_of(__file__), scene, SCENES[scene])


if __name__ == "__main__":
    main(__file__, SCENES)
