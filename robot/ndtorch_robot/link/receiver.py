"""What arrives from the board: frames in their order, what the board applies, and how good the line is."""

from __future__ import annotations

import threading

from ndtorch_robot.link.line import LinkQuality
from ndtorch_robot.link.messages import BODY_SIZE, VERSION, Fault, Frame, Telemetry, decode_frame, read_telemetry
from ndtorch_robot.ports import STAND, DriveCommand

MAX_APPLIED = 30
"""Commands of the board that are kept for a loop that does not ask for them."""

MAX_FRAME_BYTES = 31
"""Bytes of the longest frame without its zero: four of header, 22 of body, four of checks, one of stuffing."""


class Parser:
    """Collects bytes and gives out the frames among them that are without error.

    Attributes:
        refused: frames with an error in them, so far.
        other_version: version of the last good frame that was not of this version, or None.
        received: bytes so far.
    """

    def __init__(self) -> None:
        self.collected = bytearray()
        self.overlong = False
        self.refused = 0
        self.received = 0
        self.other_version: int | None = None

    def feed(self, data: bytes) -> list[Frame]:
        """The frames that end in these bytes."""
        self.received += len(data)
        frames = []
        *ended, rest = data.split(b"\0")
        for part in ended:
            frame = self.end(part)
            if frame is not None:
                frames.append(frame)
        self.collect(rest)
        return frames

    def collect(self, part: bytes) -> None:
        """Bytes inside a frame; more than any frame has are not kept."""
        room = MAX_FRAME_BYTES - len(self.collected)
        self.overlong |= len(part) > room
        self.collected += part[:room]

    def end(self, part: bytes) -> Frame | None:
        self.collect(part)
        coded, overlong = bytes(self.collected), self.overlong
        self.collected.clear()
        self.overlong = False
        if not coded:
            return None
        frame = None if overlong else decode_frame(coded)
        if frame is None:
            self.refused += 1
            return None
        if frame.version != VERSION:
            self.other_version = frame.version
            return None
        if len(frame.body) != BODY_SIZE.get(frame.type, -1):  # type: ignore[call-overload]
            self.refused += 1
            return None
        return frame


class Receiver:
    """Takes frames from one thread; any thread may ask.

    Attributes:
        parser: finds the frames.
        quality: whether too many are refused.
        telemetry: the latest, None before any.
        last: when the last frame arrived, s.
        applied: by the latest telemetry since the board was greeted; a stop before any.
    """

    def __init__(self) -> None:
        self.parser, self.quality = Parser(), LinkQuality()
        self.telemetry: Telemetry | None = None
        self.last = 0.0
        self.applied = STAND
        self._sequence: int | None = None
        self._applied: list[DriveCommand] = []
        self._lock = threading.Lock()

    def begin(self) -> None:
        self._sequence = None

    def welcome(self, frame: Frame, now: float) -> None:
        self.last, self._sequence = now, frame.sequence
        self.applied = STAND  # what it applied before the line was lost is long over
        self.quality.count = 0

    def take(self, frame: Frame, now: float) -> Telemetry | None:
        """Telemetry in a frame; None for a repeated frame, or one that is older than the last."""
        if self._sequence is not None and not 0 < (frame.sequence - self._sequence) & 0xFFFF < 0x8000:
            self.parser.refused += 1
            return None
        self.telemetry = telemetry = read_telemetry(frame.body)
        self._sequence, self.last, self.applied = frame.sequence, now, telemetry.applied
        with self._lock:
            self._applied.append(telemetry.applied)
            del self._applied[:-MAX_APPLIED]
        return telemetry

    def other_version(self) -> str | None:
        """What to do about another version of the protocol, if one has arrived since the last call."""
        other, self.parser.other_version = self.parser.other_version, None
        if other is None:
            return None
        return (
            f"the board speaks version {other} of the protocol, this program {VERSION}: "
            "flash it with make -C robot/firmware flash"
        )

    def silence(self, baud: int) -> str:
        count = self.parser.received
        if count == 0:
            return "no answer from the board; is the firmware on it? (make -C robot/firmware flash)"
        return f"{count} bytes came but no valid frame; is {baud} baud right?"

    def bad(self, now: float) -> bool:
        return self.quality.bad(self.parser.refused, now)

    def driven(self) -> DriveCommand | None:
        """Mean of the speeds and curvatures applied since this was last asked, None for none."""
        with self._lock:
            applied, self._applied = self._applied, []
        if not applied:
            return None
        count = len(applied)
        return DriveCommand(sum(a.speed for a in applied) / count, sum(a.curvature for a in applied) / count)


def new_events(before: Telemetry | None, now: Telemetry) -> list[str]:
    """Faults that need no stop and were not there before, in words."""
    new = now.faults & ~(before.faults if before is not None else Fault(0))
    lines = {
        Fault.BATTERY: f"battery low, {now.battery:.1f} V",
        Fault.WATCHDOG: "the board was reset by its watchdog timer",
    }
    return [line for fault, line in lines.items() if fault in new]
