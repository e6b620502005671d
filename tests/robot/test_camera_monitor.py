"""Cameras that are dark, frozen, silent, blind or unequally lit stop the car; good ones in any light do not."""

import functools

import cv2
import numpy as np
import pytest
import torch

from ndtorch.navigation import StereoRig, Strips
from ndtorch_robot.camera_monitor import CameraMonitor, mounting_fault
from ndtorch_robot.ports import FaultKind, StereoFrames
from ndtorch_robot.sim.arenas import load_arena
from ndtorch_robot.sim.simulation import Simulation

RIG, RATE, SPEED, BEFORE = StereoRig(), 30.0, 0.5, 30
RANDOM = np.random.default_rng(5)


@functools.cache
def scene():
    """A wall of panels and a carpet, both longer than the drive."""
    rng = np.random.default_rng(0)
    ends = np.cumsum(rng.integers(30, 150, 80))
    wall = 150 + rng.normal(0, 25, 81)[np.searchsorted(ends, np.arange(4000))] + rng.normal(0, 2, 4000)
    coarse = cv2.GaussianBlur(rng.normal(0, 1, (29, 4000)), (0, 0), 6)
    return wall[None], 115 + 3.4 * rng.normal(0, 1, (29, 4000)) + 60 * coarse


def views(light=1.0, pixels=6, disparity=60):
    """Left row, right row, left field, right field in levels, step by step, while the scene slides past."""
    wall, carpet = scene()
    for n in range(60):
        at = 400 + pixels * n
        parts = (
            wall[:, at:][:, :640],
            wall[:, at + disparity :][:, :640],
            carpet[:, at:][:, :85],
            carpet[:, at + 900 :][:, :85],
        )
        yield [light * part + RANDOM.normal(0, 1, part.shape) for part in parts]


def frames(parts, time):
    levels = [torch.from_numpy(np.clip(np.round(part), 0, 255).astype(np.uint8))[None, None] for part in parts]
    return StereoFrames(Strips(levels[2], levels[0]), Strips(levels[3], levels[1]), time)


def first_fault(change, light=1.0, speed=SPEED):
    """Steps from the change to the first fault, and the fault."""
    monitor, kept = CameraMonitor(RIG, RATE, 0.1), None
    for n, parts in enumerate(views(light)):
        given = frames(parts, n / RATE)
        kept = given if n <= BEFORE else kept
        given = given if n < BEFORE else change(given, kept)
        fault = monitor.judge(given, speed, n / RATE)
        if fault is not None:
            return n - BEFORE, fault
    return None, None


def changed(how, side):
    def change(given, kept):
        parts = [
            torch.from_numpy(np.clip(how(part.numpy().astype(float)), 0, 255).astype(np.uint8)) for part in given[side]
        ]
        return given._replace(**{("left", "right")[side]: Strips(*parts)})

    return change


@pytest.mark.parametrize(("side", "light"), [(0, 0.25), (1, 1.0)])
@pytest.mark.parametrize(
    ("how", "kind", "frames"),
    [
        (lambda a: 0 * a, FaultKind.BLACK, 4),
        (lambda a: 254 + RANDOM.normal(0, 1, a.shape), FaultKind.BLANK, 8),
        (lambda a: 128 + RANDOM.integers(-1, 2, a.shape), FaultKind.BLANK, 8),
        (lambda a: 0.1 * a + 0.9 * 190, FaultKind.BLANK, 8),
        (lambda a: 25 + 35 * np.linspace(0, 1, a.shape[-1]) ** 2 + RANDOM.normal(0, 1.5, a.shape), FaultKind.BLANK, 8),
        (lambda a: a / 6 if a.mean() > 100 else 6 * a, FaultKind.UNEQUAL, 8),
    ],
)
def test_a_blind_camera_stops_the_car(how, kind, frames, side, light):
    number, fault = first_fault(changed(how, side), light)
    assert fault.kind is kind
    assert number < frames
    assert kind is FaultKind.UNEQUAL or ("left", "right")[side] in fault.message


