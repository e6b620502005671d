"""What takes longer than a short drive is done once in a process, or seldom: a building is painted once (a seed decides
what it looks like), and the garbage collector passes through the objects of all tests
before every tenth drive."""

from __future__ import annotations

import gc
import itertools
from collections.abc import Iterator
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import pytest

from ndtorch_robot import car
from ndtorch_robot.sim import simulation


@pytest.fixture(scope="session", autouse=True)
def painted_once() -> Iterator[None]:
    """Every simulation gets a copy of the corners: what it sets there is its own."""
    build = simulation.build
    kept = lru_cache(maxsize=4)(build)

    def copied(*given: Any) -> Any:
        world = kept(*given)
        return world._replace(corners=world.corners.copy())

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(simulation, "build", copied)
        yield


@pytest.fixture(scope="session", autouse=True)
def seldom_collected() -> Iterator[None]:
    drives = itertools.count()
    sparing = SimpleNamespace(
        collect=lambda: gc.collect() if next(drives) % 10 == 0 else 0, freeze=gc.freeze, unfreeze=gc.unfreeze
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(car, "gc", sparing)
        yield
