"""The gamepad: events as the kernel writes them, from a pipe."""

import os
import struct
from types import SimpleNamespace

import pytest

from ndtorch.errors import InputError
from ndtorch_robot.bridges import Opening, Wish
from ndtorch_robot.bridges.gamepad import Gamepad, GamepadSettings
from ndtorch_robot.ports import STAND


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
