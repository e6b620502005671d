"""Messages of the drive link, and how they are put into frames; see docs/robot/protocol.md."""

from __future__ import annotations

import struct
from enum import IntEnum, IntFlag
from typing import Any, NamedTuple

from cobs import cobs
from fastcrc import crc16

from ndtorch_robot.ports import DriveCommand

VERSION = 1

HEADER = struct.Struct("<BBH")
CHECKS = struct.Struct("<HH")
COMMAND_BODY = struct.Struct("<hh")
WELCOME_BODY = struct.Struct("<H8s")
TELEMETRY_BODY = struct.Struct("<HBBhhHHHHHH")

WIDEST = 32.0
"""Largest number that fits into a command, m/s and 1/m."""

MAX_FRAME_BYTES = 31
"""Bytes of the longest frame without its zero: four of header, 22 of body, four of checks, one of stuffing."""


class Type(IntEnum):
    """Kinds of message; those from 0x80 on come from the board."""

    HELLO = 1
    HEARTBEAT = 2
    COMMAND = 3
    STOP = 4
    ARM = 5
    WELCOME = 0x81
    TELEMETRY = 0x82


BODY_SIZE = dict.fromkeys(Type, 0) | {
    Type.COMMAND: COMMAND_BODY.size,
    Type.WELCOME: WELCOME_BODY.size,
    Type.TELEMETRY: TELEMETRY_BODY.size,
}


class LinkFault(IntFlag):
    """Why the board has stopped the wheels; with `BATTERY` it drives on, but slower."""

    COMMAND = 1
    HEARTBEAT = 2
    VERSION = 4
    NOISE = 8
    BATTERY = 16
    WATCHDOG = 32
    STOPPED = 64
    EMPTY = 128


WORDS = {
    LinkFault.COMMAND: "no command for 0.2 s",
    LinkFault.HEARTBEAT: "no heartbeat for 0.15 s",
    LinkFault.VERSION: "a frame of another protocol version",
    LinkFault.NOISE: "too many refused frames",
    LinkFault.BATTERY: "battery low",
    LinkFault.EMPTY: "battery empty",
    LinkFault.WATCHDOG: "reset by its watchdog timer",
    LinkFault.STOPPED: "told to stop",
}


class LinkFrame(NamedTuple):
    """One message: protocol version, type, sequence number and body."""

    version: int
    type: int
    sequence: int
    body: bytes = b""


class Telemetry(NamedTuple):
    """What the board does."""

    echo: int  # sequence number of the last heartbeat received
    armed: bool  # whether it obeys commands
    faults: LinkFault  # why it does not
    applied: DriveCommand  # speed after the ramp, and curvature, that the pulses mean
    battery_v: float  # 0 when it is not measured
    motor_us: int
    front_us: int
    rear_us: int
    rejected: int  # frames refused since it was switched on
    uptime_s: int  # modulo 65536

    def words(self) -> list[str]:
        return [WORDS[fault] for fault in LinkFault if fault in self.faults]

    def values(self) -> dict[str, Any]:
        """All but the echo for JSON, units in the keys."""
        values = self._asdict()
        del values["echo"], values["applied"]
        speed, curvature = self.applied
        return values | {"faults": self.words(), "applied_m_per_s": speed, "applied_per_m": curvature}


def encode_frame(frame: LinkFrame) -> bytes:
    """A frame as it goes over the line, ending with a zero byte."""
    checked = HEADER.pack(frame.version, frame.type, frame.sequence & 0xFFFF) + frame.body
    return bytes(cobs.encode(checked + checksums(checked))) + b"\0"


def checksums(data: bytes) -> bytes:
    """Both checksums: CRC-16/CCITT-FALSE, which its library calls by its number at IBM, and CRC-16/DNP."""
    return CHECKS.pack(crc16.ibm_3740(data), crc16.dnp(data))


def decode_frame(coded: bytes) -> LinkFrame | None:
    """A frame without its zero byte; None when there is an error in it. The version is not looked at."""
    try:
        data = bytes(cobs.decode(coded))
    except cobs.DecodeError:
        return None
    checked, checks = data[: -CHECKS.size], data[-CHECKS.size :]
    if len(checked) < HEADER.size or checks != checksums(checked):
        return None
    version, kind, sequence = HEADER.unpack_from(checked)
    return LinkFrame(version, kind, sequence, checked[HEADER.size :])


def command_body(command: DriveCommand) -> bytes:
    """Speed in mm/s and curvature in 1/km, each a signed 16-bit number."""
    return COMMAND_BODY.pack(*(round(1000 * value) for value in command))


def read_telemetry(body: bytes) -> Telemetry:
    echo, armed, faults, speed, curvature, battery, *rest = TELEMETRY_BODY.unpack(body)
    applied = DriveCommand(speed / 1000, curvature / 1000)
    return Telemetry(echo, armed == 1, LinkFault(faults), applied, battery / 1000, *rest)


class Parser:
    """Collects bytes and gives out the frames among them that are without error."""

    def __init__(self) -> None:
        self.collected = b""
        self.refused = self.received = 0  # frames with an error in them, and bytes, so far
        self.other_version: int | None = None  # of the last good frame that was not of this version

    def feed(self, data: bytes) -> list[LinkFrame]:
        """The frames that end in these bytes."""
        self.received += len(data)
        frames = []
        *ended, rest = (self.collected + data).split(b"\0")
        # Of a frame that is too long only as many bytes are kept as say so.
        self.collected = rest[: MAX_FRAME_BYTES + 1]
        for coded in filter(None, ended):
            frame = decode_frame(coded) if len(coded) <= MAX_FRAME_BYTES else None
            if frame is not None and frame.version != VERSION:
                self.other_version = frame.version
            elif frame is not None and len(frame.body) == BODY_SIZE.get(frame.type):  # type: ignore[call-overload]
                frames.append(frame)
            else:
                self.refused += 1
        return frames
