"""The simulated car: limits, arcs, odometer."""

import math

import pytest

from ndtorch.errors import InputError
from ndtorch_robot.ports import DriveCommand
from ndtorch_robot.sim.car import Car, CarLimits


def drive(car, seconds, dt=1 / 120):
    for _ in range(round(seconds / dt)):
        car.advance(dt)


def test_returns_what_was_sent():
    car = Car()
    assert car.send(DriveCommand(0.5, 1.0)) == (0.5, 1.0)
    assert car.send(DriveCommand(9.0, -9.0)) == (car.limits.speed, -car.limits.curvature)


def test_circle():
    car = Car(CarLimits(acceleration=1e9, steering=1e9))
    car.send(DriveCommand(0.5, 2.0))
    drive(car, 2 * math.pi * 0.5 / 0.5, dt=2 * math.pi / 1000)
    assert (car.x, car.y) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert car.heading == pytest.approx(2 * math.pi)


def test_rate_limits():
    car = Car()
    car.send(DriveCommand(0.5, 1.0))
    drive(car, 0.1)
    assert car.speed == pytest.approx(0.25)
    assert car.curvature == pytest.approx(0.8)
    drive(car, 0.2)
    assert (car.speed, car.curvature) == (0.5, 1.0)


def test_odometer():
    car = Car()
    assert car.driven() == (0.0, 0.0)
    car.send(DriveCommand(0.5, 1.0))
    drive(car, 0.5)
    driven = car.driven()
    assert driven.speed * 0.5 == pytest.approx(0.2, abs=0.003)  # accelerating takes 0.2 s
    assert driven.speed * driven.curvature * 0.5 == pytest.approx(car.heading)
    drive(car, 0.5)
    assert car.driven() == (pytest.approx(0.5), pytest.approx(1.0))


@pytest.mark.parametrize("command", [(math.nan, 0.0), (0.5, math.inf)])
def test_bad_commands(command):
    with pytest.raises(InputError, match="finite"):
        Car().send(DriveCommand(*command))
