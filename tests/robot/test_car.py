"""The car and its loop."""

import os
import threading
from contextlib import contextmanager

import pytest

from ndtorch.errors import InputError
from ndtorch_robot.emergency import watch
from ndtorch_robot.loop import Loop
from ndtorch_robot.safety import SafeDrive
from tests.robot.support.cars import RIG, FilmCar, PlainDrive, SimulatedClock, bare_loop, moving_world


def film(count, kind=FilmCar, **options):
    """A car on so many pictures, all that it told, and the lines of its safety layer."""
    told, lines = [], []
    car = bare_loop(kind(moving_world(count, RIG), **options), RIG, [told.append], controller="published")
    car.safe.report = lines.append
    return car, told, lines


def test_every_observer_is_told_every_step():
    car, told, _ = film(40)
    numbers = []
    car.observers.append(lambda step: numbers.append(step.number))
    assert car.run(38.5 / 30) == 40
    assert numbers == [step.number for step in told] == list(range(40))
    assert (told[0].sent.speed, told[0].standing) == (0.0, None)  # told to go at its end
    assert not any(step.restarted for step in told)
    assert all(step.used and step.state is not None for step in told)
    assert told[5].telemetry["battery_v"] == 7.4
    assert max(step.sent.speed for step in told) > 0.3


def test_a_command_is_sent_before_the_map_is_filled(monkeypatch):
    car, _, _ = film(4)
    order, send, complete = [], car.drive.send, car.runner.complete
    monkeypatch.setattr(car.drive, "send", lambda command: order.append("send") or send(command))
    monkeypatch.setattr(car.runner, "complete", lambda: order.append("complete") or complete())
    car.run(2.5 / 30)
    assert order == ["send", "complete"] * 4


def test_it_stands_until_told_whatever_the_drive_says():
    """A drive without a reason to stand, too."""
    car, told, lines = film(40)
    car.go = False
    car.run(38.5 / 30)
    assert {step.sent for step in told} == {(0.0, 0.0)}
    assert car.drive.trouble() is None
    assert lines == ["stopped: not yet told to drive"]


def test_an_observer_that_fails_stops_the_car():
    car, _, _ = film(40)

    def broken(step):
        if step.number == 30:
            raise ZeroDivisionError

    car.observers.append(broken)
    with pytest.raises(ZeroDivisionError):
        car.run()
    assert car.drive.sent == (0.0, 0.0)


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


@pytest.mark.parametrize("takes_it", [False, True])
def test_go_outlasts_a_link_that_drops_before_the_car_moves(takes_it):
    """Said once, before there is a link, or just before it is lost: the car drives when it is back."""
    car, told, lines = film(150, DroppingLink, missing=70, takes_it=takes_it)
    car.run(148.5 / 30)
    assert {step.sent.speed for step in told[2:69]} == {0.0}
    assert told[-1].standing is None
    assert told[-1].sent.speed > 0.3
    if not takes_it:
        assert "resuming waits until the drive can: lost: unplugged" in lines


class LateCameras(DroppingLink):
    """The same, before cameras that give their first good frame a second late."""

    def read(self):
        frames = super().read()
        if self.time < 1.0:
            raise InputError("the left camera gives no frames")
        return frames


@contextmanager
def keyboard(car):
    """Presses keys, as the thread that watches stdin sees them; each has been dealt with when it returns."""
    (wake, woken), (stdin, keys) = os.pipe(), os.pipe()
    thread = threading.Thread(target=watch, args=(car.safe, wake, stdin, car.ended))
    thread.start()
    dealt = threading.Semaphore(0)
    for name in ("resume", "emergency"):
        carried_out = getattr(car.safe, name)
        setattr(car.safe, name, lambda *given, act=carried_out, **named: (act(*given, **named), dealt.release()))

    def press(key):
        os.write(keys, key)
        assert dealt.acquire(timeout=30)

    yield press
    os.close(woken)
    thread.join(30)
    for file in (wake, stdin, keys):
        os.close(file)


@pytest.mark.parametrize(
    "at", [0, 20, 50], ids=["before there are frames", "while the link is gone", "once it is back"]
)
@pytest.mark.parametrize("takes_it", [False, True], ids=["link not there yet", "link dropped at once"])
def test_the_key_is_not_swallowed_when_the_link_drops_before_the_first_good_frame(takes_it, at):
    car, told, lines = film(150, LateCameras, missing=40, takes_it=takes_it)
    car.go = False
    with keyboard(car) as press:
        car.observers.append(lambda step: press(b"g") if step.number == at else None)
        car.run(148.5 / 30)
    assert {step.sent.speed for step in told[:30]} == {0.0}
    assert told[-1].standing is None
    assert told[-1].sent.speed > 0.3
    assert lines[-1].startswith("resumed after")


def test_a_key_that_cannot_be_obeyed_in_time_is_said_to_be_over():
    """10 s after it, with the frames good again and the link still gone."""
    car, told, lines = film(360, LateCameras, missing=1000)
    car.go = False
    with keyboard(car) as press:
        car.observers.append(lambda step: press(b"g") if step.number == 5 else None)
        car.run(358.5 / 30)
    assert {step.sent.speed for step in told} == {0.0}
    assert lines[-1] == "not resumed: the drive did not obey in time; resume it again"


