"""A camera that shows the same picture while the other one's changes is told before the way driven could tell."""

import numpy as np
import pytest

from ndtorch_robot.watching.sight import Sight
from tests.robot.watching.test_sight import RATE, RIG, drive, frames

SLOW = 0.18
"""m/s: 6 mm a frame, so that three frames are less than the 20 mm on which every picture must change."""

FREEZES, STANDS = 30, 33


def said(eyes, seconds=2.0, plain=()):
    """Step and words of the first thing that is said of a car that stops just after a picture has frozen.

    Args:
        eyes: which freeze.
        plain: whose floor shows next to nothing.
    """
    rng = np.random.default_rng(3)
    sight = Sight(RIG, RATE, 0.1)
    pictures = list(drive(seconds, noise=0.0))
    for n in range(len(pictures)):
        parts = [part.copy() for part in pictures[min(n, STANDS)]]
        for k in range(4):
            if k % 2 in eyes and n > FREEZES:
                parts[k] = pictures[FREEZES][k].copy()
            if k >= 2 and k % 2 in plain:
                parts[k] = 115 + 0.02 * (parts[k] - 115)
        parts = [part + rng.normal(0, 1, part.shape) for part in parts]
        why = sight.judge(frames(parts, n), SLOW if n <= STANDS else 0.0, n / RATE)
        if why is not None:
            return n, why.words
    return None, ""


@pytest.mark.parametrize("eye", [0, 1])
def test_one_that_freezes_just_before_the_car_stands_is_told_while_it_stands(eye):
    n, why = said([eye])
    assert STANDS < n <= FREEZES + 0.4 * RATE
    assert why == (
        f"the {('left', 'right')[eye]} camera shows the same picture while that of the "
        f"{('right', 'left')[eye]} one changes, but for noise"
    )


def test_good_cameras_of_such_a_car_are_not():
    assert said([]) == (None, "")


def test_two_that_freeze_together_have_no_witness():
    assert said([0, 1]) == (None, "")


def test_one_whose_floor_shows_next_to_nothing_need_not_have_changed():
    assert said([0], plain=[0]) == (None, "")
