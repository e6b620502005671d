"""Patches are found where they are, by kernel and by NumPy."""

import numpy as np
import pytest

from ndtorch_robot.drive import DriveConfig, drive
from ndtorch_robot.watching import agreement
from ndtorch_robot.watching.agreement import partners
from ndtorch_robot.watching.eye import SightLimits
from tests.robot.support.gl_needed import needs_gl

LIMITS, REACH = SightLimits(), 50


def row(seed, columns=160):
    return np.random.default_rng(seed).uniform(30, 220, columns).astype(np.float32)


@pytest.mark.parametrize("quickly", [True, False])
@pytest.mark.parametrize(("moved", "which"), [(12, 0), (-12, 1)])
def test_patches_lie_where_the_row_was_moved_to(monkeypatch, quickly, moved, which):
    if quickly:
        pytest.importorskip("numba")
    else:
        monkeypatch.setattr(agreement, "compiled", lambda: False)
    left = row(1)
    found = partners(left, np.roll(left, -moved), REACH, LIMITS)
    assert len(found[0]) == 9
    assert found[which].min() > 0.98
    assert max(found[2].max(), found[1 - which].max()) < 0.9
    mirrored = partners(left, np.roll(left[::-1], 3).copy(), 2 * REACH, LIMITS, 2 * REACH)[2]
    assert len(mirrored) == 5
    assert mirrored.max() > 0.98


@pytest.mark.parametrize("kind", ["alike", "unlike", "flat in places", "bright", "narrow"])
def test_kernel_and_numpy_find_the_same(monkeypatch, kind):
    pytest.importorskip("numba")
    left, right, reach = row(1), np.roll(row(1), -7) + row(2) / 10, REACH
    if kind == "unlike":
        right = row(3)
    elif kind == "flat in places":
        left[40:75], right[50:90] = 80, 70
    elif kind == "bright":
        left, right = 225 + left / 8, 225 + right / 8
    elif kind == "narrow":
        left, right, reach = left[:40], right[:40], 10
    quick = partners(left, right, reach, LIMITS)
    monkeypatch.setattr(agreement, "compiled", lambda: False)
    slow = partners(left, right, reach, LIMITS)
    assert len(quick[0]) == len(slow[0]) > 0
    for a, b in zip(quick, slow, strict=True):
        np.testing.assert_allclose(a, b, atol=2e-5)


@needs_gl
@pytest.mark.long
@pytest.mark.parametrize("seed", [100, 101, 105])
def test_good_cameras_in_a_dead_end_are_right(seed):
    """Walls on three sides, nearer than partners are looked for."""
    result = drive(DriveConfig(arena="dead-end", seed=seed, seconds=25))  # raises where a drive is ended
    assert result.summary["simulated_seconds"] == 25
