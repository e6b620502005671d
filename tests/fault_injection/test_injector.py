"""How stops are sorted: for a fault, before a blank wall, after the car was moved."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from ndtorch.navigation import Strips
from ndtorch_robot.faults import FaultKind, Stop
from ndtorch_robot.ports import StereoFrames
from ndtorch_robot.sim.firmware_host import Pulse
from tests.fault_injection.faults import FAULTS
from tests.fault_injection.injector import FaultInjector


class StubWorld:
    """A world of which only the injector is a user: its frames, and whether the car was moved."""

    def __init__(self, marks):
        self.simulation, self.time, self.marks = SimpleNamespace(placed=None), 0.0, marks
        self.up = self.down = None

    def now(self):
        return self.time

    def read(self):
        row = 120.0 + self.marks * np.random.default_rng(1).normal(0, 1, (1, 3, 1, 128)).repeat(5, -1)
        field = np.full((1, 3, 29, 85), 120.0)
        image = Strips(*(torch.from_numpy(part.astype(np.uint8)) for part in (field, row)))
        return StereoFrames(image, image, self.time)


def sorted_stop(kind, marks=0.0, fault=None, moved_at=-np.inf):
    """Where a stop of this kind at 5 s is kept."""
    world = StubWorld(marks)
    car = SimpleNamespace(safe=SimpleNamespace(faults=[Stop(5.0, "why", kind)], frame_check=None))
    injector = FaultInjector(car, world, None, 0, None)
    injector.fault, injector.moved_at = next((each for each in FAULTS if each.name == fault), None), moved_at
    injector.sort_stops()
    injector.sort_stops()
    places = {name: getattr(injector, name) for name in ("stopped", "unexplained", "blank", "carried")}
    return {name: lines for name, lines in places.items() if lines}


@pytest.mark.parametrize("fault", [None, "single writes lost"])
def test_stops_before_blank_walls_and_after_a_move_are_kept_apart(fault):
    line, own = ["5.00 s: why"], "unexplained" if fault is None else "stopped"
    assert sorted_stop(FaultKind.BLANK, fault=fault) == {"blank": line}
    assert sorted_stop(FaultKind.BLANK, marks=30.0, fault=fault) == {own: line}
    assert sorted_stop(FaultKind.BLURRED, fault=fault) == {own: line}
    assert sorted_stop(FaultKind.MOVED_WHILE_STOPPED, fault=fault, moved_at=4.1) == {"carried": line}
    assert sorted_stop(FaultKind.MOVED_WHILE_STOPPED, fault=fault, moved_at=3.9) == {own: line}
    assert sorted_stop(FaultKind.DRIVE, fault=fault, moved_at=4.1) == {own: line}


def test_a_stop_for_a_fault_that_must_stop_the_car_is_not_sorted_stop():
    assert sorted_stop(FaultKind.BLANK, fault="covered") == sorted_stop(FaultKind.DRIVE, fault="cable pulled") == {}
    assert sorted_stop(FaultKind.NOT_STARTED) == {}


@pytest.mark.parametrize(("fault", "counts"), [("frozen but for noise", 0.42), ("fogged", 0.8)])
def test_only_seconds_in_which_the_wheels_turn_count_for_a_frozen_camera(fault, counts):
    """Wheels turn for 0.1 s, stand for 0.38 s while the board shifts into reverse, and turn back for 0.32 s."""
    world = StubWorld(0.0)
    world.simulation.car = SimpleNamespace(speed=0.3)
    cameras = SimpleNamespace(fault=None, sides=(0, 1), inject=lambda name: None)
    injector = FaultInjector(SimpleNamespace(safe=SimpleNamespace(faults=[])), world, cameras, 0, None)
    injector.link.clear = lambda: None
    for n in range(151):
        now = 1.0 + 0.02 * n
        stands = 55 < n <= 74
        world.simulation.car.speed = 0.0 if stands or n > 90 else 0.3 if n <= 55 else -0.3
        injector.on_pulse(Pulse("motor", 1500.0 if n > 90 else 1350.0 if stands else 1560.0, now))
        if n == 50:
            injector.queue = [each for each in FAULTS if each.name == fault]
            injector.begin(now)
    injector.end(injector.fault, now)
    assert injector.rows[-1]["reaction_s"] == pytest.approx(counts)
    assert injector.rows[-1]["failure"] == (f"wheels turned for {counts:.3f} s" if counts > 0.5 else None)
