"""Cameras that are blind or stuck stop the car in half a second, swapped ones soon; good ones do not, in any light."""

import functools

import cv2
import numpy as np
import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import StereoRig, Strips
from ndtorch.utils.toml import check as check_values
from ndtorch_robot.camera_monitor.frame_check import FrameCheck
from ndtorch_robot.camera_monitor.limits import CameraLimits
from ndtorch_robot.ports import DriveCommand, StereoFrames
from ndtorch_robot.run_config import CameraMonitorTable
from ndtorch_robot.safety import SafeDrive
from tests.robot.support.cars import PlainDrive, SimulatedClock

RIG, RATE, SPEED = StereoRig(), 30.0, 0.5
ROW, FIELD = 640, (29, 85)
SLIDE = 6
"""Pixels a step by which everything goes to the left, which is what a car sees that turns to the right."""
CURVATURE = -SLIDE * RATE / RIG.focal / SPEED


@functools.cache
def world(seed):
    """A wall with panels and grain, and a carpet, both longer than any drive."""
    rng = np.random.default_rng(seed)
    ends = np.cumsum(rng.integers(30, 150, 80))
    wall = 150 + rng.normal(0, 25, 81)[np.searchsorted(ends, np.arange(4000))] + rng.normal(0, 2, 4000)
    fine, coarse = rng.normal(0, 1, (29, 4000)), rng.normal(0, 1, (29, 4000))
    carpet = 115 + 3.4 * fine + 60 * cv2.GaussianBlur(coarse, (0, 0), 6)
    return wall, carpet


def drive(seconds, moving=True, seed=0, light=1.0, noise=1.0, disparity=60):
    """Left row, right row, left field, right field, step by step: what two cameras see of a wall that slides past."""
    rng = np.random.default_rng(seed + 1)
    wall, carpet = world(seed)
    for n in range(round(seconds * RATE)):
        at = 400 + (SLIDE * n if moving else 0)
        parts = [
            wall[at : at + ROW][None],
            wall[at + disparity : at + disparity + ROW][None],
            carpet[:, at : at + FIELD[1]],
            carpet[:, at + 900 : at + 900 + FIELD[1]],
        ]
        yield [light * part + rng.normal(0, noise, part.shape) for part in parts]


def frames(parts, n):
    """Of four pictures in levels."""
    row_l, row_r, field_l, field_r = (
        torch.from_numpy(np.clip(np.round(part), 0, 255).astype(np.uint8))[None, None] for part in parts
    )
    return StereoFrames(Strips(field_l, row_l), Strips(field_r, row_r), n / RATE)


def stopped(parts, speed=SPEED, curvature=0.0):
    """Step at which something is said, and what; (None, "") when nothing is."""
    check = FrameCheck(RIG, RATE, 0.1)
    for n, part in enumerate(parts):
        why = check.judge(frames(part, n), speed, n / RATE, curvature)
        if why is not None:
            return n, why.message
    return None, ""


RANDOM = np.random.default_rng(5)
SHADE = {
    "level 4 to 7": lambda a: RANDOM.integers(4, 8, a.shape).astype(float),
    "white": lambda a: 254 + RANDOM.normal(0, 1, a.shape),
    "grey": lambda a: 128.0 + RANDOM.integers(-1, 2, a.shape),
    "fog": lambda a: 0.1 * a + 0.9 * 190,
    "blur": lambda a: cv2.GaussianBlur(a, (0, 0), 14) + RANDOM.normal(0, 1, a.shape),
    "noise": lambda a: RANDOM.uniform(0, 255, a.shape),
    "hand": lambda a: 25 + 35 * np.linspace(0, 1, a.shape[1])[None] ** 2 + RANDOM.normal(0, 1.5, a.shape),
}
BEFORE = 30


def spoil(change, eyes, light=1.0):
    for n, part in enumerate(drive(2.0, light=light)):
        yield [change(p) if n >= BEFORE and k % 2 in eyes else p for k, p in enumerate(part)]


@pytest.mark.parametrize(("eyes", "light"), [((0,), 0.25), ((1,), 1.0), ((0, 1), 1.5)])
@pytest.mark.parametrize("name", SHADE)
def test_a_blind_camera_stops_the_car(name, eyes, light):
    n, why = stopped(spoil(SHADE[name], eyes, light))
    assert n is not None
    assert BEFORE < n <= BEFORE + 0.4 * RATE
    blind = [("left", "right")[eye] for eye in eyes]
    assert any(name in why for name in blind)  # of two that are blind, either may be told first


