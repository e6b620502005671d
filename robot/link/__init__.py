"""The drive link: frames over a serial line to the board that steers and drives; see PROTOCOL.md."""

from robot.link.messages import VERSION, Fault, Frame, Telemetry, Type
from robot.link.parser import Parser
from robot.link.serial_drive import SerialDrive

__all__ = ["VERSION", "Fault", "Frame", "Parser", "SerialDrive", "Telemetry", "Type"]