@pytest.mark.parametrize("key", [b" ", b"x"])
def test_an_emergency_stop_before_the_first_good_frame_ends_what_the_command_line_said(key):
    car, told, lines = film(150, LateCameras, missing=0)
    with keyboard(car) as press:
        car.observers.append(lambda step: press(key) if step.number == 10 else None)
        car.observers.append(lambda step: press(b"g") if step.number == 100 else None)
        car.run(148.5 / 30)
    assert {step.sent.speed for step in told[:100]} == {0.0}
    assert any("emergency stop: key" in line for line in lines)
    assert told[-1].sent.speed > 0.3


def test_a_stop_ends_what_was_not_carried_out():
    car, told, _ = film(150, DroppingLink, missing=40)
    car.observers.append(lambda step: car.safe.emergency("a key") if step.number == 20 else None)
    car.run(148.5 / 30)
    assert {step.sent.speed for step in told} == {0.0}
    assert told[-1].standing is not None


def test_a_link_that_is_lost_while_driving_needs_telling():
    car, told, _ = film(150)
    car.observers.append(lambda step: setattr(car.drive, "trouble", lambda: "lost") if step.number == 40 else None)
    car.observers.append(lambda step: setattr(car.drive, "trouble", lambda: None) if step.number == 60 else None)
    car.run(148.5 / 30)
    assert told[39].sent.speed > 0.0
    assert {step.sent.speed for step in told[42:]} == {0.0}
    assert told[-1].standing == "lost"


def test_blind_steps_are_told_and_end_in_a_new_beginning():
    class Blinking(FilmCar):
        def read(self):
            frames = super().read()
            if 1.0 < self.time < 1.2:
                raise InputError("the left camera gives no frames")
            return frames

    car, told, _ = film(150, Blinking)
    car.run(148.5 / 30)
    blind = [step for step in told if not step.used]
    assert 4 <= len(blind) <= 6
    assert {(step.frames, step.state, step.standing) for step in blind} == {
        (None, None, "the left camera gives no frames")
    }
    after = blind[-1].number + 1
    assert told[after].restarted
    assert told[-1].sent.speed > 0.3
    assert not told[-1].restarted


def test_the_navigator_is_told_of_a_low_limit_of_speed():
    from ndtorch.navigation import Body, StereoRig
    from ndtorch.navigation.options import NavigatorOptions
    from ndtorch_robot.run import within_limits
    from ndtorch_robot.safety import SafetyLimits

    slow = within_limits(NavigatorOptions(), SafetyLimits(speed=0.4), Body())
    assert slow.speed == 0.4
    assert slow.make(StereoRig(), 1 / 30).params.tight_speed_m_per_s < 0.4
    assert within_limits(NavigatorOptions(), SafetyLimits(speed=0.6), Body()) == NavigatorOptions()
    assert within_limits(NavigatorOptions("published"), SafetyLimits(speed=0.4), Body()).speed == 0.4


def safe(drive):
    return SafeDrive(drive, SimulatedClock())


def test_drives_only_through_the_safety_layer():
    drive = PlainDrive()
    with pytest.raises(TypeError, match="SafeDrive, got PlainDrive"):
        Loop(30, SimulatedClock(), max_steps=1).run(lambda n, t: None, drive)
    assert drive.sent == []


def test_fixed_rate_without_drift():
    times, drive = [], PlainDrive()
    loop = Loop(30, SimulatedClock(), max_steps=301)
    assert loop.run(lambda n, t: times.append((n, t)), safe(drive)) == 301
    assert [n for n, _ in times] == list(range(301))
    assert times[300][1] == pytest.approx(10.0, abs=1e-9)
    assert loop.late == 0
    assert drive.stops == 1


def test_step_can_end_the_loop():
    drive = PlainDrive()
    assert Loop(30, SimulatedClock()).run(lambda n, t: n < 4, safe(drive)) == 5
    assert drive.stops == 1


@pytest.mark.parametrize("error", [InputError("camera gone"), KeyboardInterrupt(), ZeroDivisionError()])
def test_stops_on_every_error(error):
    def step(n, time):
        if n == 2:
            raise error

    drive = PlainDrive()
    with pytest.raises(type(error)):
        Loop(30, SimulatedClock(), max_steps=5).run(step, safe(drive))
    assert drive.stops == 1


def test_late_steps_are_counted_not_made_up():
    clock = SimulatedClock()

    def step(n, time):
        if n == 1:
            clock.time += 1.0

    loop = Loop(10, clock, max_steps=4)
    loop.run(step, safe(PlainDrive()))
    assert loop.late == 1
    assert clock.now() == pytest.approx(0.1 + 1.0 + 0.2)


@pytest.mark.parametrize("options", [{"rate": 0}, {"rate": float("nan")}, {"rate": 30, "max_steps": 0}])
def test_bad_input(options):
    with pytest.raises(InputError, match="rate"):
        Loop(clock=SimulatedClock(), **options)
