"""The drive link: frames over a serial line to the board that steers and drives; see docs/robot/protocol.md."""

from ndtorch_robot.link.messages import VERSION, Fault, Frame, Telemetry, Type
from ndtorch_robot.link.receiver import Parser
from ndtorch_robot.link.registry import MovesWorld, Opening, check_link, link, open_link
from ndtorch_robot.link.serial_drive import SerialDrive

__all__ = [
    "VERSION",
    "Fault",
    "Frame",
    "MovesWorld",
    "Opening",
    "Parser",
    "SerialDrive",
    "Telemetry",
    "Type",
    "check_link",
    "link",
    "open_link",
]
