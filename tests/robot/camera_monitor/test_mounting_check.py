"""Patches match where they are, and wrongly mounted cameras are detected by their matches."""

from itertools import count
from types import SimpleNamespace

import numpy as np
import pytest

from ndtorch.navigation.options import NavigatorOptions
from ndtorch.navigation.stereo.strips import strips
from ndtorch_robot.camera_monitor.floor_check import measure_floor, moved_level
from ndtorch_robot.camera_monitor.frame_check import FrameCheck
from ndtorch_robot.camera_monitor.limits import CameraLimits
from ndtorch_robot.camera_monitor.mounting_check import EVERY, MAX_PER_VIEW, MountingCheck, correlations
from ndtorch_robot.car import Car
from ndtorch_robot.drive import DriveConfig, drive
from ndtorch_robot.navigator_runner import NavigatorRunner
from ndtorch_robot.safety import SafeDrive, SafetyLimits
from ndtorch_robot.sim.arenas import load_arena
from ndtorch_robot.sim.simulation import RIG, Simulation

LIMITS, REACH = CameraLimits(), 50
ONLY_MIRRORED = CameraLimits(swapped_sum=1e3)


def row(seed, columns=160):
    return np.random.default_rng(seed).uniform(30, 220, columns).astype(np.float32)


@pytest.mark.parametrize(("moved", "which"), [(12, 0), (-12, 1)])
def test_patches_match_where_the_row_was_moved_to(moved, which):
    left = row(1)
    found = correlations(left, np.roll(left, -moved), REACH, LIMITS)
    assert len(found[0]) == 9
    assert found[which].min() > 0.98
    assert max(found[2].max(), found[1 - which].max()) < 0.9
    mirrored = correlations(left, np.roll(left[::-1], 3).copy(), 2 * REACH, LIMITS, 2 * REACH)[2]
    assert len(mirrored) == 5
    assert mirrored.max() > 0.98


def test_correlations_by_their_definition():
    """One patch of a narrow row, against `np.corrcoef`; `SOFT` lowers it by less than 0.01."""
    left, right = row(1)[:40], row(1)[:40] + row(2)[:40] / 10
    found = correlations(left, right, 10, LIMITS)
    patch = left[10:30]

    def best(starts, patch):
        return max(np.corrcoef(patch, right[at : at + 20])[0, 1] for at in starts)

    assert found[0][0] == pytest.approx(best(range(10), patch), abs=0.01)
    assert found[1][0] == pytest.approx(best(range(12, 21), patch), abs=0.01)
    assert found[2][0] == pytest.approx(best(range(21), patch[::-1]), abs=0.01)


def test_flat_patches_are_not_compared():
    flat = row(1)
    flat[40:80] = 80
    assert len(correlations(flat, flat, REACH, LIMITS)[0]) == len(correlations(row(1), row(1), REACH, LIMITS)[0]) - 3


def seen(row):
    """As much of an eye as is compared."""
    return SimpleNamespace(row=row)


def judged(rows, views, limits=LIMITS, upright=False):
    """What is said of pairs of rows, each of `EVERY` times looked at, and the judge."""
    judge = MountingCheck(limits, 4 * REACH)
    said = None
    for (left, right), view in zip(rows, views, strict=True):
        for _ in range(EVERY):
            said = judge.compare(seen(left), seen(right), view, upright=upright) or said
    return said, judge


def moved(blocks):
    """Rows of noise, each with its partner so many blocks away."""
    return [(row(n), np.roll(row(n), -blocks)) for n in range(8)]


def test_two_views_say_too_little_of_a_mirrored_row():
    """Right before a wall much fits by chance, in all patches at once."""
    upside_down = [(left, right[::-1].copy()) for left, right in moved(-1)]
    for views, told in ((2, False), (3, False), (4, True)):
        said, judge = judged(upside_down[:views], [(0.05 * n, 0.0) for n in range(views)], ONLY_MIRRORED)
        assert 0.9 * views * MAX_PER_VIEW < judge.mirrored <= views * MAX_PER_VIEW
        assert (said is not None) == told


