"""The simulated car, its collisions, and the world that steps with its board."""

import itertools
import math
import re
import shutil

import numpy as np
import pytest

from ndtorch_robot.link.board import NAMES, Board, BoardSettings, Pulse
from ndtorch_robot.link.messages import LinkFrame, Parser, Type, encode_frame, read_telemetry
from ndtorch_robot.ports import DriveCommand
from ndtorch_robot.run import open_car
from ndtorch_robot.run_config import RunConfig, SimulationTable
from ndtorch_robot.safety import SafeDrive
from ndtorch_robot.sim.arenas import load_arena
from ndtorch_robot.sim.firmware_host import FIRMWARE, Electronics, FirmwareHost
from ndtorch_robot.sim.plan import Plan, ring
from ndtorch_robot.sim.simulation import CarLimits, SimulatedCar, Simulation


def drive(car, seconds, dt=1 / 120):
    for _ in range(round(seconds / dt)):
        car.advance(dt)


def test_returns_what_was_sent():
    car = SimulatedCar()
    assert car.send(DriveCommand(0.5, 1.0)) == (0.5, 1.0)
    assert car.send(DriveCommand(9.0, -9.0)) == (car.limits.speed, -car.limits.curvature)


def test_circle():
    car = SimulatedCar(CarLimits(acceleration=1e9, steering=1e9))
    car.send(DriveCommand(0.5, 2.0))
    drive(car, 2 * math.pi * 0.5 / 0.5, dt=2 * math.pi / 1000)
    assert (car.x, car.y) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert car.heading == pytest.approx(2 * math.pi)


def test_rate_limits():
    car = SimulatedCar()
    car.send(DriveCommand(0.5, 1.0))
    drive(car, 0.1)
    assert car.speed == pytest.approx(0.25)
    assert car.curvature == pytest.approx(0.8)
    drive(car, 0.2)
    assert (car.speed, car.curvature) == (0.5, 1.0)


def test_odometer():
    car = SimulatedCar()
    assert car.driven() == (0.0, 0.0)
    car.send(DriveCommand(0.5, 1.0))
    drive(car, 0.5)
    driven = car.driven()
    assert driven.speed * 0.5 == pytest.approx(0.2, abs=0.003)  # accelerating takes 0.2 s
    assert driven.speed * driven.curvature * 0.5 == pytest.approx(car.heading)
    drive(car, 0.5)
    assert car.driven() == (pytest.approx(0.5), pytest.approx(1.0))


def speak(board, numbers, now, *kinds):
    return board.run(now, b"".join(encode_frame(LinkFrame(1, kind, next(numbers), body)) for kind, body in kinds))


def test_the_board_in_python_is_that_of_the_firmware():
    """Its car is that of config.h; every answer and every pulse, of messages good and bad at random times."""
    defines = re.findall(r"#define (\w+) \(?(-?\d+)", (FIRMWARE / "config.h").read_text())
    numbers = {name.lower(): int(value) for name, value in defines}
    assert BoardSettings().model_dump() == {name: numbers[name] for name in BoardSettings.model_fields}
    if shutil.which("cc") is None:
        pytest.skip("needs a C compiler (cc)")
    rng, firmware, board = np.random.default_rng(5), FirmwareHost(), Board("maxston8")
    now, sequence, speed = 0.0, 0, 300
    kinds = [Type.HEARTBEAT, Type.COMMAND, Type.COMMAND, Type.HELLO, Type.STOP, Type.ARM, Type.WELCOME, 99]
    for _ in range(6000):
        now += float(rng.choice([0.003, 0.02, 0.03, 0.12], p=[0.3, 0.4, 0.29, 0.01]))
        data = b""
        for kind in rng.choice(kinds, int(rng.integers(4)), p=[0.34, 0.3, 0.3, 0.005, 0.005, 0.04, 0.005, 0.005]):
            sequence += int(rng.choice([1, 2, 0], p=[0.97, 0.02, 0.01]))
            speed = int(rng.integers(-1200, 1200)) if rng.random() < 0.03 else speed
            bodies = {Type.COMMAND: np.array([speed, rng.integers(-3000, 3000)], "<i2").tobytes()}
            version = 1 if rng.random() < 0.999 else 2
            frame = encode_frame(LinkFrame(version, int(kind), sequence & 0xFFFF, bodies.get(kind, b"")))
            data += frame if rng.random() < 0.995 else frame[:4] + frame[5:]
        assert (board.run(now, data), board.widths) == (firmware.run(now, data), tuple(firmware.widths))
    firmware.close()