@pytest.mark.parametrize(
    "change",
    [
        lambda given, kept: given._replace(left=kept.left),
        lambda given, kept: given._replace(right=kept.right),
        lambda given, kept: kept._replace(time=given.time),
    ],
)
def test_frozen_images_stop_a_car_that_moves(change):
    number, fault = first_fault(change)
    assert fault.kind is FaultKind.FROZEN
    assert number <= 4
    assert first_fault(change, speed=0.0) == (None, None)


def test_a_change_of_direction_does_not_hide_a_frozen_image():
    monitor, given = CameraMonitor(RIG, RATE, 0.1), frames(next(views()), 0.0)
    speeds = [0.5, 0.5, 0.2, 0.0, 0.0, 0.0, -0.1, -0.2]
    faults = [monitor.judge(given._replace(time=n / RATE), speed, n / RATE) for n, speed in enumerate(speeds)]
    assert [fault is not None for fault in faults[:5]] == [False] * 4 + [True], "before it reverses"


@pytest.mark.parametrize(
    ("change", "kind"),
    [
        (lambda given, kept: given._replace(time=given.time + 0.05), FaultKind.TIMES),
        (lambda given, kept: given._replace(time=float("nan")), FaultKind.TIMES),
        (lambda given, kept: given._replace(time=given.time - 0.2), FaultKind.AGE),
        (lambda given, kept: given._replace(time=given.time - 1.5 / RATE), FaultKind.TIMES),
        (lambda given, kept: given._replace(right=torch.zeros(1, 1, 40, 64)), FaultKind.SHAPE),
        (lambda given, kept: given._replace(right=Strips(*(part.double() for part in given.right))), FaultKind.SHAPE),
    ],
)
def test_unusable_frames_stop_the_car_at_once(change, kind):
    number, fault = first_fault(change)
    assert fault.kind is kind
    assert number == 0


def test_half_the_frame_rate_is_a_slow_camera():
    monitor = CameraMonitor(RIG, RATE, 0.1)
    found = [monitor.judge(frames(parts, n / 15), SPEED, n / 15) for n, parts in enumerate(views())]
    assert [fault.kind if fault else None for fault in found[:3]] == [None, None, FaultKind.SLOW]


@pytest.mark.parametrize("light", [0.25, 0.5, 1.0, 1.4])
def test_good_cameras_drive_in_any_light(light):
    assert first_fault(lambda given, kept: given, light) == (None, None)


def test_one_bad_image_is_no_fault():
    monitor = CameraMonitor(RIG, RATE, 0.1)
    for n, parts in enumerate(views()):
        parts = [0 * part for part in parts] if n % 10 == 9 else parts
        assert monitor.judge(frames(parts, n / RATE), SPEED, n / RATE) is None


@pytest.fixture(scope="module")
def moved():
    """Whole frames of a car that is turned about in a building."""
    simulation = Simulation(load_arena("office", 3), 3, full_frames=True)
    try:
        x, y, heading = simulation.pose
        seen = []
        for n in range(24):
            simulation.place(x, y, heading + 0.26 * n)
            seen.append(simulation.read())
        return seen
    finally:
        simulation.close()


@pytest.mark.slow
def test_swapped_and_inverted_cameras_are_told_before_the_drive(moved):
    def turned(image):
        return image.flip(-1, -2)

    assert mounting_fault(moved, RIG) is None
    assert "swapped" in mounting_fault([pair._replace(left=pair.right, right=pair.left) for pair in moved], RIG)
    assert "upside down" in mounting_fault([pair._replace(left=turned(pair.left)) for pair in moved], RIG)
    both = [pair._replace(left=turned(pair.left), right=turned(pair.right)) for pair in moved]
    assert mounting_fault(both, RIG) is not None
    assert "few edges" in mounting_fault(moved[:1], RIG)