@pytest.mark.parametrize(("eyes", "light"), [((0,), 0.25), ((1,), 1.0), ((0, 1), 0.25)])
def test_a_frozen_picture_with_noise(eyes, light):
    def parts():
        kept: list[np.ndarray] = []
        for n, part in enumerate(drive(2.0, light=light)):
            kept = part if n <= BEFORE else kept
            noisy = [np.round(p) + RANDOM.integers(-1, 2, p.shape) for p in kept]
            yield [noisy[k] if n > BEFORE and k % 2 in eyes else p for k, p in enumerate(part)]

    n, why = stopped(parts())
    assert n is not None
    assert n <= BEFORE + 0.5 * RATE
    assert "same image" in why


@pytest.mark.parametrize(("late", "curvature"), [(-6, 0.0), (-2, 2.0), (2, 0.0), (6, 2.0)])
def test_a_picture_that_freezes_about_a_change_from_reverse_to_forward(late, curvature):
    """With noise. On its way through standing the car hardly moves, and nothing shows; but it must stop in time."""
    begins, kept, check = 40, [], FrameCheck(RIG, RATE, 0.1)
    for n, part in enumerate(drive(3.0)):
        kept = part if n <= begins else kept
        noisy = [np.round(p) + RANDOM.integers(-1, 2, p.shape) for p in kept]
        speed = min(0.4, -0.3 + 2.0 * max(0, n - begins - late) / RATE)
        seen = [noisy[k] if n > begins and k % 2 == 0 else p for k, p in enumerate(part)]
        why = check.judge(frames(seen, n), speed, n / RATE, curvature)
        if why is not None:
            break
    assert "the left camera shows the same image" in why.message
    assert 0 < n - begins <= 11  # and half a second are 15


@pytest.mark.parametrize("late", range(4))
def test_two_pictures_that_freeze_before_a_stand_are_told_on_the_way_back(late):
    """Nothing shows while the car stands, and neither is a witness of the other. Back it rolls by 4 cm at most."""
    freezes, kept, check, back = 40 + late, [], FrameCheck(RIG, RATE, 0.1), 0.0
    for n, part in enumerate(drive(3.0)):
        kept = part if n <= freezes else kept
        seen = part if n <= freezes else [np.round(p) + RANDOM.integers(-1, 2, p.shape) for p in kept]
        speed = max(0.0, min(0.4, 0.4 - 2.5 * (n - 40) / RATE)) - max(0.0, min(0.3, 2.5 * (n - 60) / RATE))
        why = check.judge(frames(seen, n), speed, n / RATE)
        if why is not None:
            break
        back += max(0.0, -speed / RATE)
    assert "shows the same image" in why.message
    assert back < 0.04


def frozen(begins, eyes, moving=False, noise=1.0):
    """What these eyes give that are frozen, to the bit, from a picture on."""
    kept: list[np.ndarray] = []
    for n, part in enumerate(drive(3.0, moving=moving, noise=noise)):
        kept = part if n <= begins else kept
        yield [kept[k] if k % 2 in eyes else p for k, p in enumerate(part)]


@pytest.mark.parametrize("eyes", [(0,), (1,), (0, 1)])
def test_a_camera_without_its_noise_is_frozen_while_the_car_stands_too(eyes):
    """Who changes from forward to reverse stands for half a second, and must not drive on by what was seen before."""
    n, why = stopped(frozen(45, eyes), speed=0.0)
    assert n == 45 + 4
    assert "same image" in why
    assert ("right" if eyes == (1,) else "left") in why
    # A camera that has shown no noise for long enough may have none.
    assert stopped(frozen(28, eyes), speed=0.0) == (None, "")


def test_carried_while_the_wheels_stand():
    n, why = stopped(drive(2.0), speed=0.0)
    assert n is not None
    assert n < RATE
    assert "wheels stand" in why


@pytest.mark.parametrize("begin", [0, 214, 320, 425])
def test_who_passes_a_stationary_car_is_no_fault(begin):
    """.3 m at .6 m are 215 of 640 pixels; the fields may be covered."""
    still, passing = drive(3.0, moving=False, light=0.3), drive(3.0, seed=1)

    def parts():
        for n, (part, other) in enumerate(zip(still, passing, strict=True)):
            rows = [
                np.hstack((p[:, :begin], o[:, :215], p[:, begin + 215 :]))
                for p, o in zip(part[:2], other[:2], strict=True)
            ]
            yield [*rows, *other[2:]] if n > 30 else part

    assert stopped(parts(), speed=0.0) == (None, "")