def test_no_wheel_turns_backwards_while_the_board_says_that_they_stand():
    """A motor controller may take a brake that begins again for reverse."""
    board, electronics, numbers = Board("maxston8"), Electronics(), itertools.count(1)

    def say(now, *kinds):
        answers = speak(board, numbers, now, *kinds)
        for name, width in zip(NAMES, board.widths, strict=True):
            electronics.apply(Pulse(name, width, now))
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
                lowest = min(lowest, electronics.target(begin + 0.02 * n).speed)
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


def test_the_board_goes_on_while_frames_are_lost():
    """As with a car, whose cameras do not make its board wait."""
    simulation = SimulationTable(arena="curve", seed=3, disturbance="lost_ratio=0.8")
    config = RunConfig(board_name="maxston8", simulation=simulation)
    with open_car(config, lambda line: None, go=False) as car:
        world, pulses = car.drive, []
        world.pulsed = lambda pulse: pulses.append(pulse.time) if pulse.name == "motor" else None
        times = [world.read().time for _ in range(6)]
        trouble = car.drive.trouble()
    assert max(np.diff(times)) > 1.5 / 30
    assert len(pulses) >= (times[-1] - times[0]) / 0.02 - 1
    assert max(np.diff(pulses)) < 0.03
    assert trouble is None


def test_collision_is_counted_and_the_car_respawns():
    simulation = Simulation(load_arena("hallway", 0), 0)
    assert simulation.take_placed() == simulation.pose
    assert simulation.take_placed() is None
    simulation.place(16.5, 0.0, 0.0)
    simulation.take_placed()
    SafeDrive(simulation, simulation).send(DriveCommand(0.5, 0.0))
    simulation.wait_until(4.0)
    (hit,) = simulation.collisions
    assert hit.x == pytest.approx(18.0 - 0.25, abs=0.01)  # the front of the body at the end wall
    x, y, _ = simulation.take_placed()
    assert simulation.plan.clearance(np.array([[x, y]]))[0] > 0.5
    assert simulation.pose == (x, y, simulation.car.heading)
    assert simulation.car.speed == 0.0


def test_a_car_that_cannot_begin_is_put_elsewhere():
    plan, places = Plan("small", ring([(0, 0), (2, 0), (2, 2), (0, 2)])), []
    simulation = Simulation(plan, 0)
    fitting = {pose[:2] for pose in simulation.spawn_points.by_distance(1.0, 1.0)}
    for _ in fitting:
        places.append(simulation.pose[:2])
        simulation.respawn()
    assert len(fitting) > 4
    assert set(places) == fitting  # each once
    assert simulation.pose[:2] in fitting  # and then again one of them
    simulation = Simulation(plan, 0)
    x, y, _ = simulation.pose
    simulation.car.x += 0.6  # it comes away
    simulation.respawn()
    simulation.car.x = x
    simulation.respawn()
    assert simulation.pose[:2] == (x, y)


def test_noisy_odometry():
    exact, noisy = (Simulation(load_arena("hallway", 0), 0, odometry=kind) for kind in ("true", "noisy"))
    for simulation in (exact, noisy):
        SafeDrive(simulation, simulation).send(DriveCommand(0.5, 0.0))
        simulation.wait_until(1.0)
    a, b = exact.driven(), noisy.driven()
    assert b.speed == pytest.approx(1.01 * a.speed)
    assert b.speed * b.curvature == pytest.approx(math.radians(0.05))
