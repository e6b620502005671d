"""Injected faults stop the wheels in time, and disturbances that are no fault do not."""

import shutil

import numpy as np
import pytest

from ndtorch_robot.ports import STAND, DriveCommand
from ndtorch_robot.run import open_car
from ndtorch_robot.run_config import RunConfig, SimulationTable
from tests.fault_injection.camera_faults import FaultyCameras
from tests.fault_injection.faults import FAULTS, Fault
from tests.fault_injection.injector import FaultInjector

needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler (cc)")
pytestmark = needs_compiler

AHEAD, BACK = DriveCommand(0.5, 0.0), DriveCommand(-0.3, 0.0)


def hosted_car():
    """The configuration of a car with simulated cameras and the firmware of the board."""
    simulation = SimulationTable(arena="curve", seed=3)
    return RunConfig(board_name="maxston8", link={"kind": "hosted-board"}, simulation=simulation)


class InOrder(FaultInjector):
    """Injects these faults and no others."""

    wanted: list[Fault]

    def begin(self, now):
        if self.wanted:
            self.queue = [self.wanted.pop(0)]
            super().begin(now)
            self.calm = 0.5


def inject(folder, *names, backwards=False):
    """Drive through these faults; returns the injector and the lowest speed."""
    by_name, lowest = {fault.name: fault for fault in FAULTS}, 0.0
    with open_car(hosted_car(), lambda line: None, go=True) as car:
        car.steer = (lambda wanted: BACK) if backwards else None
        injector = InOrder(car, 0, folder)
        injector.calm, injector.wanted = 0.1, [by_name[name] for name in names]
        simulation, start = car.drive.simulation, np.array(car.drive.simulation.pose)

        def to_the_start(step):
            """A car that drives backwards would come to a wall."""
            nonlocal lowest
            lowest = min(lowest, step.driven.speed)
            if backwards and injector.fault is None and np.hypot(*(simulation.pose - start)[:2]) > 0.5:
                simulation.place(*start)

        def end(step):
            if len(injector.rows) == len(names):
                car.ended.set()

        car.observers += [to_the_start, injector, end]
        car.run(120.0)
    assert [row["fault"] for row in injector.rows] == list(names)
    return injector, lowest


@pytest.mark.slow
def test_a_pulled_cable_stops_the_wheels_in_time(tmp_path):
    injector, _ = inject(tmp_path, "cable pulled")
    assert injector.rows[0]["failure"] is None
    assert 0 < injector.rows[0]["reaction_s"] <= 0.25


@pytest.mark.long
def test_every_fault_stops_the_wheels_in_time_and_nothing_else_does(tmp_path):
    injector, _ = inject(tmp_path / "recording.mcap", *(fault.name for fault in FAULTS))
    assert [row for row in injector.rows if row["failure"] is not None] == []
    assert injector.unexplained == []
    assert any("No space left on device" in line for line in injector.lines)
    assert not (tmp_path / "recording.mcap").exists()


@pytest.mark.parametrize(
    "names",
    [
        pytest.param(("no frames", "cable pulled", "loop stalls"), marks=pytest.mark.slow, id="three"),
        pytest.param([f.name for f in FAULTS if f.max_reaction_s is not None], marks=pytest.mark.long, id="all"),
    ],
)
def test_faults_stop_wheels_that_turn_backwards(tmp_path, names):
    injector, lowest = inject(tmp_path / "recording.mcap", *names, backwards=True)
    assert lowest == pytest.approx(-0.3, abs=0.02)
    assert [row for row in injector.rows if row["failure"] is not None] == []
    at_once = {row["fault"] for row in injector.rows if not row["reaction_s"] > 0}
    assert at_once <= {"board restarts"}  # the outputs of a board that restarts are dead
    assert injector.unexplained == []


@pytest.mark.slow
def test_cameras_that_freeze_before_a_change_of_direction_are_detected_before_the_car_reverses():
    """The car stands for half a second first, and must not reverse by frames from before that."""
    last, frozen = 0.0, None
    with open_car(hosted_car(), lambda line: None, go=True) as car:
        world = car.drive
        car.cameras = cameras = FaultyCameras(world, 0)

        def pulsed(pulse):
            nonlocal last
            if pulse.name == "motor" and pulse.width != 1500:
                last = pulse.time

        def freeze(step):
            nonlocal frozen
            if frozen is None and world.now() > 2.6 and step.driven.speed < 0.28:
                frozen = world.now()
                cameras.inject("both frozen")

        world.pulsed = pulsed
        car.steer = lambda wanted: STAND if world.now() < 1.5 else AHEAD if world.now() < 2.6 else BACK
        car.observers.append(freeze)
        car.run(4.0)
        assert "the same image for 4 frames" in car.safe.faults[-1].message
    assert 0.0 < last - frozen <= 0.25
