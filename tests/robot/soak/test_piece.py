"""A short soak: faults stop the wheels in time, and what is no fault does not."""

import shutil

import numpy as np
import pytest

from ndtorch_robot.link.messages import Frame, Type, encode_frame, read_telemetry
from ndtorch_robot.link.parser import Parser
from ndtorch_robot.ports import STAND, DriveCommand
from ndtorch_robot.run import open_car
from ndtorch_robot.run_config import RunConfig, SimulationTable
from ndtorch_robot.sim.hosted_board import HostedBoard
from ndtorch_robot.sim.pulse_world import Electronics
from ndtorch_robot.sim.put_back import PutBack
from ndtorch_robot.soak.eyes import FailingCameras
from ndtorch_robot.soak.faults import FAULTS, TOLD, Fault
from ndtorch_robot.soak.piece import go_elsewhere
from ndtorch_robot.soak.trial import Trials
from tests.robot.support.gl_needed import needs_gl

needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler (cc)")


@needs_compiler
def test_the_board_obeys_and_stands_when_it_is_not_spoken_to():
    board, sequence = HostedBoard(), 0

    def say(now, *kinds):
        nonlocal sequence
        data = b""
        for kind, body in kinds:
            sequence += 1
            data += encode_frame(Frame(1, kind, sequence, body))
        return board.run(now, data)

    answers, _ = say(0.002, (Type.HELLO, b""))
    assert [frame.type for frame in Parser().feed(answers)] == [Type.WELCOME]
    say(0.004, (Type.HEARTBEAT, b""), (Type.ARM, b""))
    command = np.array([500, 0], "<i2").tobytes()
    widths = []
    for n in range(1, 40):
        _, pulses = say(0.004 + 0.02 * n, *([(Type.HEARTBEAT, b""), (Type.COMMAND, command)] if n < 20 else []))
        widths += [(pulse.time, pulse.width) for pulse in pulses if pulse.name == "motor"]
    assert len(widths) == 39
    last = max(when for when, width in widths if width != 1500)
    assert max(width for _, width in widths) == 1630  # 0.5 m/s
    assert 0.384 + 0.13 <= last <= 0.384 + 0.17  # 0.15 s after the last heartbeat, a pulse earlier or later
    board.close()
    board.close()


@needs_compiler
def test_no_wheel_turns_backwards_while_the_board_says_that_they_stand():
    """A motor controller may take a brake that begins again for reverse."""
    board, electronics, sequence = HostedBoard(), Electronics(), 0

    def say(now, *kinds):
        nonlocal sequence
        data = b""
        for kind, body in kinds:
            sequence += 1
            data += encode_frame(Frame(1, kind, sequence, body))
        answers, pulses = board.run(now, data)
        for pulse in pulses:
            electronics.take(pulse)
        told = [read_telemetry(f.body).applied.speed for f in Parser().feed(answers) if f.type == Type.TELEMETRY]
        return told[-1] if told else None

    def drive(begin, end, speed):
        """Lowest speed of the wheels while the board says 0, and what it says at last."""
        said, lowest = 0.0, 0.0
        command = np.array([speed, 0], "<i2").tobytes()
        for n in range(round((end - begin) / 0.02)):
            heard = say(begin + 0.02 * n, (Type.HEARTBEAT, b""), (Type.COMMAND, command))
            said = said if heard is None else heard
            if said == 0:
                lowest = min(lowest, electronics.drives(begin + 0.02 * n).speed)
        return lowest, said

    say(0.002, (Type.HELLO, b""))
    say(0.004, (Type.HEARTBEAT, b""), (Type.ARM, b""))
    assert drive(0.02, 1.0, 500) == (0.0, 0.5)
    assert drive(1.0, 1.4, -300) == (0.0, 0.0)  # in the middle of the brake
    say(1.7)
    say(1.704, (Type.HEARTBEAT, b""), (Type.ARM, b""))
    lowest, said = drive(1.72, 2.6, -300)
    assert said == -0.3
    assert -0.03 <= lowest < 0
    board.close()


@needs_gl
@needs_compiler
def test_the_board_goes_on_while_frames_are_lost():
    """As with a car, whose cameras do not make its board wait."""
    simulation = SimulationTable(arena="curve", seed=3, stress="drop=0.8")
    config = RunConfig(robot="maxston8", link={"kind": "hosted-board"}, simulation=simulation)
    with open_car(config, lambda line: None, go=False) as car:
        world, pulses = car.drive.world, []
        world.pulsed = lambda pulse: pulses.append(pulse.time) if pulse.name == "motor" else None
        times = [world.read().time for _ in range(6)]
        trouble = car.drive.trouble()
    assert max(np.diff(times)) > 1.5 / 30
    assert len(pulses) >= (times[-1] - times[0]) / 0.02 - 1
    assert max(np.diff(pulses)) < 0.03
    assert trouble == "not yet told to drive"


