"""The ranging controller in closed loop: no collision where it drives, and collisions where its turns are mirrored."""

import numpy as np
import pytest

from ndtorch.navigation import CRUISE, SUPPRESSED, TURN
from ndtorch_robot.config import DriveConfig
from ndtorch_robot.drive import drive
from ndtorch_robot.ports import DriveCommand

SEED = 21
"""Of the short drives below; taken before anything was driven with it, and not one that anything was tuned on."""


def mirrored(command):
    """Turns the other way, and cannot reverse out of it."""
    return DriveCommand(abs(command.speed), -command.curvature)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arena", "walls", "seconds"),
    [
        ("loop", "textured", 20),
        pytest.param("loop", "textured", 60, marks=pytest.mark.long),
        pytest.param("room", "blank", 60, marks=pytest.mark.long),
    ],
)
def test_driving_without_collisions(arena, walls, seconds):
    result = drive(DriveConfig(arena=arena, walls=walls, seed=SEED, seconds=seconds))
    assert result.summary["collisions"] == 0
    assert result.summary["stopped"] == 0
    assert result.summary["controller"] == "ranging"
    assert result.summary["distance_m"] > 25 / 60 * seconds
    assert result.summary["free_area_passed"] > 0.4 / 60 * seconds
    mode = result.record.array("mode").astype(int)
    assert mode[0] == SUPPRESSED
    assert {CRUISE, TURN} <= set(np.unique(mode))


@pytest.mark.slow
def test_turning_the_wrong_way_collides():
    result = drive(DriveConfig(arena="loop", seed=SEED, seconds=21), steer=mirrored)
    assert result.summary["collisions"] >= 1
