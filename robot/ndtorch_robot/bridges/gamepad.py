"""A gamepad of Linux as a source of commands: for a guard, whose stops it feels."""

from __future__ import annotations

import os
import struct
from typing import Annotated

from pydantic import Field

from ndtorch.errors import InputError
from ndtorch.utils.toml import Strict
from ndtorch_robot.bridges.registry import Bridge, Opening, bridge
from ndtorch_robot.ports import DriveCommand, Step

EVENT = struct.Struct("<IhBB")
"""`struct js_event` of linux/joystick.h: time in ms, value, type, number."""

AXIS, INITIAL, FULL = 0x02, 0x80, 32767.0


class GamepadSettings(Strict):
    """`[bridges.gamepad]`.

    Args:
        device: of the joystick.
        speed_axis, turn_axis: numbers of the axes; forward and left are negative, as the kernel has them.
        max_speed_m_per_s, max_curvature_per_m: at full deflection.
    """

    device: str = "/dev/input/js0"
    speed_axis: Annotated[int, Field(ge=0, le=63)] = 1
    turn_axis: Annotated[int, Field(ge=0, le=63)] = 3
    max_speed_m_per_s: Annotated[float, Field(gt=0, le=5)] = 0.5
    max_curvature_per_m: Annotated[float, Field(gt=0, le=10)] = 2.0


class Gamepad(Bridge):
    """Says nothing, and wishes what its sticks say, for as long as it is plugged in.

    Raises:
        InputError: no such device.
    """

    def __init__(self, settings: GamepadSettings, opening: Opening) -> None:
        self.settings, self.wish, self.axes = settings, opening.wish, dict[int, float]()
        try:
            self.file = os.open(settings.device, os.O_RDONLY | os.O_NONBLOCK)
        except OSError as error:
            raise InputError(f"{settings.device}: {error.strerror}; is the gamepad plugged in?") from None

    def publish(self, step: Step) -> None:
        """A stick that is held sends no events: its wish is as new as the step."""
        if self.wish is not None:
            speed, turn = (-self.axes.get(axis, 0.0) for axis in (self.settings.speed_axis, self.settings.turn_axis))
            most = self.settings
            self.wish.put(DriveCommand(speed * most.max_speed_m_per_s, turn * most.max_curvature_per_m))

    def poll(self) -> None:
        try:
            data = os.read(self.file, 64 * EVENT.size)
        except BlockingIOError:
            return
        if not data:
            raise OSError(f"{self.settings.device} is gone")
        for _, value, kind, number in EVENT.iter_unpack(data[: len(data) // EVENT.size * EVENT.size]):
            if kind & ~INITIAL == AXIS:
                self.axes[number] = value / FULL

    def close(self) -> None:
        os.close(self.file)


@bridge("gamepad", GamepadSettings)
def open_gamepad(settings: GamepadSettings, opening: Opening) -> Gamepad:
    return Gamepad(settings, opening)
