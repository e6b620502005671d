"""A camera that shows the same image while the other one's changes is told before the way driven could tell."""

import numpy as np
import pytest

from ndtorch_robot.camera_monitor.frame_check import FrameCheck
from tests.robot.camera_monitor.test_frame_check import RATE, RIG, drive, frames

SLOW = 0.18
"""m/s: 6 mm a frame, so that three frames are less than the 20 mm on which every picture must change."""

FREEZES, STANDS = 30, 33


def said(eyes, seconds=2.0, plain=(), stands=STANDS, wall=True, late=0, goes=0):
    """Step and words of the first thing that is said of a car that stops just after a picture has frozen.

    Args:
        eyes: which freeze.
        plain: whose floor shows next to nothing.
        stands: the step from which the car stands.
        wall: something is on it.
        late: by so many frames all of it is later.
        goes: so often somebody says go after something was said.
    """
    rng = np.random.default_rng(3)
    check = FrameCheck(RIG, RATE, 0.1)
    pictures = list(drive(seconds, noise=0.0))
    for n in range(len(pictures)):
        parts = [part.copy() for part in pictures[min(n, stands + late)]]
        for k in range(4):
            if k % 2 in eyes and n > FREEZES + late:
                parts[k] = pictures[FREEZES + late][k].copy()
            if k >= 2 and k % 2 in plain:
                parts[k] = 115 + 0.02 * (parts[k] - 115)
            if k < 2 and not wall:
                parts[k] = 0 * parts[k] + 180
        parts = [part + rng.normal(0, 1, part.shape) for part in parts]
        why = check.judge(frames(parts, n), SLOW if n <= stands + late else 0.0, n / RATE)
        if why is not None and goes:
            goes -= 1
            check.monitor.reset()
        elif why is not None:
            return n, why.message
    return None, ""


@pytest.mark.parametrize("eye", [0, 1])
def test_one_that_freezes_just_before_the_car_stands_is_told_while_it_stands(eye):
    n, why = said([eye])
    assert STANDS < n <= FREEZES + 0.4 * RATE
    assert why == (
        f"the {('left', 'right')[eye]} camera shows the same image while that of the "
        f"{('right', 'left')[eye]} one changes, but for noise"
    )


@pytest.mark.parametrize("eye", [0, 1])
def test_a_go_is_not_refused_for_what_was_seen_before_the_stand(eye):
    """As long as the car stands, a picture that froze just before cannot be told from a good one."""
    assert said([eye])[0] is not None
    assert said([eye], goes=1) == (None, "")


@pytest.mark.parametrize("stands", [31, 32, 33])
def test_good_cameras_of_such_a_car_are_not(stands):
    assert said([], stands=stands) == (None, "")
    assert said([], stands=stands, wall=False) == (None, "")
