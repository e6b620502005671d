"""The loop: fixed rate, timing, and a drive that is always stopped."""

import pytest

from ndtorch.errors import InputError
from ndtorch_robot.loop import Loop
from ndtorch_robot.safety import SafeDrive
from tests.robot.support.plain_drive import PlainDrive, SimulatedClock


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
