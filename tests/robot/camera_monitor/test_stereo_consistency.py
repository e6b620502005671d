"""Both cameras see one floor, or they do not any more."""

import functools
import math

import cv2
import numpy as np
import pytest
import torch

from ndtorch.navigation import Strips
from ndtorch.navigation.options import NavigatorOptions
from ndtorch.navigation.proximity.floor_consistency import floor_correlation
from ndtorch_robot.camera_monitor.frame_check import FrameCheck
from ndtorch_robot.camera_monitor.image_quality import one_color
from ndtorch_robot.camera_monitor.mounting_check import EVERY
from ndtorch_robot.camera_monitor.stereo_consistency import (
    BEFORE,
    EXCHANGED_VIEWS,
    VIEWS,
    StereoConsistency,
    clarity,
    wall_correlation,
)
from ndtorch_robot.config import DriveConfig
from ndtorch_robot.drive import drive
from ndtorch_robot.faults import FaultKind
from ndtorch_robot.ports import StereoFrames
from ndtorch_robot.sim.simulation import RIG

RECTS = NavigatorOptions().fields(RIG)
GRAIN = 0.006
"""Size of a spot of the carpet, m."""
WAY = 0.05
"""Between two looks, m."""


@functools.cache
def carpet():
    """Levels 60 to 200 or so, 6.6 m long and 3 m wide."""
    spots = np.random.default_rng(3).normal(0, 1, (1100, 500)).astype(np.float32)
    return 128 + 60 * cv2.GaussianBlur(spots, (0, 0), 0.8)


def floor(at, sides=(0.5, -0.5)):
    """What both cameras see of it from `at` m on, levels `[h, w]`; `sides` are where they are, in baselines."""
    pictures = []
    for side, rect in zip(sides, RECTS, strict=True):
        rows, columns = np.mgrid[rect.top : rect.bottom, rect.left : rect.right].astype(np.float32)
        ahead = RIG.focal * RIG.camera_height / (rows - (RIG.height - 1) / 2)
        aside = side * RIG.baseline + ahead * ((RIG.width - 1) / 2 - columns) / RIG.focal
        pictures.append(cv2.remap(carpet(), (aside + 1.5) / GRAIN, (ahead + at) / GRAIN, cv2.INTER_LINEAR))
    return pictures


def strips(left, right, noise=1.0, seed=0):
    """Of two pictures in levels, with noise; the rows show something else."""
    rng = np.random.default_rng(seed)
    wall = rng.uniform(60, 200, 900).repeat(5)
    out = []
    for at, picture in zip((0, 60), (left, right), strict=True):
        levels = np.clip(np.rint(picture + rng.normal(0, noise, picture.shape)), 0, 255).astype(np.uint8)
        row = torch.from_numpy(wall[at : at + RIG.width].astype(np.uint8))
        out.append(Strips(torch.from_numpy(levels)[None].repeat(3, 1, 1), row.repeat(3, 1, 1)))
    return out


def upside_down(left, right):
    """The right one is."""
    return left, right[::-1, ::-1]


def look(judge, count, change=lambda left, right: (left, right), begin=0, moving=True, light=1.0, source=floor):
    """So many looks that are looked into; the last answer."""
    sure = False
    for n in range(begin, begin + count):
        left, right = change(*source(WAY * n))
        pair = strips(light * left, light * right, seed=n)
        view = (WAY * n if moving else 0.0, 0.0)
        answers = [judge.compare(*pair, view) for _ in range(EVERY)]
        assert not any(answers[1:])  # one of so many is looked into
        sure = answers[0]
    return sure


def judge():
    return StereoConsistency(RIG, RECTS)


def test_good_cameras_see_one_floor():
    mine = judge()
    assert look(mine, 2 * VIEWS)
    assert (mine.seen, mine.without, mine.lost) == (2 * VIEWS, 0, False)


def test_cameras_are_swapped_when_so_many_views_show_one_floor_with_their_images_exchanged():
    """With and without a floor seen before; a car that stands has one view."""
    for first in (0, BEFORE):
        mine = judge()
        look(mine, first)
        exchanged = {"source": functools.partial(floor, sides=(-0.5, 0.5)), "begin": 20}
        look(mine, EXCHANGED_VIEWS, moving=False, **exchanged)
        assert mine.exchanged == 1
        look(mine, EXCHANGED_VIEWS - 2, **exchanged)
        assert not mine.swapped
        look(mine, 1, **exchanged | {"begin": 40})
        assert mine.swapped
        mine.reset()
        assert not mine.swapped


def test_a_floor_that_was_seen_is_lost_after_so_many_views():
    mine, change = judge(), upside_down
    look(mine, BEFORE)
    assert not look(mine, VIEWS - 1, change, begin=BEFORE)
    assert not mine.lost
    look(mine, 1, change, begin=BEFORE + VIEWS)
    assert not mine.swapped
    assert mine.lost
    mine.reset()
    assert not mine.lost
    look(mine, 1, begin=100)
    assert (mine.without, mine.seen) == (0, BEFORE + 1)


def test_a_car_that_stands_loses_no_floor():
    mine = judge()
    look(mine, BEFORE)
    look(mine, 2 * VIEWS, upside_down, moving=False)
    assert mine.without == 1


