"""A building is painted once in a process: that takes longer than a short drive."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache

import pytest

from ndtorch_robot.sim import simulation


@pytest.fixture(scope="session", autouse=True)
def painted_once() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(simulation, "build", lru_cache(maxsize=4)(simulation.build))
        yield
