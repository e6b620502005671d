"""Bridges beside the loop, and the gamepad."""

import os
import struct
import threading
from types import SimpleNamespace

import pytest

from ndtorch.errors import InputError
from ndtorch.utils.toml import Strict, check
from ndtorch_robot.bridges import BRIDGES, Bridge, BridgeThread, Opening, Wish, bridge, open_bridges
from ndtorch_robot.bridges import registry as registry_module
from ndtorch_robot.bridges.gamepad import Gamepad, GamepadSettings
from ndtorch_robot.ports import STAND, DriveCommand
from ndtorch_robot.run_config import RunConfig
from tests.robot.support.autopilot import wait_for
from tests.robot.support.cars import RIG, FilmCar, bare_loop, moving_world


class Held(Bridge):
    """Takes a step, and the next one when it is let go."""

    def __init__(self):
        self.steps, self.go, self.closed, self.polls = [], threading.Event(), 0, 0

    def publish(self, step):
        self.steps.append(step)
        self.go.wait(20)

    def poll(self):
        self.polls += 1

    def close(self):
        self.closed += 1


class Broken(Held):
    def publish(self, step):
        raise RuntimeError("no route\nto host")


def test_a_slow_bridge_gets_the_newest_step_and_the_loop_goes_on():
    held, lines = Held(), []
    thread = BridgeThread("held", held, lines.append)
    thread(0)
    assert wait_for(lambda: held.steps == [0])
    for number in range(1, 50):
        thread(number)
    held.go.set()
    assert wait_for(lambda: len(held.steps) == 2)
    assert held.steps == [0, 49]
    assert wait_for(lambda: held.polls > 2)
    thread.close()
    assert (thread.taken, thread.skipped, held.closed, lines) == (2, 48, 1, [])


@pytest.mark.parametrize("part", ["publish", "poll"])
def test_a_bridge_that_fails_ends_with_one_line_and_the_car_drives_on(part):
    broken, lines, steps = Held(), [], []
    setattr(broken, part, Broken.publish.__get__(broken) if part == "publish" else lambda: 1 / 0)
    broken.go.set()
    car = bare_loop(FilmCar(moving_world(40, RIG)), RIG, [steps.append], controller="published")
    thread = BridgeThread("broken", broken, lines.append)
    car.observers.append(thread)
    assert car.run(38.5 / 30) == 40
    assert wait_for(lambda: broken.closed == 1)
    reason = "RuntimeError: no route to host" if part == "publish" else "ZeroDivisionError: division by zero"
    assert lines == [f"the bridge broken has ended: {reason}"]
    assert steps[-1].sent.speed > 0
    assert car.safe.faults[1:] == []  # the first is that nobody had started it
    thread.close()


def test_a_bridge_that_hangs_is_left_behind(monkeypatch):
    monkeypatch.setattr(registry_module, "CLOSE_TIMEOUT", 0.05)
    held, lines = Held(), []
    thread = BridgeThread("held", held, lines.append)
    thread(0)
    assert wait_for(lambda: held.steps)
    thread.close()
    assert lines == ["the bridge held hangs: left behind"]
    held.go.set()
    thread.thread.join(20)


def test_an_old_wish_is_a_stand():
    time = SimpleNamespace(now=5.0)
    wish = Wish(0.5, lambda: time.now)
    assert wish() == STAND
    wish.put(DriveCommand(0.3, 1.0))
    time.now = 5.5
    assert wish() == (0.3, 1.0)
    time.now = 5.51
    assert wish() == STAND


class PaperSettings(Strict):
    pages: int = 3


def test_another_bridge_is_a_class_a_table_and_a_function():
    made = []

    @bridge("paper", PaperSettings)
    def open_paper(settings, opening):
        made.append((settings.pages, opening.robot, Held()))
        return made[-1][-1]

    try:
        opening = Opening("x", print, SimpleNamespace())
        with open_bridges({"paper": {"pages": 7}}, opening) as threads:
            assert [thread.name for thread in threads] == ["paper"]
        assert made[0][:2] == (7, "x")
        assert made[0][-1].closed == 1
        with pytest.raises(InputError, match="there is a bridge of the kind 'paper' already"):
            bridge("paper", PaperSettings)(open_paper)
    finally:
        del BRIDGES.known["paper"]


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"mavlnk": {}}, "no bridge of the kind 'mavlnk', known are .*mavlink.*did you mean mavlink"),
        ({"mavlink": {"device": "x", "bauds": 1}}, "bridges.mavlink: unknown key 'bauds'; did you mean baud?"),
        ({"mavlink": {"system_id": 300}}, "system_id = 300"),
    ],
)
def test_bad_tables(tables, message):
    car = {"robot": "x", "simulation": {}, "bridges": tables}
    with pytest.raises(InputError, match=message) as error:
        check(car, RunConfig, "car.toml")
    assert "\n" not in str(error.value)


@pytest.fixture
def pad(tmp_path):
    os.mkfifo(tmp_path / "js0")
    wish = Wish(timeout=60)
    made = Gamepad(GamepadSettings(device=str(tmp_path / "js0")), Opening("x", print, SimpleNamespace(), wish=wish))
    with (tmp_path / "js0").open("wb", buffering=0) as events:
        yield made, wish, lambda *event: events.write(struct.pack("<IhBB", 0, *event))
    made.close()


def test_a_stick_that_is_held_is_a_wish_at_every_step(pad):
    """Forward and left are negative; buttons (type 1) and the state at the start (0x80) are told apart."""
    made, wish, event = pad
    made.poll()
    made.publish(None)
    assert wish() == STAND
    event(-32767, 2 | 0x80, 1)
    event(-16384, 2, 3)
    event(1, 1, 1)
    made.poll()
    for _ in range(2):
        wish.newest = (STAND, 0.0)
        made.publish(None)
        assert wish() == pytest.approx((0.5, 1.0), abs=1e-3)


def test_a_gamepad_that_is_pulled_out_is_an_error(tmp_path):
    (tmp_path / "js0").touch()
    made = Gamepad(GamepadSettings(device=str(tmp_path / "js0")), Opening("x", print, SimpleNamespace()))
    with pytest.raises(OSError, match="js0 is gone"):
        made.poll()
    made.close()


def test_no_gamepad():
    with pytest.raises(InputError, match="is the gamepad plugged in"):
        Gamepad(GamepadSettings(device="/dev/input/none"), Opening("x", print, SimpleNamespace()))
