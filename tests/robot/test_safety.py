"""The safety layer and the loop: nothing gets around them, what they let through, and when a car drives."""

import math
import os
import threading
from contextlib import contextmanager

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from ndtorch.errors import InputError
from ndtorch.navigation import StereoRig
from ndtorch_robot.camera_monitor import CameraMonitor
from ndtorch_robot.car import Car
from ndtorch_robot.emergency import watch
from ndtorch_robot.ports import STAND, DriveCommand, Fault, FaultKind, SafeCommand, StereoFrames, unseal
from ndtorch_robot.safety import DriveState, SafeDrive, SafetyLimits
from tests.robot.support.cars import RIG, FilmCar, PlainDrive, SimulatedClock, bare_loop, moving_world

CRUISE = DriveCommand(0.5, 1.0)
LIMITS = SafetyLimits(0.6, 2.2, 2.0, 40.0, 0.1, 0.1, 1.0)


def test_only_the_safety_layer_makes_commands():
    with pytest.raises(TypeError, match=r"only robot\.safety"):
        SafeCommand(DriveCommand(0.5, 0.0), 0.0, object())
    for wrong in (DriveCommand(0.5, 0.0), (0.5, 0.0), None):
        with pytest.raises(TypeError, match="send through a SafeDrive"):
            unseal(wrong)
    drive, kept = PlainDrive(), []
    drive.send = lambda command: kept.append(command) or unseal(command)
    SafeDrive(drive, SimulatedClock()).send(DriveCommand(0.5, 0.0))
    with pytest.raises(AttributeError, match="cannot assign"):
        kept[0].command = DriveCommand(3.0, 0.0)
    with pytest.raises(TypeError, match="SafeDrive, got PlainDrive"):
        Car(None, None, PlainDrive())


def make(frame_check=False):
    clock, drive, lines = SimulatedClock(), PlainDrive(), []
    rig = StereoRig(width=64, height=48, focal=43.0)
    safe = SafeDrive(drive, clock, LIMITS, CameraMonitor(rig, 30, 0.1) if frame_check else None, lines.append)
    return clock, drive, lines, safe


def steps(clock, safe, seconds, command=CRUISE, frames=None):
    for _ in range(round(seconds * 30)):
        clock.time += 1 / 30
        if frames is not None:
            safe.see(frames(), 0.5)
        safe.send(command)


def test_ramps_up_and_stops_at_once():
    clock, drive, _, safe = make()
    steps(clock, safe, 0.4)
    speeds = [sent.speed for sent in drive.sent]
    assert speeds[:8] == pytest.approx([min(0.5, n * 2.0 / 30) for n in range(8)])
    steps(clock, safe, 1 / 30, DriveCommand(0.0, 0.0))
    assert drive.sent[-1].speed == 0.0
    steps(clock, safe, 0.4)
    steps(clock, safe, 1 / 30, DriveCommand(-0.5, 0.0))
    assert drive.sent[-1].speed == 0.0  # never straight through zero
    safe.stop()
    assert (safe.state, safe.standing) == (DriveState.STOPPED, "told to stop")
    steps(clock, safe, 3.0)
    assert drive.sent[-1] == STAND


@settings(deadline=None)
@given(st.lists(st.tuples(st.floats(-9.0, 9.0), st.floats(-50.0, 50.0)), min_size=2, max_size=30))
def test_commands_are_clamped_and_counted(commands):
    clock, drive, lines, safe = make()
    for command in commands:
        clock.time += 1 / 30
        safe.send(DriveCommand(*command))
    for a, b in zip([STAND, *drive.sent], drive.sent, strict=False):
        assert abs(b.speed) <= min(0.6, abs(a.speed) + 2.0 / 30 + 1e-9)
        assert abs(b.curvature) <= 2.2
        assert abs(b.curvature - a.curvature) <= 40.0 / 30 + 1e-9
    assert safe.clamped == sum(abs(speed) > 0.6 * (1 + 1e-6) or abs(c) > 2.2 * (1 + 1e-6) for speed, c in commands)
    assert lines == []


