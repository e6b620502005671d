"""The driven path: what is kept of it, and backing out on it."""

import math

import numpy as np
import pytest

from ndtorch.navigation import Pose
from ndtorch.navigation.local_grid import POSES, SPACING, DrivenPath, pure_pursuit_back, record
from ndtorch.navigation.odometry import arc

DT, TIGHT = 1 / 30, 2.0


def drive(path, pose, moves):
    """Drive (speed, curvature, steps) after each other; returns path and pose."""
    for speed, curvature, steps in moves:
        for _ in range(steps):
            pose = arc(pose, speed, curvature, DT)
            path = record(path, tuple(pose), speed)
    return path, pose


def started(x=0.0, y=0.0, heading=0.0):
    nothing = DrivenPath(np.zeros((POSES, 3), np.float32), 0)
    return record(nothing, (x, y, heading), 0.0), Pose(x, y, heading)


def test_it_is_as_long_as_the_way_up_to_its_end():
    path, pose = drive(*started(), [(0.5, 0.0, 60)])
    length, bend = pure_pursuit_back(path, tuple(pose), TIGHT)
    # 1 m, in whole spacings, which a step of 1.7 cm makes up to that much longer.
    assert 1.0 - 17 * 0.017 < length <= 1.0
    assert bend == pytest.approx(0.0, abs=1e-6)
    path, pose = drive(path, pose, [(0.5, 0.0, 600)])
    assert pure_pursuit_back(path, tuple(pose), TIGHT)[0] == pytest.approx((POSES - 1) * SPACING)


@pytest.mark.parametrize("bend", [2.0, -1.0])
def test_a_car_goes_back_the_way_it_came(bend):
    """An arc after a straight, back to where it began: soon beside the path by little, at the end as it stood."""
    path, pose = drive(*started(1.0, -2.0, 0.7), [(0.5, 0.0, 60), (0.4, bend, 45)])
    away = []
    for _ in range(300):
        length, follow = pure_pursuit_back(path, tuple(pose), TIGHT)
        if length < 0.1:
            break
        pose = arc(pose, -0.3, follow, DT)
        path = record(path, tuple(pose), -0.3)
        ahead = (pose.x - 1.0) * math.cos(0.7) + (pose.y + 2.0) * math.sin(0.7)
        if ahead < 0.9:
            away.append(abs((pose.y + 2.0) * math.cos(0.7) - (pose.x - 1.0) * math.sin(0.7)))
    assert len(away) > 60
    assert max(away) < 0.06
    assert away[-1] < 0.015
    assert pose.heading == pytest.approx(0.7, abs=0.05)