class OneAfterTheOther(Trials):
    """These faults and no others."""

    wanted: list[Fault]

    def begin(self, now):
        if self.wanted:
            self.waiting = [self.wanted.pop(0)]
            super().begin(now)
            self.calm = 0.5


def soak(folder, *names, steer=None, observe=None):
    """Drive through these faults; `steer` changes what the navigator wants."""
    by_name = {fault.name: fault for fault in FAULTS}
    simulation = SimulationTable(arena="curve", seed=3)
    config = RunConfig(robot="maxston8", link={"kind": "hosted-board"}, simulation=simulation)
    lines = []
    with open_car(config, lines.append, go=True) as car:
        cameras = FailingCameras(car.drive.world, 0)
        car.cameras, car.steer = cameras, steer
        trials = OneAfterTheOther(car, car.drive.world, cameras, 0, folder)
        trials.calm = 0.1
        trials.wanted = [by_name[name] for name in names]
        simulation, start = car.drive.world.simulation, np.array(car.drive.world.simulation.pose)
        put_back = PutBack(simulation, car.pilot)

        def from_the_start(step):
            """Whoever goes back comes to a wall sooner or later."""
            if observe is not None:
                observe(step)
                if trials.fault is None and np.hypot(*(simulation.pose - start)[:2]) > 0.5:
                    simulation.place(*start)

        car.observers += [
            put_back,
            from_the_start,
            trials,
            go_elsewhere(trials, put_back),
            lambda step: car.ended.set() if len(trials.rows) == len(names) else None,
        ]
        car.run(120.0)
    assert [row["fault"] for row in trials.rows] == list(names)
    return trials


@needs_gl
@needs_compiler
@pytest.mark.slow
def test_a_pulled_cable_stops_the_wheels_in_time(tmp_path):
    trials = soak(tmp_path, "cable pulled")
    assert trials.rows[0]["bad"] is None
    assert 0 < trials.rows[0]["turned"] <= 0.25


@needs_gl
@needs_compiler
@pytest.mark.long
def test_every_fault_stops_the_wheels_in_time_and_nothing_else_does(tmp_path):
    trials = soak(tmp_path / "recording", *(fault.name for fault in FAULTS))
    assert [row for row in trials.rows if row["bad"] is not None] == []
    assert trials.unexplained == []
    assert any("No space left on device" in line for line in trials.lines)
    assert not (tmp_path / "recording").exists()


AHEAD = DriveCommand(0.5, 0.0)

BACK = DriveCommand(-0.3, 0.0)
"""What the controller asks for that goes back from a wall."""


def soak_backwards(folder, *names):
    """Drive backwards through these faults; returns the trials and the lowest speed."""
    lowest = 0.0

    def watch(step):
        nonlocal lowest
        lowest = min(lowest, step.driven.speed)

    trials = soak(folder, *names, steer=lambda wanted: BACK, observe=watch)
    return trials, lowest


@needs_gl
@needs_compiler
@pytest.mark.slow
def test_faults_of_cameras_link_and_loop_stop_wheels_that_turn_backwards(tmp_path):
    trials, lowest = soak_backwards(tmp_path, "no frames", "cable pulled", "loop stalls")
    assert lowest == pytest.approx(-0.3, abs=0.02)
    for row in trials.rows:
        assert row["bad"] is None, row
        assert 0 < row["turned"] <= 0.25


@needs_gl
@needs_compiler
@pytest.mark.long
def test_every_fault_stops_wheels_that_turn_backwards(tmp_path):
    names = [fault.name for fault in FAULTS if fault.within is not None and fault.within < TOLD]
    trials, lowest = soak_backwards(tmp_path / "recording", *names)
    assert lowest == pytest.approx(-0.3, abs=0.02)
    assert [row for row in trials.rows if row["bad"] is not None] == []
    assert trials.unexplained == []


@needs_gl
@needs_compiler
@pytest.mark.slow
def test_cameras_that_freeze_before_the_change_of_gear_are_told_before_it_goes_back():
    """It stands for half a second then, and must not go back by pictures from before."""
    simulation = SimulationTable(arena="curve", seed=3)
    config = RunConfig(robot="maxston8", link={"kind": "hosted-board"}, simulation=simulation)
    last, frozen = 0.0, None
    with open_car(config, lambda line: None, go=True) as car:
        world = car.drive.world
        car.cameras = cameras = FailingCameras(world, 0)

        def pulsed(pulse):
            nonlocal last
            if pulse.name == "motor" and pulse.width != 1500:
                last = pulse.time

        def freeze(step):
            nonlocal frozen
            if frozen is None and world.now() > 2.6 and step.driven.speed < 0.28:
                frozen = world.now()
                cameras.fail("both frozen")

        world.pulsed = pulsed
        car.steer = lambda wanted: STAND if world.now() < 1.5 else AHEAD if world.now() < 2.6 else BACK
        car.observers.append(freeze)
        car.run(4.0)
        assert "the same picture for 4 frames" in car.safe.faults[-1].why
    assert 0.1 < last - frozen <= 0.25