def test_a_passing_fault_that_comes_again_starts_the_waiting_anew():
    clock, drive, lines, safe = make()
    steps(clock, safe, 0.5)
    for _ in range(3):
        clock.time += 0.2
        steps(clock, safe, 0.8)
        assert drive.sent[-1] == STAND
    assert (drive.resumes, safe.state, len(lines)) == (0, DriveState.RECOVERING, 1)
    assert "a step took 0.233 s" in lines[0]
    steps(clock, safe, 0.4)
    assert (drive.resumes, safe.state) == (1, DriveState.DRIVING)
    assert drive.sent[-1].speed > 0


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_what_is_no_number_stops_the_car(value):
    clock, drive, _, safe = make()
    with pytest.raises(InputError, match="finite"):
        safe.send(DriveCommand(value, 0.0))
    assert drive.stops == 1
    steps(clock, safe, 3.0)
    assert set(drive.sent) == {STAND}
    _, drive, lines, safe = make()
    drive.driven = lambda: DriveCommand(0.1, value)
    assert safe.driven() == STAND
    assert (safe.state, "not finite" in lines[0]) == (DriveState.STOPPED, True)


@pytest.mark.parametrize("fault", ["link", "emergency"])
def test_trouble_of_the_drive_and_emergency_need_resuming(fault):
    clock, drive, lines, safe = make()
    steps(clock, safe, 0.5)
    if fault == "link":
        drive.why = "lost"
    else:
        safe.emergency("key")
    steps(clock, safe, 0.1)
    drive.why = None
    steps(clock, safe, 5.0)
    assert (drive.sent[-1], drive.resumes, safe.state) == (STAND, 0, DriveState.STOPPED)
    safe.resume()
    steps(clock, safe, 0.5)
    assert drive.sent[-1].speed == 0.5
    assert lines[-1].startswith("resumed after")


def test_no_frames_no_driving():
    clock, drive, _, safe = make(frame_check=True)
    safe.resume()
    seed = [0]

    def good():
        seed[0] += 1
        rng = torch.Generator().manual_seed(seed[0])
        pair = torch.randint(20, 250, (2, 1, 3, 48, 16), generator=rng, dtype=torch.uint8).repeat_interleave(4, -1)
        return StereoFrames(*pair, clock.time)

    steps(clock, safe, 0.5, frames=good)
    assert drive.sent[-1].speed == 0.5
    steps(clock, safe, 0.2)  # commands, but no frames
    assert drive.sent[-1] == STAND
    assert "old" in safe.standing
    steps(clock, safe, 1.5, frames=good)
    assert drive.sent[-1].speed == 0.5


@pytest.mark.parametrize("kind", FaultKind)
def test_the_kind_of_a_fault_decides_whether_it_passes(kind):
    clock, drive, _, safe = make(frame_check=True)
    verdicts = iter([Fault(kind, "words"), *[None] * 100])
    safe.frame_check.judge = lambda *_: next(verdicts)
    eye = torch.zeros(1, 3, 48, 64)
    steps(clock, safe, 2.0, frames=lambda: StereoFrames(eye, eye, clock.time))
    assert safe.faults[0].kind is kind
    passes = kind not in (FaultKind.FROZEN, FaultKind.COMMAND, FaultKind.DRIVE, FaultKind.EMERGENCY)
    assert (safe.state is DriveState.DRIVING) == passes
    assert any(command.speed for command in drive.sent) == passes


# The loop.


def film(count, kind=FilmCar, **options):
    """A car on so many pictures, its steps, and the lines of its safety layer."""
    made, lines = [], []
    car = bare_loop(kind(moving_world(count, RIG), **options), RIG, [made.append], controller="published")
    car.safe.report = lines.append
    return car, made, lines


def test_late_steps_are_counted_not_made_up():
    car, made, _ = film(40)
    car.observers.append(lambda step: setattr(car.drive, "time", step.time + 1.0) if step.number == 1 else None)
    car.max_steps = 4
    assert car.run() == 4
    assert car.late == 1
    assert made[-1].time == pytest.approx(1 / 30 + 1.0 + 1 / 30)


@pytest.mark.parametrize("error", [InputError("disk"), KeyboardInterrupt(), ZeroDivisionError()])
def test_an_observer_that_fails_stops_the_car(error):
    car, _, _ = film(40)

    def broken(step):
        if step.number == 30:
            raise error

    car.observers.append(broken)
    with pytest.raises(type(error)):
        car.run()
    assert car.drive.sent == STAND