def test_pictures_may_move_while_the_board_shifts():
    """Some motor controllers take the brake before reverse for reverse: the car creeps, and is said to stand."""

    def judged(wanted):
        check = FrameCheck(RIG, RATE, 0.1)
        for n, part in enumerate(drive(3.0, moving=False)):
            moved = [np.roll(p, -SLIDE * max(0, n - 31), 1) for p in part]
            why = check.judge(frames(moved, n), -SPEED if n > 48 else 0.0, n / RATE, -CURVATURE, wanted(n))
            if why is not None:
                return n, why.message
        return None, ""

    assert "wheels stand" in judged(lambda n: 0.0)[1]
    assert judged(lambda n: -0.3 if n > 30 else 0.0) == (None, "")
    assert judged(lambda n: -0.3 if n > 30 else 0.2) == (None, "")  # from forward to reverse
    # It is told to go for long already, or was told to stand again.
    assert "wheels stand" in judged(lambda n: -0.3)[1]
    assert judged(lambda n: -0.3 if 30 < n <= 40 else 0.0) == (None, "")


@pytest.mark.parametrize("delay", [0.0, 0.3, 0.9])
def test_a_push_within_a_second_after_go_is_told_when_the_second_is_over(delay):
    """Until then it may be the board that shifts. A push that is over in the first half of it is not told."""
    go = 30

    def judged(until):
        check = FrameCheck(RIG, RATE, 0.1)
        for n, part in enumerate(drive(3.0, moving=False)):
            slid = min(max(0, n - go - delay * RATE), (until - delay) * RATE)
            why = check.judge(
                frames([np.roll(p, -SLIDE * int(slid), 1) for p in part], n), 0.0, n / RATE, 0.0, 0.3 * (n > go)
            )
            if why is not None:
                return (n - go) / RATE, why.message
        return None, ""

    after, why = judged(9.0)
    assert 1.0 <= after <= 1.3
    assert "wheels stand" in why
    assert delay > 0.5 or judged(0.5) == (None, "")


def test_the_drive_says_what_the_car_was_told():
    """Of two cars whose pictures move while they are said to stand, only the one that was told nothing is stopped."""
    for speed in (0.0, 0.3):
        safe = SafeDrive(PlainDrive(), SimulatedClock(), frame_check=FrameCheck(RIG, RATE, 0.1))
        safe.check_image, seen = None, []
        for n, part in enumerate(drive(0.8)):
            safe.clock.time = n / RATE
            seen.append(safe.see(frames(part, n), 0.0))
            safe.send(DriveCommand(speed, 0.0))
        assert all(seen) == (speed > 0)


MOUNTS = {
    "swapped": (lambda a, b: (b, a), "swapped"),
    "both upside down": (lambda a, b: (a[:, ::-1], b[:, ::-1]), "swapped"),
    "left upside down": (lambda a, b: (a[:, ::-1], b), "upside down"),
    "right upside down": (lambda a, b: (a, b[:, ::-1]), "upside down"),
    "one turned outward": (lambda a, b: (a, np.roll(b, 110, 1)), "turned"),
}


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("name", MOUNTS)
def test_wrongly_mounted_cameras_are_told(name, seed):
    mount, words = MOUNTS[name]
    parts = ([*mount(part[0], part[1]), *part[2:]] for part in drive(12.0, seed=seed))
    n, why = stopped(parts, curvature=CURVATURE)
    assert n is not None
    assert words in why or "upside down" in why


@pytest.mark.parametrize(("seed", "light", "noise"), [(0, 0.25, 1.0), (0, 1.0, 0.0), (1, 1.4, 1.0), (2, 1.0, 2.0)])
def test_good_cameras_drive_on(seed, light, noise):
    assert stopped(drive(12.0, seed=seed, light=light, noise=noise), curvature=CURVATURE) == (None, "")


def test_good_cameras_stand():
    assert stopped(drive(4.0, moving=False), speed=0.0) == (None, "")


def test_a_wall_without_marks_is_no_fault_where_a_floor_is_seen():
    blank = ([p * 0 + 180 if k < 2 else p for k, p in enumerate(part)] for part in drive(4.0))
    assert stopped(blank) == (None, "")


def test_times_ahead_and_half_the_rate_are_faults():
    check, said = FrameCheck(RIG, RATE, 0.1), []
    for n, part in enumerate(drive(0.3)):
        seen = frames(part, 2 * n)
        assert "0.500 s ahead" in check.judge(seen._replace(time=seen.time + 0.5), SPEED, seen.time).message
        said.append(check.judge(seen, SPEED, seen.time))
    assert said[:2] == [None, None]
    assert said[2].message == "the cameras give 15 frames a second, 30 are wanted"


def test_single_bad_pictures_are_no_fault():
    parts = ([p * 0 + 128 if n % 3 == 0 else p for p in part] for n, part in enumerate(drive(3.0)))
    assert stopped(parts) == (None, "")


def test_the_table_of_a_car_says_what_the_defaults_say():
    assert CameraMonitorTable().model_dump() == CameraLimits().model_dump()
    with pytest.raises(InputError, match="row_contrast_levels"):
        check_values({"row_contrast_levels": float("nan")}, CameraMonitorTable, "car.toml")


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