def test_noise_is_no_floor_and_no_other_one():
    mine = judge()
    look(mine, BEFORE)
    look(mine, VIEWS, light=0.02)
    assert (mine.without, mine.seen) == (0, BEFORE)
    rng = np.random.default_rng(0)
    assert clarity(rng.normal(0, 1, (70, 560)).astype(np.float32)) < 0.05
    assert clarity(np.full((70, 560), 0.5, np.float32)) == 0.0
    assert clarity(floor(0.0)[0].astype(np.float32)) > 0.8


@pytest.mark.parametrize("seed", range(3))
def test_in_the_dark_noise_leaves_enough_of_one_floor(seed):
    """Less than it takes in the light, but all that it can be."""

    def looks(change):
        mine, found = judge(), []
        for n in range(10 * seed, 10 * seed + 10):
            left, right = strips(*(0.08 * picture for picture in change(*floor(WAY * n))), seed=n)
            pair = [one_color(eye.field).astype(np.float32) / 255 for eye in (left, right)]
            found.append((floor_correlation(*pair, RECTS, RIG, mine.params), mine.compare(left, right, (n, 0.0))))
            mine.count = 0
        return found

    good, wrong = looks(lambda *eyes: eyes), looks(upside_down)
    assert all(0.35 < likeness < 0.7 and sure for likeness, sure in good)
    assert all(likeness < 0.3 and not sure for likeness, sure in wrong)


def test_a_near_wall_hides_the_floor_of_good_cameras():
    """Both see it, as far apart in all rows as it is near."""
    paper = floor(0.0)[0].astype(np.float32)
    left, right = paper, np.roll(paper, 80 - 150, 1)
    anywhere, near = wall_correlation(left, right)
    assert anywhere > 0.99
    assert near < 0.5
    assert max(wall_correlation(left, right[::-1, ::-1])) < 0.5
    assert wall_correlation(left[:, :50], right[:, :50]) == (0.0, 0.0)
    window, patch = right[::4, 58:122], left[::4, 128:192]  # by the definition, for the best of them
    assert anywhere == pytest.approx(np.corrcoef(window.ravel(), patch.ravel())[0, 1], abs=1e-3)
    mine = judge()
    look(mine, BEFORE)
    look(mine, VIEWS, lambda *_: (left, right), begin=BEFORE)
    assert mine.without == 0
    look(mine, 3, lambda *_: upside_down(left, right), begin=100)
    assert mine.without == 3


@pytest.mark.parametrize(("upright", "one"), [(1.0, True), (0.87, True), (0.82, False)])
def test_a_floor_must_match_better_by_a_margin_than_upside_down(upright, one):
    """A picture that holds itself upside down too, as a smooth wall does, correlates with both as it is mixed."""
    left, right = (picture - 128 for picture in floor(0.0))
    mixed = upright * right + math.sqrt(1 - upright**2) * right[::-1, ::-1]
    mine, pair = judge(), strips(128 + left, 128 + mixed)
    eyes = [one_color(eye.field).astype(np.float32) / 255 for eye in pair]
    kept, turned = (mine.correlation(eyes[0], eye, mine.params) for eye in (eyes[1], eyes[1][::-1, ::-1]))
    assert kept > 0.75
    assert (kept - turned > 0.3) is one
    assert mine.compare(*pair, (0.0, 0.0)) is one


@pytest.mark.parametrize(("begin", "one"), [(0.34, True), (0.2, False)])
def test_floor_counts_up_to_30_cm_beside_the_middle_of_the_car(begin, one):
    """Beyond, the right camera sees another one."""
    left, right = floor(0.0)
    rows, columns = np.mgrid[RECTS[1].top : RECTS[1].bottom, RECTS[1].left : RECTS[1].right]
    ahead = RIG.focal * RIG.camera_height / (rows - (RIG.height - 1) / 2)
    aside = ahead * ((RIG.width - 1) / 2 - columns) / RIG.focal - RIG.baseline / 2
    right = np.where(np.abs(aside) < begin, right, floor(3.0)[1])
    assert judge().compare(*strips(left, right), (0.0, 0.0)) is one


def test_the_car_is_stopped_and_may_be_told_to_go_on():
    check = FrameCheck(RIG, 30.0, 0.1, floor=RECTS)

    def drives(begin, seconds, change):
        for n in range(round(30 * begin), round(30 * (begin + seconds))):
            pair = strips(*change(*floor(0.5 * n / 30)), seed=n)
            wrong = check.judge(StereoFrames(*pair, n / 30), 0.5, n / 30)
            if wrong is not None:
                return n / 30 - begin, wrong
        return None

    assert drives(0.0, 2.0, lambda left, right: (left, right)) is None
    after, wrong = drives(2.0, 6.0, upside_down)
    assert after < 1.05 * VIEWS * 2 * EVERY / 30 + 0.3
    assert wrong.kind is FaultKind.MOUNTING
    assert "do not see one floor any more" in wrong.message
    check.monitor.reset()
    assert drives(6.0, 2.0, lambda left, right: (left, right)) is None
    # Somebody looks through the same strips without knowing where they lie.
    assert FrameCheck(RIG, 30.0, 0.1).monitor.floor is None


@pytest.mark.slow
@pytest.mark.parametrize("seed", [801, 810])
def test_a_corridor_that_is_its_own_mirror_image_ends_no_drive(seed):
    """Without a mark, one wall is seen from one side as the other one from the other side."""
    steps = []
    drive(DriveConfig(arena="hallway", walls="blank", seed=seed, seconds=6.0), [steps.append])
    assert len(steps) == 180