class DroppingLink(FilmCar):
    """A link that is not there for some steps, from its first or from when it is first told to resume."""

    def __init__(self, frames, missing, takes_it=False):
        super().__init__(frames)
        self.missing, self.takes_it, self.asked, self.fault = missing, takes_it, 0, "lost: unplugged"

    def read(self):
        self.missing -= not self.takes_it or self.asked > 0
        if self.missing > 0 and self.asked > 0:
            self.fault = "lost: unplugged"
        return super().read()

    def resume(self):
        self.asked += 1
        if self.missing <= 0 or (self.takes_it and self.asked == 1):
            self.fault = None
        return self.fault is None

    def trouble(self):
        return self.fault


class LateCameras(DroppingLink):
    """The same, before cameras that give their first good frame a second late."""

    def read(self):
        frames = super().read()
        if self.time < 1.0:
            raise InputError("the left camera gives no frames")
        return frames


@pytest.mark.parametrize("takes_it", [False, True])
def test_go_outlasts_a_link_that_drops_before_the_car_moves(takes_it):
    """Said once, before there is a link, or just before it is lost: the car drives when it is back."""
    car, made, _ = film(150, DroppingLink, missing=70, takes_it=takes_it)
    car.run(148.5 / 30)
    assert {step.sent.speed for step in made[2:69]} == {0.0}
    assert made[-1].standing is None
    assert made[-1].sent.speed > 0.3


@contextmanager
def keyboard(car):
    """Presses keys, as the thread that watches stdin sees them; each has been dealt with when it returns."""
    (wake, woken), (stdin, keys) = os.pipe(), os.pipe()
    thread = threading.Thread(target=watch, args=(car.safe, wake, stdin, car.ended))
    thread.start()
    dealt = threading.Semaphore(0)
    for name in ("resume", "emergency"):
        carried_out = getattr(car.safe, name)
        setattr(car.safe, name, lambda *given, act=carried_out: (act(*given), dealt.release()))

    def press(key):
        os.write(keys, key)
        assert dealt.acquire(timeout=30)

    yield press
    os.close(woken)
    thread.join(30)
    for file in (wake, stdin, keys):
        os.close(file)


@pytest.mark.parametrize("at", [0, 20, 50], ids=["without frames", "without a link", "with both"])
def test_a_car_stands_until_the_key_is_pressed(at):
    """It is not swallowed when there are no frames or no link yet."""
    car, made, lines = film(150, LateCameras, missing=40)
    car.go = False
    with keyboard(car) as press:
        car.observers.append(lambda step: press(b"g") if step.number == at else None)
        car.run(148.5 / 30)
    assert {step.sent.speed for step in made[: max(30, at)]} == {0.0}
    assert made[-1].standing is None
    assert made[-1].sent.speed > 0.3
    assert lines[-1] == "started"


def test_a_key_that_cannot_be_obeyed_in_time_is_over():
    """10 s after it, with the frames good again and the link still gone."""
    car, made, lines = film(360, LateCameras, missing=1000)
    car.go = False
    with keyboard(car) as press:
        car.observers.append(lambda step: press(b"g") if step.number == 5 else None)
        car.run(358.5 / 30)
    assert {step.sent.speed for step in made} == {0.0}
    assert lines[-1] == "not resumed: the drive did not obey in time; resume it again"


def test_an_emergency_stop_before_the_first_good_frame_ends_what_the_command_line_said():
    car, made, lines = film(150, LateCameras, missing=0)
    with keyboard(car) as press:
        car.observers.append(lambda step: press(b" ") if step.number == 10 else None)
        car.observers.append(lambda step: press(b"g") if step.number == 100 else None)
        car.run(148.5 / 30)
    assert {step.sent.speed for step in made[:100]} == {0.0}
    assert any("emergency stop: key" in line for line in lines)
    assert made[-1].sent.speed > 0.3


def test_steps_without_frames_stand_and_restart_the_filters():
    class Blinking(FilmCar):
        def read(self):
            frames = super().read()
            if 1.0 < self.time < 1.2:
                raise InputError("the left camera gives no frames")
            return frames

    car, made, _ = film(150, Blinking)
    car.run(148.5 / 30)
    blind = [step for step in made if not step.used]
    assert 4 <= len(blind) <= 6
    why = "the left camera gives no frames"
    assert {(step.frames, step.state, step.standing) for step in blind} == {(None, None, why)}
    assert made[blind[-1].number + 1].restarted
    assert made[-1].sent.speed > 0.3
    assert not made[-1].restarted