def test_wrong_cameras_are_told_on_the_way_and_good_ones_are_not():
    way = [(0.05 * n, 0.0) for n in range(8)]
    said, judge = judged(moved(12), way)
    assert (said, judge.swapped, judge.mirrored) == (None, 0, 0)
    said, judge = judged(moved(-12), way)
    assert "swapped" in said
    assert judge.swapped > 8 * 9 * 0.1
    upside_down = [(left, right[::-1].copy()) for left, right in moved(-1)]
    said, judge = judged(upside_down, way)
    assert "upside down" in said
    assert judge.mirrored > LIMITS.mirrored_sum


@pytest.mark.parametrize(("step", "heading"), [(0.0, 0.0), (0.009, 0.011)])
def test_a_view_is_looked_at_once(step, heading):
    """A corner that by chance fits wrongly does not become likelier while the car stands, or creeps."""
    count = 5
    said, judge = judged(moved(-12)[:1] * count, [(step * n, heading * n) for n in range(count)])
    once = judged(moved(-12)[:1], [(0.0, 0.0)])[1].swapped
    assert said is None
    assert 0 < once < LIMITS.swapped_sum
    assert judge.swapped == once
    assert judged(moved(-12)[:1] * count, [None] * count)[1].swapped == pytest.approx(count * once)
    assert judged(moved(-12)[:1] * count, [(0.0, 0.06 * n) for n in range(count)])[1].swapped == pytest.approx(
        count * once
    )


def test_cameras_whose_pictures_turn_as_the_wheels_say_are_not_upside_down():
    """Whatever fits when mirrored: a place may nearly be its own mirror image. They may still be swapped."""
    way = [(0.05 * n, 0.0) for n in range(8)]
    upside_down = [(left, right[::-1].copy()) for left, right in moved(-1)]
    assert judged(upside_down, way, upright=True)[0] is None
    assert "swapped" in judged(moved(-12), way, upright=True)[0]


def test_a_near_wall_in_both_pictures_says_nothing_of_the_rows():
    """Met in a soak: good cameras .3 m before a wall, whose rows fit when mirrored and on the wrong side."""
    judge = MountingCheck(LIMITS, 4 * REACH)
    wrong = [*moved(-12), *((left, right[::-1].copy()) for left, right in moved(-1))]
    for wall in (True, False):
        for n, (left, right) in enumerate(wrong):
            judge.count = 0
            said = judge.compare(seen(left), seen(right), (0.05 * n, 0.0), near_wall=wall)
        assert (judge.swapped > 0, judge.mirrored > 0, said is not None) == (not wall, not wall, not wall)


@pytest.mark.long
@pytest.mark.parametrize("seed", [100, 101, 105])
def test_good_cameras_in_a_dead_end_are_right(seed):
    """Walls on three sides, nearer than partners are looked for."""
    result = drive(DriveConfig(arena="dead-end", seed=seed, seconds=25))  # raises where a drive is ended
    assert result.summary["simulated_seconds"] == 25


FLOOR_LIMITS = SafetyLimits(speed=0.6, curvature=2.2, silence=0.1, age=0.1)


def reading(world):
    """Frames of a car that stands."""
    moments = count(1)

    def read():
        world.wait_until(next(moments) / 30)
        return world.read()

    return read


@pytest.mark.slow
def test_the_level_is_the_one_that_driving_teaches():
    runner = NavigatorRunner(NavigatorOptions(), RIG, 30.0)
    world = Simulation(load_arena("dead-end", 3), 3, fields=runner.fields)
    try:
        frames = world.read()
        told = moved_level(runner.navigator.controller, strips(frames.left), strips(frames.right), RIG)
        check = FrameCheck(RIG, 30.0, FLOOR_LIMITS.age, joint_freeze=False)
        Car(runner, world, SafeDrive(world, world, FLOOR_LIMITS, check)).run(0.8, warm_up=False)
        learned = runner.state.control.floor.level
        assert np.abs(np.log(told[:6] / learned[:6])).max() < 0.4
    finally:
        world.close()


@pytest.mark.slow
def test_smooth_floor_will_not_do():
    world = Simulation(load_arena("smooth", 3), 3, fields=NavigatorOptions().fields(RIG))
    try:
        found = measure_floor(reading(world), RIG, 30.0)
    finally:
        world.close()
    assert not found.good
    assert not found.ahead
    assert found.speed == 0
    assert "the floor shows little" in found.words()[0]
