"""A whole car on the bench: simulated cameras that can fail, the real loop, link and firmware, all pulses timed."""

import os
import threading
import time
from collections import deque
from contextlib import contextmanager, suppress

import torch

import tests.robot.support.avr_board  # noqa: F401 (its link)
from ndtorch.errors import InputError
from ndtorch_robot.camera_monitor import MOVING_M_PER_S
from ndtorch_robot.link.board import BoardSettings
from ndtorch_robot.run import open_car, real_time_priority
from ndtorch_robot.run_config import RunConfig, SimulationTable

NEUTRAL, SLACK, STEERING_SLACK = 1500.0, 2.0, 12.0
FASTEST = 0.5
"""What the navigator asks for at most, m/s, and what a motor pulse may therefore mean."""
LIMIT = 0.25


class FailingCameras:
    """Wraps a camera pair; `fault` names what goes wrong from now on. Silence is as `StereoCameras` has it."""

    def __init__(self, inner):
        self.inner, self.simulation = inner, inner.simulation
        self.fault, self.began = None, 0.0
        self.kept = deque(maxlen=30)
        self.given = 0.0

    def fail(self, fault):
        self.fault, self.began = fault, time.monotonic()
        return self.began

    def read(self):
        fault = self.fault
        if fault == "unplugged":
            raise InputError("the left camera gives no frames")
        if fault == "hang":
            time.sleep(0.6)
        frames = self.inner.read()
        if fault == "both frozen":
            frames = self.kept[-1]._replace(time=frames.time)
        elif fault == "black":
            black = type(frames.right)(*(torch.zeros_like(part) for part in frames.right))
            frames = frames._replace(right=black)
        self.kept.append(frames)
        if fault == "late":
            old = [kept for kept in self.kept if kept.time <= time.monotonic() - 0.2]
            if not old or old[-1].time <= self.given:
                time.sleep(0.1)
                raise InputError("no pair of frames for 0.1 s")
            frames = old[-1]
        self.given = frames.time
        return frames

    def close(self):
        self.inner.close()


class Bench:
    """The running car."""

    def __init__(self, car, lines):
        self.car, self.lines, self.cameras = car, lines, car.cameras
        self.board = car.cameras.inner.board

    def moving(self):
        return [p.time for p in self.board.pulses if p.name == "motor" and abs(p.width - NEUTRAL) > SLACK]

    def too_fast(self):
        """Motor pulses beyond what the navigator can have asked for, either way; a brake is the shortest."""
        s = BoardSettings()
        widest = s.motor_neutral_us + s.motor_dead_band_us + FASTEST * s.motor_us_per_m_s + SLACK
        motor = [p.width for p in self.board.pulses if p.name == "motor"]
        return [width for width in motor if not s.motor_brake_us - SLACK <= width <= widest]

    def wait_to_move(self, seconds=10.0):
        """Until it has driven for a while, at a speed at which pictures must change.

        Told to resume again every two seconds when the link broke: it may break on a machine that stalls, and waiting
        is no claim. Other reasons to stand must pass by themselves.
        """
        began = told = time.monotonic()
        while time.monotonic() < began + seconds:
            if time.monotonic() > told + 2.0 and self.car.drive.trouble() is not None:
                told = time.monotonic()
                self.car.safe.resume()
            recent = [p for p in self.board.pulses[-75:] if p.name == "motor"]
            moves = len(recent) > 20 and all(p.time > began and p.width > NEUTRAL + SLACK for p in recent[-15:])
            if moves and self.car.safe.sent.speed > 2 * MOVING_M_PER_S:
                return
            time.sleep(0.05)
        raise AssertionError(f"does not drive: {self.lines}")

    def watch(self, fault, seconds=0.7):
        """Seconds from the fault to the last pulse that moved a wheel, after which all are neutral."""
        time.sleep(max(0.0, fault + seconds - time.monotonic()))
        last = [p for p in self.board.pulses[-200:] if p.time > fault + seconds - 0.3]
        # The rear pulse is ended by an interrupt, which others delay by a few microseconds.
        moved = [p for p in last if abs(p.width - NEUTRAL) > (SLACK if p.name == "motor" else STEERING_SLACK)]
        assert not moved, (self.lines, moved)
        return max([when for when in self.moving() if when > fault], default=fault) - fault

    def steps_go_on(self):
        before = self.car.steps
        time.sleep(0.3)
        return self.car.steps > before


@contextmanager
def bench(**changes):
    """Opens and runs it in a thread, since that is where the pictures are drawn."""
    world = SimulationTable(arena="curve", seed=11)
    config = RunConfig(board_name="maxston8", link={"kind": "avr-board"}, simulation=world, **changes)
    lines, made, ready, failed = [], [], threading.Event(), []

    def work():
        torch.set_num_threads(1)
        real_time_priority(lines.append)
        try:
            with open_car(config, lines.append, go=True) as car:
                car.cameras = FailingCameras(car.cameras)
                made.append(car)
                car.runner.navigator.warm_up()  # kernels that nobody has compiled yet take most of a minute
                ready.set()
                car.run()
        except BaseException as error:  # told to the test below
            failed.append(error)
        ready.set()

    # This thread too: the loop waits for it whenever it has the interpreter, however unimportant it is.
    real_time_priority(lines.append)
    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    assert ready.wait(180)
    try:
        assert not failed, failed
        result = Bench(made[0], lines)
        result.wait_to_move()
        yield result
        assert not result.too_fast()
    finally:
        for car in made:
            car.ended.set()
        thread.join(10)
        with suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        assert not thread.is_alive(), "the loop hangs"
    assert not failed, failed


class Garage:
    """One running car for many faults; after a failed attempt a fresh one."""

    def __init__(self):
        self.context = self.car = None

    def get(self):
        if self.car is None:
            self.context = bench()
            self.car = self.context.__enter__()
        del self.car.lines[:]
        return self.car

    def close(self):
        context, self.context, self.car = self.context, None, None
        if context is not None:
            context.__exit__(None, None, None)

    def in_time(self, try_it):
        """What `try_it` returns is within the limit. After a failure the next one gets a fresh car."""
        try:
            took = try_it(self.get())
            print(f"stood after {1e3 * took:.0f} ms")
            assert took <= LIMIT, self.car.car.safe.faults[-3:]
        except BaseException:
            self.close()
            raise


def said(lines, *words):
    """A line of the log holds all the words."""
    return any(all(word in line for word in words) for line in lines)
