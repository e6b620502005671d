"""Links of a Raspberry Pi: pulses on a simulated bank of registers and on mock pins, and what stops the wheels."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
SOON = 20.0


def start(*arguments, **options):
    command = [sys.executable, "-m", "tests.robot.support.pi_pins", *map(str, arguments)]
    return subprocess.Popen(command, cwd=ROOT, text=True, **options)


def entries(log):
    lines = log.read_text().splitlines() if log.exists() else []
    return [(float(t), name, float(v)) for t, name, v in (line.split() for line in lines if line.count(" ") == 2)]


def wait_for(true):
    end = time.monotonic() + SOON
    while not (found := true()) and time.monotonic() < end:
        time.sleep(0.005)
    assert found
    return found


@pytest.fixture
def car(kind, tmp_path):
    """A car that drives: half a metre a second is 100 us beyond the dead band of 30 us, or half the supply, and a
    curvature of 1/m is 200 us."""
    log, programs, address = tmp_path / "log", [], tmp_path / "bus"
    if kind == "pca9685":
        programs.append(start("bank", address, log))
        wait_for(address.exists)
        motor, servo, rest, driving = "0", "1", (1500, 1500), (1630, 1700)
    else:
        address, motor, servo, rest, driving = log, "GPIO23", "GPIO12", (0.0, 0.075), (0.5, 0.085)
    programs.append(start("car", kind, address, stdout=subprocess.PIPE))

    def times(name, value, since=0.0):
        """When a pin got a value."""
        near = pytest.approx(value, rel=0.002, abs=1e-6)
        return [t for t, n, v in entries(log) if n == name and t >= since and v == near]

    program = programs[-1]
    program.rest_at = lambda since: wait_for(lambda: times(motor, rest[0], since) and times(servo, rest[1], since))[0]
    program.drives_since = lambda since: wait_for(
        lambda: times(motor, driving[0], since) and times(servo, driving[1], since)
    )
    program.drives_since(0.0)
    yield program
    for program in programs:
        program.send_signal(signal.SIGCONT)
        program.kill()
        program.wait()
        if program.stdout is not None:
            program.stdout.close()


@pytest.mark.realtime
@pytest.mark.parametrize(("kind", "end"), [("pca9685", signal.SIGKILL), ("gpio", signal.SIGINT)])
def test_what_stops_a_program_stops_the_wheels(kind, end, car):
    """After 150 ms and the time of two looks at the clock; half a second on a machine that stalls."""
    for how in (signal.SIGSTOP, end):
        began = time.monotonic()
        os.kill(car.pid, how)
        stood = car.rest_at(began) - began
        print(f"{how.name}: neutral after {1e3 * stood:.0f} ms")
        assert stood < 0.5
        if how == signal.SIGSTOP:
            os.kill(car.pid, signal.SIGCONT)
            car.drives_since(began + stood)
    assert car.wait(SOON) != 0
