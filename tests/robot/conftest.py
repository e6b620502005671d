"""Buildings are painted once in a process: a seed decides what one looks like, and painting takes longer than a short
drive."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import pytest

from ndtorch_robot.sim import simulation


@pytest.fixture(scope="session", autouse=True)
def painted_once() -> Iterator[None]:
    """Every simulation gets a copy of the model: what it sets there is its own."""
    build = simulation.build
    kept = lru_cache(maxsize=4)(build)

    def copied(*given: Any) -> Any:
        world = kept(*given)
        return world._replace(model=copy.copy(world.model), profiles=[line.copy() for line in world.profiles])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(simulation, "build", copied)
        yield
