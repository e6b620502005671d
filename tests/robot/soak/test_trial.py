"""How a soak counts a stop: for a fault, before a blank wall, of a car that was put elsewhere."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from ndtorch.navigation import Strips
from ndtorch_robot.ports import StereoFrames
from ndtorch_robot.sim.board import Pulse
from ndtorch_robot.soak.faults import FAULTS
from ndtorch_robot.soak.trial import Trials
from ndtorch_robot.trouble import Kind, Stop


class Placed:
    """A world that is looked at by `Trials` alone: its pictures, and whether somebody has put the car elsewhere."""

    def __init__(self, marks):
        self.simulation, self.time, self.marks = SimpleNamespace(placed=None), 0.0, marks
        self.up = self.down = None

    def now(self):
        return self.time

    def read(self):
        row = 120.0 + self.marks * np.random.default_rng(1).normal(0, 1, (1, 3, 1, 128)).repeat(5, -1)
        field = np.full((1, 3, 29, 85), 120.0)
        eye = Strips(*(torch.from_numpy(part.astype(np.uint8)) for part in (field, row)))
        return StereoFrames(eye, eye, self.time)


def counted(kind, marks=0.0, fault=None, put=-np.inf):
    """Where a stop of this kind at 5 s is counted."""
    world = Placed(marks)
    car = SimpleNamespace(safe=SimpleNamespace(faults=[Stop(5.0, "why", kind)], sight=None))
    trials = Trials(car, world, None, 0, None)
    trials.fault, trials.put = next((each for each in FAULTS if each.name == fault), None), put
    trials.look_at_stops()
    trials.look_at_stops()
    places = {name: getattr(trials, name) for name in ("stopped", "unexplained", "blank", "carried")}
    return {name: lines for name, lines in places.items() if lines}


@pytest.mark.parametrize("fault", [None, "single writes lost"])
def test_only_a_stop_with_nothing_to_see_or_with_nobody_at_the_car_is_its_own(fault):
    told, own = ["5.00 s: why"], "unexplained" if fault is None else "stopped"
    assert counted(Kind.BLANK, fault=fault) == {"blank": told}
    assert counted(Kind.BLANK, marks=30.0, fault=fault) == {own: told}
    assert counted(Kind.BLURRED, fault=fault) == {own: told}
    assert counted(Kind.CARRIED, fault=fault, put=4.1) == {"carried": told}
    assert counted(Kind.CARRIED, fault=fault, put=3.9) == {own: told}
    assert counted(Kind.DRIVE, fault=fault, put=4.1) == {own: told}


def test_a_stop_for_a_fault_that_must_stop_the_car_is_not_counted():
    assert counted(Kind.BLANK, fault="covered") == counted(Kind.DRIVE, fault="cable pulled") == {}
    assert counted(Kind.NOT_TOLD) == {}


@pytest.mark.parametrize(("fault", "counts"), [("frozen but for noise", 0.42), ("fogged", 0.8)])
def test_while_a_car_stands_an_old_picture_is_a_right_one(fault, counts):
    """Wheels turn for 0.1 s, stand for 0.38 s while the board shifts into reverse, and turn back for 0.32 s."""
    world = Placed(0.0)
    world.simulation.car = SimpleNamespace(speed=0.3)
    cameras = SimpleNamespace(fault=None, sides=(0, 1), fail=lambda name: None)
    trials = Trials(SimpleNamespace(safe=SimpleNamespace(faults=[])), world, cameras, 0, None)
    trials.cable.mend = lambda: None
    for n in range(151):
        now = 1.0 + 0.02 * n
        stands = 55 < n <= 74
        world.simulation.car.speed = 0.0 if stands or n > 90 else 0.3 if n <= 55 else -0.3
        trials.pulsed(Pulse("motor", 1500.0 if n > 90 else 1350.0 if stands else 1560.0, now))
        if n == 50:
            trials.waiting = [each for each in FAULTS if each.name == fault]
            trials.begin(now)
    trials.end(trials.fault, now)
    assert trials.rows[-1]["turned"] == pytest.approx(counts)
    assert trials.rows[-1]["bad"] == (f"wheels turned for {counts:.3f} s" if counts > 0.5 else None)
